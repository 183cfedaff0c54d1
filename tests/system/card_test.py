#!/usr/bin/python3
"""scripts/flash and the device's finsight-update, on files that stand for cards and partitions.

usage: card_test.py SOURCE_DIR [unittest arguments]
"""
import fcntl
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

from machine import make_update

SOURCE = Path(sys.argv.pop(1))
ROOT = SOURCE / "boards" / "image" / "rootfs"
MIB = 1 << 20
RESTART = 64  # exit code of slots: the machine must start again


class Case(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory()
        self.addCleanup(holder.cleanup)
        self.folder = Path(holder.name)

    def run_with(self, words, **environment):
        return subprocess.run([str(w) for w in words], capture_output=True, text=True, timeout=120,
                              stdin=subprocess.DEVNULL, env={**os.environ, **environment})


class Flash(Case):
    def setUp(self):
        super().setUp()
        self.image = self.folder / "image"
        self.image.write_bytes(random.Random(1).randbytes(24 * MIB))
        table = "label: gpt\n" + "size=1MiB\n" * 4 + "size=8MiB\n"
        subprocess.run(["/usr/sbin/sfdisk", "-q", self.image], input=table, text=True, check=True)

    def flash(self, device, *options, **environment):
        return self.run_with([SOURCE / "scripts" / "flash", *options, self.image, device], **environment)

    def device(self, size):
        path = self.folder / "device"
        path.write_bytes(b"\xA5" * size)
        return path

    def disk(self, name="sdz", where="usb1", **files):
        """A disk as the system describes it, with a file as its medium: the script is told where to look."""
        sys_folder, proc = self.folder / "sys", self.folder / "proc"
        node = sys_folder / "devices" / where / "block" / name
        for folder in (node / name / "holders", node / "holders", node / "device", sys_folder / "class" / "block",
                       proc / "self"):
            folder.mkdir(parents=True)
        for file, text in {"dev": "8:0", "ro": "0", "removable": "0", "size": str(64 * MIB // 512),
                           "device/model": "Card", f"{name}/dev": "8:1", **files}.items():
            (node / file).write_text(text + "\n")
        (sys_folder / "class" / "block" / name).symlink_to(node)
        (proc / "self" / "mountinfo").write_text("30 1 254:0 / / rw - ext4 /dev/root rw\n")
        (proc / "swaps").write_text("Filename Type Size Used Priority\n")
        fake = self.folder / name
        if not fake.exists():
            os.mkfifo(fake)  # neither file nor disk, so that nothing could be written by mistake
        return fake, {"FINSIGHT_SYS": str(sys_folder), "FINSIGHT_PROC": str(proc)}, node

    def test_a_card_holds_the_image_and_the_last_partition_fills_it(self):
        card = self.device(64 * MIB)
        answer = self.flash(card, "--yes")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        written = card.read_bytes()
        self.assertEqual(written[MIB:23 * MIB], self.image.read_bytes()[MIB:23 * MIB])
        table = subprocess.run(["/usr/sbin/sfdisk", "-J", card], capture_output=True, text=True, check=True).stdout
        self.assertIn('"size": 12', table)  # of 12xxxx sectors in all, the last partition has the rest
        check = subprocess.run(["/usr/sbin/sfdisk", "--verify", card], capture_output=True, text=True)
        self.assertIn("No errors", check.stdout)

    def test_without_a_yes_nothing_is_written(self):
        card = self.device(64 * MIB)
        self.assertEqual(self.flash(card).returncode, 2)
        self.assertEqual(card.read_bytes(), b"\xA5" * 64 * MIB)

    def test_a_small_device_is_refused(self):
        answer = self.flash(self.device(8 * MIB), "--yes")
        self.assertEqual(answer.returncode, 2)
        self.assertIn("holds 8 MB, the image has 24 MB", answer.stderr)

    def test_what_is_not_an_image_is_refused(self):
        self.image.write_bytes(b"\0" * 4 * MIB)
        answer = self.flash(self.device(64 * MIB), "--yes")
        self.assertEqual((answer.returncode, "not an image" in answer.stderr), (2, True), answer.stderr)

    def test_half_an_image_is_refused(self):
        self.image.write_bytes(self.image.read_bytes()[:12 * MIB])
        card = self.device(64 * MIB)
        answer = self.flash(card, "--yes")
        self.assertEqual((answer.returncode, "not complete" in answer.stderr), (2, True), answer.stderr)
        self.assertEqual(card.read_bytes(), b"\xA5" * 64 * MIB)

    def test_the_image_is_not_flashed_onto_itself(self):
        before = self.image.read_bytes()
        link = self.folder / "link"
        link.symlink_to(self.image)
        for device in (self.image, link):
            answer = self.flash(device, "--yes")
            self.assertEqual((answer.returncode, "the image itself" in answer.stderr), (2, True), answer.stderr)
            self.assertEqual(self.image.read_bytes(), before)

    def test_disks_in_use_or_built_in_are_refused(self):
        cases = [({"where": "pci0"}, {}, "built-in disk"),
                 ({"ro": "1"}, {}, "write-protected"),
                 ({"partition": "1"}, {}, "name the whole disk"),
                 ({}, {"self/mountinfo": "31 1 8:1 / /media/card rw - vfat /dev/sdz1 rw\n"}, "mounted at /media/card"),
                 ({}, {"self/mountinfo": "31 1 8:0 / / rw - ext4 /dev/sdz rw\n"}, "mounted at /"),
                 ({}, {"self/mountinfo": "31 1 0:47 / /media/b rw shared:9 - btrfs /dev/sdz rw\n"}, "mounted at /media/b"),
                 ({}, {"swaps": "Filename Type Size Used Priority\n/dev/sdz partition 1 0 -2\n"}, "used as swap")]
        for files, proc, reason in cases:
            with self.subTest(reason):
                fake, environment, _ = self.disk(**files)
                for name, text in proc.items():
                    (self.folder / "proc" / name).write_text(text)
                answer = self.flash(fake, "--yes", **environment)
                self.assertEqual(answer.returncode, 2)
                self.assertIn(reason, answer.stderr)
                subprocess.run(["rm", "-rf", self.folder / "sys", self.folder / "proc"], check=True)

    def test_a_disk_under_a_volume_is_refused(self):
        fake, environment, node = self.disk()
        (node / "sdz" / "holders" / "dm-0").touch()
        self.assertIn("used by dm-0", self.flash(fake, "--yes", **environment).stderr)

    def test_an_interrupted_card_is_empty(self):
        """Interrupted at every start of a dd, by the dd itself: a clock would miss the writing of a fast machine."""
        dd = self.folder / "bin" / "dd"
        dd.parent.mkdir()
        # Two run at once where card and image are compared, hence a count that each takes a number of its own from.
        dd.write_text(f"""#!/bin/sh
call=1
while ! mkdir {self.folder}/calls/$call 2>/dev/null; do call=$((call + 1)); done
[ $call -ne "$FINSIGHT_TEST_CALL" ] || kill -INT 0
exec /usr/bin/dd "$@"
""")
        dd.chmod(0o755)
        interrupted = 0
        for call in range(1, 100):
            shutil.rmtree(self.folder / "calls", ignore_errors=True)
            (self.folder / "calls").mkdir()
            card = self.device(64 * MIB)
            environment = {**os.environ, "PATH": f"{dd.parent}:{os.environ['PATH']}", "FINSIGHT_TEST_CALL": str(call)}
            process = subprocess.Popen([SOURCE / "scripts" / "flash", "--yes", self.image, card], start_new_session=True,
                                       stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment)
            errors = process.communicate(timeout=30)[1]
            if process.returncode == 0:
                break
            start = card.read_bytes()[:MIB]
            if start[:446] == self.image.read_bytes()[:446]:
                continue  # interrupted while the complete system was compared
            with self.subTest(call=call):
                self.assertEqual(process.returncode, -signal.SIGINT, errors)
                if start == bytes(MIB):
                    interrupted += 1
                    self.assertIn("holds no system until", errors)
                else:
                    self.assertEqual(card.read_bytes(), b"\xA5" * 64 * MIB, "neither emptied nor as it was")
        self.assertGreater(interrupted, 5)
        self.assertEqual(process.returncode, 0, "every call was interrupted")


class Update(Case):
    def setUp(self):
        super().setUp()
        (self.folder / "keys").mkdir()
        self.key = self.make_key("key", self.folder / "keys" / "0.pub")
        self.old, self.new = (random.Random(n).randbytes(3 * MIB + 4096 * n) for n in (1, 2))
        (self.folder / "slot-a").write_bytes(self.old.ljust(4 * MIB, b"\0"))
        (self.folder / "slot-b").write_bytes(self.old.ljust(4 * MIB, b"\0"))
        record = b"# GRUB Environment Block\nslot=a\nleft=iiiiiiii\nspare=1\ntrial=0\n".ljust(1024, b"#")
        (self.folder / "head").write_bytes(random.Random(3).randbytes(8192))
        (self.folder / "env").write_bytes(((self.folder / "head").read_bytes() + record).ljust(MIB, b"\0"))
        (self.folder / "cmdline").write_text("BOOT_IMAGE=/boot/vmlinuz finsight.slot=a ro quiet\n")
        (self.folder / "release").write_text("board=rpi4\nversion=1\nid=old\n")
        self.environment = {"FINSIGHT_DEVICES": str(self.folder), "FINSIGHT_CMDLINE": str(self.folder / "cmdline"),
                            "FINSIGHT_LIB": str(ROOT / "usr/lib/finsight"), "FINSIGHT_KEYS": str(self.folder / "keys"),
                            "FINSIGHT_RELEASE": str(self.folder / "release"), "FINSIGHT_STATE": str(self.folder),
                            "FINSIGHT_ENV_HEAD": str(self.folder / "head"), "FINSIGHT_STAYS_UP_S": "0"}
        self.file = self.folder / "finsight-2.update"

    def make_key(self, name, public=None):
        key = self.folder / f"{name}.pem"
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", key], check=True)
        if public:
            subprocess.run(["openssl", "pkey", "-in", key, "-pubout", "-out", public], check=True)
        return key

    def make(self, payload=None, key=None, board="rpi4", identity="new", version="2"):
        make_update(self.file, payload or self.new, key or self.key, board, version, identity)

    def update(self):
        return self.run_with(["sh", ROOT / "usr/sbin/finsight-update", self.file], **self.environment)

    def slots(self, *words):
        return self.run_with(["sh", ROOT / "usr/lib/finsight/slots", *words], **self.environment)

    def put_record(self, *values):
        self.run_with(["sh", "-c", '. "$FINSIGHT_LIB/slots"; slots_put "$@"', "sh", *values], **self.environment)

    def record(self):
        block = (self.folder / "env").read_bytes()[8192:9216]
        self.assertTrue(block.startswith(b"# GRUB Environment Block\n"), block)
        self.assertEqual(set(block.rstrip(b"#").split(b"\n")[-1]), set())
        return dict(line.split("=") for line in block.decode().split("#")[1].splitlines() if "=" in line)

    def test_a_good_update_is_written_to_the_other_slot_and_starts_next(self):
        self.make()
        answer = self.update()
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertEqual(self.record(), {"slot": "b", "left": "iii", "spare": "1", "trial": "1"})
        self.assertTrue((self.folder / "slot-b").read_bytes().startswith(self.new))
        self.assertTrue((self.folder / "slot-a").read_bytes().startswith(self.old))
        self.assertEqual((self.folder / "env").stat().st_size, MIB)

    def test_an_update_by_any_of_the_keys_is_taken(self):
        self.make(key=self.make_key("next", self.folder / "keys" / "1.pub"))
        self.assertEqual(self.update().returncode, 0)

    def test_older_versions_are_the_way_back_down_to_the_lowest(self):
        (self.folder / "release").write_text("board=rpi4\nversion=0.10.0-202611221947\nid=old\nlowest=0.9.0-202601010000\n")
        for version in ("0.9.0-202512312359", "0.2.0-202611221947"):
            self.make(version=version)
            answer = self.update()
            self.assertEqual(answer.returncode, 2)
            self.assertIn(f"version {version} is older than 0.9.0-202601010000", answer.stderr)
        self.make(version="0.9.0-202601010000")
        answer = self.update()
        self.assertEqual(answer.returncode, 0, answer.stderr)
        self.assertIn("writing version 0.9.0-202601010000 back from 0.10.0-202611221947", answer.stdout)

    def test_what_is_not_ours_is_refused_and_nothing_is_written(self):
        other = self.folder / "other.pem"
        subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", other], check=True)
        before = (self.folder / "env").read_bytes(), (self.folder / "slot-b").read_bytes()

        def changed(at):
            self.make()
            content = bytearray(self.file.read_bytes())
            content[at] ^= 1
            self.file.write_bytes(content)

        cases = [(lambda: self.make(key=other), "signature"), (lambda: self.make(board="qemu-virt"), "for board"),
                 (lambda: changed(50), "signature"), (lambda: changed(1030), "signature"),
                 (lambda: changed(2 * MIB), "is damaged"), (lambda: self.make(payload=b"x" * 5 * MIB), "larger"),
                 (lambda: self.file.write_bytes(b"hello"), "not a Finsight update"),
                 (lambda: self.file.write_bytes(self.file.read_bytes()[:-1]), "is not complete")]
        for make, reason in cases:
            with self.subTest(reason):
                if reason == "is not complete":
                    self.make()
                make()
                answer = self.update()
                self.assertEqual(answer.returncode, 2, answer.stdout + answer.stderr)
                self.assertIn(reason, answer.stderr)
                self.assertEqual(((self.folder / "env").read_bytes(), (self.folder / "slot-b").read_bytes()), before)

    def test_a_second_update_is_refused_while_one_is_written_and_until_it_was_started(self):
        self.make()
        with open(self.folder / "update.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            self.environment["FINSIGHT_WAIT_S"] = "0.1"
            self.assertIn("still being written", self.update().stderr)
        self.assertEqual(self.update().returncode, 0)
        answer = self.update()
        self.assertEqual((answer.returncode, "start it first" in answer.stderr), (1, True), answer.stderr)

    def test_a_strange_name_is_not_shown(self):
        self.file = self.folder / "finsight-\n\x1b[2J.update"
        self.file.write_bytes(b"hello")
        self.assertEqual(self.update().stderr, "finsight-update: finsight-2J.update: not a Finsight update\n")

    def test_the_running_version_is_left_alone(self):
        self.make(identity="old")
        self.assertEqual(self.update().returncode, 3)
        self.assertEqual(self.record()["slot"], "a")

    def test_killed_anywhere_the_slot_that_starts_is_complete(self):
        self.make()
        began = time.monotonic()
        self.assertEqual(self.update().returncode, 0)
        whole = time.monotonic() - began
        chance = random.Random(3)
        switched = 0
        for _ in range(40):
            self.put_record("a", "iiiiiiii", "1", "0")
            (self.folder / "slot-b").write_bytes(self.old.ljust(4 * MIB, b"\0"))
            (self.folder / "updated").unlink(missing_ok=True)
            process = subprocess.Popen(["sh", ROOT / "usr/sbin/finsight-update", self.file], start_new_session=True,
                                       env={**os.environ, **self.environment}, stdout=subprocess.DEVNULL,
                                       stderr=subprocess.DEVNULL)
            time.sleep(chance.uniform(0, 2 * whole))  # more than the whole: the machine may have become slower
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            record = self.record()
            held = (self.folder / f"slot-{record['slot']}").read_bytes()
            wanted = self.new if record["slot"] == "b" else self.old
            self.assertEqual(hashlib.sha256(held[:len(wanted)]).digest(), hashlib.sha256(wanted).digest())
            switched += record["slot"] == "b"
        self.assertGreater(switched, 0)
        self.assertLess(switched, 40)

    def replace_systemctl(self, script):
        bin_folder = self.folder / "bin"
        bin_folder.mkdir(exist_ok=True)
        (bin_folder / "systemctl").write_text(f"#!/bin/sh\n{script}\n")
        (bin_folder / "systemctl").chmod(0o755)
        self.environment["PATH"] = f"{bin_folder}:{os.environ['PATH']}"

    def test_an_update_is_healthy_when_the_sensor_measures_not_when_it_looks_for_the_camera(self):
        self.replace_systemctl(f"cat {self.folder}/says")
        (self.folder / "says").write_text("looking for the camera\n")
        self.put_record("a", "ii", "1", "1")
        with subprocess.Popen(["sh", ROOT / "usr/lib/finsight/slots", "healthy"],
                              env={**os.environ, **self.environment}) as waiting:
            time.sleep(1.5)
            self.assertIsNone(waiting.poll())
            self.assertEqual(self.record()["left"], "ii")
            with open(self.folder / "update.lock", "w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # what gives the update up must not wait for this
            (self.folder / "says").write_text("measuring\n")
            self.assertEqual(waiting.wait(10), 0)
        self.assertEqual(self.record(), {"slot": "a", "left": "iiiiiiii", "spare": "1", "trial": "0"})

    def test_a_slot_that_was_healthy_before_needs_no_camera_to_stay_so(self):
        self.replace_systemctl("echo looking for the camera")
        self.put_record("a", "ii", "1", "0")
        self.assertEqual(self.slots("healthy").returncode, 0)
        self.assertEqual(self.record()["left"], "iiiiiiii")

    def test_starts_are_filled_up_when_healthy_and_taken_when_an_update_is_sick(self):
        self.put_record("a", "i", "1", "1")
        self.assertEqual(self.slots("trial-over").returncode, RESTART)
        self.assertEqual(self.record(), {"slot": "b", "left": "iiiiiiii", "spare": "2", "trial": "0"})
        self.put_record("a", "ii", "1", "0")
        self.assertEqual(self.slots("trial-over").returncode, 0)
        self.assertEqual(self.record()["left"], "ii")

    def slot(self, name):
        return (self.folder / f"slot-{name}").read_bytes()

    def test_a_slot_that_holds_nothing_that_works_becomes_a_copy_of_the_one_that_runs(self):
        """An update was cut off; one did not work; a slot became damaged while the other one ran."""
        for record, harm in (("a iiiiiii 0 0", self.damage), ("a iiiiiii 2 0", None), ("a iiiiiii 1 0", self.damage),
                             ("b ii 1 0", self.damage), ("b ii 0 0", self.damage)):
            with self.subTest(record):
                self.put_head("a")
                self.put_head("b")
                if harm:
                    harm("b")
                self.put_record(*record.split())
                answer = self.slots("healthy")
                self.assertEqual((answer.returncode, "slot b held nothing that works" in answer.stderr), (0, True))
                self.assertEqual(self.slot("b"), self.slot("a"))
                self.assertEqual(self.record(), {"slot": "a", "left": "iiiiiiii", "spare": "1", "trial": "0"})

    def test_a_whole_slot_is_left_alone_whoever_signed_it_and_why_ever_the_boot_loader_left_it(self):
        for key in (self.key, self.make_key("former")):
            for record in ("a iiiiiii 1 0", "b ii 1 0", "b ii 0 0", "x  1 0"):
                with self.subTest(record):
                    (self.folder / "slot-b").write_bytes(self.old.ljust(4 * MIB, b"\1"))
                    self.put_head("a")
                    self.put_head("b", key)
                    before = self.slot("b")
                    self.put_record(*record.split(" "))
                    self.assertEqual(self.slots("healthy").returncode, 0)
                    self.assertEqual((self.slot("b"), self.record()["spare"]), (before, "1"))

    def test_what_is_running_is_copied_only_if_it_is_what_was_signed(self):
        self.put_head("a", self.make_key("former"))
        self.put_record("a", "iiiiiii", "2", "0")
        before = self.slot("b")
        self.assertEqual(self.slots("healthy").returncode, 0)
        self.put_head("a")
        self.damage("a")
        answer = self.slots("healthy")
        self.assertEqual((answer.returncode, "the other one is no better" in answer.stderr), (0, True), answer.stderr)
        self.assertEqual((self.slot("b"), self.record()["spare"]), (before, "2"))

    def test_an_update_that_is_being_written_is_waited_for_and_neither_overwritten_nor_left_half_done(self):
        for word in ("healthy", "trial-over", "safe-mode"):
            self.put_head("a")
            self.put_record("a", "i", "0", "1")
            with open(self.folder / "update.lock", "w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                self.replace_systemctl("echo measuring")
                process = subprocess.Popen(["sh", ROOT / "usr/lib/finsight/slots", word], stderr=subprocess.DEVNULL,
                                           env={**os.environ, **self.environment})
                time.sleep(0.5)
                self.assertIsNone(process.poll(), word)
                self.put_record("b", "iii", "1", "1")
                (self.folder / "updated").touch()
            self.assertEqual(process.wait(10), 0, word)
            self.assertEqual(self.record(), {"slot": "b", "left": "iii", "spare": "1", "trial": "1"}, word)
            (self.folder / "updated").unlink()

    def test_a_reading_that_fails_once_is_no_damage(self):
        self.put_head("a")
        self.put_head("b")
        cat = self.folder / "bin" / "cat"
        self.replace_systemctl("")
        cat.write_text(f"#!/bin/sh\nif [ -e {self.folder}/read ]; then exec /bin/cat \"$@\"; fi\n: >{self.folder}/read\nexit 1\n")
        cat.chmod(0o755)
        self.assertEqual(self.slots("healthy").returncode, 0)
        self.assertTrue((self.folder / "read").exists())
        self.assertEqual(self.record()["slot"], "a")

    def test_a_slot_that_does_not_keep_its_copy_is_no_spare(self):
        self.put_head("a")
        self.put_record("a", "iiiiiii", "2", "0")
        (self.folder / "slot-b").unlink()
        (self.folder / "slot-b").symlink_to("/dev/full")
        self.assertNotEqual(self.slots("healthy").returncode, 0)
        self.assertEqual(self.record(), {"slot": "a", "left": "iiiiiiii", "spare": "0", "trial": "0"})

    def test_an_update_that_waits_for_its_start_is_not_forgotten_when_the_firmware_starts_again(self):
        self.make()
        self.assertEqual(self.update().returncode, 0)
        record = self.record()
        for word in ("healthy", "safe-mode"):
            self.assertEqual((self.slots(word).returncode, self.record()), (0, record), word)
        self.assertTrue(self.slot("b").startswith(self.new))

    def put_head(self, slot, key=None):
        """The head of an update of what the slot holds, at its end."""
        make_update(self.folder / "head", self.old, key or self.key, "rpi4", "1", "old")
        content = bytearray((self.folder / f"slot-{slot}").read_bytes())
        content[-4096:] = (self.folder / "head").read_bytes()[:4096]
        (self.folder / f"slot-{slot}").write_bytes(content)

    def damage(self, slot):
        content = bytearray((self.folder / f"slot-{slot}").read_bytes())
        content[MIB] ^= 1
        (self.folder / f"slot-{slot}").write_bytes(content)

    def test_a_damaged_slot_is_left_if_the_other_one_is_whole(self):
        self.put_head("a")
        self.put_head("b")
        self.assertEqual(self.slots("safe-mode").returncode, 0)
        self.assertEqual(self.record()["left"], "iiiiiiii")
        self.damage("a")
        for word in ("healthy", "safe-mode"):
            self.assertEqual(self.slots(word).returncode, RESTART)
            self.assertEqual(self.record(), {"slot": "b", "left": "iiiiiiii", "spare": "2", "trial": "0"})
        self.damage("b")
        answer = self.slots("safe-mode")
        self.assertEqual((answer.returncode, self.record()["left"]), (0, "iiiiiiii"))
        self.assertIn("the other one is no better", answer.stderr)

    def test_a_damaged_slot_is_left_for_one_from_before_a_change_of_keys(self):
        self.put_head("a")
        self.put_head("b", self.make_key("old"))
        self.damage("a")
        self.assertEqual(self.slots("healthy").returncode, RESTART)
        self.assertEqual(self.record(), {"slot": "b", "left": "iiiiiiii", "spare": "2", "trial": "0"})

    def test_a_slot_without_a_head_of_ours_is_not_judged(self):
        self.put_head("a", self.make_key("other"))
        self.put_head("b")
        self.damage("a")
        self.assertEqual(self.slots("safe-mode").returncode, 0)

    def test_the_head_of_an_update_stays_with_its_slot(self):
        self.make()
        self.assertEqual(self.update().returncode, 0)
        self.assertEqual((self.folder / "slot-b").read_bytes()[-4096:], self.file.read_bytes()[:4096])

    def test_the_third_failure_of_safe_mode_starts_the_machine_with_less_trust_in_the_slot(self):
        for end in ("failure", "failure", "success", "failure", "failure"):
            self.assertEqual(self.slots("after-safe-mode", end).returncode, 0)
        self.assertEqual(self.record()["left"], "iiiiiiii")
        self.assertEqual(self.slots("after-safe-mode", "failure").returncode, RESTART)
        self.assertEqual(self.record(), {"slot": "a", "left": "i", "spare": "1", "trial": "0"})

    def damage_record(self, at, with_bytes):
        content = bytearray((self.folder / "env").read_bytes())
        content[at:at + len(with_bytes)] = with_bytes
        (self.folder / "env").write_bytes(content)

    def test_a_record_that_the_boot_loader_cannot_read_is_mended_by_a_healthy_start(self):
        whole = (self.folder / "env").read_bytes()
        for at, harm in ((0, bytes(64)), (5000, b"x"), (8192, bytes(1024)), (8192, b"X"), (8192 + 32, b"h"), (8192 + 50, b"??")):
            self.damage_record(at, harm)
            self.assertNotEqual((self.folder / "env").read_bytes(), whole)
            self.assertEqual(self.slots("healthy").returncode, 0)
            self.assertEqual((self.folder / "env").read_bytes(), whole, (at, harm))

    def test_with_such_a_record_a_slot_that_does_not_work_is_left_all_the_same(self):
        whole = (self.folder / "env").read_bytes()
        for at, harm in ((0, bytes(64)), (8192, bytes(1024)), (8192 + 40, b"h"), (8192 + 50, b"?")):
            self.damage_record(0, whole)
            self.damage_record(at, harm)
            self.replace_systemctl("echo failed; echo; echo failed")
            self.assertEqual([self.slots("guard").returncode for _ in range(2)], [0, RESTART])
            self.assertEqual(self.record(), {"slot": "a", "left": "i", "spare": "1", "trial": "0"}, (at, harm))
            self.assertEqual((self.folder / "env").read_bytes()[:8192], (self.folder / "head").read_bytes())
            (self.folder / "nothing-runs").unlink()

    def test_a_machine_on_which_nothing_runs_is_started_again(self):
        for states, code in (("active", 0), ("failed", 0), ("activating", 0), ("failed", 0), ("inactive", RESTART)):
            self.replace_systemctl(f"echo {states}; echo; echo inactive")
            self.assertEqual(self.slots("guard").returncode, code, states)


class Trim(Case):
    def trimmed(self, recordings, size):
        """What is left of recordings (name -> seconds since 1970) that take `size` bytes each of a disk of 8 MiB."""
        for name, seconds in recordings.items():
            (self.folder / name).mkdir()
            (self.folder / name / "frames.y4m").write_bytes(b"x" * size)
            os.utime(self.folder / name, (seconds, seconds))
        bin_folder = self.folder / "bin"
        bin_folder.mkdir()
        (bin_folder / "stat").write_text("#!/bin/sh\necho '2048 * 4096'\n")
        (bin_folder / "stat").chmod(0o755)
        answer = self.run_with(["sh", ROOT / "usr/lib/finsight/trim-recordings", self.folder],
                               PATH=f"{bin_folder}:{os.environ['PATH']}")
        self.assertEqual(answer.returncode, 0, answer.stderr)
        return {name for name in recordings if (self.folder / name).exists()}

    def test_the_lowest_number_goes_first_whatever_the_clock_said(self):
        names = {"session-0009": 300, "session-0010": 200, "session-0011": 100}
        self.assertEqual(self.trimmed(names, 2 * MIB), {"session-0011"})

    def test_recordings_above_9999_are_newer(self):
        self.assertEqual(self.trimmed({"session-10000": 1, "session-9999": 2}, 3 * MIB), {"session-10000"})

    def test_a_recording_that_fills_the_disk_stays(self):
        self.assertEqual(self.trimmed({"session-0001": 1}, 7 * MIB), {"session-0001"})


if __name__ == "__main__":
    unittest.main()
