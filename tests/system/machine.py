"""An emulated board (QEMU, 64-bit ARM, UEFI) that starts a card's image, with hands: power, sticks, settings, a shell.

The image is the one that users get. The shell comes from outside: systemd takes further units from the owner of a
virtual machine (SMBIOS strings), and this one adds a root shell on a virtual serial port.
"""
import base64
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts" / "lib"))
from firmware_process import free_port  # noqa: E402

FIRMWARE = "/usr/share/AAVMF/AAVMF_CODE.fd"
READY = 1  # bit of register 0
TEST_CONSTANT = 0x1234  # register 39
NOMINAL_START_S = 45  # power to the first answer: a start that takes longer stretches all time limits
TWO_CORES = ("-smp", "2", "-accel", "tcg,thread=multi")
COUNTING = ("-smp", "1", "-accel", "tcg,thread=single", "-icount", "shift=0,sleep=off")  # a nanosecond for each instruction
# The shell outlives what it ran when memory was out: systemd would stop the whole unit, and lose what the shell is told next.
SHELL_UNIT = """[Unit]
DefaultDependencies=no
[Service]
ExecStart=/bin/sh
StandardInput=tty-force
StandardOutput=inherit
StandardError=inherit
TTYPath=/dev/hvc0
Restart=always
OOMPolicy=continue
"""
SHELL_WANT = "[Unit]\nWants=test-shell.service\n"


def credential(name, text):
    return f"io.systemd.credential.binary:{name}=" + base64.b64encode(text.encode()).decode()


def read_registers(port, count=48, timeout=3, address=0):
    """The measurement block, or None when nobody answers. One connection per call, as nothing is kept over a power cut."""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout) as client:
            client.settimeout(timeout)
            client.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 4, address, count))
            answer = b""
            while len(answer) < 9 + 2 * count:
                part = client.recv(512)
                if not part:
                    return None
                answer += part
        return struct.unpack(f">{count}H", answer[9:9 + 2 * count])
    except OSError:
        return None


