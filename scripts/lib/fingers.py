#!/usr/bin/python3
"""How one, two and three fingers on one machine fare: frame times, dropped frames and memory of each.

usage: fingers.py FINSIGHTD PACK SESSION [--seconds N] [--tier TIER] [--json FILE]
Every finger replays SESSION at its recorded speed with a loop of its own. Prints or writes JSON, per number of fingers the worst
of them: {"1": {"p50_ms", "p99_ms", "worst_ms", "frames", "dropped", "memory_mb"}, "2": ..., "each": [rows of every finger],
"load": [before]}
"""
import argparse
import json
import os
import re
import subprocess
import tempfile
import time
from pathlib import Path


def run(arguments, count):
    with tempfile.TemporaryDirectory() as folder:
        board = Path(folder) / "board.toml"
        fingers = "".join(f'[[finger]]\nname = "f{n}"\n' for n in range(1, count + 1))
        board.write_text(f'pack = "{Path(arguments.pack).resolve()}"\n[source]\nkind = "session"\n'
                         f'path = "{Path(arguments.session).resolve()}"\nrepeat = true\n'
                         f'[shape]\ntier = "{arguments.tier}"\n[modbus]\nport = 0\n{fingers}')
        process = subprocess.Popen([arguments.finsightd, "--settings", board], stderr=subprocess.PIPE, text=True)
        time.sleep(arguments.seconds)
        resident = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{process.pid}/status").read_text())
        process.terminate()
        errors = process.communicate(timeout=20)[1]
        assert process.returncode == 0, errors
        results = []
        for times, frames, dropped in re.findall(r"^frame((?: +\d+)+)$\nframes (\d+), dropped (\d+)", errors, re.M):
            _, p50, p99, worst = (int(word) for word in times.split())
            results.append({"fingers": count, "finger": len(results) + 1, "p50_ms": p50 / 1000, "p99_ms": p99 / 1000,
                            "worst_ms": worst / 1000, "frames": int(frames), "dropped": int(dropped)})
        assert len(results) == count, errors
        slowest = {key: max(one[key] for one in results) for key in ("p50_ms", "p99_ms", "worst_ms")}
        return {**slowest, "frames": min(one["frames"] for one in results), "dropped": sum(one["dropped"] for one in results),
                "memory_mb": round(int(resident[1]) / 1024, 1)}, results


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("finsightd")
    parser.add_argument("pack")
    parser.add_argument("session")
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--tier", default="newton")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    report = {"load": list(os.getloadavg()), "processors": os.cpu_count(), "each": []}
    for count in (1, 2, 3):
        report[str(count)], each = run(arguments, count)
        report["each"] += each
    text = json.dumps(report, indent=1) + "\n"
    if arguments.json:
        arguments.json.write_text(text)
    else:
        print(text, end="")


if __name__ == "__main__":
    main()
