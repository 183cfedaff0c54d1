#!/usr/bin/python3
"""The camera port with libcamera's virtual camera, fed with rendered frames, under sanitizers: its own tests, then the
whole firmware, whose registers must be those of the same frames replayed. Skips without the Debian 13 sysroot.

usage: virtual_camera.py BINARY_DIR SOURCE_DIR [unittest arguments]
"""
import csv
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest

import end_to_end
from end_to_end import BINARIES, PACK, SOURCE, SPEC, WORK
from usb_camera import read_images
from virtual_frames import SIZE, YAML, pgm, write_frames, write_session

TRIXIE = SOURCE / "build" / "amd64-trixie"
FRAMES = WORK / "virtual-camera"    # the camera's JPEGs,
PICTURES = WORK / "virtual-images"  # what it makes of them,
SESSION = WORK / "virtual-session"    # and as a session
# Of the rendered frames: more than ImageCheck remembers, and a prime number, so that a firmware that comes to every second
# or third picture only still sees them in turn, not the same few again and again.
CHOSEN = (0, 70, 85, 100, 115, 130, 150)
OF_ONE_IMAGE = [k for k in range(5, 20) if k not in (8, 10)]  # the uncertainties also depend on how fast it changes
SKIPPED = 77


def run(*words, **options):
    answer = subprocess.run([str(w) for w in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=1800,
                            **options)
    if answer.returncode != 0:
        sys.exit(f"{words}: exit code {answer.returncode}\n" + answer.stdout.decode(errors="replace"))


def make_frames():
    """Rendered frames as the camera's JPEGs (it takes nothing else), and what it makes of them: PGMs, a session."""
    rendered = WORK / "virtual-rendered"
    run(BINARIES / "hostgen", "render", SPEC, "-o", rendered, "--seconds", 3)
    width, height, images = read_images(rendered)
    assert (width, height) == SIZE
    for folder in (FRAMES, PICTURES):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    shown = write_frames(FRAMES, [bytes(images[k]) for k in CHOSEN])
    for k, pixels in enumerate(shown):
        (PICTURES / f"{k}.pgm").write_bytes(pgm(pixels))
    write_session(SESSION, rendered, shown * 2)  # the second time with all that the first has left behind


def prepare():
    end_to_end.prepare()
    run("cmake", "--preset", "amd64-trixie", cwd=SOURCE)
    run("cmake", "--build", "--preset", "amd64-trixie", "--target", "finsightd", "udmabuf_shim",
        "test_ports_camera_libcamera", "test_ports_gpio_libgpiod", "test_ports_live_camera", cwd=SOURCE)
    make_frames()
    yaml = WORK / "virtual.yaml"
    yaml.write_text(YAML.format(folder=FRAMES))
    return {**os.environ, "LD_PRELOAD": str(TRIXIE / "tests" / "libudmabuf_shim.so"),
            "FINSIGHT_VIRTUAL_YAML": str(yaml), "FINSIGHT_VIRTUAL_FRAMES": str(PICTURES),
            "ASAN_OPTIONS": "quarantine_size_mb=1:verify_asan_link_order=0"}


def board(name, source):
    path = WORK / f"virtual-{name}.toml"
    path.write_text(f'pack = "{PACK}"\n[source]\n{source}\n[modbus]\nport = 0\n'
                    '[shape]\ntier = "map+newton"\n')  # every frame by itself: the camera may leave some out
    return path


def rows(path):
    with open(path, newline="") as file:
        return [[int(word) for word in row] for row in list(csv.reader(file))[1:]]


def signed(words):
    return [word - 65536 if word >= 32768 else word for word in words]


def furthest(a, b):
    return max(abs(x - y) for x, y in zip(signed(a), signed(b)))


def of_one_image(row):
    return [row[k] for k in OF_ONE_IMAGE]


class VirtualCamera(unittest.TestCase):
    def setUp(self):
        for name in ("camera", "replay"):
            (WORK / f"virtual-{name}.csv").unlink(missing_ok=True)

    def test_the_ports_own_tests(self):
        # What is freed is kept for a while to catch its use; where memory is counted, it must not be.
        counting = {**ENVIRONMENT, "ASAN_OPTIONS": "quarantine_size_mb=0:thread_local_quarantine_size_kb=0:"
                                                   "malloc_context_size=1:verify_asan_link_order=0"}
        for name, cases, environment in (("live_camera", "-tc=*", ENVIRONMENT), ("gpio_libgpiod", "-tc=*", ENVIRONMENT),
                                         ("camera_libcamera", "-tce=*reopenings*", ENVIRONMENT),
                                         ("camera_libcamera", "-tc=*reopenings*", counting)):
            with self.subTest(f"{name} {cases}"):
                answer = subprocess.run([TRIXIE / "tests" / f"test_ports_{name}", cases], env=environment, text=True,
                                        stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
                print(answer.stdout)
                self.assertEqual(answer.returncode, 0, answer.stdout)

    def test_the_cameras_registers_are_those_of_the_replay(self):
        lens = (SESSION / "session.toml").read_text().split("[camera]")[1].split("[markers]")[0].split("\n", 1)[1]
        camera = board("camera", 'kind = "camera"\ncamera = "Finger0"\nwidth_px = 640\nheight_px = 480\n'
                                 f"frames_per_second = 60\n[source.lens]\n{lens}")
        replay = board("replay", f'kind = "session"\npath = "{SESSION}"\nspeed = "full"')
        run(TRIXIE / "finsightd", "--settings", replay, "--registers", WORK / "virtual-replay.csv", env=ENVIRONMENT)
        process = subprocess.Popen([TRIXIE / "finsightd", "--settings", camera, "--registers",
                                    WORK / "virtual-camera.csv"], env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
        time.sleep(10)
        process.send_signal(signal.SIGTERM)
        said = process.communicate(timeout=60)[1]
        self.assertEqual(process.returncode, 0, said)
        print(said)

        expected = rows(WORK / "virtual-replay.csv")[len(CHOSEN):]
        seen = set()
        frames = rows(WORK / "virtual-camera.csv")
        for row in frames:
            distances = [furthest(of_one_image(row), of_one_image(one)) for one in expected]
            nearest = min(range(len(expected)), key=lambda k: distances[k])
            self.assertLessEqual(distances[nearest], 5, "counts")
            seen.add(nearest)
        self.assertEqual(seen, set(range(len(CHOSEN))), "every image was shown")
        print(f"{len(frames)} frames of the camera, all as replayed")


if __name__ == "__main__":
    if not (SOURCE / "build" / "sysroot-amd64" / "finsight-sysroot").exists():
        print("skipped: the virtual camera needs scripts/setup --cross and scripts/sysroot amd64")
        sys.exit(SKIPPED)
    ENVIRONMENT = prepare()
    unittest.main(verbosity=2)
