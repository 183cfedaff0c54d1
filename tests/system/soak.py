#!/usr/bin/python3
"""Replay at full rate with many clients that come and go: memory stays flat, no heartbeat is missed, nothing old is shown
as fresh, and how long a result takes from its exposure to the client that has read it.

usage: soak.py BINARY_DIR SOURCE_DIR [--seconds N] [--clients N] [--json FILE]
20 seconds and 8 clients at 50 requests per second unless told otherwise; 3600 for the long form. exit code 1: failed
"""
import argparse
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

ARGUMENTS = sys.argv[3:]
sys.argv = sys.argv[:3]  # end_to_end takes the first two
from end_to_end import SESSION, Firmware, prepare, session_source  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from importlib.machinery import SourceFileLoader  # noqa: E402

finsightctl = SourceFileLoader("finsightctl", str(Path(__file__).resolve().parents[2] / "scripts" / "finsightctl")).load_module()

RATE_HZ, FRAMES_PER_S = 50, 60
RECONNECT_S = 3
HELD, ANY_FAULT = 1 << 4, 1 << 15
SILENT_S = 0.5  # without a new heartbeat
STALE_MS = 305  # a result older than this must not look fresh: hold time and the longest wait for a frame


class Client(threading.Thread):
    """Reads the whole block, checks it, and connects anew every few seconds."""

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
                    words = device.read(0, 48)
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
        age_ms = words[3] / 10
        if not words[0] & ANY_FAULT and not words[0] & HELD:
            # The answer was made after the request came: exposure to answered is the age and at most this.
            self.latency_ms.append(age_ms + elapsed_ms)
            if age_ms > STALE_MS:
                self.problems.append(f"client {self.number}: {age_ms:.0f} ms old and shown as fresh")
        if last:
            heartbeats = (words[2] - last[0]) % 65536
            if heartbeats != 0 and now - last[1] > SILENT_S:
                self.silences.append((last[1], now))
            if heartbeats > 32768:
                self.problems.append(f"client {self.number}: the heartbeat went back")
            if heartbeats == 0:
                return last
        return words[2], now


class Stalls:
    """When this machine ran nothing: on each processor a process that only sleeps notes when it was not woken. A busy or a
    virtual machine stalls like that; what stands still then is not finsightd's fault."""

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
        """Seconds of the span in which some processor stood still."""
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
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--json")
    arguments = parser.parse_args(ARGUMENTS)
    prepare()
    # From memory: a disk that is busy with others would look like a camera that stalls.
    memory = tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None)
    session = shutil.copytree(SESSION, Path(memory.name) / "session")
    with memory, Firmware(session_source(path=session)) as firmware, Stalls() as stalls:
        deadline = time.monotonic() + 30
        while True:
            try:
                reader = finsightctl.Device("127.0.0.1", firmware.port)
                break
            except OSError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.1)
        while not reader.read(0, 1)[0] & 1:
            time.sleep(0.05)
        until = time.monotonic() + arguments.seconds
        clients = [Client(n, firmware.port, until) for n in range(arguments.clients)]
        first_frames = reader.read(32, 3)
        for client in clients:
            client.start()
        time.sleep(min(5, arguments.seconds / 4))  # everything has been used once
        before_kb = memory_kb(firmware.process.pid)
        while time.monotonic() < until:
            time.sleep(min(60, max(0, until - time.monotonic())))
            if arguments.seconds > 120:
                print(f"{arguments.seconds - max(0, until - time.monotonic()):.0f} s, "
                      f"{memory_kb(firmware.process.pid)} kB", flush=True)
        for client in clients:
            client.join(10)
        after_kb = memory_kb(firmware.process.pid)
        last_frames = finsightctl.Device("127.0.0.1", firmware.port).read(32, 3)  # the first one was silent for too long
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
