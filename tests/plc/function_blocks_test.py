#!/usr/bin/python3
"""The function blocks of Finsight.st, checked against the standard's grammar and types, and run.

usage: function_blocks_test.py [unittest arguments]
"""
import struct
import unittest
from pathlib import Path

from structured_text import Machine, Refused

SOURCE = (Path(__file__).resolve().parents[2] / "hostgen" / "plc" / "Finsight.st").read_text()
REGISTERS = Machine(SOURCE).types["FinsightWords"][2] + 1
READY, TOUCH, CONTACT = 1, 2, 4


def block_of_words(heartbeat=1, age=120, fault=0, status=READY | TOUCH | CONTACT, low_word_first=False):
    words = [0] * REGISTERS
    words[0], words[1], words[2], words[3] = status, fault, heartbeat, age
    words[5], words[6], words[9] = 0xFF38, 6000, 250  # -2.00 mm, 60.00 mm, 2.50 N
    pairs = {20: struct.unpack(">HH", struct.pack(">f", -2.0)), 30: (0x7FC0, 0), 46: (0x1234, 0x5678)}
    for at, (high, low) in pairs.items():
        words[at:at + 2] = (low, high) if low_word_first else (high, low)
    words[39] = 0x1234
    return words


def gripper_words(heartbeats=(1, 1), ages=(120, 90), fault=0):
    """Registers 2000 on of two fingers that push with 2.5 N and 3.0 N."""
    words = [0] * (Machine(SOURCE).types["FinsightGripperWords"][2] + 1)
    words[0:8] = 2, 0b1111, max(ages), 550, 0xFFCE, 42, 150, 6500  # balance -0.50 N
    for n in (0, 1):
        at = 10 + 16 * n
        words[at:at + 9] = READY | TOUCH | CONTACT, fault * n, heartbeats[n], ages[n], 100, 6500, 0, 80, 250 + 50 * n
    for n in (2, 3):
        words[10 + 16 * n + 3] = 0xFFFF
    return words


class Gripper(unittest.TestCase):
    def setUp(self):
        self.machine = Machine(SOURCE)
        self.block = self.machine.block("FB_FinsightGripper")

    def call(self, at_ms, words):
        self.machine.now_ms = at_ms
        return self.block(words=words, poll_period=50)

    def test_both_fingers_and_what_they_make_together_are_scaled(self):
        block = self.call(0, gripper_words())
        self.assertTrue(block.alive and block.finger_1_alive and block.finger_2_alive)
        self.assertFalse(block.finger_3_alive or block.finger_3_status_any_fault)
        self.assertEqual((block.fingers, block.force_sum_n, block.force_balance_n), (2, 5.5, -0.5))
        self.assertEqual((block.finger_1_force_n, block.finger_2_force_n), (2.5, 3.0))
        self.assertTrue(block.gripper_state_all_contact and block.finger_2_status_touch_valid)

    def test_one_finger_that_stands_takes_the_grippers_values_with_it_and_not_the_others(self):
        for words in (gripper_words(ages=(120, 3001)), gripper_words(fault=8)):
            block = self.call(0, words)
            self.assertTrue(block.finger_1_alive and block.finger_1_force_valid)
            self.assertFalse(block.finger_2_alive or block.finger_2_force_valid or block.alive or block.force_sum_valid)
            self.assertTrue(block.finger_2_status_any_fault and block.gripper_state_any_fault)

    def test_a_link_that_repeats_the_words_ends_all_and_one_heartbeat_keeps_it(self):
        self.call(0, gripper_words())
        self.assertTrue(self.call(100, gripper_words()).alive)  # its timer starts here
        self.assertTrue(self.call(390, gripper_words((1, 2))).alive)
        self.assertTrue(self.call(400, gripper_words((1, 2))).alive)
        block = self.call(701, gripper_words((1, 2)))
        self.assertFalse(block.alive or block.finger_1_alive or block.finger_1_force_valid)


