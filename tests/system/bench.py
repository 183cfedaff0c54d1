"""What the steps of tests/system/boot share: the card, the machine, the measured figures, and how a step is written."""
import os
import re
import subprocess
import time
from pathlib import Path

import machine
from machine import Machine

SOURCE = Path(__file__).resolve().parents[2]
WORK = Path(os.environ.get("FINSIGHT_BOOT_WORK", SOURCE / "build" / "image" / "test"))
# What the image shows, and with which model: taken out of it.
CONTENT = WORK / "content"
SESSION, PACK = CONTENT / "usr/lib/finsight/session", CONTENT / "usr/lib/finsight/model.safetensors"
TOUCH_VALID, SHAPE_VALID, HELD, CAMERA_FAULT, ANY_FAULT = 1 << 1, 1 << 3, 1 << 4, 1 << 10, 1 << 15
CAMERA_LOST = 1  # register 1
CAMERA_FPS = 20
STEPS = []


def step(function):
    STEPS.append(function)
    return function


def check(condition, message):
    if not condition:
        raise AssertionError(message)


class Bench:
    """What the steps share: the card, the machine, what was measured."""

    def __init__(self, arguments):
        self.image_folder = Path(arguments.image)
        self.finsightd = Path(arguments.finsightd)
        self.key = SOURCE / "build" / "image" / "update-key.pem"
        self.card = WORK / "card.img"
        self.machine = Machine(self.card, WORK / "machine")
        # An emulated frame can take longer than results stay fresh on a board.
        self.default_settings = ("hold_time_ms = 5000\n" +
                                 (SOURCE / "boards" / "image" / "esp" / "finsight.toml").read_text())
        self.measured = {}
        self.fault_minutes, self.seed = arguments.fault_minutes, arguments.seed

    def image(self):
        return next(self.image_folder.glob("finsight-*.img"))

    def update(self):
        return next(self.image_folder.glob("finsight-*.update"))

    def fresh_card(self, settings="", image=None):
        """With the image under test, or another one."""
        self.machine.cut_power()
        machine.copy_card(image or self.image(), self.card)
        machine.write_settings(self.card, self.default_settings + settings)

    def running(self, settings='\n[source]\nspeed = "full"\n'):
        """The machine with a healthy system; starts it if need be."""
        if self.machine.process is None:
            self.fresh_card(settings)
            self.machine.start()
        self.machine.wait_registers(lambda words: not words[0] & ANY_FAULT, since_now=True)
        return self.machine

    def running_afresh(self):
        self.machine.cut_power()
        return self.running()

    def order(self, command):
        """A command by name, over Modbus."""
        key = self.machine.identity()["write_key"]
        subprocess.run([SOURCE / "scripts/finsightctl", "do", "127.0.0.1", command, "--port", str(self.machine.port),
                        "--key", key], check=True, capture_output=True)

    def frames_advance(self, limit_s=120):
        first = machine.read_registers(self.machine.port)
        end = time.monotonic() + limit_s * self.machine.slowness
        while time.monotonic() < end:
            now = machine.read_registers(self.machine.port)
            if now and first and now[32:34] != first[32:34] and not now[0] & ANY_FAULT:
                return
            first = first or now
            time.sleep(0.5)
        raise AssertionError(f"no new frame within {limit_s} s: {now}")


def camera_settings():
    """The session's camera instead of the session: same image size, same lens. Emulation may pause for a while."""
    lens = re.search(r"\[camera\].*\n((?:\w.*\n)+)", (SESSION / "session.toml").read_text())[1]
    return (f'\n[source]\nkind = "camera"\nwidth_px = 640\nheight_px = 480\nframes_per_second = {CAMERA_FPS}\n'
            f"stall_ms = 3000\n[source.lens]\n{lens}")
