#!/usr/bin/python3
"""The device's key and name, the report for a stick, and the packages that an image is made of: shell scripts on files of
the workstation.

usage: identity_test.py SOURCE_DIR [unittest arguments]
"""
import os
import subprocess
import sys
import tarfile
import tempfile
import unittest
import xml.etree.ElementTree
from pathlib import Path

SOURCE = Path(sys.argv.pop(1))
SCRIPTS = SOURCE / "boards/image/rootfs/usr/lib/finsight"


class Case(unittest.TestCase):
    def setUp(self):
        holder = tempfile.TemporaryDirectory()
        self.addCleanup(holder.cleanup)
        self.folder = Path(holder.name)
        self.state, self.kept = self.folder / "state", self.folder / "kept"
        self.state.mkdir()
        self.write("release", "board=x\nversion=0.1.0-202611222207\n")
        self.write("cmdline", "ro finsight.slot=b quiet\n")
        self.write("programs/finsightd", "#!/bin/sh\necho serial=AB_c 12\necho modbus_port=1502\necho page_port=80\n"
                   f"echo write_key=$(cat {self.state}/write-key)\n")

        self.write("programs/busybox", "#!/bin/sh\ncase $1 in wget) exit 1 ;; ip) ;; sleep) exit ;; *) exec \"$@\" ;; esac\n"
                   "echo '2: eth0 inet 169.254.7.8/16 brd x'; echo '1: lo inet 127.0.0.1/8'\n"
                   f"[ ! -e {self.folder}/third ] || echo '3: eth1 inet 10.1.2.3/24'\n")
        # Time passes at once; with the third pause another address comes.
        self.write("programs/sleep", f"#!/bin/sh\ncd {self.folder}\nif [ -e second ]; then touch third; fi\n"
                   "if [ -e first ]; then touch second; fi\ntouch first\n")

    def write(self, name, text):
        file = self.folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        file.chmod(0o755)
        return file

    def run_script(self, name, *arguments):
        environment = {"FINSIGHT_STATE": self.state, "FINSIGHT_KEPT": self.kept, "FINSIGHT_RELEASE": self.folder / "release",
                       "FINSIGHT_CMDLINE": self.folder / "cmdline", "FINSIGHT_SYSTEM": self.folder,
                       "FINSIGHT_ESP": self.folder / "esp", "FINSIGHT_DATA": self.folder / "data",
                       "FINSIGHT_BUNDLE": self.folder / "bundle", "PATH": f"{self.folder}/programs:{os.environ['PATH']}"}
        return subprocess.run(["/bin/sh", SCRIPTS / name, *map(str, arguments)], capture_output=True, text=True, timeout=60,
                              env={**os.environ, **{key: str(value) for key, value in environment.items()}})

    def make(self):
        for part in ("key", "name"):
            done = self.run_script("identity", part)
            self.assertEqual(done.returncode, 0, done.stderr)
        return int((self.state / "write-key").read_text())


class Identity(Case):
    def test_the_key_is_made_once_and_is_another_on_another_device(self):
        keys = set()
        for device in range(3):
            self.kept = self.folder / f"kept{device}"
            key = self.make()
            self.assertEqual(self.make(), key)
            keys.add(key)
        self.assertGreater(len(keys), 1)
        self.assertFalse(keys & {0, 18003})

    def test_a_damaged_key_is_made_again(self):
        for damaged in ("", "0\n", "65536\n", "12a\n", "007\n"):
            self.kept.mkdir(exist_ok=True)
            (self.kept / "write-key").write_text(damaged)
            self.assertEqual(str(self.make()), (self.kept / "write-key").read_text().strip())

    def test_without_a_data_partition_there_is_a_key_all_the_same(self):
        self.kept = self.write("no-folder", "") / "kept"
        self.assertIn(self.make(), range(1, 65536))

    def test_name_services_and_image(self):
        self.make()
        self.assertEqual((self.state / "name").read_text(), "finsight-ab-c-12\n")
        self.assertEqual((self.state / "image").read_text(), "0.1.0-202611222207 b\n")
        services = xml.etree.ElementTree.parse(self.state / "announced/finsight.service").findall("service")
        self.assertEqual([(s.find("type").text, s.find("port").text) for s in services],
                         [("_modbus._tcp", "1502"), ("_http._tcp", "80")])

    def test_the_console_is_told_once(self):
        key = self.make()
        said = self.run_script("identity", "show").stdout
        for wanted in ("AB_c 12", "finsight-ab-c-12.local", "169.254.7.8", str(key)):
            self.assertIn(wanted, said)
        self.assertNotIn("127.0.0.1", said)
        self.assertEqual([line.split("addresses: ")[1].split() for line in said.splitlines() if "addresses" in line],
                         [["169.254.7.8"], ["169.254.7.8", "10.1.2.3"]])
        self.assertEqual(self.run_script("identity", "show").stdout, "")


