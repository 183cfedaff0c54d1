"""What the report claims, beside what others reach, and the tier that it advises, all from results.json."""
from collections import defaultdict

BEGIN, END = "<!-- BEGIN GENERATED claims by `scripts/report --readme` -->", "<!-- END GENERATED claims -->"
README_FOLDER = "hostgen/report"  # where README's plots and the figures of its claims are kept
README_PLOTS = [
    ("growth.svg", "Time of one Newton iteration against the number of tetrahedra, by method"),
    ("speed_model.svg", "Time per frame of each tier against its distance to the finite-element shape"),
    ("reliability.svg", "Share of touch errors inside the published radius, by plate motion"),
]


def number(value, places=3):
    if value == 0:
        return "0"
    if not isinstance(value, float):
        return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)
    if abs(value) >= 10 ** places:
        return f"{value:,.0f}"
    text = f"{value:.{places}g}"
    return f"{float(text):g}" if "e" in text and abs(value) > 1e-4 else text


def at(results, path):
    """results["a"]["b"] by "a.b"; None where it is missing or was not measured."""
    for key in path.split("."):
        results = results.get(key) if isinstance(results, dict) else None
    return results


def _off_68(path):
    return lambda results: None if at(results, path) is None else 100 * abs(at(results, path) - 0.68)


def _percent(path):
    return lambda results: None if at(results, path) is None else 100 * at(results, path)


def _worst_r2(results):
    values = at(results, "real.random.r2")
    return min(values) if values else None


def _strong(figure, axis=None):
    """Of touches as the pack's scene draws them, from 4 mm of plate motion: a figure, of its worst axis unless one is named."""
    def of(results):
        cases = at(results, "scene.cases") or []
        values = next((case.get(figure) for case in cases if case["case"] == "any touch of the scene, from 4 mm of plate motion"), None)
        if isinstance(values, list):
            return max(values) if axis is None else values[axis]
        return values
    return of


def _worst_lies(contained):
    def worst(results):
        cases = at(results, "scene.cases") or []
        lies = [case["lies"] for case in cases if "lies" in case and case.get("contained") == contained]
        return 100 * max(lies) if lies else None
    return worst


def _least_lies(results):
    """What the best test of the plates would leave of two pushes, where most lies are."""
    lies = [case["lies_at_best"] for case in at(results, "scene.imitated") or []]
    return 100 * max(lies) if lies else None


def _worst_attack(results):
    attacks = at(results, "modbus.attack")
    worst = [a["worst_ms"] for a in attacks.values() if isinstance(a, dict) and "worst_ms" in a] if attacks else []
    hostile = at(results, "modbus.hostile_worst_ms")  # the fifth: functions that Modbus libraries sleep on
    return max(worst + [hostile or 0]) if worst else None


def _off_the_finest(results):
    """How far the default mesh bends, against the finest one."""
    bends_mm = {row["mesh"]: row["selective_mm"] for row in at(results, "fem.locking") or []}
    if not {"default", "finest"} <= bends_mm.keys():
        return None
    return 100 * abs(bends_mm["default"] / bends_mm["finest"] - 1)


def _claim(area, claim, ours, unit, aim, peer=None, peer_is="", less_is_better=True, rounds=None):
    """`rounds`: where the rounds of this figure stand, if the aim is as small as their spread; the upper quartile has to meet it."""
    return {"area": area, "claim": claim, "ours": ours, "unit": unit, "aim": aim, "peer": peer, "peer_is": peer_is,
            "less_is_better": less_is_better, "rounds": rounds}


