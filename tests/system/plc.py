#!/usr/bin/python3
"""What a PLC does with the device, against a running finsightd: the function blocks of Finsight.st on live registers,
the recipes of hostgen/plc/README.md, and recordings that end in another way than by command.

usage: plc.py BINARY_DIR SOURCE_DIR [unittest arguments]
The full disk needs the right to mount a small tmpfs.
"""
import re
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

from pymodbus.client import ModbusTcpClient

from end_to_end import SOURCE, Firmware, prepare, session_source  # and scripts/lib is in the path from here on
from register_block import ADDRESS, MEASUREMENTS, VALUES

sys.path.insert(0, str(SOURCE / "tests" / "plc"))
from structured_text import Machine  # noqa: E402

KEY = 18003


class Client:
    """pymodbus, with registers by name. `number` counts this client's commands."""

    def __init__(self, port, number=1000):
        self.client, self.number = ModbusTcpClient("127.0.0.1", port=port, timeout=5), number
        deadline = time.monotonic() + 20
        while not self.client.connect():
            assert time.monotonic() < deadline
            time.sleep(0.05)

    def close(self):
        self.client.close()

    def read(self, name, count=1):
        words = self.client.read_holding_registers(ADDRESS[name], count, slave=1).registers
        return words[0] if count == 1 else words

    def write(self, name, *words):
        """The exception's code, 0 for none."""
        answer = self.client.write_registers(ADDRESS[name], list(words), slave=1)
        return answer.exception_code if answer.isError() else 0

    def command(self, name):
        """Carries out a command by name; its result by name."""
        code, self.number = VALUES["command"][name], self.number + 1
        assert self.write("write_key", KEY) == 0
        assert self.write("command", code, self.number) == 0
        self.wait(lambda: self.read("own_sequence", 2) == [self.number, code] and
                  self.read("own_result") != VALUES["own_result"]["running"])
        return next(text for text, value in VALUES["own_result"].items() if value == self.read("own_result"))

    def wait(self, condition, limit_s=30):
        deadline = time.monotonic() + limit_s
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.005)


def signed(word):
    return word - 65536 if word >= 32768 else word


class Device(unittest.TestCase):
    more = ""

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        folder = self.folder.name
        self.start(f'[storage]\nsettings = "{folder}/settings.toml"\nrecordings = "{folder}/recordings"\n'
                   "record_reserve_mb = 0")

    def start(self, storage):
        self.firmware = Firmware(session_source() + "\n" + storage).__enter__()
        self.addCleanup(self.stop)
        self.client = Client(self.firmware.port)
        self.addCleanup(self.client.close)
        self.client.wait(lambda: self.client.read("heartbeat") > 0)

    def stop(self):
        if self.firmware:
            self.firmware.__exit__()
        self.firmware = None


class Blocks(Device):
    def test_the_blocks_run_on_live_registers(self):
        machine = Machine((SOURCE / "hostgen" / "plc" / "Finsight.st").read_text())
        block, order = machine.block("FB_Finsight"), machine.block("FB_FinsightCommand")
        begin, seen, dead, commanded = time.monotonic(), 0, 0, []
        self.assertEqual(self.client.write("write_key", KEY), 0)
        while time.monotonic() - begin < 15:
            machine.now_ms = int(1000 * (time.monotonic() - begin))
            words = self.client.read("status", MEASUREMENTS)
            block(words=words, poll_period=100)
            own = self.client.read("commands_given", 4)
            refused = 0
            order(execute=machine.now_ms % 1000 > 200, command=VALUES["command"]["reset_peaks"], own_sequence=own[1],
                  own_command=own[2], own_result=own[3], link_ready=True, write_exception=0)
            while order.write_request and refused in (0, 3):
                answer = self.client.client.write_registers(1000, order.request, slave=1)
                refused = answer.exception_code if answer.isError() else 0
                if refused != 3:
                    break
                order(write_exception=3)
            if order.done and (not commanded or commanded[-1] != order.sequence):
                commanded.append(order.sequence)
            self.assertFalse(order.error)
            seen, dead = seen + 1, dead + (not block.alive)
            self.assertEqual(block.touch_valid, bool(words[0] & 2) and block.alive)
            self.assertEqual(block.touch_x_valid, block.touch_valid)
            if block.touch_valid:
                self.assertAlmostEqual(block.touch_x_mm, signed(words[5]) / 100, delta=1e-9)
                self.assertAlmostEqual(block.force_real_n, words[9] / 100, delta=0.006)
            time.sleep(0.05)
        self.assertGreater(seen, 50)
        self.assertEqual(dead, 0, "alive flickers")
        self.assertGreater(len(commanded), 5)
        self.assertEqual(sorted(set(commanded)), commanded)

    def test_a_device_that_dies_is_not_alive(self):
        machine = Machine((SOURCE / "hostgen" / "plc" / "Finsight.st").read_text())
        block, words = machine.block("FB_Finsight"), self.client.read("status", MEASUREMENTS)
        self.assertTrue(block(words=words).alive)
        machine.now_ms = 400  # reads fail, so the words stay
        self.assertTrue(block(words=words).alive)  # its timer starts with the first repeated heartbeat
        machine.now_ms = 801
        self.assertFalse(block(words=words).alive)
        self.assertFalse(block.contact or block.touch_valid or block.force_valid)


