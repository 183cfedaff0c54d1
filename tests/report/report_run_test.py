#!/usr/bin/python3
"""What scripts/report measures and in which order, without measuring it."""
import json
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

SOURCE = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(SOURCE / "scripts" / "lib"))
import report_run  # noqa: E402
from report_words import SECTIONS  # noqa: E402


class Run(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def test_hostgen_knows_the_same_areas_and_each_has_a_section(self):
        command = (SOURCE / "hostgen/commands/report_command.cpp").read_text()
        known = re.findall(r'^ +{"(\w+)",', command[command.index("kAreas[]"):], re.M)
        self.assertEqual(known, list(report_run.AREAS))
        self.assertEqual(set(known), {section["area"] for section in SECTIONS.values()})

    def test_help_names_them_and_anything_else_is_refused(self):
        script = SOURCE / "scripts" / "lib" / "report_run.py"
        said = subprocess.run([script, "--help"], stdout=subprocess.PIPE, text=True, check=True).stdout
        for area in report_run.AREAS:
            self.assertIn(area, said)
        answer = subprocess.run([script, "--quick", "sovler"], stderr=subprocess.PIPE, text=True)
        self.assertEqual(answer.returncode, 2)
        self.assertIn("unknown argument 'sovler'", answer.stderr)
        report = subprocess.run(["bash", "-x", SOURCE / "scripts" / "report", "--quik"], stderr=subprocess.PIPE, text=True)
        self.assertEqual(report.returncode, 2)
        self.assertNotIn("scripts/setup", report.stderr, "something may be installed before the arguments are read")
        self.assertIn("unknown argument '--quik'", report.stderr)

    def run_main(self, *words, done):
        """Which areas main() measures when those in `done` have their figures."""
        (self.folder / "results.json").write_text(json.dumps({"measured": done}))
        measured = []
        with mock.patch.multiple(report_run, FOLDER=self.folder, build=mock.DEFAULT, run=mock.DEFAULT, commit=lambda: "abc",
                                 measure=lambda area, _: measured.append(area)), \
                mock.patch.object(report_run.Run, "make_pack"), mock.patch.object(sys, "argv", ["report", *words]), \
                mock.patch("builtins.print"):
            self.assertEqual(report_run.main(), 0)
        return measured

    def test_resume_leaves_out_what_this_commit_has_as_thoroughly(self):
        done = {"solver": {"commit": "abc", "profile": "full", "seconds": 9},
                "hard": {"commit": "abc", "profile": "quick", "seconds": 9},
                "fem": {"commit": "older", "profile": "full", "seconds": 9},
                "touch": {"commit": "abc", "profile": "full"}}  # interrupted before its time was noted
        self.assertEqual(self.run_main("--resume", done=done), [area for area in report_run.AREAS if area != "solver"])
        self.assertEqual(self.run_main(done=done), list(report_run.AREAS))
        self.assertEqual(self.run_main("--quick", "--resume", "hard", "fem", done=done), ["fem"])

    def test_a_program_that_fails_leaves_its_reason_and_the_others_go_on(self):
        def fails(*words):
            raise subprocess.CalledProcessError(3, words)
        with mock.patch.multiple(report_run, FOLDER=self.folder, run=fails):
            file = report_run.Run(True).tool("soak", "finsightd")
        self.assertEqual(json.loads(file.read_text()), {"why": "scripts/lib/soak.py failed, exit code 3"})

    def test_time_left_comes_from_the_last_run_of_the_same_profile(self):
        results = {"measured": {"solver": {"profile": "full", "seconds": 333}}}
        self.assertEqual(report_run.expected_seconds("solver", results, "full"), 333)
        self.assertEqual(report_run.expected_seconds("solver", results, "quick"), report_run.AREAS["solver"][1])

    def test_what_others_take_of_the_processors_is_counted_without_our_own_programs(self):
        before = report_run.busy_seconds()
        subprocess.run([sys.executable, "-c", "import time\nwhile time.process_time() < 0.2: pass"], check=True)
        after = report_run.busy_seconds()
        self.assertGreater(after[1] - before[1], 0.1)
        self.assertGreaterEqual(after[0] - before[0] + 0.05, after[1] - before[1])


if __name__ == "__main__":
    unittest.main(verbosity=2)
