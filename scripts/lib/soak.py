#!/usr/bin/python3
"""Replays a session at its recorded rate while many clients connect and disconnect. Checks that memory stays flat, that
no heartbeat is missed and that nothing old looks fresh, and measures the time from an exposure to the client that has
read its result.

usage: soak.py FINSIGHTD PACK SESSION [--seconds N] [--clients N] [--json FILE]
20 seconds and 8 clients by default, each with 50 requests per second. exit code 1: failed
"""
import argparse
import importlib.machinery
import importlib.util
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from firmware_process import Firmware, session_source


def load_finsightctl():
    """As a module: its client is plain Python and quick."""
    loader = importlib.machinery.SourceFileLoader("finsightctl", str(Path(__file__).resolve().parents[1] / "finsightctl"))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("finsightctl", loader))
    loader.exec_module(module)
    return module


finsightctl = load_finsightctl()
STATUS, AGE, HEARTBEAT = (finsightctl.ROWS[name].address for name in ("status", "age", "heartbeat"))
FRAME_COUNTER = finsightctl.ROWS["frame_counter"].address  # two words; dropped frames in the word behind them
BIT = {name: 1 << number for number, name in finsightctl.ROWS["status"].values.items()}
RATE_HZ, FRAMES_PER_S = 50, 60
RECONNECT_S = 3
SILENT_S = 0.5  # without a new heartbeat
STALE_MS = 305  # a result older than the hold time and the longest wait for a frame must not look fresh


class Client(threading.Thread):
    """Reads and checks all measurements, and reconnects every few seconds."""

    def __init__(self, number, port, until):
        super().__init__(daemon=True)
        self.number, self.port, self.until = number, port, until
        self.reads, self.connections, self.problems = 0, 0, []
        self.latency_ms, self.silences = [], []

    def run(self):
        last = None
        while time.monotonic() < self.until:
            asked = time.monotonic()
            try:
                device = finsightctl.Device("127.0.0.1", self.port)
                self.connections += 1
                end = min(self.until, time.monotonic() + RECONNECT_S + 0.3 * self.number)
                while time.monotonic() < end:
                    asked = time.monotonic()
                    words = device.read(0, finsightctl.MEASURED)
                    elapsed_ms = 1000 * (time.monotonic() - asked)
                    last = self.check(words, elapsed_ms, last, time.monotonic())
                    time.sleep(max(0, 1 / RATE_HZ - (time.monotonic() - asked)))
                device.socket.close()
            except TimeoutError:
                self.silences.append((asked, time.monotonic()))
            except (OSError, finsightctl.Refusal) as error:
                self.problems.append(f"client {self.number}: {error}")
                return
        if last:
            self.silences.append((last[1], time.monotonic()))  # silent to the end

    def check(self, words, elapsed_ms, last, now):
        self.reads += 1
        age_ms = words[AGE] / 10
        if not words[STATUS] & (BIT["any_fault"] | BIT["held"]):
            # The age is that of the moment of the answer; until the client has it, at most the whole exchange passes.
            self.latency_ms.append(age_ms + elapsed_ms)
            if age_ms > STALE_MS:
                self.problems.append(f"client {self.number}: a result {age_ms:.0f} ms old looks fresh")
        if last:
            heartbeats = (words[HEARTBEAT] - last[0]) % 65536
            if heartbeats != 0 and now - last[1] > SILENT_S:
                self.silences.append((last[1], now))
            if heartbeats > 32768:
                self.problems.append(f"client {self.number}: the heartbeat went backwards")
            if heartbeats == 0:
                return last
        return words[HEARTBEAT], now


