#!/usr/bin/python3
"""Attacks a running finsightd over loopback while a lawful client reads and a session is replayed at its recorded rate
(hostgen attack), and lets eight clients give commands at the same time (hammer.py).

usage: attack.py HOSTGEN FINSIGHTD PACK SESSION [--seconds N] [--command-seconds N] [--json FILE]
10 seconds per attack and 60 of commands by default. exit code 1: commands were mixed up or lost, or finsightd failed
"""
import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from firmware_process import Firmware, session_source
from hammer import hammer
from register_block import Reader


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("hostgen", "finsightd", "pack", "session"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--command-seconds", type=float, default=60)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    # The session is replayed from memory: a busy disk would look like a camera that stalls.
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as memory:
        session = shutil.copytree(arguments.session, Path(memory) / "session")
        load_before = os.getloadavg()[0]
        with Firmware(arguments.finsightd, arguments.pack.resolve(), session_source(session)) as firmware:
            reader = Reader(firmware.port)
            while not reader.read().has("ready"):
                pass
            reader.close()
            measured = Path(memory) / "attack.json"
            subprocess.run([arguments.hostgen, "attack", "--port", str(firmware.port), "--process",
                            str(firmware.process.pid), "--seconds", str(arguments.seconds), "-o", measured], check=True,
                           stdout=subprocess.DEVNULL)
            commands, problems = hammer(firmware.port, arguments.command_seconds)
        figures = {"attack": json.loads(measured.read_text()), "commands": commands,
                   "machine": {"processors": os.cpu_count(), "load_before": round(load_before, 2)}}
    if firmware.process.returncode != 0:
        problems.append(f"finsightd ended with {firmware.process.returncode}")
    print(json.dumps(figures, indent=1))
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")
    for problem in problems[:20]:
        print("PROBLEM:", problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
