"""A cable from an emulated board to us, where nobody gives out addresses: asks by multicast DNS, as a laptop would.

QEMU hands us the board's Ethernet frames as datagrams. Questions and answers are put together and taken apart by
python3-zeroconf.
"""
import socket
import struct
import time

from zeroconf import DNSIncoming, DNSOutgoing, DNSQuestion, const

from machine import free_port

GROUP, PORT = "224.0.0.251", 5353
OUR_ADDRESS = "169.254.250.1"
ETHERNET = bytes.fromhex("01005e0000fb 025254123401 0800")


def checksum(header):
    total = sum(struct.unpack(f">{len(header) // 2}H", header))
    return ~(total % 0xFFFF) & 0xFFFF


def frame_of(payload):
    """One multicast UDP datagram as an Ethernet frame."""
    udp = struct.pack(">4H", PORT, PORT, 8 + len(payload), 0) + payload  # 0: no checksum
    header = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 255, socket.IPPROTO_UDP, 0,
                         socket.inet_aton(OUR_ADDRESS), socket.inet_aton(GROUP))
    return ETHERNET + header[:10] + struct.pack(">H", checksum(header)) + header[12:] + udp


def payload_of(frame):
    """Of a UDP datagram to the port of multicast DNS; nothing of others."""
    if len(frame) < 42 or frame[12:14] != b"\x08\x00" or frame[23] != socket.IPPROTO_UDP:
        return None
    udp = frame[14 + 4 * (frame[14] & 15):]
    return udp[8:struct.unpack(">H", udp[4:6])[0]] if struct.unpack(">H", udp[2:4])[0] == PORT else None


class LocalLink:
    """`device()` is for Machine.start()."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.board_port = free_port()

    def device(self):
        ends = [f"local.type=inet,local.host=127.0.0.1,local.port={self.board_port}",
                f"remote.type=inet,remote.host=127.0.0.1,remote.port={self.socket.getsockname()[1]}"]
        return ["-netdev", "dgram,id=link," + ",".join(ends), "-device", "virtio-net-pci,netdev=link,romfile="]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def ask(self, name, kind, limit_s):
        """The records of this kind for this name (zeroconf's), asked for every two seconds until there is one."""
        end = time.monotonic() + limit_s
        question = DNSOutgoing(const._FLAGS_QR_QUERY)
        question.add_question(DNSQuestion(name, kind, const._CLASS_IN))
        while time.monotonic() < end:
            self.socket.sendto(frame_of(question.packets()[0]), ("127.0.0.1", self.board_port))
            again = time.monotonic() + 2
            while (left := again - time.monotonic()) > 0:
                self.socket.settimeout(left)
                try:
                    payload = payload_of(self.socket.recv(65536))
                except TimeoutError:
                    break
                answers = DNSIncoming(payload).answers if payload else []
                answers = answers() if callable(answers) else answers  # zeroconf 0.47 of Debian 12; later ones
                found = [record for record in answers if record.type == kind and record.name.lower() == name.lower()]
                if found:
                    return found
        raise TimeoutError(f"nobody answers for {name}")
