#!/usr/bin/python3
"""One finsightd with several fingers, read by clients that we did not write.

usage: several_fingers.py BINARY_DIR SOURCE_DIR [unittest arguments]
"""
import csv
import shutil
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

from pymodbus.client import ModbusTcpClient

from end_to_end import BINARIES, PACK, SESSION, SOURCE, SPEC, WORK, prepare, run
from firmware_process import free_port
from register_block import ADDRESS, VALUES

KEY = 18003
RIGHT_SPEC, RIGHT_PACK, RIGHT_SESSION = WORK / "right.toml", WORK / "right.safetensors", WORK / "right"
GATHERED = 74  # registers from 2000 on
STRIDE = ADDRESS["finger_2_status"] - ADDRESS["finger_1_status"]
# What a finger's part of the gathered block repeats, by the names of its own registers.
REPEATED = ("status", "fault", "heartbeat", "age", "touch_x", "touch_y", "touch_z", "touch_uncertainty", "force",
            "force_uncertainty", "deformation_level", "limits", "force_normal", "force_normal_uncertainty", "force_across",
            "force_along")


def prepare_right():
    """The other finger: softer, with markers of its own, and a session in which it is touched otherwise."""
    prepare()
    text = SPEC.read_text()
    for marker in (2, 1, 0):
        text = text.replace(f"marker_id = {marker}\n", f"marker_id = {marker + 10}\n")
    text = text.replace("youngs_modulus_mpa = 10", "youngs_modulus_mpa = 8")
    if not RIGHT_SPEC.exists() or RIGHT_SPEC.read_text() != text:
        RIGHT_SPEC.write_text(text)
    newest = max((BINARIES / "hostgen").stat().st_mtime, RIGHT_SPEC.stat().st_mtime)
    if not RIGHT_PACK.exists() or RIGHT_PACK.stat().st_mtime < newest:
        subprocess.run([BINARIES / "hostgen", "build", RIGHT_SPEC, "-o", RIGHT_PACK, "--scene", "probe", "--size", "coarse",
                        "--points", "24", "--forces", "4", "--training-steps", "2000"], check=True)
    if not RIGHT_SESSION.exists() or RIGHT_SESSION.stat().st_mtime < newest:
        shutil.rmtree(RIGHT_SESSION, ignore_errors=True)
        subprocess.run([BINARIES / "hostgen", "render", RIGHT_SPEC, "-o", RIGHT_SESSION, "--size", "640x480",
                        "--seconds", "4", "--seed", "11"], check=True)


def finger(name, pack, session, speed="recorded", repeat="true", more=""):
    return (f'[[finger]]\nname = "{name}"\npack = "{pack}"\n{more}[finger.source]\nkind = "session"\n'
            f'path = "{session}"\nspeed = "{speed}"\nrepeat = {repeat}\n')


LEFT, RIGHT = finger("left", PACK, SESSION), finger("right", RIGHT_PACK, RIGHT_SESSION)