class Machine:
    """A board with one card. `start` and `cut_power` may be called again and again."""

    def __init__(self, card, folder, card_format="raw", extra=(), cpu=TWO_CORES):
        self.card, self.format, self.extra = Path(card), card_format, [*cpu, *extra]
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.process = None
        self.write_log = None  # a file: every write to a raw card is kept there, too (QEMU's blklogwrites)
        self.slowness = 1.0  # of this workstation just now, by the last start: what time limits are multiplied with
        for name, text in (("unit", credential("systemd.extra-unit.test-shell.service", SHELL_UNIT)),
                           ("want", credential("systemd.unit-dropin.multi-user.target", SHELL_WANT))):
            (self.folder / name).write_text(text)

    def chardev(self, name):
        return f"socket,id={name},path={self.folder}/{name}.sock,server=on,wait=off"

    def camera_port(self, name="camera"):
        """For start(): a USB port for a UsbCamera on NAME.sock in our folder."""
        return ["-chardev", self.chardev(name), "-device", f"usb-redir,chardev={name}"]

    def card_drive(self):
        if not self.write_log:
            return f"if=none,id=card,file={self.card},format={self.format}"
        return (f"if=none,id=card,driver=blklogwrites,file.driver=raw,file.file.driver=file,file.file.filename={self.card},"
                f"log.driver=raw,log.file.driver=file,log.file.filename={self.write_log}")

    def command(self, *more):
        # With ACPI the machine has no GPIO lines, so it describes itself by device tree.
        return ["qemu-system-aarch64", "-M", "virt,gic-version=3,acpi=off", "-cpu", "cortex-a72",
                "-m", "768", "-nographic", "-nodefaults",
                "-drive", f"if=pflash,format=raw,unit=0,readonly=on,file={FIRMWARE}",
                "-drive", self.card_drive(),
                "-device", "virtio-blk-pci,drive=card,bootindex=0",
                "-netdev", f"user,id=net,restrict=on,hostfwd=tcp:127.0.0.1:{self.port}-:502,"
                f"hostfwd=tcp:127.0.0.1:{self.page_port}-:80",
                "-device", "virtio-net-pci,netdev=net,romfile=",
                "-device", "virtio-serial-pci",
                "-chardev", self.chardev("shell"), "-device", "virtconsole,chardev=shell",
                "-device", "i6300esb", "-device", "virtio-rng-pci", "-device", "qemu-xhci,id=usb",
                "-smbios", f"type=11,path={self.folder}/unit", "-smbios", f"type=11,path={self.folder}/want",
                "-chardev", self.chardev("monitor"), "-mon", "chardev=monitor",
                "-chardev", f"file,id=console,path={self.folder}/console.log", "-serial", "chardev:console",
                *self.extra, *more]

    def start(self, *more):
        self.port, self.page_port = free_port(), free_port()
        for stale in (*self.folder.glob("*.sock"), *self.folder.glob("console.log")):
            stale.unlink()
        self.errors = open(self.folder / "qemu.log", "w")
        self.process = subprocess.Popen([str(w) for w in self.command(*more)], stderr=self.errors, stdout=self.errors,
                                        stdin=subprocess.DEVNULL)
        self.switched_on = time.monotonic()
        self.has_answered = False

    def cut_power(self):
        if self.process:
            self.process.kill()
            self.process.wait()
            self.errors.close()
            self.process = None

    def __enter__(self):
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that __exit__ is reached
        return self

    def __exit__(self, *_):
        self.cut_power()

    def wait_registers(self, accept=lambda words: True, limit_s=900, since_now=False):
        """Seconds from power, or from now, to the first block that is acceptable, and the block."""
        began = time.monotonic() if since_now else self.switched_on
        while time.monotonic() - began < limit_s * self.slowness:
            assert self.process.poll() is None, "qemu ended: " + (self.folder / "qemu.log").read_text()
            words = read_registers(self.port, timeout=3 if self.has_answered else 1)
            if words and words[39] == TEST_CONSTANT and not self.has_answered:
                self.has_answered = True
                self.slowness = max(1.0, (time.monotonic() - self.switched_on) / NOMINAL_START_S)
            if words and words[39] == TEST_CONSTANT and accept(words):
                return time.monotonic() - began, words
            time.sleep(0.2)
        raise TimeoutError(f"no such registers within {limit_s * self.slowness:.0f} s; the last are {words and words[:5]}; the console says:\n" + self.console()[-3000:])

    def console(self):
        file = self.folder / "console.log"  # which QEMU makes a moment after its start
        return file.read_text(errors="replace").replace("\r", "") if file.exists() else ""

    def wait_console(self, pattern, limit_s=900):
        """Until a line of the console matches; seconds from power."""
        end = time.monotonic() + limit_s * self.slowness
        while not re.search(pattern, self.console()):
            if time.monotonic() > end:
                raise TimeoutError(f"the console does not say {pattern!r}:\n" + self.console()[-2000:])
            time.sleep(0.1)
        return time.monotonic() - self.switched_on

    def connect(self, client, name, limit_s=60):
        """QEMU makes its sockets a moment after its start."""
        end = time.monotonic() + limit_s
        while True:
            try:
                return client.connect(str(self.folder / name))
            except OSError:
                if time.monotonic() > end or self.process.poll() is not None:
                    raise
                time.sleep(0.1)

    def monitor(self, line):
        """One command to QEMU itself; its answer."""
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(120)
            self.connect(client, "monitor.sock")
            self.read_until(client, b"(qemu) ")
            client.sendall(line.encode() + b"\n")
            return self.read_until(client, b"(qemu) ").decode(errors="replace")

    def shell(self, command, limit_s=300):
        """Runs a command as root in the guest: (exit status, output)."""
        end = f"end-{time.monotonic_ns()}"
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(limit_s)
            self.connect(client, "shell.sock")
            # In a shell of its own: what a command sets or ends stays there. The shell echoes what it is told, so the mark is put together only by what it runs.
            client.sendall(f"stty -echo cols 200; PS1=; export SYSTEMD_COLORS=0 SYSTEMD_PAGER= SYSTEMD_URLIFY=0 TERM=dumb\n"
                           f"echo begin-''{end}; (\n{command}\n)\n"
                           f"echo \"$? {end[:3]}\"'{end[3:]}'\n".encode())
            text = self.read_until(client, f" {end}\n".encode()).decode(errors="replace").replace("\r", "")
        text = text.split(f"begin-{end}\n")[-1]
        output, _, last = text.rstrip("\n").rpartition("\n")
        return int(last.split()[-2]), output

    def identity(self):
        """Serial number, ports and write key, which are known a moment after the sensor answers."""
        _, said = self.shell("for i in $(seq 300); do [ -s /run/finsight/name ] && break; sleep 1; done; cat /run/finsight/identity")
        return dict(line.split("=", 1) for line in said.splitlines())

    def times_logged(self, pattern, of="-b"):
        """How many lines of the guest's log match; `of`: which part of it, as journalctl's options. While the log is rotated
        there may be fewer than before, and journalctl says so on its error output."""
        return int(self.shell(f"journalctl {of} --no-pager 2>/dev/null | grep -cE '{pattern}'")[1])

    @staticmethod
    def read_until(client, mark):
        text = b""
        while not text.replace(b"\r", b"").endswith(mark):
            part = client.recv(65536)
            if not part:
                raise ConnectionError("the guest's end was closed: " + text[-500:].decode(errors="replace"))
            text += part
        return text.replace(b"\r", b"")

    def wait_new_process(self, unit, last, limit_s):
        """Until a unit's main process is another one than the last."""
        end = time.monotonic() + limit_s * self.slowness
        while time.monotonic() < end:
            _, now = self.shell(f"systemctl show -P MainPID {unit}")
            if now.strip() not in ("0", last.strip()):
                return
            time.sleep(1)
        raise TimeoutError(f"{unit} has process {now.strip()}, before {last.strip()}")

    def wait_up(self, limit_s=900):
        """Until the device counts itself healthy (or stays in safe mode): from then on it takes updates."""
        end = time.monotonic() + limit_s * self.slowness
        while self.shell("[ -e /run/finsight/up ]")[0] != 0:
            if time.monotonic() > end:
                raise TimeoutError("never healthy:\n" + self.console()[-2000:])
            time.sleep(1)

    def plug_stick(self, image, name="stick"):
        self.monitor(f"drive_add 0 if=none,id={name},file={image},format=raw")
        self.monitor(f"device_add usb-storage,id=usb-{name},drive={name}")

    def pull_stick(self, name="stick"):
        self.monitor(f"device_del usb-{name}")


