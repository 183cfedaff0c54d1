#!/usr/bin/python3
"""The report's page: its words, its claims and its charts, from figures made up for the test."""
import sys
import tempfile
import unittest
from pathlib import Path

SOURCE = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(SOURCE / "scripts" / "lib"))
import report_charts  # noqa: E402
import report_page  # noqa: E402

TIERS = (("measures", 20.0, 0.12), ("contact", 60.0, 0.02), ("newton", 1000.0, 0.12))
MEASURED = {area: {"command": f"scripts/report {area}", "date": "2026-01-01", "commit": "abc", "load": 0.2}
            for area in ("solver", "touch", "scene", "modbus", "fem")}


def results(**changes):
    made_up = {
        "machine": "a <processor> & more", "commit": "abc", "profile": "full", "measured": MEASURED,
        "solver": {"iteration_ms": 0.5, "ratio_to_published": 73.0, "ratio_to_eigen": 5.0, "ratio_to_cholmod": 1.5,
                   "growth_exponent": 1.22,
                   "iterations": [{"way": way, "mesh_tets": tets, "sum_us": us * tets, "derivatives_us": 0.3 * us * tets,
                                   "factor_us": 0.5 * us * tets, "solve_us": 0.1 * us * tets, "step_us": 0.1 * us * tets}
                                  for way, us in (("float", 0.2), ("published", 15.0)) for tets in (1700, 16000)]},
        "speed_error": [{"tier": "newton", "mesh_tets": 1700, "factorisations": 1, "chords": 1, "scalar": scalar, "motion": motion,
                         "us_per_frame": 100.0, "worst_mm": 0.1, "mean_mm": 0.01}
                        for scalar in ("float", "double") for motion in ("slow", "fast")],
        "scene": {"cases": [{"case": "point", "contained": True}, {"case": "back", "contained": False}],
                  "shapes": [{"case": case, "tier": tier, "us": us, "level_95": error * (9 if case == "back" else 1),
                              "level_bias": -0.01, "largest_bias_mm": -0.1, "largest_95_mm": 0.2}
                             for case in ("point", "back") for tier, us, error in TIERS]},
        "modbus": {"read_us_p99": 58.0, "attack": {"none": {"worst_ms": 0.4}, "mute": {"worst_ms": 3.1}}},
        "real": {"why": "no recordings"}}
    made_up.update(changes)
    return made_up


class Page(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name)
        self.addCleanup(self.folder.cleanup)

    def made(self, figures):
        report_charts.draw(figures, self.path)
        return report_page.page(figures, self.path)

    def test_text_is_escaped_and_what_was_not_measured_says_why(self):
        page = self.made(results())
        self.assertIn("a &lt;processor&gt; &amp; more", page)
        self.assertIn("not measured: no recordings", page)
        self.assertNotIn("http://", page.replace("http://www.w3.org", "").replace("http://purl.org", "")
                         .replace("http://creativecommons.org", ""))

    def test_a_claim_that_falls_short_is_red_and_one_that_holds_is_not(self):
        rows = {row["claim"]: row for row in report_page.claims(results())}
        self.assertEqual([row["met"] for claim, row in rows.items() if "published way" in claim], [False])
        self.assertTrue(rows["… faster than CHOLMOD"]["met"])
        self.assertTrue(rows["A lawful client's worst answer under five attacks"]["met"])
        self.assertEqual(rows["A lawful client's worst answer under five attacks"]["ours"], "3.1 ms")
        self.assertIsNone(rows["A whole frame, 99 %"]["met"])
        self.assertIn("class=bad>73 times – falls short", self.made(results()))

    def test_the_advice_follows_the_figures_of_contained_cases(self):
        self.assertIn("<code>contact</code>", report_charts.advice(results())[0])
        shapes = results()["scene"]
        for row in shapes["shapes"]:
            row["level_95"] = 0.3 if row["tier"] == "contact" else row["level_95"]
        self.assertNotIn("<code>contact</code>", report_charts.advice(results(scene=shapes))[0])
        self.assertEqual(report_charts.advice(results(scene={"why": "not measured"})), [])

    def test_every_point_tells_what_it_is_and_by_which_command(self):
        page = self.made(results())
        self.assertIn("<title>newton 1+1 float, slow: 100 µs, 0.1 mm — scripts/report solver</title>", page)
        self.assertEqual(page.count("<figure>"), 4)  # numerics, registers, growth, parts
        ids = report_page.re.findall(r"\bid=['\"]([^'\"]+)", page)
        self.assertEqual(len(ids), len(set(ids)), "two pictures share an id")

    def test_times_beside_other_work_are_not_called_quiet(self):
        busy = {area: dict(how, load=7.5) for area, how in MEASURED.items()}
        self.assertIn("other work was running", self.made(results(measured=busy)))
        self.assertNotIn("other work was running", self.made(results()))

    def test_readme_gets_the_claims_between_its_markers_and_keeps_the_rest(self):
        readme = f"before\n{report_page.BEGIN}\nold\n{report_page.END}\nafter\n"
        renewed = report_page.with_claims(readme, report_page.claims(results()))
        self.assertTrue(renewed.startswith("before\n") and renewed.endswith("\nafter\n"))
        self.assertNotIn("\nold\n", renewed)
        self.assertIn("**73 times (falls short)**", renewed)
        with self.assertRaises(SystemExit):
            report_page.with_claims("no markers", [])


if __name__ == "__main__":
    unittest.main(verbosity=2)
