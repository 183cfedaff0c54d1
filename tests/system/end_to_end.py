#!/usr/bin/python3
"""The whole path with the real programs: spec -> pack -> rendered session -> finsightd -> clients that we did not write.

usage: end_to_end.py BINARY_DIR SOURCE_DIR [unittest arguments]
"""
import csv
import math
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts" / "lib"))
import firmware_process  # noqa: E402
from live_table import session_truth, watch  # noqa: E402
from register_block import Reader  # noqa: E402

BINARIES = Path(sys.argv.pop(1)).resolve()
SOURCE = Path(sys.argv.pop(1)).resolve()
WORK = BINARIES / "system-test"
PACK = WORK / "srm.safetensors"
SESSION = WORK / "session"
SPEC = SOURCE / "hostgen" / "fingers" / "srm.toml"


def run(*words, **options):
    return subprocess.run([str(w) for w in words], capture_output=True, text=True, timeout=1200, **options)


def Firmware(source, pack=PACK, **options):
    return firmware_process.Firmware(BINARIES / "finsightd", pack, source, **options)


def session_source(speed="recorded", repeat="true", path=SESSION):
    return firmware_process.session_source(path, speed, repeat)


class WholePath(unittest.TestCase):
    def test_touch_is_read_within_the_stated_error(self):
        truth = session_truth(SESSION)
        with Firmware(session_source()) as firmware:
            reader = Reader(firmware.port)
            errors, _, latencies, frames, _ = watch(reader, truth, 12, of_pen=False)
            reader.close()
        self.assertGreater(frames, 300, "most of 12 s at 60 frames/s are seen by the client")
        strong = [error for error, motion, _ in errors if motion >= 4]
        self.assertGreater(len(strong), 50)
        self.assertLessEqual(sum(strong) / len(strong), 2.5, "mean touch error, mm, at plate motion >= 4 mm")
        self.assertEqual(firmware.process.returncode, 0)

    def test_no_touch_is_published_while_the_finger_rests(self):
        truth = session_truth(SESSION)
        with Firmware(session_source()) as firmware:
            reader = Reader(firmware.port)
            false_touches = 0
            for _ in range(600):
                block = reader.read()
                if block.has("ready") and truth[block.frame % len(truth)][2] < 0.5 and block.has("touch_valid"):
                    false_touches += 1
                time.sleep(0.01)
            reader.close()
        self.assertEqual(false_touches, 0)

    def test_mbpoll_sees_the_block_change(self):
        with Firmware(session_source()) as firmware:
            Reader(firmware.port).close()
            answers = []
            for _ in range(4):
                answer = run("mbpoll", "-m", "tcp", "-t", "3", "-r", "1", "-c", "40", "-1", "-p", firmware.port,
                             "127.0.0.1")
                self.assertEqual(answer.returncode, 0, answer.stdout + answer.stderr)
                values = [line.split()[1] for line in answer.stdout.splitlines() if line.startswith("[")]
                self.assertEqual(len(values), 40)
                self.assertEqual(int(values[39]), 0x1234)
                answers.append(values)
                time.sleep(0.5)
        self.assertGreater(len({tuple(a[:20]) for a in answers}), 1, "a moving touch changes the registers")

    def test_two_replays_publish_the_same_registers(self):
        blocks = []
        for name in ("first", "second"):
            log = WORK / f"{name}.csv"
            with Firmware(session_source(speed="full", repeat="false"), extra_arguments=("--registers", log)) as firmware:
                self.assertEqual(firmware.process.wait(120), 0)
            with open(log, newline="") as file:
                rows = list(csv.reader(file))
            # Latency (register 4) is the one word that depends on the machine's speed.
            blocks.append([row[:4] + row[5:] for row in rows])
        self.assertGreater(len(blocks[0]), 400, "most of 480 frames")
        self.assertEqual(blocks[0], blocks[1])