class Stalls:
    """The times at which this machine stood still, as busy and virtual machines do; silence then is not finsightd's fault.
    On each processor a process that only sleeps notes when it was woken late."""

    SLEEPER = ("import os, sys, time\nos.sched_setaffinity(0, {int(sys.argv[1])})\nnow = time.monotonic()\nwhile True:\n"
               "    before, _, now = now, time.sleep(0.01), time.monotonic()\n"
               "    if now - before > 0.03: print(before, now, flush=True)\n")

    def __init__(self):
        self.sleepers = [subprocess.Popen([sys.executable, "-c", self.SLEEPER, str(cpu)], stdout=subprocess.PIPE, text=True)
                         for cpu in os.sched_getaffinity(0)]
        self.times = []
        self.readers = [threading.Thread(target=self.read, args=(s.stdout,), daemon=True) for s in self.sleepers]
        for reader in self.readers:
            reader.start()

    def read(self, lines):
        for line in lines:
            self.times.append(tuple(map(float, line.split())))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for sleeper in self.sleepers:
            sleeper.kill()
            sleeper.wait()
        for reader in self.readers:
            reader.join(5)
        self.times.sort()

    def within_s(self, begin, end):
        """Seconds between begin and end in which some processor stood still."""
        total, reached = 0, begin
        for start, stop in self.times:
            start, stop = max(start, reached), min(stop, end)
            if stop > start:
                total, reached = total + stop - start, stop
        return total


def memory_kb(pid):
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1])
    return 0


def percentile(ordered, share):
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else math.nan


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("finsightd", type=Path)
    parser.add_argument("pack", type=Path)
    parser.add_argument("session", type=Path)
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--json")
    arguments = parser.parse_args()
    # The session is replayed from memory: a disk busy with something else would look like a camera that stalls.
    memory = tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None)
    session = shutil.copytree(arguments.session, Path(memory.name) / "session")
    source = session_source(session)
    with memory, Firmware(arguments.finsightd, arguments.pack.resolve(), source) as firmware, Stalls() as stalls:
        deadline = time.monotonic() + 30
        while True:
            try:
                reader = finsightctl.Device("127.0.0.1", firmware.port)
                break
            except OSError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.1)
        while not reader.read(STATUS, 1)[0] & BIT["ready"]:
            time.sleep(0.05)
        until = time.monotonic() + arguments.seconds
        clients = [Client(n, firmware.port, until) for n in range(arguments.clients)]
        first_frames = reader.read(FRAME_COUNTER, 3)
        for client in clients:
            client.start()
        time.sleep(min(5, arguments.seconds / 4))  # until everything has been used once
        before_kb = memory_kb(firmware.process.pid)
        while time.monotonic() < until:
            time.sleep(min(60, max(0, until - time.monotonic())))
            if arguments.seconds > 120:
                print(f"{arguments.seconds - max(0, until - time.monotonic()):.0f} s, "
                      f"{memory_kb(firmware.process.pid)} kB", flush=True)
        for client in clients:
            client.join(10)
        after_kb = memory_kb(firmware.process.pid)
        reader = finsightctl.Device("127.0.0.1", firmware.port)  # the first one has been silent too long and was closed
        last_frames = reader.read(FRAME_COUNTER, 3)
    frames = ((last_frames[0] << 16 | last_frames[1]) - (first_frames[0] << 16 | first_frames[1])) % 2**32
    latency = sorted(value for client in clients for value in client.latency_ms)
    problems = [problem for client in clients for problem in client.problems]
    silences = [(end - begin, stalls.within_s(begin, end)) for client in clients for begin, end in client.silences]
    problems += [f"no heartbeat or no answer for {silent_s:.2f} s, of which the machine stood still for {still_s:.2f} s"
                 for silent_s, still_s in silences if silent_s - still_s > SILENT_S]
    figures = {
        "seconds": arguments.seconds, "clients": arguments.clients, "reads": sum(c.reads for c in clients),
        "connections": sum(c.connections for c in clients), "camera_frames": frames,
        "dropped_frames": last_frames[2] - first_frames[2],
        "exposure_to_answer_ms": {f"p{int(share * 1000) / 10:g}": round(percentile(latency, share), 2)
                                  for share in (0.5, 0.9, 0.99, 0.999)},
        "machine_stood_still_s": round(stalls.within_s(0, math.inf), 1),
        "longest_stall_s": round(max((stop - start for start, stop in stalls.times), default=0), 2),
        "longest_silence_s": round(max((silent_s for silent_s, _ in silences), default=0), 2),
        "memory_kb_before": before_kb, "memory_kb_after": after_kb,
    }
    if after_kb - before_kb > 1024:
        problems.append(f"memory grew from {before_kb} to {after_kb} kB")
    if firmware.process.returncode != 0:
        problems.append(f"finsightd ended with {firmware.process.returncode}")
    print(json.dumps(figures, indent=1))
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(figures, indent=1) + "\n")
    for problem in problems[:20]:
        print("PROBLEM:", problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