def make_stick(image, files, free_mib=48):
    """A FAT-formatted USB stick with these files at its root."""
    size = sum(Path(f).stat().st_size for f in files) + (free_mib << 20)  # FAT32 begins at about 33 MB
    with open(image, "wb") as out:
        out.truncate((size + 0xFFFFF) & ~0xFFFFF)
    subprocess.run(["mformat", "-i", image, "-F", "::"], check=True)
    subprocess.run(["mcopy", "-i", image, *files, "::/"], check=True)


def write_settings(card, text):
    """Puts a settings file onto the card's boot partition, as a user does on a computer."""
    file = Path(str(card) + ".toml")
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    subprocess.run(["mcopy", "-o", "-i", f"{card}@@1M", file, "::/finsight.toml"], check=True)


def copy_card(image, card):
    subprocess.run(["cp", "--sparse=always", image, card], check=True)


def make_update(file, payload, key, board, version, identity):
    """A signed update of any content: what scripts/image makes, for content that it would never make."""
    import hashlib
    text = (f"finsight-update=1\nboard={board}\nversion={version}\nid={identity}\nsize={len(payload)}\n"
            f"sha256={hashlib.sha256(payload).hexdigest()}\n").encode().ljust(1024, b"\n")
    Path(file).with_suffix(".text").write_bytes(text)
    signature = subprocess.run(["openssl", "pkeyutl", "-sign", "-inkey", key, "-rawin", "-in",
                                Path(file).with_suffix(".text")], check=True, capture_output=True).stdout
    Path(file).write_bytes((text + signature).ljust(4096, b"\0") + payload)