class Stick(Case):
    def setUp(self):
        super().setUp()
        self.make()
        self.stick = self.folder / "stick"
        self.stick.mkdir()
        self.write("board.toml", "[modbus]\nwrite_key = 4711 # mine\n")
        self.write("esp/finsight.toml", 'modbus = { "write_key" = 4712, port = 502 }\n')
        self.write("data/settings/settings.toml", "zeroed = true\n")
        self.write("data/measured/mount.toml", "a = 1\n")
        self.write("programs/journalctl", "#!/bin/sh\necho the log\n")
        self.write("programs/systemctl", f"#!/bin/sh\n[ $1 = start ] || exit 0\nmkdir -p {self.folder}/bundle\n"
                   f"sh {SCRIPTS}/bundle {self.folder}/bundle\n")

    def test_a_stick_that_asks_gets_the_report_without_the_key_and_the_key_once(self):
        (self.stick / "finsight-report.txt").write_text("")
        done = self.run_script("read-stick", self.stick)
        self.assertEqual(done.returncode, 0, done.stderr)
        with tarfile.open(self.stick / "finsight-diagnostics.tar.gz") as tar:
            parts = {name.split("/", 1)[-1]: tar.extractfile(name).read().decode() for name in tar.getnames()
                     if tar.getmember(name).isfile()}
        self.assertLessEqual({"board.toml", "finsight.toml", "log.txt", "release", "settings/settings.toml",
                              "measured/mount.toml", "system.txt"}, set(parts))
        self.assertEqual(parts["log.txt"], "the log\n")
        self.assertEqual(parts["board.toml"], '[modbus]\nwrite_key = "left out" # mine\n')
        self.assertEqual(parts["finsight.toml"], 'modbus = { "write_key" = "left out", port = 502 }\n')
        key = (self.stick / "finsight-key.txt").read_text()
        self.assertIn((self.state / "write-key").read_text().strip(), key)
        (self.stick / "finsight-key.txt").unlink()
        self.run_script("read-stick", self.stick)
        self.assertFalse((self.stick / "finsight-key.txt").exists())

    def test_a_stick_that_asks_for_nothing_is_left_alone(self):
        (self.stick / "holiday.jpg").write_text("")
        self.assertEqual(self.run_script("read-stick", self.stick).returncode, 0)
        self.assertEqual([file.name for file in self.stick.iterdir()], ["holiday.jpg"])


class PackageList(Case):
    def bash(self, command):
        return subprocess.run(["bash", "-c", f". {SOURCE}/scripts/lib/debian.sh; {command}"], capture_output=True, text=True,
                              cwd=SOURCE, timeout=60)

    def check(self, found):
        self.write("list", "zlib1g\t1.3\tarm64\taa\nlibssl3\t3.5\tarm64\tbb\nlibssl3\t3.5\tamd64\tcc\n")
        file = self.write("found", found)
        return self.bash(f"package_list={self.folder}/list; check_packages {file}")

    def test_a_mirror_that_has_moved_on_ends_the_build_and_the_packages_are_named(self):
        self.assertEqual(self.check("zlib1g\t1.3\tarm64\taa\tzlib\t1.3\nlibssl3\t3.5\tarm64\tbb\topenssl\t3.5\n").returncode, 0)
        for found, reason in (("libssl3\t3.6\tarm64\tdd\to\t1\n", "libssl3 3.6 (arm64): the list has 3.5"),
                              ("libssl3\t3.5\tarm64\tdd\to\t1\n", "libssl3 3.5 (arm64): other bytes than listed"),
                              ("new\t1\tarm64\tdd\to\t1\n", "new 1 (arm64): not in the list")):
            checked = self.check(found)
            self.assertEqual(checked.returncode, 1)
            self.assertIn(reason, checked.stderr)

    def test_security_comes_from_beside_every_mirror(self):
        day = "20261101T000000Z"
        for mirror, security in (("", "http://deb.debian.org/debian-security"),
                                 ("http://x.org/pub/debian", "http://x.org/pub/debian-security"),
                                 (f"http://x.org/archive/debian/{day}", f"http://x.org/archive/debian-security/{day}")):
            self.assertIn(f"deb {security} trixie-security ", self.bash(f"debian_sources '{mirror}'").stdout)
        self.assertEqual(self.bash("debian_sources http://debian.x.org/pub").returncode, 1)


if __name__ == "__main__":
    unittest.main()
