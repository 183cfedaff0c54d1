"""A USB stick formatted with exFAT, as sticks of 64 GB and more are sold.

mkfs.exfat formats it; nothing in Debian puts files onto such an image without mounting it, so the entries of the root
directory are written and read here (Microsoft's exFAT file system specification, sections 3 and 6 to 7).
"""
import struct
import subprocess

ENTRY = 32
FILE, STREAM, NAME = 0x85, 0xC0, 0xC1
NAME_UNITS = 15  # UTF-16 units in an entry


class Volume:
    def __init__(self, image):
        with open(image, "rb") as file:
            boot = file.read(512)
            self.heap, _, root = struct.unpack_from("<III", boot, 88)
            sector, per_cluster = 1 << boot[108], 1 << boot[109]
            self.heap, self.cluster = self.heap * sector, sector * per_cluster
            self.root = self.at(root)
            file.seek(self.root)
            self.entries = file.read(self.cluster)

    def at(self, cluster):
        return self.heap + (cluster - 2) * self.cluster


def checksum(data, skip=()):
    value = 0
    for k, byte in enumerate(data):
        if k not in skip:
            value = ((value << 15 | value >> 1) + byte) & 0xFFFF
    return value


def entries_of(name):
    """Of an empty file."""
    units = name.encode("utf-16-le")
    parts = [units[k:k + 2 * NAME_UNITS] for k in range(0, len(units), 2 * NAME_UNITS)]
    entries = bytearray(struct.pack("<BBHHH24x", FILE, 1 + len(parts), 0, 0x20, 0))
    entries += struct.pack("<BBBBH26x", STREAM, 1, 0, len(name), checksum(name.upper().encode("utf-16-le")))
    for part in parts:
        entries += struct.pack("<BB30s", NAME, 0, part)
    struct.pack_into("<H", entries, 2, checksum(entries, skip=(2, 3)))
    return entries


def make_exfat_stick(image, names, size_mib=64):
    """With empty files in its root, a cluster of one megabyte."""
    with open(image, "wb") as file:
        file.truncate(size_mib << 20)
    subprocess.run(["/usr/sbin/mkfs.exfat", "-c", "1M", image], check=True, capture_output=True)
    volume = Volume(image)
    free = next(k for k in range(0, volume.cluster, ENTRY) if volume.entries[k] == 0)
    entries = b"".join(map(entries_of, names))
    if free + len(entries) > volume.cluster:
        raise ValueError(f"{len(names)} files are too many for one cluster")
    with open(image, "r+b") as file:
        file.seek(volume.root + free)
        file.write(entries)


def files_on_exfat(image):
    """Of the root: name -> bytes. Only of files that lie in one piece, as they do on an empty stick."""
    volume, found = Volume(image), {}
    with open(image, "rb") as file:
        for k in range(0, volume.cluster, ENTRY):
            if volume.entries[k] != FILE:
                continue
            first, last = k + ENTRY, k + ENTRY * volume.entries[k + 1]
            _, flags, _, units = struct.unpack_from("<BBBB", volume.entries, first)
            cluster, size = struct.unpack_from("<IQ", volume.entries, first + 20)
            text = b"".join(volume.entries[j + 2:j + ENTRY] for j in range(first + ENTRY, last + 1, ENTRY))
            if size and not flags & 2:
                raise ValueError(f"{text.decode('utf-16-le')} is in pieces")
            file.seek(volume.at(cluster) if size else 0)
            found[text.decode("utf-16-le")[:units]] = file.read(size)
    return found
