#!/usr/bin/python3
"""Modbus clients that we did not write, finsightctl and the Node-RED flow against a running finsightd.

usage: modbus_clients.py BINARY_DIR SOURCE_DIR [unittest arguments]
The test of npm's modbus-serial needs FINSIGHT_NODE_MODULES, a node_modules folder that has it; that of the flow needs
node.
"""
import csv
import json
import os
import shutil
import tempfile
import time
import unittest
from pathlib import Path

from pymodbus.client import ModbusTcpClient

from end_to_end import SOURCE, Firmware, prepare, run, session_source  # and scripts/lib is in the path from here on
from register_block import ADDRESS, VALUES, Block, Reader

KEY = 18003


def firmware(folder, more=""):
    storage = f'[storage]\nsettings = "{folder}/settings.toml"\nrecordings = "{folder}/recordings"'
    return Firmware(session_source() + "\n" + storage + more)


def ctl(port, *words):
    return run(SOURCE / "scripts" / "finsightctl", words[0], "127.0.0.1", *words[1:], "--port", port)


class Clients(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.firmware = firmware(self.folder.name).__enter__()
        self.addCleanup(self.firmware.__exit__)
        self.port = self.firmware.port
        Reader(self.port).close()

    def wait_for(self, read, is_right):
        """Settings take effect with the next frame, which may take a while on a busy machine."""
        deadline = time.monotonic() + 20
        while not is_right(answer := read()):
            self.assertLess(time.monotonic(), deadline, answer)
            time.sleep(0.02)
        return answer

    def test_mbpoll_reads_settings_and_writes_them_once_unlocked(self):
        def mbpoll(*words):
            return run("mbpoll", "-m", "tcp", "-0", "-1", "-q", "-p", self.port, *words)
        answer = mbpoll("-t", "4", "-r", 1016, "127.0.0.1")
        self.assertIn("200", answer.stdout)
        refused = mbpoll("-t", "4", "-r", 1016, "127.0.0.1", 100)
        self.assertNotEqual(refused.returncode, 0)
        self.assertIn("Slave device or server failure", refused.stdout + refused.stderr)
        self.assertEqual(mbpoll("-t", "4", "-r", 1004, "127.0.0.1", KEY).returncode, 0)
        self.assertEqual(mbpoll("-t", "4", "-r", 1016, "127.0.0.1", 100).returncode, 0)
        self.assertIn("100", mbpoll("-t", "4", "-r", 1016, "127.0.0.1").stdout)
        floats = mbpoll("-t", "4:hex", "-r", 46, "-c", 2, "127.0.0.1").stdout
        self.assertIn("0x1234", floats)
        self.assertIn("0x5678", floats)

    def test_pymodbus_reads_and_writes_in_both_word_orders(self):
        client = ModbusTcpClient("127.0.0.1", port=self.port, timeout=2)
        self.assertTrue(client.connect())
        self.assertEqual(client.write_register(1016, 100, slave=1).exception_code, 4)
        self.assertFalse(client.write_register(1004, KEY, slave=1).isError())
        self.assertFalse(client.write_registers(1012, [300, 250], slave=1).isError())
        both = client.readwrite_registers(read_address=1012, read_count=3, write_address=1016, write_registers=[123],
                                          slave=1)
        self.assertEqual(both.registers, [300, 250, 1000])
        self.assertEqual(client.read_input_registers(1016, 1, slave=1).registers, [123])
        self.assertEqual(client.write_registers(1010, [10, 10], slave=1).exception_code, 3)
        self.assertEqual(client.write_register(1002, 10, slave=1).exception_code, 2)
        self.assertEqual(client.read_coils(0, 1, slave=1).exception_code, 1)
        for order, code in (("ABCD", 0), ("CDAB", 1)):
            self.assertFalse(client.write_register(1019, code, slave=1).isError())
            expected = [0x1234, 0x5678] if order == "ABCD" else [0x5678, 0x1234]
            words = self.wait_for(lambda: client.read_holding_registers(0, 48, slave=1).registers,
                                  lambda words: words[46:48] == expected and Block(words).has("shape_valid"))
            block = Block(words)
            level_mm = block.deformation_permille / 1000 * 6  # the finger's rated deformation is 6 mm
            self.assertAlmostEqual(block.float_at(ADDRESS["deformation_float"], order), level_mm, delta=0.004)
        from pymodbus.mei_message import ReadDeviceInformationRequest
        identity = client.execute(ReadDeviceInformationRequest(read_code=1, object_id=0, unit=1))
        self.assertEqual(identity.information[0], b"Finsight")
        client.close()

    def test_modbus_serial_of_npm(self):
        modules = os.environ.get("FINSIGHT_NODE_MODULES")
        if not modules:
            self.skipTest("FINSIGHT_NODE_MODULES names no node_modules folder")
        program = f"""
const ModbusRTU = require('modbus-serial');
(async () => {{
  const client = new ModbusRTU();
  await client.connectTCP('127.0.0.1', {{port: {self.port}}});
  client.setID(1);
  client.setTimeout(2000);
  const block = await client.readHoldingRegisters(0, 48);
  const long = await client.readInputRegisters(46, 2);
  let refused = 0;
  try {{ await client.writeRegister(1016, 100); }} catch (error) {{ refused = error.modbusCode; }}
  await client.writeRegister(1004, {KEY});
  await client.writeRegisters(1012, [310, 260]);
  const read = await client.readHoldingRegisters(1012, 2);
  const identity = await client.readDeviceIdentification(1, 0);
  console.log(JSON.stringify([block.data[39], long.buffer.readUInt32BE(0), refused, read.data, identity.data[0]]));
  client.close(() => process.exit(0));
}})().catch(error => {{ console.error(error); process.exit(1); }});
"""
        answer = run("node", "-e", program, env={**os.environ, "NODE_PATH": modules})
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertEqual(answer.stdout.strip(), '[4660,305419896,4,[310,260],"Finsight"]')

    def test_finsightctl_shows_sets_and_commands(self):
        shown = ctl(self.port, "show")
        self.assertEqual(shown.returncode, 0, shown.stderr)
        self.assertIn("test_constant_long     305419896", shown.stdout)
        watched = ctl(self.port, "watch", "--seconds", "1")
        self.assertEqual(watched.returncode, 0, watched.stderr)
        self.assertGreaterEqual(len(watched.stdout.splitlines()), 4)
        self.assertIn("ready", watched.stdout)
        self.assertEqual(ctl(self.port, "set", "contact_on=0.35", "hold_time=150").returncode, 0)
        shown = ctl(self.port, "show").stdout
        self.assertIn("contact_on             0.35 N", shown)
        self.assertIn("hold_time              150 ms", shown)
        self.assertEqual(ctl(self.port, "set", "after_hold=keep").returncode, 0)
        self.assertIn("after_hold             1   (keep)", ctl(self.port, "show").stdout)
        self.assertEqual(ctl(self.port, "set", "contact_on=0.05").returncode, 1)
        self.assertEqual(ctl(self.port, "set", "contact=1").returncode, 2)
        self.assertEqual(ctl(self.port, "do", "dance").returncode, 2)
        self.assertEqual(ctl(1, "show").returncode, 1)

    def test_finsightctl_takes_options_anywhere_and_names_a_wrong_key(self):
        ctl = SOURCE / "scripts" / "finsightctl"
        for words in (("--port", self.port, "set", "127.0.0.1", "hold_time=160"),
                      ("set", "--port", self.port, "127.0.0.1", "hold_time=161", "--key", KEY),
                      ("set", "127.0.0.1", "hold_time=162", "--port", self.port, "contact_on=0.4", "lowpass=2.5")):
            answer = run(ctl, *words)
            self.assertEqual(answer.returncode, 0, answer.stderr)
        shown = run(ctl, "show", "127.0.0.1", "--port", self.port).stdout
        self.assertIn("hold_time              162 ms", shown)
        self.assertIn("lowpass                2.5 Hz", shown)
        wrong = run(ctl, "set", "127.0.0.1", "hold_time=163", "--port", self.port, "--key", 4711)
        self.assertEqual(wrong.returncode, 1)
        self.assertIn("4711 is not the device's key", wrong.stderr)
        unknown = run(ctl, "show", "127.0.0.1", "--prot", self.port)
        self.assertEqual(unknown.returncode, 2)
        self.assertIn("--prot", unknown.stderr)

    def test_finsightctl_refuses_what_it_would_have_to_guess_and_writes_nothing_then(self):
        def settings():
            lines = ctl(self.port, "show").stdout.splitlines()
            return [line for line in lines if 1010 <= int(line.split()[0]) < 1110]
        before = settings()
        for words, reason in (
                (("watch", "--seconds", "-3"), "'-3': expected a number above 0"),
                (("watch", "--seconds", "nan"), "'nan': expected a number above 0"),
                (("set", "hold_time=150", "hold_time=160"), "hold_time: is given twice"),
                (("set", "contact_on=0.603"), "contact_on: '0.603': expected a multiple of 0.01 N"),
                (("set", "hold_time=150", "contact_on=1000"), "contact_on: '1000': expected 0.01 to 100 N"),
                (("set", "lowpass=2", "contact_on=0.05"), "contact_on must exceed contact_off: they would be 0.05 N and 0.10 N"),
                (("set",), "expected NAME=VALUE"),
                (("do", "tare"), "expected one of zero")):
            with self.subTest(words):
                answer = ctl(self.port, *words)
                self.assertNotEqual(answer.returncode, 0)
                self.assertIn(reason, answer.stderr)
        self.assertEqual(settings(), before)
        self.assertEqual(len(before), 23)  # 20 settings, and gravity
        for words, reason in (((), "expected watch, show, set or do"), (("show",), "show: expected the device's address")):
            answer = run(SOURCE / "scripts" / "finsightctl", *words)
            self.assertEqual(answer.returncode, 2)
            self.assertIn(reason, answer.stderr)

    def test_finsightctl_is_one_file_that_works_anywhere(self):
        copy = shutil.copy(SOURCE / "scripts" / "finsightctl", self.folder.name)
        shown = run(copy, "show", "127.0.0.1", "--port", self.port, cwd="/")
        self.assertEqual(shown.returncode, 0, shown.stderr)
        self.assertIn("fault                  0   (none)", shown.stdout)

    def test_the_node_red_flow_scales_what_pymodbus_reads(self):
        node = shutil.which("node")
        if not node:
            self.skipTest("node is not installed")
        flow = json.loads((SOURCE / "hostgen" / "plc" / "Finsight.node-red.json").read_text())
        function = next(part["func"] for part in flow if part["id"] == "finsight-scale")
        reader = Reader(self.port)
        block = self.wait_for(reader.read, lambda block: block.has("touch_valid"))
        reader.close()
        program = f"const scale = msg => {{{function}}};console.log(JSON.stringify(scale({{payload: {block.words}}})));"
        answer = run(node, "-e", program)
        self.assertEqual(answer.returncode, 0, answer.stderr)
        scaled = json.loads(answer.stdout)["payload"]
        self.assertEqual([scaled[f"touch_{axis}_mm"] for axis in "xyz"], list(block.point_mm))
        self.assertAlmostEqual(scaled["touch_x_real_mm"], block.point_mm[0], delta=0.006)
        self.assertEqual(scaled["force_n"], block.force_n)
        self.assertEqual(scaled["frame_counter"], block.frame)
        self.assertEqual({bit: scaled[bit] for bit in VALUES["status"]}, {bit: block.has(bit) for bit in VALUES["status"]})
        self.assertEqual(scaled["fault_text"], "none")
        self.assertIsNone(scaled["temperature_real_degc"])

    def test_a_master_that_stops_writing_is_a_fault_until_it_writes_again(self):
        client = ModbusTcpClient("127.0.0.1", port=self.port, timeout=2)
        self.assertTrue(client.connect())
        self.assertFalse(client.write_register(1004, KEY, slave=1).isError())
        self.assertFalse(client.write_register(1022, 1000, slave=1).isError())
        def fault():
            return client.read_holding_registers(0, 2, slave=1).registers
        for value in range(15):  # 3 s
            self.assertFalse(client.write_register(1006, value, slave=1).isError())
            time.sleep(0.2)
        self.assertEqual(fault()[1], 0)
        lost = self.wait_for(fault, lambda words: words[1] == VALUES["fault"]["master_lost"])
        self.assertTrue(lost[0] >> 15)
        self.assertFalse(client.write_register(1006, 1, slave=1).isError())
        self.wait_for(fault, lambda words: words[1] == 0)
        self.assertFalse(client.write_register(1022, 0, slave=1).isError())
        client.close()

    def test_diagnostics_tell_who_and_how_the_device_is(self):
        client = ModbusTcpClient("127.0.0.1", port=self.port, timeout=2)
        self.assertTrue(client.connect())
        def at(words, name, count=1):
            return words[ADDRESS[name] - 3000:ADDRESS[name] - 3000 + count]
        def read():
            return client.read_holding_registers(3000, 119, slave=1).registers
        words = self.wait_for(read, lambda words: at(words, "frame_rate")[0] != 65535)
        self.assertAlmostEqual(at(words, "frame_rate")[0] / 100, 60, delta=10)
        self.assertGreater(at(words, "uptime", 2)[1], 0)
        self.assertEqual(at(words, "connections")[0], 1)
        self.assertTrue(0 < at(words, "loop_load")[0] <= 1000)
        self.assertEqual(at(words, "pack_checksum", 2), client.read_holding_registers(36, 2, slave=1).registers)
        name = b"".join(word.to_bytes(2, "big") for word in at(words, "model_name", 16)).rstrip(b"\0")
        self.assertIn(name.decode(), self.shown_name())
        self.assertEqual(client.write_register(1004, 1, slave=1).exception_code, 3)
        self.assertEqual(client.read_coils(0, 1, slave=1).exception_code, 1)
        after = read()
        self.assertEqual(at(after, "wrong_keys", 4), [0, 1, 0x7F00, 0x0001])
        self.assertEqual(at(after, "exceptions_value", 2), [0, 1])
        self.assertEqual(at(after, "exceptions_function", 2), [0, 1])
        self.assertEqual(client.read_holding_registers(3001, 125, slave=1).exception_code, 2)
        client.close()

    def shown_name(self):
        shown = ctl(self.port, "show")
        return next(line for line in shown.stdout.splitlines() if " model_name " in line)

    def test_saved_settings_survive_a_reset_and_the_factory_settings_return_on_command(self):
        self.assertEqual(ctl(self.port, "set", "hold_time=77").returncode, 0)
        self.wait_for(lambda: ctl(self.port, "show").stdout, lambda shown: "unsaved" in shown)
        self.assertEqual(ctl(self.port, "do", "save").stdout, "done\n")
        self.wait_for(lambda: ctl(self.port, "show").stdout, lambda shown: "unsaved" not in shown)
        self.assertEqual(ctl(self.port, "set", "hold_time=78").returncode, 0)
        self.assertEqual(ctl(self.port, "do", "reset").stdout, "done\n")
        self.wait_for(lambda: ctl(self.port, "show").stdout, lambda shown: "hold_time              77 ms" in shown)
        self.assert_the_reset_is_remembered()
        self.assertEqual(ctl(self.port, "do", "factory").stdout, "done\n")
        self.assertIn("hold_time              200 ms", ctl(self.port, "show").stdout)
        self.assertIsNone(self.firmware.process.poll())

    def assert_the_reset_is_remembered(self):
        """A slow client that has missed the result before the restart finds it, and does not reset the device again."""
        client = ModbusTcpClient("127.0.0.1", port=self.port)
        self.assertTrue(client.connect())
        with client:
            number, command, result = client.read_holding_registers(ADDRESS["own_sequence"], 3, slave=1).registers
            self.assertEqual((command, result), (VALUES["command"]["reset"], 0))
            client.write_register(ADDRESS["write_key"], KEY, slave=1)
            again = client.write_registers(ADDRESS["command"], [command, number], slave=1)
            self.assertEqual(again.exception_code, 3)

    def test_a_recording_made_over_modbus_is_a_session_that_replays(self):
        self.assertEqual(ctl(self.port, "do", "record").stdout, "done\n")
        self.assertEqual(ctl(self.port, "do", "record").returncode, 1)
        time.sleep(1)
        self.assertEqual(ctl(self.port, "do", "stop").stdout, "done\n")
        session = Path(self.folder.name) / "recordings" / "session-0001"
        with open(session / "registers.csv", newline="") as file:
            rows = list(csv.reader(file))
        self.assertGreater(len(rows), 20)
        log = session / "again.csv"
        source = f'kind = "session"\npath = "{session}"\nspeed = "full"'
        with Firmware(source, extra_arguments=("--registers", log)) as again:
            self.assertEqual(again.process.wait(60), 0)
        self.assertEqual(len(log.read_text().splitlines()), len(rows))


class SavedSettings(unittest.TestCase):
    def wait_for_fault(self, reader, code):
        deadline = time.monotonic() + 20
        while reader.read().at("fault") != code and time.monotonic() < deadline:
            time.sleep(0.02)
        self.assertEqual(reader.read().at("fault"), code)

    def test_a_damaged_file_means_factory_settings_and_a_fault_until_it_is_cleared(self):
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "settings.toml").write_text("version = 1\n[settings]\n")
            with firmware(folder) as started:
                reader = Reader(started.port)
                self.wait_for_fault(reader, VALUES["fault"]["saved_settings_refused"])
                self.assertEqual(ctl(started.port, "do", "clear").stdout, "done\n")
                self.wait_for_fault(reader, 0)
                reader.close()
            self.assertIn("settings.toml:2", started.errors)

    def test_a_zero_of_another_model_is_refused_with_a_fault_and_the_settings_are_used(self):
        with tempfile.TemporaryDirectory() as folder:
            with firmware(folder) as started:
                Reader(started.port).close()
                self.assertEqual(ctl(started.port, "set", "hold_time=77").returncode, 0)
                self.assertEqual(ctl(started.port, "do", "save").stdout, "done\n")
            saved = Path(folder, "settings.toml")
            pose = "position_mm = [0, 0, 0]\nturn_deg = [0, 0, 0]\n"
            plates = ("top", "middle", "low")
            zero = "set = true\n" + "".join(f"{plate} = [0.1, 0, 0, 0, 0, 0]\n" for plate in plates)
            mount = "".join(f"[zero.mount.{name}]\n{pose}" for name in ("camera", *plates))
            saved.write_text(saved.read_text().replace("set = false\n", f'{zero}model = "01234567"\n{mount}'))
            with firmware(folder) as started:
                reader = Reader(started.port)
                self.wait_for_fault(reader, VALUES["fault"]["saved_settings_refused"])
                self.assertFalse(reader.read().has("zeroed"))
                self.assertIn("hold_time              77 ms", ctl(started.port, "show").stdout)
                reader.close()
            self.assertIn("was measured with model 01234567", started.errors)


if __name__ == "__main__":
    prepare()
    unittest.main(verbosity=2)
