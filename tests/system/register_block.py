"""Reads Finsight's measurement block with pymodbus (Debian's python3-pymodbus) and turns it into numbers.

Shared by the demo's live table and the end-to-end tests. Addresses are those of the register table in the README.
"""
import struct
import time
from dataclasses import dataclass

from pymodbus.client import ModbusTcpClient

BLOCK = 44
STATUS_BITS = {
    0: "ready", 1: "touch", 2: "contact", 3: "shape", 4: "held", 5: "top", 6: "middle", 7: "low",
    8: "zeroed", 9: "over-range", 10: "camera fault", 11: "fallback", 13: "over-temperature", 15: "fault",
}


def signed(word):
    return word - 65536 if word >= 32768 else word


@dataclass
class Block:
    """One consistent snapshot in millimetres, newtons and milliseconds."""
    words: list

    @property
    def status(self):
        return self.words[0]

    def has(self, bit):
        return bool(self.status >> bit & 1)

    @property
    def status_text(self):
        return " ".join(name for bit, name in STATUS_BITS.items() if self.has(bit))

    @property
    def touch_valid(self):
        return self.has(1)

    @property
    def age_ms(self):
        return self.words[3] / 10

    @property
    def latency_ms(self):
        return self.words[4] / 10

    @property
    def point_mm(self):
        return tuple(signed(w) / 100 for w in self.words[5:8])

    @property
    def contact_mm(self):
        return tuple(signed(w) / 100 for w in self.words[40:43])

    @property
    def radius_mm(self):
        return self.words[8] / 100

    @property
    def force_n(self):
        return self.words[9] / 100

    @property
    def deformation_permille(self):
        return self.words[11]

    @property
    def frame(self):
        return self.words[32] << 16 | self.words[33]

    def float_at(self, address, order="ABCD"):
        high, low = self.words[address:address + 2]
        if order == "CDAB":
            high, low = low, high
        return struct.unpack(">f", struct.pack(">HH", high, low))[0]


class Reader:
    """A Modbus TCP client that waits for the server to come up and raises on any exception answer."""

    def __init__(self, port, host="127.0.0.1", wait_s=10.0):
        deadline = time.monotonic() + wait_s
        self.client = ModbusTcpClient(host, port=port, timeout=2)
        while not self.client.connect():
            if time.monotonic() > deadline:
                raise ConnectionError(f"no Modbus server on {host}:{port}")
            time.sleep(0.05)

    def read(self):
        answer = self.client.read_holding_registers(0, BLOCK, slave=1)
        if answer.isError():
            raise ConnectionError(f"Modbus answered {answer}")
        return Block(answer.registers)

    def close(self):
        self.client.close()