class Fingers:
    """A running finsightd with these [[finger]] tables; the end of a `with` block stops it."""

    def __init__(self, *tables, more="", extra_arguments=()):
        self.scratch = tempfile.TemporaryDirectory()
        self.folder, self.port = Path(self.scratch.name), free_port()
        board = self.folder / "board.toml"
        board.write_text(f'[modbus]\nport = {self.port}\n[shape]\ntier = "map"\n[storage]\n'
                         f'settings = "{self.folder}/settings.toml"\nrecordings = "{self.folder}/recordings"\n'
                         + more + "".join(tables))
        self.process = subprocess.Popen([BINARIES / "finsightd", "--settings", board, *extra_arguments],
                                        stderr=subprocess.PIPE, text=True)
        self.client = ModbusTcpClient("127.0.0.1", port=self.port, timeout=2)

    def __enter__(self):
        deadline = time.monotonic() + 20
        while not self.client.connect():
            assert self.process.poll() is None and time.monotonic() < deadline, self.process.stderr.read()
            time.sleep(0.05)
        return self

    def __exit__(self, *_):
        self.client.close()
        self.process.terminate()
        self.errors = self.process.communicate(timeout=20)[1]
        self.scratch.cleanup()

    def read(self, address, count, unit=1):
        answer = self.client.read_holding_registers(address, count, slave=unit)
        assert not answer.isError(), answer
        return answer.registers

    def gathered(self, unit=1):
        words = self.read(ADDRESS["fingers"], GATHERED, unit)
        return lambda name: words[ADDRESS[name] - ADDRESS["fingers"]]

    def one(self, name, unit):
        return self.read(ADDRESS[name], 1, unit)[0]

    def write(self, unit, address, words):
        assert not self.client.write_register(ADDRESS["write_key"], KEY, slave=unit).isError()
        return self.client.write_registers(address, words, slave=unit)

    def command(self, unit, name, number, limit_s=30):
        """Its result, from the unit that it was given to."""
        answer = self.write(unit, ADDRESS["command"], [VALUES["command"][name], number])
        assert not answer.isError(), answer
        deadline = time.monotonic() + limit_s
        while self.one("result_sequence", unit) != number:
            assert time.monotonic() < deadline, f"{name} has no result"
            time.sleep(0.02)
        return self.one("result", unit)

    def wait(self, is_true, limit_s=20):
        deadline = time.monotonic() + limit_s
        while not is_true():
            assert time.monotonic() < deadline, "never came true"
            time.sleep(0.02)


def has(word, register, bit):
    return bool(word >> VALUES[register][bit] & 1)


def without_latency(rows):
    return [row[:4] + row[5:] for row in rows]


def log_of(file):
    with open(file, newline="") as opened:
        return list(csv.reader(opened))


