#!/usr/bin/python3
"""What browsers that watch the commissioning page cost the frame loop: finsightd replays a session at its recorded rate, and
hostgen page-cost reads the times of its frames, unwatched and watched in turns.

usage: page_cost.py BINARY_DIR PACK SESSION [--seconds N] [--rounds N] [--json FILE]
9 rounds of two turns of 10 s by default. The page and those who watch it have processor 0, the frame loop processor 1, as on a
board; browsers would be other machines.
"""
import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from firmware_process import Firmware, free_port, session_source
from register_block import Reader


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("binaries", "pack", "session"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    processors = os.cpu_count()
    # The session is replayed from memory: a busy disk would look like a slow frame.
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as memory:
        session = shutil.copytree(arguments.session, Path(memory) / "session")
        load_before = os.getloadavg()[0]
        port, folder = free_port(), Path(memory) / "page"
        source = session_source(session) + f'\n[page]\nport = {port}\nfolder = "{folder}"'
        # As on a board (boards/image/realtime.toml), where this machine allows it.
        is_real_time = subprocess.run(["chrt", "-f", "20", "true"], stderr=subprocess.DEVNULL).returncode == 0
        source += "\n[realtime]\n" + ("cpu = 1\n" if processors > 1 else "") + ("priority = 20\n" if is_real_time else "")
        with Firmware(arguments.binaries / "finsightd", arguments.pack.resolve(), source) as firmware:
            reader = Reader(firmware.port)
            while not reader.read().has("ready"):
                pass
            reader.close()
            aside = (lambda: os.sched_setaffinity(0, {0})) if processors > 1 else None
            page = subprocess.Popen([arguments.binaries / "finsight-page", "--settings", Path(firmware.folder.name) / "board.toml"],
                                    stderr=subprocess.PIPE, text=True, preexec_fn=aside)
            for line in page.stderr:
                if "http://" in line:
                    break
            measured = Path(memory) / "cost.json"
            try:
                subprocess.run([arguments.binaries / "hostgen", "page-cost", "--folder", folder, "--port", str(port), "--seconds",
                                str(arguments.seconds), "--rounds", str(arguments.rounds), "-o", measured], check=True,
                               stdout=subprocess.DEVNULL, preexec_fn=aside)
            finally:
                page.terminate()
                page.communicate(timeout=20)
        figures = json.loads(measured.read_text()) | {"processors": processors, "real_time": is_real_time, "load_before": round(load_before, 2)}
    if firmware.process.returncode != 0:
        sys.exit(f"finsightd ended with {firmware.process.returncode}: {firmware.errors}")
    print(json.dumps(figures, indent=1))
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