CLAIMS = [
    _claim("solver", "One Newton iteration at the default mesh, in float as the loop runs it, is faster than the published way", "solver.ratio_to_published",
           "times", 80, 1, "the paper's formulas in double, same mesh and machine", False),
    _claim("solver", "… and in double on both sides", "solver.double_ratio_to_published", "times", 1, 1,
           "the same in double", False),
    _claim("solver", "… faster than Eigen's sparse LDLT", "solver.ratio_to_eigen", "times", 1, 1, "Eigen 3, in double", False),
    _claim("solver", "… faster than CHOLMOD", "solver.ratio_to_cholmod", "times", 1, 1, "SuiteSparse, in double", False),
    _claim("solver", "Time grows almost as the number of tetrahedra, 1,700 to 16,000: exponent", "solver.growth_exponent", "", 1.15),
    _claim("hard", "No hard case ends further from the converged shape than its limit, or inverted without a flag", "hard_cases.bad", "cases", 0),
    _claim("hard", "… nor any motion of the random search (10,000 in full)", "hard_cases.search.bad", "motions", 0),
    _claim("touch", "Touch from 4 mm of plate motion, held-out paths, with noise: mean error", "touch.held_out_from_4_mm.mean_mm",
           "mm", 2.0),
    _claim("scene", "Touch from 4 mm of plate motion, drawn as the scene draws it and solved apart, with noise: mean error", _strong("touch_mm"),
           "mm", 2.0),
    _claim("scene", "… normal force: RMSE", _strong("force_rmse_n", 0), "N", 0.25, 0.25, "the authors' later six-axis finger"),
    _claim("scene", "… force across the face", _strong("force_rmse_n", 1), "N", 0.25, 0.24, "the same"),
    _claim("scene", "… force along the face, where it is told at all", _strong("force_rmse_n", 2), "N", 0.25, 0.35, "the same"),
    _claim("scene", "… moment about the base, worst axis", _strong("moment_rmse_nm"), "N m", 0.03, 0.034, "the same"),
    _claim("touch", "The published radius holds 68 % of the errors of all new touches together: off by", _off_68("touch.coverage_68"), "points", 3),
    _claim("scene", "The radius also holds 68 % in each case of the pack's scene: off by at most", _percent("scene.worst_coverage_error"), "points", 3),
    _claim("scene", "Touches off by over three radii, worst case of the pack's scene", _worst_lies(True), "%", 0.3),
    _claim("scene", "… worst case of those that it does not contain", _worst_lies(False), "%", 0.3, _least_lies,
           "the best test that the plates allow, at the median radius of touches"),
    _claim("fit", "Force after nine weights, fingers as a workshop makes them: mean error", _percent("fit.after.force_relative"), "%", 5,
           _percent("fit.before.force_relative"), "before the fit"),
    _claim("fit", "… in newtons", "fit.after.force_mean_n", "N", 0.15, "fit.before.force_mean_n", "before the fit"),
    _claim("fit", "… touch from 4 mm of plate motion: mean error", "fit.after.touch_mean_mm", "mm", 1.0, "fit.before.touch_mean_mm",
           "before the fit"),
    _claim("fit", "… drift of a force over a minute", _percent("fit.after.drift"), "%", 2, _percent("fit.before.drift"),
           "before the fit"),
    _claim("fit", "… its radius holds 68 % of the errors: off by", _off_68("fit.after.coverage_68"), "points", 3),
    _claim("fit", "… the radius of a finger that was not fitted: off by", _off_68("fit.before.coverage_68"), "points", 5),
    _claim("fit", "… and the deviation of its force: off by", _off_68("fit.before.force_coverage_68"), "points", 5),
    _claim("fit", "… with smoothing_ms = 50 in the board file: force", _percent("fit.smoothed.force_relative"), "%", 5,
           _percent("fit.before.force_relative"), "before the fit, not smoothed"),
    _claim("fit", "… so smoothed, in newtons", "fit.smoothed.force_mean_n", "N", 0.15, "fit.before.force_mean_n", "the same"),
    _claim("fit", "… touch", "fit.smoothed.touch_mean_mm", "mm", 1.0, "fit.before.touch_mean_mm", "the same"),
    _claim("fem", "The finite elements, with CalculiX's kind of element, agree with CalculiX", "fem.calculix_max_diff_mm", "mm", 1e-4),
    _claim("fem", "… with their own, on the mesh of the packs, bend as far as on the finest: difference", _off_the_finest, "%", 5),
    _claim("real", "Touch on a real finger's recordings by a quarter second of motion, random split as in the paper: R² of the worst axis", _worst_r2, "", 0.942, 0.942,
           "the paper's network, on its own recordings", False),
    _claim("force", "Contact forces from plate motions, one touch", "force.gauss_newton_s", "s", 1.0, "force.lbfgs_s",
           "the paper's L-BFGS, our code"),
    _claim("vision", "A whole frame of 1280×720 pixels, 99 %", "vision.frame_ms_p99", "ms", 16.7),
    _claim("modbus", "Read of 48 registers, 99 %, on an idle machine", "modbus.read_us_p99", "µs", 100),
    _claim("modbus", "A lawful client's worst answer under five attacks", _worst_attack, "ms", 5),
    _claim("page", "Three browsers that watch cost the frame loop (99 %)", "page.loop_cost_us", "µs", 30,
           rounds="page.cost_us_by_round"),
    _claim("fingers", "Two fingers on one machine, 1280×720 pixels at 60 frames/s: a frame of either, 99 %", "fingers.2.p99_ms", "ms", 16.7),
]


def _tiers(results):
    """Per tier, over the cases that the pack's scene contains: mean time, and of the worst case, 95 % of the
    errors of the deformation (a share) and of the largest displacement (mm)."""
    wanted = {case["case"] for case in at(results, "scene.cases") or [] if case.get("contained")}
    rows = defaultdict(list)
    for row in at(results, "scene.shapes") or []:
        if row["case"] in wanted:
            rows[row["tier"]].append(row)
    return {tier: (sum(row["us"] for row in of) / len(of), max(row["level_95"] for row in of),
                   max(row["largest_95_mm"] for row in of)) for tier, of in rows.items()}


def _beyond_the_scene(results, best):
    """Where newton is nearer than the advised tier in cases that the scene does not contain, in words."""
    contained = {case["case"] for case in at(results, "scene.cases") or [] if case.get("contained")}
    level = {(row["tier"], row["case"]): row["level_95"] for row in at(results, "scene.shapes") or []}
    others = [case for tier, case in level if tier == "newton" and case not in contained and (best, case) in level]
    nearer = [f"{case} ({100 * level['newton', case]:.1f} instead of {100 * level[best, case]:.1f} %)" for case in others
              if level["newton", case] < level[best, case]]
    return others, nearer