class Guide(Device):
    def test_every_line_of_the_guide_does_what_it_says(self):
        guide = (SOURCE / "hostgen" / "plc" / "README.md").read_text()
        lines = re.findall(r"^(mbpoll|M) (.*?)(?: +# (.*))?$", "\n".join(re.findall(r"```\n(.*?)```", guide, re.S)), re.M)
        self.assertGreater(len(lines), 20)
        def settings():
            return self.client.read("contact_on", 13) + self.client.read("lowpass", 2)
        before, refused = settings(), 0
        for program, words, said in lines:
            if program == "M":
                self.assertEqual(self.client.write("write_key", KEY), 0)
                words = "-m tcp -p 1502 -1 -q -t 4 " + words
            words = words.replace("-p 1502", f"-p {self.firmware.port}").split()
            ran = subprocess.run(["mbpoll", *words], capture_output=True, text=True, timeout=20)
            self.assertEqual(ran.returncode != 0, "refused" in said, (words, ran.stdout, ran.stderr))
            refused += ran.returncode != 0
            expected = [re.sub(r"\s+", "", pair) for pair in re.findall(r"\[\d+\]: +\d+(?= |$)", said)]
            for pair in expected:
                self.assertIn(pair, re.sub(r"[ \t]+", "", ran.stdout))
            running = VALUES["own_result"]["running"]
            self.client.wait(lambda: self.client.client.read_holding_registers(1212, 1, slave=1).registers != [running])
        self.assertEqual(refused, 1)
        # Whoever follows the guide leaves the device as it was.
        self.assertEqual(settings(), before)


class ProcessHelpers(Device):
    def test_tare_peaks_and_events(self):
        client = self.client
        client.wait(lambda: client.read("status") & 2)
        self.assertEqual(client.command("tare_deformation"), "done")
        client.wait(lambda: client.read("process_state") & 2)
        self.assertEqual(client.command("reset_peaks"), "done")
        time.sleep(13)  # the session has wandered through everything
        net, peak, low = (signed(client.read(f"deformation_{what}")) for what in ("net", "peak", "minimum"))
        self.assertTrue(low <= net <= peak)
        self.assertGreater(peak - low, 100)  # 1 mm
        self.assertGreater(client.read("contact_made_count"), 0)
        self.assertGreater(client.read("contact_lost_count"), 0)
        self.assertEqual(client.read("events") & 3, 3)
        self.assertEqual(client.command("clear_tare"), "done")
        client.wait(lambda: not client.read("process_state") & 7)
        self.assertEqual(client.command("reset_events"), "done")

    def test_settings_are_written_and_the_delay_is_shown(self):
        self.assertEqual(self.client.write("write_key", KEY), 0)
        self.assertEqual(self.client.write("lowpass", 10, 15), 0)
        self.client.wait(lambda: self.client.read("lowpass_delay") == 1592)
        self.assertEqual(self.client.read("lowpass", 35)[:3], [10, 15, 0])
        self.assertEqual(self.client.write("lowpass", 1001), 3)
        self.assertEqual(self.client.write("events", 0), 2)


class CutRecordings(Device):
    def replayed(self, session):
        """Frames of a replay to the end, and what it says."""
        with Firmware(f'kind = "session"\npath = "{session}"\nspeed = "full"') as again:
            self.assertEqual(again.process.wait(60), 0)
        return int(re.search(r"frames (\d+)", again.errors).group(1)), again.errors

    def test_a_kill_in_mid_recording(self):
        self.assertEqual(self.client.command("record"), "done")
        self.client.wait(lambda: self.client.read("recording_s") >= 1)
        self.firmware.process.kill()
        self.firmware.process.wait()
        self.firmware = None
        session = Path(self.folder.name) / "recordings" / "session-0001"
        frames, said = self.replayed(session)
        self.assertGreaterEqual(frames, 40)
        self.assertIn("cut off", said)
        rows = (session / "registers.csv").read_text().splitlines()
        self.assertLessEqual(abs(len(rows) - 1 - frames), 1)

    def test_a_full_disk(self):
        disk = Path(self.folder.name) / "disk"
        disk.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=20m", "tmpfs", disk], capture_output=True)
        if mounted.returncode:
            self.skipTest("no right to mount")
        self.addCleanup(subprocess.run, ["umount", "-l", disk])
        for reserve_mb in (0, 8):
            self.stop()
            self.start(f'[storage]\nrecordings = "{disk}"\nrecord_reserve_mb = {reserve_mb}')
            self.assertEqual(self.client.command("record"), "done")
            self.client.wait(lambda: self.client.read("recording") == VALUES["recording"]["full"])
            session = sorted(disk.iterdir())[-1]
            frames, said = self.replayed(session)
            self.assertGreater(frames, 20)
            self.assertNotIn("cut off", said)
            self.assertLess(self.client.read("recording_mb_left"), 3)
            self.assertEqual(self.client.command("record"), "not_possible")
            subprocess.run(["rm", "-r", session], check=True)


if __name__ == "__main__":
    prepare()
    unittest.main(verbosity=2)
