#!/usr/bin/python3
"""Watches a running finsightd over Modbus, prints its registers beside the truth, then a summary.

usage: live_table.py --port P --seconds N (--session FOLDER | --recording CSV NAME)
"""
import argparse
import csv
import math
import sys
import time
from pathlib import Path

from register_block import Reader

BANDS = [(0, 2), (2, 4), (4, 7), (7, math.inf)]  # plate motion, mm


def session_truth(folder):
    """For every frame of a rendered session: touched point, force, largest plate displacement."""
    rows = []
    with open(Path(folder) / "truth.csv", newline="") as file:
        for row in csv.DictReader(file):
            motion = max(math.hypot(*(float(row[f"{p}_displacement_{a}_mm"]) for a in "xyz")) for p in ("top", "middle", "low"))
            point = tuple(float(row[f"point_{a}_mm"]) for a in "xyz")
            rows.append((point, float(row["force_n"]), motion))
    return rows


def recording_truth(path, name):
    """For every frame of a recording: the pen's tip, no force, displacement of the only recorded plate."""
    rows = []
    with open(path, newline="") as file:
        for row in csv.DictReader(file):
            if row["recording"] != name:
                continue
            motion = math.hypot(*(float(row[f"marker_t{a}_mm"]) for a in "xyz"))
            rows.append((tuple(float(row[f"touch_{a}_mm"]) for a in "xyz"), None, motion))
    return rows


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else math.nan


def show(block, point, truth):
    true_point, true_force, motion = truth
    valid = block.has("touch_valid")
    status = block.status_text.replace("top plate seen, middle plate seen, low plate seen", "all plates seen")
    read_point = "{:7.2f} {:7.2f} {:7.2f}".format(*point) if valid else "      -       -       -"
    print("{:6d}  {}  {:5.2f}  {:5.2f}  {:4d}   {:7.2f} {:7.2f} {:7.2f}  {}  {:5.1f}   {}".format(
        block.frame, read_point, block.radius_mm if valid else math.nan,
        block.force_n if valid else math.nan, block.deformation_permille, *true_point,
        "  -  " if true_force is None else f"{true_force:5.2f}", motion, status), flush=True)


def watch(reader, truth, seconds, of_pen):
    """Reads every new frame and prints four a second.

    Returns (error_mm, motion_mm, is inside the published radius) of every touch, ages and latencies in ms, the number
    of frames read and the number of them with a valid touch.
    """
    errors, ages, latencies, frames, valid = [], [], [], set(), 0
    started = shown = time.monotonic()
    while time.monotonic() - started < seconds:
        block = reader.read()
        if block.frame in frames or not block.has("ready"):
            time.sleep(0.002)
            continue
        frames.add(block.frame)
        ages.append(block.age_ms)
        latencies.append(block.latency_ms)
        row = truth[block.frame % len(truth)]
        point = block.contact_mm if of_pen else block.point_mm
        if block.has("touch_valid"):
            valid += 1
            error = math.dist(point, row[0])
            errors.append((error, row[2], error <= block.radius_mm))
        if time.monotonic() - shown >= 0.25:
            shown = time.monotonic()
            show(block, point, row)
    return errors, ages, latencies, len(frames), valid


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--seconds", type=float, default=12)
    parser.add_argument("--session")
    parser.add_argument("--recording", nargs=2, metavar=("CSV", "NAME"))
    arguments = parser.parse_args()
    of_pen = arguments.recording is not None
    truth = recording_truth(*arguments.recording) if of_pen else session_truth(arguments.session)
    if not truth:
        sys.exit("live_table: no truth to compare with")

    reader = Reader(arguments.port)
    print("        touch from the registers, mm    ±68%  force  level   " +
          ("pen's tip, mm          " if of_pen else "truth, mm              ") + "  force  plate   status")
    print(" frame        x       y       z     mm      N     ‰         x       y       z       N     mm")
    errors, ages, latencies, frames, valid = watch(reader, truth, arguments.seconds, of_pen)
    reader.close()

    print(f"\n{frames} frames read, touch valid in {valid}")
    print(("distance to the pen" if of_pen else "touch error") + " by plate motion:")
    for low, high in BANDS + [(4, math.inf)]:
        band = [(error, inside) for error, motion, inside in errors if low <= motion < high]
        name = f"{low} mm and more" if high == math.inf else f"{low} to {high} mm"
        if band:
            values = [error for error, _ in band]
            print(f"  {name:14s} {len(band):5d} frames   mean {sum(values) / len(values):5.2f} mm   "
                  f"95 % under {percentile(values, 0.95):5.2f} mm   "
                  f"inside the published radius {100 * sum(i for _, i in band) / len(band):3.0f} %")
    print("latency, exposure to publication: p50 {:.1f} ms, p99 {:.1f} ms;  age when read: p50 {:.1f} ms, p99 {:.1f} ms"
          .format(percentile(latencies, 0.5), percentile(latencies, 0.99), percentile(ages, 0.5),
                  percentile(ages, 0.99)))
    if frames == 0:
        sys.exit("live_table: finsightd published nothing")


if __name__ == "__main__":
    main()