class Scaling(unittest.TestCase):
    def setUp(self):
        self.machine = Machine(SOURCE)
        self.block = self.machine.block("FB_Finsight")

    def call(self, at_ms, words, **inputs):
        self.machine.now_ms = at_ms
        return self.block(words=words, **inputs)

    def test_values_are_scaled_in_both_word_orders(self):
        for low_word_first in (False, True):
            block = self.call(0, block_of_words(low_word_first=low_word_first), low_word_first=low_word_first)
            self.assertTrue(block.alive and block.word_order_is_right and block.touch_valid and block.contact)
            self.assertEqual((block.touch_x_mm, block.touch_y_mm, block.force_n), (-2.0, 60.0, 2.5))
            self.assertEqual((block.touch_x_real_mm, block.touch_x_float_valid), (-2.0, True))
            self.assertFalse(block.temperature_float_valid)
        self.assertFalse(self.call(0, block_of_words(), low_word_first=True).word_order_is_right)

    def test_nothing_is_valid_before_the_first_read(self):
        block = self.call(0, [0] * REGISTERS)
        self.assertFalse(block.alive)
        self.assert_nothing_is_valid(block)

    def assert_nothing_is_valid(self, block):
        outputs = block.outputs()
        self.assertEqual([name for name, value in outputs.items() if name.endswith("_valid") and value], [])
        bits = [name for name, value in outputs.items() if value is True]
        self.assertEqual([name for name in bits if name != "word_order_is_right"], ["any_fault"])
        self.assertEqual((outputs["touch_x_mm"], outputs["force_n"]), (0.0, 0.0))

    def test_an_old_age_and_a_stall_end_alive_in_the_same_call(self):
        self.assertTrue(self.call(0, block_of_words(age=3000)).alive)
        self.assert_nothing_is_valid(self.call(10, block_of_words(2, age=3001)))
        self.assertTrue(self.call(20, block_of_words(3)).alive)
        self.assert_nothing_is_valid(self.call(30, block_of_words(4, fault=8, status=0x8000)))
        self.assert_nothing_is_valid(self.call(40, block_of_words(5, age=65535)))

    def test_alive_does_not_flicker_at_slow_polls_and_ends_when_they_stop(self):
        for poll_ms, cycle_ms in ((17, 10), (100, 10), (500, 10), (1000, 100), (2000, 2000)):
            machine = Machine(SOURCE)
            block, words = machine.block("FB_Finsight"), block_of_words()
            for now_ms in range(0, 20 * poll_ms, cycle_ms):
                machine.now_ms = now_ms
                words = block_of_words(heartbeat=now_ms // poll_ms * 6 + 1)
                self.assertTrue(block(words=words, poll_period=poll_ms).alive, (poll_ms, now_ms))
            lost_ms = now_ms
            while block(words=words, poll_period=poll_ms).alive:  # the link is dead: the words stay
                machine.now_ms += cycle_ms
                self.assertLess(machine.now_ms - lost_ms, 3 * poll_ms + 200 + 2 * cycle_ms + 1)
            self.assert_nothing_is_valid(block)

    def test_alive_does_not_flicker_at_fast_polls_of_a_device_that_waits_for_its_camera(self):
        block = self.machine.block("FB_Finsight")
        for now_ms in range(0, 3000, 20):
            self.machine.now_ms = now_ms
            self.assertTrue(block(words=block_of_words(heartbeat=now_ms // 100), poll_period=20).alive, now_ms)

    def test_the_array_has_a_named_type(self):
        self.assertEqual(self.machine.blocks["FB_Finsight"]["variables"]["words"], "FinsightWords")


class Device:
    """The device's side of the handshake, as firmware/modbus/README.md states it, with another client's commands."""

    def __init__(self):
        self.used = {}  # number -> (client, command)
        self.own, self.runs, self.left = {}, [], {}

    def write(self, client, command, number, run_cycles=3):
        """The exception's code, 0 for none."""
        if number == 0:
            return 3
        if number in self.used:  # repeated over the same connection, or used
            newest = self.own.get(client, (0, 0, 0))
            return 0 if self.used[number] == (client, command) and newest[:2] == (number, command) else 3
        if any(result == 4 for _, _, result in self.own.values()):
            return 6
        self.used[number] = (client, command)
        self.own[client] = (number, command, 4)
        self.left[client] = run_cycles
        self.runs.append((client, command))
        return 0

    def cycle(self, result=0):
        for client, (number, command, state) in list(self.own.items()):
            if state == 4:
                self.left[client] -= 1
                if self.left[client] <= 0:
                    self.own[client] = (number, command, result)


class Handshake(unittest.TestCase):
    def setUp(self):
        self.machine, self.device = Machine(SOURCE), Device()
        self.block = self.machine.block("FB_FinsightCommand")

    def run_command(self, command, cycles=200, result=0, read_from=0, answer=True, **inputs):
        """Calls the block every 10 ms; reads are one cycle old. The outcome: done, error code."""
        exception, seen, has_read = 0, (0, 0, 0), False
        for cycle in range(cycles):
            self.machine.now_ms += 10
            block = self.block(execute=cycle > 0, command=command, own_sequence=seen[0], own_command=seen[1],
                               own_result=seen[2], link_ready=has_read, write_exception=exception, **inputs)
            exception = 0
            if cycle > 0 and not block.busy:
                self.block(execute=False)
                return block.done, block.error_code
            if cycle >= read_from:
                seen, has_read = self.device.own.get("plc", (0, 0, 0)), True
            if block.write_request and answer:
                self.assertTrue(has_read)
                exception = self.device.write("plc", *block.request)
            self.device.cycle(result)
        self.fail("still busy")

    def test_a_command_runs_once_and_its_result_is_its_own(self):
        self.assertEqual(self.run_command(1), (True, 0))
        self.assertEqual(self.run_command(1, result=1), (False, 1))
        self.assertEqual(self.run_command(2, result=3), (False, 3))
        self.assertEqual(self.device.runs, [("plc", 1), ("plc", 1), ("plc", 2)])

    def test_before_the_first_read_nothing_is_written_and_no_number_is_taken_for_its_own(self):
        self.device.write("plc", 1, 1)  # by this PLC before it was restarted
        self.device.cycle(), self.device.cycle(), self.device.cycle()
        self.assertEqual(self.run_command(1, read_from=20), (True, 0))
        self.assertEqual(self.device.runs, [("plc", 1), ("plc", 1)])

    def test_numbers_that_other_clients_have_used_are_passed_over(self):
        for number in range(1, 6):
            self.device.write("hmi", 7, number)
            for _ in range(3):
                self.device.cycle()
        self.assertEqual(self.run_command(1), (True, 0))
        self.assertEqual(self.device.runs[-1], ("plc", 1))
        self.assertEqual(self.block.request, [1, 6])
        self.assertEqual(self.run_command(2, first_number=20000, last_number=29999), (True, 0))
        self.assertEqual(self.block.request, [2, 20000])

    def test_another_clients_running_command_is_waited_for(self):
        self.device.write("hmi", 1, 40, run_cycles=50)
        self.assertEqual(self.run_command(3), (True, 0))
        self.assertEqual(self.device.runs, [("hmi", 1), ("plc", 3)])

    def test_without_an_answer_it_ends_with_an_error_within_the_time_limit(self):
        self.assertEqual(self.run_command(1, cycles=2000, answer=False), (False, 65535))
        self.assertEqual(self.run_command(1), (True, 0))
        self.assertEqual(len(self.device.runs), 1)

    def test_numbers_start_over_at_the_end_of_their_range(self):
        for _ in range(12):
            self.assertEqual(self.run_command(1, first_number=100, last_number=104 + 10), (True, 0))
        self.assertEqual(len(self.device.runs), 12)

    def test_two_blocks_of_a_plc_take_turns_and_never_the_same_number(self):
        shared = {}
        blocks = [self.machine.block("FB_FinsightCommand", shared) for _ in range(2)]
        ended, seen = [0, 0], (0, 0, 0)
        for cycle in range(400):
            self.machine.now_ms += 10
            for i, block in enumerate(blocks):
                was_busy = block.busy
                block(execute=not was_busy and cycle % 3 > i, command=12, own_sequence=seen[0], own_command=seen[1],
                      own_result=seen[2], link_ready=cycle > 2, write_exception=0)
                if was_busy and not block.busy:
                    self.assertTrue(block.done)
                    ended[i] += 1
                if block.write_request:
                    self.assertIn(self.device.write("plc", *block.request), (0, 6))
            seen = self.device.own.get("plc", (0, 0, 0))
            self.device.cycle()
        self.assertGreater(min(ended), 5)
        self.assertLessEqual(len(self.device.runs) - sum(ended), 1)  # the last one may still run
        self.assertGreaterEqual(len(self.device.runs), sum(ended))

    def test_every_command_of_a_sequence_has_its_whole_time(self):
        seen, runs, was_busy = (0, 0, 0), 0, False
        for cycle in range(3000):
            self.machine.now_ms += 10
            block = self.block(execute=not was_busy, command=1, own_sequence=seen[0], own_command=seen[1],
                               own_result=seen[2], link_ready=True)  # given again in the cycle after it has ended
            self.assertFalse(block.error, cycle)
            runs += was_busy and not block.busy
            was_busy = block.busy
            if block.write_request:
                self.device.write("plc", *block.request, run_cycles=150)
            seen = self.device.own.get("plc", (0, 0, 0))
            self.device.cycle()
        self.assertGreater(runs, 15)

    def test_a_change_of_command_while_busy_does_not_change_what_is_written(self):
        self.block(execute=False, link_ready=True)
        block = self.block(execute=True, command=1)
        block = self.block(command=7)
        self.assertEqual(block.request[0], 1)


class Checker(unittest.TestCase):
    def test_what_a_compiler_refuses_is_refused(self):
        for right, wrong in (("words : FinsightWords;", "words : ARRAY[0..47] OF WORD;"),
                             ("WORD_TO_UINT(words[1]);", "words[1];"), ("alive := NOT quiet.Q", "alive := NOT words[1]"),
                             ("last_heartbeat := words[2];", "last_heart := words[2];"),
                             ("last_heartbeat := words[2];", "last_heartbeat := words[99];"),
                             ("END_IF;\nEND_FUNCTION", "END_FUNCTION"), ("done := NOT error;", "done = NOT error;"),
                             ("max_age : UINT := 3000;", "max_age : UINT := 3.5;"), ("SHL(", "ROT("),
                             ("poll_period : TIME", "words : TIME")):
            self.assertIn(right, SOURCE)
            with self.assertRaises(Refused, msg=wrong):
                Machine(SOURCE.replace(right, wrong))


if __name__ == "__main__":
    unittest.main(verbosity=2)