class Calibration(unittest.TestCase):
    def rest_mm(self, session, first_line=""):
        """How far the top plate of a finger at rest seems to be from where it should be."""
        source = f'kind = "session"\npath = "{session}"\nspeed = "full"\nrepeat = false'
        log = WORK / "rest.csv"
        with Firmware(source, first_line=first_line, extra_arguments=("--registers", log)) as firmware:
            self.assertEqual(firmware.process.wait(60), 0)
        with open(log, newline="") as file:
            words = [int(word) for word in list(csv.reader(file))[-1]]
        return math.dist((0, 0, 0), [(word ^ 0x8000) - 0x8000 for word in words[14:17]]) / 100

    def test_a_camera_that_sits_askew_is_measured_and_corrected(self):
        with tempfile.TemporaryDirectory() as folder:
            spec, session, mount = Path(folder) / "askew.toml", Path(folder) / "session", Path(folder) / "mount.toml"
            text = SPEC.read_text()
            spec.write_text(text.replace("position_mm = [0, -22, -3]", "position_mm = [0.8, -22.5, -2.4]")
                            .replace("look = [0, 1, 0]", "look = [0.01, 1, 0.02]"))
            self.assertNotEqual(spec.read_text(), text)
            answer = run(BINARIES / "hostgen", "render", spec, "-o", session, "--motion", "rest", "--seconds", 0.5)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            answer = run(BINARIES / "hostgen", "mount", session, "--spec", SPEC, "-o", mount)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertIn("camera", answer.stdout)
            self.assertGreater(self.rest_mm(session), 1)
            self.assertLess(self.rest_mm(session, f'mount = "{mount}"'), 0.15)

    def test_a_touched_finger_is_no_rest(self):
        answer = run(BINARIES / "hostgen", "mount", SESSION, "--spec", SPEC, "-o", WORK / "mount.toml")
        self.assertEqual(answer.returncode, 2)
        self.assertIn("a finger at rest", answer.stderr)
        self.assertFalse((WORK / "mount.toml").exists())

    def test_a_printed_board_is_found_and_one_view_of_it_is_too_few(self):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("board.png", "board.svg"):
                answer = run(BINARIES / "hostgen", "calibrate", "--print-board", Path(folder) / name)
                self.assertEqual(answer.returncode, 0, answer.stderr)
            answer = run(BINARIES / "hostgen", "calibrate", folder, "-o", Path(folder) / "lens.toml")
            self.assertEqual(answer.returncode, 2)
            self.assertRegex(answer.stdout, r"board\.png +54 .*used")
            self.assertIn("usable images: found 1 of 1, expected at least 6", answer.stderr)
            self.assertFalse((Path(folder) / "lens.toml").exists())

    def test_what_is_read_is_not_written_over(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            session, spec, images = folder / "session", folder / "spec.toml", folder / "images"
            session.mkdir()
            images.mkdir()
            for name in ("frames.y4m", "session.toml"):
                (session / name).write_bytes((SESSION / name).read_bytes())
            spec.write_bytes(SPEC.read_bytes())
            answer = run(BINARIES / "hostgen", "calibrate", "--print-board", images / "board.png")
            self.assertEqual(answer.returncode, 0, answer.stderr)
            (folder / "link.toml").symlink_to(spec)
            (folder / "hard-link.y4m").hardlink_to(session / "frames.y4m")
            (folder / "hard-link.png").hardlink_to(images / "board.png")
            mount = ("mount", session, "--spec", spec, "-o")
            calibrate = ("calibrate", images, "-o")
            kept = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
            for words in ((*mount, spec), (*mount, folder / "link.toml"), (*mount, session / "session.toml"),
                          (*mount, session / ".." / "session" / "frames.y4m"), (*mount, folder / "hard-link.y4m"),
                          (*calibrate, images / "board.png"), (*calibrate, folder / "hard-link.png"),
                          (*calibrate, folder / "lens.toml", "--plot", images / "." / "board.png"),
                          (*calibrate, folder / "lens.toml", "--plot", folder / "." / "lens.toml")):
                answer = run(BINARIES / "hostgen", *words)
                self.assertEqual(answer.returncode, 2, words)
                self.assertIn("would replace a file that this command also uses", answer.stderr, words)
            self.assertEqual({file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}, kept)

    def test_usage_errors(self):
        for words, part in ((("calibrate",), "a folder of images"), (("calibrate", "/nowhere", "-o", "x"), "no folder"),
                            (("calibrate", "--print-board", "board.pdf"), ".svg or .png"),
                            (("calibrate", "--print-board", "b.svg", "--squares", "8x6"), "an odd number"),
                            (("calibrate", "--print-board", "b.svg", "--squares", "8"), "columns and rows")):
            answer = run(BINARIES / "hostgen", *words)
            self.assertEqual(answer.returncode, 2, words)
            self.assertIn(part, answer.stderr)


class BadInput(unittest.TestCase):
    def check(self, pack):
        with tempfile.TemporaryDirectory() as folder:
            settings = Path(folder) / "board.toml"
            settings.write_text(f'pack = "{pack}"\n[source]\n{session_source()}\n[modbus]\nport = 0\n')
            return run(BINARIES / "finsightd", "--settings", settings, "--check")

    def test_the_good_pack_passes(self):
        answer = self.check(PACK)
        self.assertEqual(answer.returncode, 0, answer.stderr)

    def test_one_flipped_byte_is_refused_and_its_tensor_named(self):
        good = PACK.read_bytes()
        header_length = int.from_bytes(good[:8], "little")
        import json
        header = json.loads(good[8:8 + header_length])
        for name in ("shape.rest_mm", "touch.weights1", "map.basis", "cholesky.rows", "self_test.registers"):
            begin, end = header[name]["data_offsets"]
            bad = bytearray(good)
            bad[8 + header_length + (begin + end) // 2] ^= 0x10
            path = WORK / "flipped.safetensors"
            path.write_bytes(bad)
            answer = self.check(path)
            self.assertEqual(answer.returncode, 2)
            self.assertIn(name, answer.stderr)

    def test_a_truncated_pack_is_refused(self):
        path = WORK / "short.safetensors"
        path.write_bytes(PACK.read_bytes()[:-100])
        self.assertEqual(self.check(path).returncode, 2)

    def test_safe_mode_says_why_the_firmware_ended(self):
        for exit_code, fault in ((1, 6), (2, 5), (3, 4)):  # 3: the self-test failed
            with self.subTest(exit_code), Firmware(session_source(), extra_arguments=("--safe-mode", str(exit_code))) as safe:
                reader = Reader(safe.port)
                until = time.monotonic() + 10
                while not reader.read().words[2] and time.monotonic() < until:
                    pass  # the server answers a moment before anything has been published: no heartbeat yet
                self.assertEqual(reader.read().words[1], fault)
                reader.close()

    def test_a_used_port_is_a_clear_error(self):
        with socket.socket() as taken, tempfile.TemporaryDirectory() as folder:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            port = taken.getsockname()[1]
            settings = Path(folder) / "board.toml"
            settings.write_text(f'pack = "{PACK}"\n[source]\n{session_source()}\n[modbus]\nport = {port}\n')
            answer = run(BINARIES / "finsightd", "--settings", settings)
        self.assertEqual(answer.returncode, 1)
        self.assertIn(str(port), answer.stderr)

    def test_wrong_options_are_named(self):
        for words, named in ((("--settings", "board.toml", "--sefe-outputs"), "--sefe-outputs"),
                             (("--check", "--settings"), "--settings: needs a value"),
                             (("--check",), "--settings: is missing"),
                             (("--settings", "a.toml", "--settings", "b.toml"), "--settings: is given twice"),
                             (("--settings", WORK), f"{WORK}: is not a file"),
                             (("--settings", "board.toml", "--check", "--safe-outputs"), "only one of them"),
                             (("--settings", "board.toml", "--safe-mode", "x"), '--safe-mode: code: found "x"')):
            answer = run(BINARIES / "finsightd", *words)
            self.assertEqual(answer.returncode, 2)
            self.assertIn(named, answer.stderr)

    def test_unknown_settings_name_their_line(self):
        with tempfile.TemporaryDirectory() as folder:
            settings = Path(folder) / "board.toml"
            settings.write_text(f'pack = "{PACK}"\n[source]\n{session_source()}\n[modbus]\nprot = 1\n')
            answer = run(BINARIES / "finsightd", "--settings", settings)
        self.assertEqual(answer.returncode, 2)
        self.assertIn("board.toml:8", answer.stderr)
        self.assertIn("prot", answer.stderr)


class Hostgen(unittest.TestCase):
    def test_the_same_spec_and_seed_give_the_same_pack_bytes(self):
        packs = []
        for name, cores in (("one", "0"), ("two", "0,1")):
            path = WORK / f"{name}.safetensors"
            shutil.rmtree(f"{path}.paths", ignore_errors=True)  # of a run that broke off
            command = [BINARIES / "hostgen", "build", SPEC, "-o", path, "--scene", "probe", "--size", "coarse", "--points", "12",
                       "--forces", "3", "--training-steps", "200"]
            if len(os.sched_getaffinity(0)) > 1:
                command = ["taskset", "-c", cores] + command
            answer = run(*command)
            self.assertEqual(answer.returncode, 0, answer.stderr)
            packs.append(path.read_bytes())
        self.assertEqual(packs[0], packs[1])

    def test_an_interrupted_build_leaves_nothing_half_written(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "pack.safetensors"
            process = subprocess.Popen([BINARIES / "hostgen", "build", SPEC, "-o", path],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(3)
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(60), 1)
            # Only whole paths, for the next run to go on with.
            self.assertLessEqual(set(os.listdir(folder)), {"pack.safetensors.paths"})
            self.assertEqual([file for file in Path(folder).rglob("*.*") if ".part" in file.suffix], [])

    def test_a_figure_shows_the_strongest_touch_or_the_wanted_frame(self):
        with tempfile.TemporaryDirectory() as folder:
            images = []
            for name, words in (("touched.png", ()), ("again.png", ()), ("first.png", ("--frame", 0))):
                answer = run(BINARIES / "hostgen", "figure", SESSION, "--pack", PACK, "-o", Path(folder) / name, *words)
                self.assertEqual(answer.returncode, 0, answer.stderr)
                images.append((Path(folder) / name).read_bytes())
                self.assertEqual(images[-1][:8], b"\x89PNG\r\n\x1a\n")
                self.assertEqual(struct.unpack(">II", images[-1][16:24]), (1200, 510))
                if not words:
                    self.assertRegex(answer.stdout, r"touch at .* \(68 % within .*\), [3-6]\.\d\d N")
                else:
                    self.assertRegex(answer.stdout, r"frame 0, no touch")
        self.assertEqual(images[0], images[1])
        self.assertNotEqual(images[0], images[2])
        answer = run(BINARIES / "hostgen", "figure", SESSION, "--pack", PACK, "-o", "/tmp/x.png", "--frame", 100000)
        self.assertEqual(answer.returncode, 2)
        self.assertIn("has no frame 100000", answer.stderr)
        answer = run(BINARIES / "hostgen", "figure", SESSION, "--pack", PACK, "-o", "/tmp/x.jpg")
        self.assertEqual(answer.returncode, 2)
        self.assertIn("a name that ends in .png", answer.stderr)

    def test_bad_usage_and_bad_specs_exit_with_2(self):
        self.assertEqual(run(BINARIES / "hostgen", "nonsense").returncode, 2)
        self.assertEqual(run(BINARIES / "hostgen", "mesh", "/no/such.toml", "-o", "/tmp/x.vtu").returncode, 2)
        self.assertEqual(run(BINARIES / "hostgen", "--help").returncode, 0)
        parts_of_a_part = ("dataset", SPEC, "-o", WORK / "part.safetensors", "--only-scene", "--shard", "1/2")
        self.assertIn("excludes", run(BINARIES / "hostgen", *parts_of_a_part).stderr)

    def test_a_known_sensor_takes_no_numbers_of_a_custom_one(self):
        camera = ("camera", SPEC, "--lens", 2.2, "--sensor")
        numbers = ("--width", 640, "--height", 400, "--pixel-um", 3)
        for words in (numbers[:2], numbers[2:4], numbers[4:], ("--rolling",)):
            answer = run(BINARIES / "hostgen", *camera, "OV9281", *words)
            self.assertEqual(answer.returncode, 2, words)
            self.assertIn("a known sensor has its own", answer.stderr, words)
        answer = run(BINARIES / "hostgen", *camera, "OV9281", "--colour")
        self.assertIn("OV9281: 1280 x 800 pixels of 3 um, global shutter, colour", answer.stdout)
        answer = run(BINARIES / "hostgen", *camera, "custom", *numbers, "--rolling")
        self.assertIn("custom: 640 x 400 pixels of 3 um, rolling shutter, grey", answer.stdout)

    def test_the_coding_that_is_asked_for_is_rendered_whatever_the_preset(self):
        with tempfile.TemporaryDirectory() as folder:
            frames = {}
            for preset, coding, expected in (("lab", "", "linear"), ("coded", "", "srgb"), ("coded", "linear", "linear"),
                                             ("lab", "srgb", "srgb")):
                session = Path(folder) / f"{preset}-{coding}"
                answer = run(BINARIES / "hostgen", "render", SPEC, "-o", session, "--motion", "rest", "--seconds", 0.1,
                             "--preset", preset, *(("--coding", coding) if coding else ()))
                self.assertEqual(answer.returncode, 0, answer.stderr)
                self.assertEqual('coding = "srgb"' in (session / "session.toml").read_text(), expected == "srgb", session)
                frames[preset, coding] = (session / "frames.y4m").read_bytes()
        self.assertEqual(frames["coded", "linear"], frames["lab", ""])
        self.assertEqual(frames["coded", ""], frames["lab", "srgb"])
        self.assertNotEqual(frames["coded", ""], frames["lab", ""])


class RealFinger(unittest.TestCase):
    def test_a_recorded_motion_runs_through_to_the_registers(self):
        data = os.environ.get("FINSIGHT_DATA")
        recordings = Path(data or "") / "touch-recordings" / "recordings.csv"
        if not data or not recordings.is_file():
            self.skipTest("FINSIGHT_DATA names no touch-recordings/recordings.csv")
        # The network of these tests is trained in seconds and calls most recordings of another maker's finger unexplained.
        # In this one it finds touches in more than half of the frames.
        name = "164131"
        source = f'kind = "poses"\npath = "{recordings.resolve()}"\nrecording = "{name}"\nrepeat = true'
        with Firmware(source) as firmware:
            reader = Reader(firmware.port)
            time.sleep(0.5)
            blocks = []
            end = time.monotonic() + 7  # longer than the recording: its touches come late in it
            while time.monotonic() < end:
                blocks.append(reader.read())
                time.sleep(0.01)
            reader.close()
        for block in blocks:
            self.assertTrue(block.has("top_plate_seen"), "the top plate is seen")
            self.assertFalse(block.has("middle_plate_seen") or block.has("low_plate_seen"), "the other two are not")
            self.assertFalse(block.has("shape_valid"), "a shape from one plate is not called valid")
        touched = [block for block in blocks if block.has("touch_valid")]
        self.assertTrue(touched)
        for block in touched:
            self.assertTrue(all(math.isfinite(v) for v in block.point_mm))
            self.assertGreater(block.radius_mm, 0)


def prepare():
    """The pack and the session that the tests share; made again when a program or the spec is newer."""
    WORK.mkdir(exist_ok=True)
    newest = max((BINARIES / "hostgen").stat().st_mtime, SPEC.stat().st_mtime)
    if not PACK.exists() or PACK.stat().st_mtime < newest:
        # A third of the quick profile's states: enough for the path; scripts/demo measures the quick profile itself.
        subprocess.run([BINARIES / "hostgen", "build", SPEC, "-o", PACK, "--scene", "probe", "--points", "36", "--forces", "4",
                        "--training-steps", "4000"], check=True)
    if not SESSION.exists() or SESSION.stat().st_mtime < newest:
        subprocess.run([BINARIES / "hostgen", "render", SPEC, "-o", SESSION, "--size", "640x480", "--seconds", "8",
                        "--seed", "7"], check=True)


if __name__ == "__main__":
    prepare()
    unittest.main(verbosity=2)
