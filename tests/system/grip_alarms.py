#!/usr/bin/python3
"""How often grip_changed is raised though a held object does not move: frames of a held grip through the whole firmware.

usage: grip_alarms.py BINARY_DIR SOURCE_DIR [--frames N (216000: an hour)] [--changes C (3, setting 1101)]
Half of the frames show each of two touches of the tests' rendered session; every frame of a 10 s round has noise of its
own, as strong as that between the session's first two frames, which show the finger at rest. Prints one line per touch.
"""
import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy
from pymodbus.client import ModbusTcpClient

arguments, sys.argv = sys.argv[1:], sys.argv[:3]
from end_to_end import SESSION, Firmware, prepare, session_source  # noqa: E402 and scripts/lib is in the path now
from register_block import ADDRESS, MEASUREMENTS  # noqa: E402

FRAME = b"FRAME\n"
TOUCHES = (90, 420)  # frames of the session
ROUND = 600          # frames


def make_session(folder, touch):
    with open(SESSION / "frames.y4m", "rb") as images:
        header = images.readline()
        size = {word[:1]: int(word[1:]) for word in header.split() if word[:1] in (b"W", b"H")}
        pixels = size[b"W"] * size[b"H"]

        def image(number):
            images.seek(len(header) + number * (len(FRAME) + pixels) + len(FRAME))
            return numpy.frombuffer(images.read(pixels), numpy.uint8).astype(numpy.float32)
        noise, shown = numpy.std(image(1) - image(0)) / 2 ** 0.5, image(touch)
    random = numpy.random.default_rng(touch)
    with open(folder / "frames.y4m", "wb") as out:
        out.write(header)
        for _ in range(ROUND):
            noisy = shown + noise * random.standard_normal(pixels, dtype=numpy.float32)
            out.write(FRAME + numpy.clip(numpy.rint(noisy), 0, 255).astype(numpy.uint8).tobytes())
    (folder / "session.toml").write_text((SESSION / "session.toml").read_text())
    return noise


def count_alarms(folder, frames, changes):
    """Frames that were processed, and how often the grip changed; the grip must be watched at the end."""
    source = session_source("full", path=folder) + '\n[shape]\ntier = "map"'
    with Firmware(source, first_line=f"grip_change = {changes}") as firmware:
        client = ModbusTcpClient("127.0.0.1", port=firmware.port, timeout=5)
        while not client.connect():
            time.sleep(0.1)
        while True:
            words = client.read_holding_registers(0, MEASUREMENTS, slave=1).registers
            process = client.read_holding_registers(ADDRESS["events"], 6, slave=1).registers
            counted = words[ADDRESS["frame_counter"]] << 16 | words[ADDRESS["frame_counter"] + 1]
            if counted >= frames:
                client.close()
                assert process[5] & 8, "the grip is not watched"
                return counted, process[4], words[ADDRESS["force"]] / 100, words[ADDRESS["touch_uncertainty"]] / 100
            time.sleep(0.2)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=216000)
    parser.add_argument("--changes", type=float, default=3)
    options = parser.parse_args(arguments[2:])
    prepare()
    for touch in TOUCHES:
        with tempfile.TemporaryDirectory() as folder:
            noise = make_session(Path(folder), touch)
            frames, alarms, force_n, radius_mm = count_alarms(folder, options.frames // len(TOUCHES), options.changes)
        print(f"touch of frame {touch}: {force_n:.2f} N, radius {radius_mm:.2f} mm, noise {noise:.2f} grey levels: "
              f"{alarms} changes of the grip in {frames} frames", flush=True)


if __name__ == "__main__":
    main()