def advice(results):
    tiers = _tiers(results)
    if not tiers:
        return []
    best = min(tiers, key=lambda name: tiers[name][1])
    fastest = min(tiers, key=lambda name: tiers[name][0])

    def said(name):
        us, level, largest = tiers[name]
        return (f"{us:,.0f} µs a frame; 95 % of the deformations within {100 * level:.1f} % and of the largest displacements within "
                f"{largest:.2f} mm in the worst of these cases")
    lines = [f"<b>Shape, registers and the dimple under the touch: <code>{best}</code></b> ({said(best)}). The most accurate in the "
             "cases that the pack's scene contains; where no touch of the scene explains the plates, the shape map answers for it. "
             "This is what tier <code>best</code>, the default, chooses where the pack has a contact map."]
    if fastest != best:
        lines.append(f"<b>Registers only, on the smallest board: <code>{fastest}</code></b> ({said(fastest)}). It makes no shape at "
                     "all, so no viewer and no page can show one.")
    others, nearer = _beyond_the_scene(results, best)
    if others and best != "newton":
        where = f"only here: {'; '.join(nearer)}" if nearer else "nowhere"
        lines.append(f"<b>A shape that depends on no training: <code>newton</code></b> ({said('newton')}). It minimises an energy for "
                     f"the plates alone, so it cannot know the dimple. Of {len(others)} cases outside the pack's scene it is nearer "
                     f"than <code>{best}</code> {where} (95 % of the deformations).")
    return lines


def value_of(results, wanted):
    """Of a claim: a number, a path of results.json, or a function of all of it."""
    if wanted is None or isinstance(wanted, (int, float)):
        return wanted
    return wanted(results) if callable(wanted) else at(results, wanted)


def claims(results):
    """What is claimed beside what others reach: rows of words, with whether the aim is met."""
    rows = []
    for claim in CLAIMS:
        ours = value_of(results, claim["ours"])
        peer = value_of(results, claim["peer"])
        measured = results.get("measured", {}).get(claim["area"], {})
        row = {"claim": claim["claim"], "ours": "not measured", "peer": "–", "ratio": "–", "met": None,
               "peer_is": claim["peer_is"], "command": measured.get("command", f"scripts/report {claim['area']}"),
               "date": measured.get("date", "–"), "commit": measured.get("commit", "–")}
        if ours is not None:
            row["ours"] = f"{number(float(ours))} {claim['unit']}".strip()
            row["met"] = ours <= claim["aim"] if claim["less_is_better"] else ours >= claim["aim"]
            rounds = sorted(value_of(results, claim["rounds"]) or [])
            if len(rounds) > 3:
                lower, upper = rounds[len(rounds) // 4], rounds[-1 - len(rounds) // 4]
                row["ours"] += f" (quartiles {number(float(lower))} to {number(float(upper))})"
                row["met"] = upper <= claim["aim"]
        if peer is not None:
            row["peer"] = f"{number(float(peer))} {claim['unit']}".strip()
            if ours:
                row["ratio"] = f"{number(float(peer / ours if claim['less_is_better'] else ours / peer), 2)} ×"
        row["aim"] = f"{'≤' if claim['less_is_better'] else '≥'} {number(float(claim['aim']))} {claim['unit']}".strip()
        rows.append(row)
    return rows


def claims_html(rows):
    body = ""
    for row in rows:
        mark = "" if row["met"] is None else " class=good" if row["met"] else " class=bad"
        short = "" if row["met"] is not False else " – falls short"
        body += (f"<tr><td>{row['claim']}</td><td{mark}>{row['ours']}{short}</td><td>{row['aim']}</td><td>{row['peer_is']}</td>"
                 f"<td>{row['peer']}</td><td>{row['ratio']}</td><td class=how><code>{row['command']}</code><br>{row['date']}, "
                 f"{row['commit']}</td></tr>\n")
    return ("<div class=wide><table class=words><thead><tr><th>claim</th><th>ours</th><th>aim</th><th>beside</th><th>theirs</th>"
            f"<th>ratio</th><th>made again by</th></tr></thead><tbody>\n{body}</tbody></table></div>\n")


def claims_markdown(rows):
    """The same for README, without dates and commits, and of what has been measured alone."""
    text = "| claim | ours | aim | beside | theirs | ratio | command |\n|---|---|---|---|---|---|---|\n"
    for row in rows:
        if row["met"] is None:
            continue
        ours = f"**{row['ours']} (falls short)**" if row["met"] is False else row["ours"]
        text += f"| {row['claim']} | {ours} | {row['aim']} | {row['peer_is']} | {row['peer']} | {row['ratio']} | `{row['command']}` |\n"
    return text


def with_claims(readme, rows, plots):
    before, marker, rest = readme.partition(BEGIN)
    if not marker or END not in rest:
        raise SystemExit(f"report: the file has no lines {BEGIN} and {END}")
    pictures = "".join(f"\n![{words}]({README_FOLDER}/{name})\n" for name, words in plots)
    return before + BEGIN + "\n" + claims_markdown(rows) + pictures + END + rest.partition(END)[2]
