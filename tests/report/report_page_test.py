#!/usr/bin/python3
"""The report's page: its words, its claims and its charts, from figures made up for the test."""
import json
import sys
import tempfile
import unittest
from pathlib import Path

SOURCE = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(SOURCE / "scripts" / "lib"))
import report_charts  # noqa: E402
import report_claims  # noqa: E402
import report_page  # noqa: E402

TIERS = (("measures", 20.0, 0.12), ("contact", 60.0, 0.02), ("newton", 1000.0, 0.12))
MEASURED = {area: {"command": f"scripts/report {area}", "date": "2026-01-01", "commit": "abc", "others": 0.02}
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
        "modbus": {"read_us_p99": 58.0, "hostile_worst_ms": 3.1, "attack": {"none": {"worst_ms": 0.4}, "mute": {"worst_ms": 2.9}}},
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

    def test_forces_are_claimed_of_strong_touches_that_the_scene_draws_and_lies_beside_what_no_test_can_find(self):
        cases = [{"case": "any touch of the scene", "contained": True, "lies": 0.01, "force_rmse_n": [9.0, 9.0, 9.0]},
                 {"case": "any touch of the scene, from 4 mm of plate motion", "contained": True, "lies": 0.002, "touch_mm": 1.5,
                  "force_rmse_n": [0.2, 0.3, 0.7], "moment_rmse_nm": [0.01, 0.04, 0.02]},
                 {"case": "two", "contained": False, "lies": 0.2}]
        scene = {"cases": cases, "imitated": [{"lies_at_best": 0.03}, {"lies_at_best": 0.07}]}
        said = {row["claim"]: row for row in report_claims.claims(results(scene=scene)) if "scene" in row["command"]}
        ours = [row["ours"] for row in said.values()]
        self.assertEqual(ours[:5], ["1.5 mm", "0.2 N", "0.3 N", "0.7 N", "0.04 N m"])
        self.assertEqual([row["met"] for row in said.values()][:5], [True, True, False, False, False])
        self.assertEqual((ours[-2], ours[-1], list(said.values())[-1]["peer"]), ("1 %", "20 %", "7 %"))

    def test_a_claim_that_falls_short_is_red_and_one_that_holds_is_not(self):
        rows = {row["claim"]: row for row in report_claims.claims(results())}
        self.assertEqual([row["met"] for claim, row in rows.items() if "published way" in claim], [False])
        self.assertTrue(rows["… faster than CHOLMOD"]["met"])
        self.assertTrue(rows["A lawful client's worst answer under five attacks"]["met"])
        self.assertEqual(rows["A lawful client's worst answer under five attacks"]["ours"], "3.1 ms")
        self.assertIsNone(rows["A whole frame of 1280×720 pixels, 99 %"]["met"])
        self.assertIn("class=bad>73 times – falls short", self.made(results()))

    def test_a_claim_smaller_than_the_spread_of_its_rounds_is_not_met(self):
        def cost(rounds):
            figures = results(page={"loop_cost_us": sorted(rounds)[len(rounds) // 2], "cost_us_by_round": rounds})
            return next(row for row in report_claims.claims(figures) if "browsers" in row["claim"])
        self.assertTrue(cost([-9.0, 1.0, 5.0, 8.0, 90.0])["met"])
        self.assertEqual(cost([-90.0, 90.0, 5.0, -80.0, 80.0])["ours"], "5 µs (quartiles -80 to 80)")
        self.assertFalse(cost([-90.0, 90.0, 5.0, -80.0, 80.0])["met"])

    def test_words_stand_for_keys_in_cells_and_what_others_publish_stands_below_ours(self):
        page = self.made(results(real={"methods": {"history": {"random": {"r2": [0.9, 0.9, 0.9]}}}}))
        self.assertIn("<td>a quarter second of motion</td>", page)
        self.assertIn("<td>the paper&#x27;s network, as published</td><td>0.968 / 0.942 / 0.954</td>", page)

    def test_the_advice_follows_the_figures_of_contained_cases(self):
        self.assertIn("<code>contact</code>", report_claims.advice(results())[0])
        shapes = results()["scene"]
        for row in shapes["shapes"]:
            row["level_95"] = 0.3 if row["tier"] == "contact" else row["level_95"]
        self.assertNotIn("<code>contact</code>", report_claims.advice(results(scene=shapes))[0])
        self.assertEqual(report_claims.advice(results(scene={"why": "not measured"})), [])

    def test_every_point_tells_what_it_is_and_by_which_command(self):
        page = self.made(results())
        self.assertIn("<title>newton 1+1 float, slow: 100 µs, 0.1 mm — scripts/report solver</title>", page)
        self.assertEqual(page.count("<figure>"), 4)  # numerics, registers, growth, parts
        ids = report_page.re.findall(r"\bid=['\"]([^'\"]+)", page)
        self.assertEqual(len(ids), len(set(ids)), "two pictures share an id")

    def test_times_beside_other_work_are_not_called_quiet(self):
        busy = {area: dict(how, others=1.5) for area, how in MEASURED.items()}
        self.assertIn("are not quiet", self.made(results(measured=busy)))
        self.assertNotIn("are not quiet", self.made(results()))

    def test_readme_gets_the_claims_between_its_markers_and_keeps_the_rest(self):
        readme = f"before\n{report_claims.BEGIN}\nold\n{report_claims.END}\nafter\n"
        renewed = report_claims.with_claims(readme, report_claims.claims(results()), [["growth.svg", "Time against size"]])
        self.assertTrue(renewed.startswith("before\n") and renewed.endswith("\nafter\n"))
        self.assertNotIn("\nold\n", renewed)
        self.assertIn("**73 times (falls short)**", renewed)
        self.assertIn("![Time against size](hostgen/report/growth.svg)", renewed)
        self.assertNotIn("not measured", renewed)
        with self.assertRaises(SystemExit):
            report_claims.with_claims("no markers", [], [])

    def test_readme_keeps_the_claims_of_areas_that_were_not_measured_here(self):
        kept = self.path / report_claims.README_FOLDER
        kept.mkdir(parents=True)
        readme = self.path / "README.md"
        readme.write_text(f"{report_claims.BEGIN}\n{report_claims.END}\n")
        measured_here, made = results(), self.path / "made"
        made.mkdir()
        report_charts.draw(measured_here, made)
        elsewhere = results(vision={"frame_ms_p99": 5.5}, modbus={"read_us_p99": 77.0})
        report_page.renew_readme(readme, elsewhere, made)
        report_page.renew_readme(readme, measured_here, made)
        self.assertIn("5.5 ms", readme.read_text())
        self.assertIn("58 µs", readme.read_text())
        self.assertNotIn("77 µs", readme.read_text())
        names = [claim["claim"] for claim in report_claims.CLAIMS]
        self.assertEqual(len(names), len(set(names)), "a claim that keeps its figure is found by its name")
        (made / "growth.svg").unlink()
        report_page.renew_readme(readme, measured_here, made)
        self.assertIn("growth.svg", readme.read_text())

    def test_readme_shows_the_claims_of_the_report_that_it_was_made_from(self):
        readme = (SOURCE / "README.md").read_text()
        kept = json.loads((SOURCE / report_claims.README_FOLDER / "claims.json").read_text())
        self.assertEqual(readme, report_claims.with_claims(readme, kept["claims"], kept["plots"]),
                         "README's claims were changed by hand, or claims.json was: scripts/report --readme writes both")
        self.assertEqual([row["claim"] for row in kept["claims"]], [claim["claim"] for claim in report_claims.CLAIMS],
                         "the report claims something else by now: scripts/report --readme")
        for name, _ in kept["plots"]:
            self.assertTrue((SOURCE / report_claims.README_FOLDER / name).exists(), name)

    def test_hard_cases_touches_and_limits_are_drawn(self):
        rest = [[0, 0, 0], [1000, 0, 0], [0, 1000, 0], [0, 0, 1000]]
        (self.path / "hard_states.json").write_text(json.dumps({
            "tet_nodes": [0, 1, 2, 3], "rest_mm_100": sum(rest, []),
            "states": [{"name": "a & b", "worst_mm": 0.5, "node_mm_100": sum(rest[:3] + [[0, 300, 1500]], [])}]}))
        touch = {"face": [{"x_mm": 1.0, "y_mm": 70.0, "touches": 9, "published": 0.9, "mean_mm": 1.25, "error_95_mm": 2.5},
                          {"x_mm": 2.0, "y_mm": 20.0, "touches": 0, "published": 0, "mean_mm": None, "error_95_mm": None}],
                 "reliability": [{"from_mm": 4, "touches": 100, "inside": [0.1 * k for k in range(10)]},
                                 {"from_mm": 7, "touches": 3, "inside": [1.0] * 10}]}
        touch |= {"by_plate_motion": [{"from_mm": start, "touches": 5, "mean_mm": 2.0, "error_95_mm": 4.5} for start in (0, 4)]}
        figures = results(touch=touch, hard_cases={"total": 1, "families": [{"family": "noise", "cases": 3, "bad": 0}]})
        figures["solver"]["limit"] = {"multiply_adds_per_us": 80000, "cache_bytes_per_us": 100000}
        for row in figures["solver"]["iterations"]:
            row |= {"factor_operations": 1e7, "factor_mb": 1.0}
        page = self.made(figures)
        self.assertIn("a &amp; b: 0.5 mm", page)
        self.assertIn("<title>x 1.0, y 70.0 mm: 1.25 mm, 9 touches — scripts/report touch</title>", page)
        self.assertIn("the multiply-adds alone, at the core's peak", page.replace("&#x27;", "'"))
        self.assertIn("plate motion from 4 mm (100 touches)", page)
        self.assertNotIn("plate motion from 7 mm", page)
        self.assertIn("<title>from 4 mm, 95 % are smaller: 4.50 mm, 5 touches — scripts/report touch</title>", page)
        self.assertIn("<td>noise</td><td>3</td>", page)

    def test_the_cases_whose_radius_is_furthest_off_are_named(self):
        cases = [{"case": f"case {k}", "contained": True, "inside_radius": 0.68 - 0.02 * k, "inside_curve": [0.05 * j for j in range(20)]}
                 for k in range(9)]
        page = self.made(results(scene=results()["scene"] | {"cases": cases}))
        chart = (self.path / "scene_reliability.svg").read_text()
        self.assertIn(">case 8<", chart)
        self.assertNotIn(">case 2<", chart)
        self.assertIn(">the other 3<", chart)
        self.assertIn("promised: 68 % inside 1 published radii", page)

    def test_objects_in_rows_become_columns(self):
        rows = report_page.rows_of({"mlp": {"r2": [1], "held_out_noisy": {"r2": [2]}}, "why": "text"})
        self.assertEqual(rows[0]["method"], "mlp")
        self.assertEqual(rows[0]["held_out_noisy_r2"], [2])
        self.assertEqual(len(rows), 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
