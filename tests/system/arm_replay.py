#!/usr/bin/python3
"""One session replayed by the workstation's finsightd and by the board's in qemu-user: the registers are the same within
one count. Skips unless the workstation's programs are built (cmake --build --preset host).

usage: arm_replay.py SOURCE_DIR BOARD_FINSIGHTD [EMULATOR...]
"""
import csv
import shutil
import struct
import subprocess
import sys
from pathlib import Path

SOURCE, FINSIGHTD, EMULATOR = Path(sys.argv[1]), sys.argv[2], sys.argv[3:]
HOST = SOURCE / "build" / "host"
WORK = SOURCE / "build" / "arm-replay"
SPEC = SOURCE / "hostgen" / "fingers" / "srm.toml"
SKIPPED = 77
LATENCY = 4          # depends on the machine's speed
FLOATS = range(20, 32, 2)
EXACT = {0: "status", 1: "fault", 2: "heartbeat", 33: "frame counter", 34: "dropped frames", 35: "iterations", 43: "shape source"}


def run(*words):
    answer = subprocess.run([str(w) for w in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=1200)
    if answer.returncode != 0:
        sys.exit(f"{words}: exit code {answer.returncode}\n" + answer.stdout.decode(errors="replace"))


def replay(name, *program):
    log = WORK / f"{name}.csv"
    run(*program, "--settings", WORK / "board.toml", "--registers", log)
    with open(log, newline="") as file:
        return [[int(word) for word in row] for row in list(csv.reader(file))[1:]]


def signed(word):
    return word - 65536 if word >= 32768 else word


def float_of(row, at):
    return struct.unpack(">f", struct.pack(">HH", row[at], row[at + 1]))[0]


def differences(ours, theirs):
    """What differs between two blocks by more than one count (0.01 mm, 0.01 N, 0.01 degrees, 1 permille)."""
    for at in range(len(ours)):
        if at == LATENCY or at in FLOATS or at - 1 in FLOATS:
            continue
        if abs(signed(ours[at]) - signed(theirs[at])) > (0 if at in EXACT else 1):
            yield f"register {at}: {ours[at]} and {theirs[at]}"
    for at in FLOATS:
        a, b = float_of(ours, at), float_of(theirs, at)
        if abs(a - b) > 0.011 or (a == a) != (b == b):
            yield f"float {at}: {a} and {b}"


if not ((HOST / "hostgen").exists() and (HOST / "finsightd").exists()):
    print("skipped: build the workstation's programs first (cmake --preset host && cmake --build --preset host)")
    sys.exit(SKIPPED)
WORK.mkdir(parents=True, exist_ok=True)
pack = WORK / "srm.safetensors"
if not pack.exists() or pack.stat().st_mtime < max((HOST / "hostgen").stat().st_mtime, SPEC.stat().st_mtime):
    shutil.rmtree(f"{pack}.paths", ignore_errors=True)  # of a run that was cut off, perhaps by another version
    run(HOST / "hostgen", "build", SPEC, "-o", pack, "--profile", "quick")
run(HOST / "hostgen", "render", SPEC, "-o", WORK / "session", "--seconds", 2)
for tier in ("newton", "contact"):
    (WORK / "board.toml").write_text('pack = "srm.safetensors"\n[source]\nkind = "session"\npath = "session"\n'
                                     f'speed = "full"\n[shape]\ntier = "{tier}"\n[modbus]\nport = 0\n')
    workstation, board = replay("workstation", HOST / "finsightd"), replay("board", *EMULATOR, FINSIGHTD)
    if len(workstation) != len(board):
        sys.exit(f"{len(workstation)} frames on the workstation, {len(board)} on the board")
    found = [f"frame {k}: {text}" for k, pair in enumerate(zip(workstation, board)) for text in differences(*pair)]
    touched = sum(row[0] >> 1 & 1 for row in workstation)
    equal = sum(a[:LATENCY] + a[LATENCY + 1:] == b[:LATENCY] + b[LATENCY + 1:] for a, b in zip(workstation, board))
    print(f"tier {tier}: {len(board)} frames, {touched} with a touch; {equal} equal to the bit, {len(found)} differences "
          "above one count")
    if found:
        sys.exit("\n".join(found[:20]))
