"""Reads Finsight's measurements with pymodbus (Debian's python3-pymodbus) and scales them.

Shared by the demo's live table and the system tests. Names and addresses are those of hostgen/plc/registers.csv.
"""
import csv
import struct
import time
from dataclasses import dataclass
from pathlib import Path

from pymodbus.client import ModbusTcpClient


def read_table():
    """Addresses by register name, and of each register with bits or codes the numbers by name."""
    addresses, values = {}, {}
    with open(Path(__file__).resolve().parents[2] / "hostgen" / "plc" / "registers.csv", newline="") as file:
        for row in csv.DictReader(file):
            addresses[row["name"]] = int(row["address"])
            if row["values"]:
                pairs = (pair.split("=") for pair in row["values"].split(";"))
                values[row["name"]] = {name: int(number) for number, name in pairs}
    return addresses, values


ADDRESS, VALUES = read_table()
STATUS_BIT = {name: 1 << number for name, number in VALUES["status"].items()}
MEASUREMENTS = ADDRESS["verified_days_ago"] + 1  # registers; that is the last


def signed(word):
    return word - 65536 if word >= 32768 else word


@dataclass
class Block:
    """One consistent snapshot of the measurements, in millimetres, newtons and milliseconds."""
    words: list

    def at(self, name):
        return self.words[ADDRESS[name]]

    def three_mm(self, first):
        """Three consecutive registers, x, y and z, of which `first` is the name of the first."""
        begin = ADDRESS[first]
        return tuple(signed(word) / 100 for word in self.words[begin:begin + 3])

    def has(self, bit):
        """Whether the status bit of this name is set."""
        return bool(self.at("status") & STATUS_BIT[bit])

    @property
    def status_text(self):
        return ", ".join(name.replace("_", " ") for name in STATUS_BIT if self.has(name))

    @property
    def age_ms(self):
        return self.at("age") / 10

    @property
    def latency_ms(self):
        return self.at("latency") / 10

    @property
    def point_mm(self):
        return self.three_mm("touch_x")

    @property
    def contact_mm(self):
        return self.three_mm("contact_x")

    @property
    def radius_mm(self):
        return self.at("touch_uncertainty") / 100

    @property
    def force_n(self):
        return self.at("force") / 100

    @property
    def deformation_permille(self):
        return self.at("deformation_level")

    @property
    def frame(self):
        begin = ADDRESS["frame_counter"]
        return self.words[begin] << 16 | self.words[begin + 1]

    def float_at(self, address, order="ABCD"):
        high, low = self.words[address:address + 2]
        if order == "CDAB":
            high, low = low, high
        return struct.unpack(">f", struct.pack(">HH", high, low))[0]


class Reader:
    """A Modbus TCP client that waits until the server is up and raises on any exception response."""

    def __init__(self, port, host="127.0.0.1", wait_s=10.0):
        deadline = time.monotonic() + wait_s
        self.client = ModbusTcpClient(host, port=port, timeout=2)
        while not self.client.connect():
            if time.monotonic() > deadline:
                raise ConnectionError(f"no Modbus server on {host}:{port}")
            time.sleep(0.05)

    def read(self):
        answer = self.client.read_holding_registers(0, MEASUREMENTS, slave=1)
        if answer.isError():
            raise ConnectionError(f"Modbus answered {answer}")
        return Block(answer.registers)

    def close(self):
        self.client.close()