class SeveralFingers(unittest.TestCase):
    def test_units_1_and_2_are_the_fingers_and_every_unit_gathers_both(self):
        with Fingers(LEFT, RIGHT) as device:
            device.wait(lambda: has(device.one("status", 1), "status", "touch_valid"))
            device.wait(lambda: has(device.one("status", 2), "status", "touch_valid"))
            checksums = [device.read(ADDRESS["model_checksum"], 2, unit) for unit in (1, 2)]
            self.assertNotEqual(*checksums)
            self.assertEqual(device.read(ADDRESS["model_checksum"], 2, 255), checksums[0])
            for unit in (1, 2, 255):
                self.assertEqual(device.gathered(unit)("fingers"), 2)
            self.assertEqual(device.client.read_holding_registers(0, 1, slave=3).exception_code, 11)
            agreed = 0
            for _ in range(500):  # the two reads are rarely of two frames
                gathered, own = device.gathered(), device.read(0, 85, 2)
                if gathered("finger_2_heartbeat") != own[2]:
                    continue
                agreed += 1
                for i, name in enumerate(REPEATED):
                    if name != "age":
                        word = ADDRESS["finger_2_status"] - ADDRESS["finger_1_status"] + i
                        self.assertEqual(device_word(gathered, word), own[ADDRESS[name]], name)
            self.assertGreater(agreed, 100)

    def test_mbpoll_reads_both_units_and_the_gathered_block(self):
        with Fingers(LEFT, RIGHT) as device:
            device.wait(lambda: has(device.gathered()("gripper_state"), "gripper_state", "all_ready"))
            def mbpoll(unit, first, count):
                answer = run("mbpoll", "-m", "tcp", "-a", unit, "-0", "-1", "-q", "-t", "4", "-r", first, "-c", count, "-p",
                             device.port, "127.0.0.1")
                self.assertEqual(answer.returncode, 0, answer.stdout + answer.stderr)
                return [int(line.split()[1]) for line in answer.stdout.splitlines() if line.startswith("[")]
            for unit in (1, 2):
                self.assertEqual(mbpoll(unit, 39, 1), [0x1234])
                self.assertEqual(mbpoll(unit, 2000, 1), [2])
            self.assertEqual(mbpoll(1, 36, 2), device.read(36, 2, 1))

    def test_what_is_gathered_is_of_one_frame_of_each_finger(self):
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log.csv"
            with Fingers(LEFT, RIGHT, extra_arguments=("--registers", log)) as device:
                device.wait(lambda: has(device.gathered()("gripper_state"), "gripper_state", "all_ready"))
                reads = []
                while len(reads) < 400:
                    reads.append(device.read(ADDRESS["fingers"], GATHERED))
                    time.sleep(0.005)
            for n, name in enumerate(("left", "right")):
                published = {row[2]: row for row in log_of(Path(folder) / f"log-{name}.csv")[1:]}
                compared = 0
                for words in reads:
                    part = words[10 + n * STRIDE:10 + (n + 1) * STRIDE]
                    row = published.get(str(part[2]))
                    if not row:
                        continue  # published without a frame
                    compared += 1
                    for name_of_word, word in zip(REPEATED, part):
                        if name_of_word != "age":
                            self.assertEqual(word, int(row[ADDRESS[name_of_word]]), name_of_word)
                self.assertGreater(compared, 300)

    def test_commands_and_settings_are_a_units_own(self):
        with Fingers(LEFT, RIGHT) as device:
            device.wait(lambda: has(device.gathered()("gripper_state"), "gripper_state", "all_ready"))
            self.assertFalse(device.write(2, ADDRESS["hold_time"], [77]).isError())
            self.assertEqual([device.one("hold_time", unit) for unit in (1, 2)], [200, 77])
            self.assertEqual(device.client.write_register(ADDRESS["hold_time"], 78, slave=1).exception_code, 4)
            self.assertEqual(device.command(2, "save", 5), 0)
            self.assertTrue((device.folder / "settings-right.toml").exists())
            self.assertFalse((device.folder / "settings-left.toml").exists())
            self.assertEqual(device.command(2, "record", 6), 0)
            time.sleep(1)
            self.assertEqual([device.one("recording", unit) for unit in (1, 2)], [0, 1])
            self.assertEqual(device.command(2, "stop", 7), 0)
            self.assertTrue((device.folder / "recordings/right/session-0001/frames.y4m").exists())
            self.assertEqual(device.one("result_sequence", 1), 0)

    def test_zero_all_given_to_one_unit_zeroes_both(self):
        with tempfile.TemporaryDirectory() as folder:
            rest = []
            for spec, name in ((SPEC, "left"), (RIGHT_SPEC, "right")):
                rest.append(Path(folder) / name)
                answer = run(BINARIES / "hostgen", "render", spec, "-o", rest[-1], "--motion", "rest", "--seconds", 1)
                self.assertEqual(answer.returncode, 0, answer.stderr)
            with Fingers(finger("left", PACK, rest[0]), finger("right", RIGHT_PACK, rest[1])) as device:
                device.wait(lambda: has(device.gathered()("gripper_state"), "gripper_state", "all_ready"))
                self.assertEqual(device.command(2, "zero_all", 9), 0)
                gathered = device.gathered()
                for n in (1, 2):
                    self.assertTrue(has(gathered(f"finger_{n}_status"), "status", "zeroed"))
                self.assertEqual(device.one("result_sequence", 1), 0)
                # A reset restarts the device, with both fingers; nothing was saved.
                self.assertEqual(device.command(1, "reset", 10), 0)
                def zeroes():
                    try:
                        gathered = device.gathered()
                        return [has(gathered(f"finger_{n}_status"), "status", "zeroed") for n in (1, 2)]
                    except Exception:  # it restarts
                        device.client.connect()
                        return None
                device.wait(lambda: zeroes() == [False, False])


    def test_a_finger_with_a_bad_pack_has_fault_5_and_the_other_works(self):
        with tempfile.TemporaryDirectory() as folder:
            broken = Path(folder) / "broken.safetensors"
            broken.write_bytes(PACK.read_bytes()[:5000])
            with Fingers(finger("left", broken, SESSION), RIGHT) as device:
                device.wait(lambda: has(device.one("status", 2), "status", "ready"))
                device.wait(lambda: device.one("fault", 1) == VALUES["fault"]["settings_or_model_refused"])
                gathered = device.gathered()
                self.assertEqual(gathered("finger_1_fault"), VALUES["fault"]["settings_or_model_refused"])
                self.assertEqual(gathered("finger_2_fault"), 0)
                self.assertTrue(has(gathered("gripper_state"), "gripper_state", "any_fault"))
                self.assertEqual(gathered("force_sum"), 65535)
                heartbeats = [device.one("heartbeat", 1)]
                device.wait(lambda: device.one("heartbeat", 1) != heartbeats[0])
                self.assertEqual(device.command(1, "zero", 3), 1)
                self.assertEqual(device.command(2, "zero_all", 3), 1)
                self.assertEqual(device.one("calibration_date", 1), 0)
            self.assertIn("left: ", device.errors)
            self.assertIn("broken.safetensors", device.errors)

    def test_a_finger_with_a_bad_mount_fit_or_measured_file_has_fault_5_and_the_other_works(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            measured = folder / "measured/right/mount.toml"
            measured.parent.mkdir(parents=True)
            bad = folder / "bad.toml"
            bad.write_text("[camera]\nturn_deg = 7\n")
            page = f'[page]\nport = {free_port()}\nfolder = "{folder}/page"\nmeasured = "{folder}/measured"\n'
            for key, file, said in (("mount", folder / "none.toml", "none.toml: no such file"),
                                    ("mount", bad, "bad.toml:2: camera.turn_deg: found 7, expected 3 numbers"),
                                    ("fit", bad, "bad.toml:1: model: found nothing, expected a text"),
                                    (None, measured, f"{measured}:1: ")):
                more = f'{key} = "{file}"\n' if key else ""
                if not key:
                    measured.write_text("broken\n")
                tables = (LEFT, finger("right", RIGHT_PACK, RIGHT_SESSION, more=more))
                with self.subTest(said), Fingers(*tables, more=page) as device:
                    device.wait(lambda: has(device.one("status", 1), "status", "ready"))
                    device.wait(lambda: device.one("fault", 2) == VALUES["fault"]["settings_or_model_refused"])
                    self.assertEqual(device.one("fault", 1), 0)
                    answer = run(BINARIES / "finsightd", "--settings", device.folder / "board.toml", "--check")
                    self.assertEqual(answer.returncode, 2)
                    self.assertIn(said, answer.stderr)
                self.assertRegex(device.errors, rf"right: .*{said}")

    def test_a_session_that_breaks_in_the_middle_costs_the_other_finger_nothing(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            broken = folder / "broken"
            shutil.copytree(RIGHT_SESSION, broken)
            frames = broken / "frames.y4m"
            with open(frames, "r+b") as file:
                file.truncate(frames.stat().st_size // 2)
            logs = []
            for name, tables in (("alone", ()), ("beside", (finger("right", RIGHT_PACK, broken, "full", "false"),))):
                log = folder / f"{name}.csv"
                left = finger("left", PACK, SESSION, "full", "false")
                with Fingers(left, *tables, extra_arguments=("--registers", log)) as device:
                    device.process.wait(120)
                logs.append(without_latency(log_of(folder / f"{name}-left.csv")))
            self.assertEqual(len(logs[0]), 481)
            self.assertEqual(logs[0], logs[1])
            self.assertLess(len(log_of(folder / "beside-right.csv")), 130)

    def test_a_finger_whose_frames_end_says_so_while_the_other_goes_on(self):
        with Fingers(LEFT, finger("right", RIGHT_PACK, RIGHT_SESSION, "full", "false")) as device:
            device.wait(lambda: device.one("fault", 2) == VALUES["fault"]["camera_lost"], 60)
            before = device.gathered()
            time.sleep(1)
            after = device.gathered()
            self.assertEqual(before("finger_1_fault"), 0)
            self.assertGreater((after("finger_1_heartbeat") - before("finger_1_heartbeat")) & 0xFFFF, 20)
            self.assertGreater(after("oldest_age"), before("oldest_age"))
            self.assertEqual(device.process.poll(), None)

    def test_fingers_of_different_frame_rates_keep_their_own(self):
        with tempfile.TemporaryDirectory() as folder:
            slow = Path(folder) / "slow"
            shutil.copytree(RIGHT_SESSION, slow)
            text = (slow / "session.toml").read_text()
            rate = next(line for line in text.splitlines() if line.startswith("frames_per_second"))
            (slow / "session.toml").write_text(text.replace(rate, "frames_per_second = 20"))
            frames = (slow / "frames.y4m").read_bytes()
            head = frames.index(b"\n")
            (slow / "frames.y4m").write_bytes(frames[:head].replace(b"F60:1", b"F20:1") + frames[head:])
            with Fingers(LEFT, finger("right", RIGHT_PACK, slow)) as device:
                device.wait(lambda: has(device.gathered()("gripper_state"), "gripper_state", "all_ready"))
                before = device.gathered()
                time.sleep(3)
                after = device.gathered()
                beats = [(after(f"finger_{n}_heartbeat") - before(f"finger_{n}_heartbeat")) & 0xFFFF for n in (1, 2)]
                self.assertAlmostEqual(beats[1], 60, delta=8)
                self.assertGreater(beats[0], 2 * beats[1])
                self.assertGreaterEqual(after("oldest_age"), after("finger_2_age"))

    def test_the_other_fingers_markers_in_view_change_nothing(self):
        # The right finger's session seen as the left finger: all of its markers are foreign.
        with tempfile.TemporaryDirectory() as folder:
            foreign = Path(folder) / "foreign"
            shutil.copytree(RIGHT_SESSION, foreign)
            text = (foreign / "session.toml").read_text()
            self.assertIn("[10, 11, 12]", text)
            (foreign / "session.toml").write_text(text.replace("[10, 11, 12]", "[0, 1, 2]"))
            with Fingers(finger("left", PACK, foreign), RIGHT) as device:
                device.wait(lambda: device.one("fault", 1) == VALUES["fault"]["markers_lost"])
                self.assertEqual(device.one("fault", 2), 0)
                for _ in range(200):
                    self.assertFalse(has(device.one("status", 1), "status", "top_plate_seen"))

    def test_two_fingers_with_one_camera_and_colliding_units_are_refused_by_name(self):
        camera = ('[finger.source]\nkind = "camera"\ncamera = "usb-1"\nwidth_px = 640\nheight_px = 480\n'
                  'frames_per_second = 60\n[finger.source.lens]\nfx_fy_cx_cy = [457, 457, 319.5, 239.5]\n'
                  'k1_k2_p1_p2_k3 = [0, 0, 0, 0, 0]\n')
        for tables, reason in (
                ("".join(f'[[finger]]\nname = "{n}"\npack = "{PACK}"\n{camera}' for n in ("left", "right")),
                 'found "usb-1", and "usb-1" of finger "left", expected names of two cameras'),
                (LEFT + RIGHT + '[modbus.serial]\ndevice = "/dev/ttyS9"\nunit = 2\n',
                 "modbus.serial.unit: found 2, expected 1, as with TCP (modbus.unit): the fingers are units 1 to 2 on both")):
            with tempfile.TemporaryDirectory() as folder:
                board = Path(folder) / "board.toml"
                board.write_text(f"[modbus]\nport = 1\n{tables}")
                answer = run(BINARIES / "finsightd", "--settings", board, "--check")
                self.assertEqual(answer.returncode, 2)
                self.assertIn(reason, answer.stderr)
                self.assertIn("board.toml:", answer.stderr)

    def test_a_check_tells_of_every_finger_what_is_wrong(self):
        with tempfile.TemporaryDirectory() as folder:
            board = Path(folder) / "board.toml"
            board.write_text("[modbus]\nport = 1\n" + "".join(
                f'[[finger]]\nname = "{name}"\npack = "{folder}/{name}.safetensors"\n[finger.source]\nkind = "session"\npath = "{folder}/none"\n'
                for name in ("left", "right")))
            answer = run(BINARIES / "finsightd", "--settings", board, "--check")
            self.assertEqual(answer.returncode, 2)
            for name in ("left", "right"):
                self.assertRegex(answer.stderr, rf"{name}: .*{name}\.safetensors")


def device_word(gathered, offset):
    """The word that is so far behind finger 1's status."""
    name = next(n for n, address in ADDRESS.items() if address == ADDRESS["finger_1_status"] + offset)
    return gathered(name)


if __name__ == "__main__":
    prepare_right()
    unittest.main(verbosity=2)
