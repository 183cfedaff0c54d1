"""The report's charts that compare methods, its claims, and its advice, all from results.json. matplotlib draws: legends
outside crowded axes, marks by group and error bars, which gnuplot makes hard to read; the pictures are SVG."""
import math
import re
from collections import defaultdict

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402

plt.rcParams.update({"svg.hashsalt": "finsight", "svg.fonttype": "none", "font.size": 9, "axes.grid": True,
                     "grid.color": "#e3e7ec", "axes.spines.top": False, "axes.spines.right": False})
COLOURS = {"measures": "#8a6d3b", "map": "#1b9e77", "contact": "#d95f02", "map+newton": "#7570b3", "newton": "#1f78b4",
           "converged": "#444444", "float": "#1f78b4", "double": "#33a0d1", "eigen": "#e7298a", "cholmod": "#66a61e",
           "published": "#a6761d"}
MARKS = "osD^vP*X<>"
METHODS = {"float": "ours, float", "double": "ours, double", "eigen": "Eigen's LDLT", "cholmod": "CHOLMOD",
           "published": "the published way"}


def at(results, path):
    """results["a"]["b"] by "a.b"; None where it is missing or was not measured."""
    for key in path.split("."):
        results = results.get(key) if isinstance(results, dict) else None
    return results


def _off_68(results):
    coverage = at(results, "touch.coverage_68")
    return None if coverage is None else 100 * abs(coverage - 0.68)


def _percent(path):
    return lambda results: None if at(results, path) is None else 100 * at(results, path)


def _worst_attack(results):
    attacks = at(results, "modbus.attack")
    worst = [a["worst_ms"] for a in attacks.values() if isinstance(a, dict) and "worst_ms" in a] if attacks else []
    return max(worst) if worst else None


def _claim(area, claim, ours, unit, aim, peer=None, peer_is="", less_is_better=True):
    return {"area": area, "claim": claim, "ours": ours, "unit": unit, "aim": aim, "peer": peer, "peer_is": peer_is,
            "less_is_better": less_is_better}


CLAIMS = [
    _claim("solver", "One Newton iteration at the default mesh is faster than the published way", "solver.ratio_to_published",
           "times", 80, 1, "the paper's formulas, same mesh and machine", False),
    _claim("solver", "… faster than Eigen's sparse LDLT", "solver.ratio_to_eigen", "times", 1, 1, "Eigen 3", False),
    _claim("solver", "… faster than CHOLMOD", "solver.ratio_to_cholmod", "times", 1, 1, "SuiteSparse", False),
    _claim("solver", "Time grows almost as the number of tetrahedra", "solver.growth_exponent", "", 1.15),
    _claim("solver", "No hard case ends wrong or unflagged", "hard_cases.bad", "cases", 0),
    _claim("touch", "Touch from 4 mm of plate motion, new points, with noise: mean error", "touch.held_out_noisy.mean_above_4_mm",
           "mm", 2.0),
    _claim("touch", "The published radius holds 68 % of the errors: off by at most", _off_68, "points", 3),
    _claim("touch", "Normal force, new points, with noise: RMSE", "touch.force_rmse_n", "N", 0.25, 0.25,
           "the authors' later six-axis finger"),
    _claim("scene", "The radius also holds 68 % in each case of the pack's scene: off by at most", _percent("scene.worst_coverage_error"), "points", 3),
    _claim("scene", "Touches off by over three radii, worst case of any scene", _percent("scene.worst_lies"), "%", 0.3),
    _claim("fem", "The training truth agrees with CalculiX", "fem.calculix_max_diff_mm", "mm", 1e-4),
    _claim("force", "Contact forces from plate motions, one touch", "force.gauss_newton_s", "s", 1.0, "force.lbfgs_s",
           "the paper's L-BFGS, our code"),
    _claim("vision", "A whole frame, 99 %", "vision.frame_ms_p99", "ms", 16.7),
    _claim("modbus", "Read of 48 registers, 99 %, alone", "modbus.read_us_p99", "µs", 100),
    _claim("modbus", "A lawful client's worst answer under five attacks", _worst_attack, "ms", 5),
    _claim("page", "Three browsers that watch cost the frame loop (99 %)", "page.loop_cost_us", "µs", 30),
]


def _tiers(results):
    """Per tier over the cases that the pack's scene contains: time, 95 % of the deformation's error."""
    contained = {case["case"] for case in at(results, "scene.cases") or [] if case.get("contained")}
    sums = defaultdict(list)
    for row in at(results, "scene.shapes") or []:
        if row["case"] in contained:
            sums[row["tier"]].append((row["us"], row["level_95"], abs(row["largest_bias_mm"])))
    return {tier: [sum(column) / len(rows) for column in zip(*rows)] for tier, rows in sums.items()}


def advice(results):
    tiers = _tiers(results)
    if not tiers:
        return []
    best = min(tiers, key=lambda name: tiers[name][1])
    fastest = min(tiers, key=lambda name: tiers[name][0])

    def said(name):
        us, level, largest = tiers[name]
        return f"{us:,.0f} µs a frame, the deformation within {100 * level:.1f} % (95 %), the largest displacement off by {largest:.2f} mm"
    lines = [f"<b>Shape, registers and the dimple under the touch: <code>{best}</code></b> ({said(best)}). The most accurate in the "
             "cases that the pack's scene contains; where no touch of the scene explains the plates, the shape map answers for it. "
             "This is what tier <code>best</code>, the default, chooses where the pack has a contact map."]
    if fastest != best:
        lines.append(f"<b>Registers only, on the smallest board: <code>{fastest}</code></b> ({said(fastest)}). It makes no shape at "
                     "all, so no viewer and no page can show one.")
    if "newton" in tiers and best != "newton":
        lines.append(f"<b>Loads that no training has seen: <code>newton</code></b> ({said('newton')}). It minimises an energy for "
                     "the plates alone, so it cannot know the dimple; but it depends on no training.")
    return lines


def _front(points):
    """Those that no other point beats in both time and error."""
    front, least = [], math.inf
    for time, error in sorted(points):
        if error < least:
            front.append((time, error))
            least = error
    return front


class Chart:
    """A figure whose points tell what they are when the pointer rests on them."""

    def __init__(self, columns=1, height=3.6, rows=1):
        self.figure, axes = plt.subplots(rows, columns, figsize=(min(12, 1.5 + 4.2 * columns), height * rows), squeeze=False)
        self.axes, self.titles = axes.ravel(), []

    def point(self, axes, x, y, title, **style):
        (mark,) = axes.plot([x], [y], linestyle="none", **style)
        mark.set_gid(f"point{len(self.titles)}")
        self.titles.append(title)

    def write(self, file):
        self.figure.tight_layout()
        self.figure.savefig(file, bbox_inches="tight", metadata={"Date": None})
        plt.close(self.figure)
        svg = file.read_text()
        for k, title in enumerate(self.titles):
            text = title.replace("&", "&amp;").replace("<", "&lt;")
            svg = re.sub(rf'(<g id="point{k}">)', rf"\1<title>{text}</title>", svg)
        file.write_text(svg)


def _outside(chart, handles):
    chart.figure.legend(handles=handles, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _key(label, **style):
    return plt.Line2D([], [], linestyle="none", label=label, **style)


def numerics(results, file):
    rows = [row for row in results.get("speed_error") or [] if row.get("worst_mm") and row.get("us_per_frame")]
    if not rows:
        return
    meshes, motions = sorted({row["mesh_tets"] for row in rows}), sorted({row["motion"] for row in rows})
    chart = Chart(min(2, len(meshes)), rows=math.ceil(len(meshes) / 2))
    for axes, mesh in zip(chart.axes, meshes):
        here = [row for row in rows if row["mesh_tets"] == mesh]
        for row in here:
            schedule = f"{row['factorisations']}+{row['chords']}" if row["factorisations"] else ""
            colour = COLOURS.get(row["tier"], "#888888")
            chart.point(axes, row["us_per_frame"], row["worst_mm"],
                        f"{row['tier']} {schedule} {row['scalar']}, {row['motion']}: {row['us_per_frame']:.0f} µs, "
                        f"{row['worst_mm']:.2g} mm — scripts/report solver", color=colour, ms=5,
                        marker=MARKS[motions.index(row["motion"]) % len(MARKS)],
                        markerfacecolor=colour if row["scalar"] == "float" else "none")
        front = _front([(row["us_per_frame"], row["worst_mm"]) for row in here if row["motion"] == motions[0]])
        axes.plot(*zip(*front), color="#999999", lw=1, zorder=0)
        axes.set(xscale="log", yscale="log", title=f"{mesh:,} tetrahedra", xlabel="µs per frame", ylabel="worst distance, mm")
    for axes in chart.axes[len(meshes):]:
        axes.set_visible(False)
    tiers = sorted({row["tier"] for row in rows})
    _outside(chart, [_key(tier, marker="s", color=COLOURS.get(tier, "#888888")) for tier in tiers] +
             [_key(motion, marker=MARKS[k % len(MARKS)], color="#555555") for k, motion in enumerate(motions)] +
             [plt.Line2D([], [], color="#999999", lw=1, label=f"nothing is better both ways ({motions[0]})")])
    chart.write(file)


def model(results, file):
    rows = at(results, "shape.tiers") or []
    if not rows:
        return
    chart = Chart(2)
    for axes, key, title in ((chart.axes[0], "touch_point", "at the touched point"), (chart.axes[1], "front", "front face")):
        for row in rows:
            for noise, face in (("noisy", COLOURS.get(row["tier"], "#888888")), ("clean", "none")):
                error = row.get(f"{key}_{noise}_mm")
                if error:
                    chart.point(axes, row["us_per_frame"], error, f"{row['tier']}, {noise}: {row['us_per_frame']:.0f} µs, "
                                f"{error:.3f} mm — scripts/report touch", marker="o", ms=7,
                                color=COLOURS.get(row["tier"], "#888888"), markerfacecolor=face)
        front = _front([(row["us_per_frame"], row[f"{key}_noisy_mm"]) for row in rows])
        axes.plot(*zip(*front), color="#999999", lw=1, zorder=0)
        axes.set(xscale="log", yscale="log", title=title, xlabel="µs per frame", ylabel="mean distance to the truth, mm")
    _outside(chart, [_key(row["tier"], marker="s", color=COLOURS.get(row["tier"], "#888888")) for row in rows] +
             [_key("with noise", marker="o", color="#555555"), _key("exact poses", marker="o", color="#555555", markerfacecolor="none")])
    chart.write(file)


def registers(results, file):
    rows = [row for row in at(results, "scene.shapes") or [] if row["level_95"] > 0]
    if not rows:
        return
    chart = Chart(1, 4.2)
    axes, cases = chart.axes[0], list(dict.fromkeys(row["case"] for row in rows))
    for row in rows:
        chart.point(axes, row["us"], 100 * row["level_95"], f"{row['tier']}, {row['case']}: {row['us']:.0f} µs, "
                    f"{100 * row['level_95']:.1f} % — scripts/report scene", marker="o", ms=5, alpha=0.8,
                    color=COLOURS.get(row["tier"], "#888888"))
    tiers = list(dict.fromkeys(row["tier"] for row in rows))
    middle = [(sorted(r["us"] for r in rows if r["tier"] == t)[len(cases) // 2],
               sorted(100 * r["level_95"] for r in rows if r["tier"] == t)[len(cases) // 2]) for t in tiers]
    axes.plot(*zip(*_front(middle)), color="#999999", lw=1, zorder=0)
    axes.set(xscale="log", yscale="log", xlabel="µs per frame", ylabel="deformation, 95 % of relative errors, %")
    _outside(chart, [_key(tier, marker="s", color=COLOURS.get(tier, "#888888")) for tier in tiers])
    chart.write(file)


def _slope(points):
    x, y = [math.log(p[0]) for p in points], [math.log(p[1]) for p in points]
    mx, my = sum(x) / len(x), sum(y) / len(y)
    return sum((a - mx) * (b - my) for a, b in zip(x, y)) / sum((a - mx) ** 2 for a in x)


def growth(results, file):
    rows = at(results, "solver.iterations") or []
    ways = list(dict.fromkeys(row["way"] for row in rows))
    if not ways:
        return
    chart = Chart(1, 4)
    for way in ways:
        points = sorted((row["mesh_tets"], row["sum_us"] / 1000) for row in rows if row["way"] == way)
        exponent = f", exponent {_slope(points):.2f}" if len(points) > 1 else ""
        chart.axes[0].plot(*zip(*points), marker="o", color=COLOURS.get(way), label=METHODS.get(way, way) + exponent)
        for tets, ms in points:
            chart.point(chart.axes[0], tets, ms, f"{METHODS.get(way, way)}, {tets:,} tetrahedra: {ms:.3g} ms — scripts/report solver",
                        marker="o", color=COLOURS.get(way))
    chart.axes[0].set(xscale="log", yscale="log", xlabel="tetrahedra", ylabel="one Newton iteration, ms")
    chart.axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    chart.write(file)


def parts(results, file):
    rows = sorted((row for row in at(results, "solver.iterations") or [] if row["way"] == "float"), key=lambda r: r["mesh_tets"])
    if not rows:
        return
    chart = Chart(1, 3)
    axes, names = chart.axes[0], [f"{row['mesh_tets']:,}" for row in rows]
    left = [0.0] * len(rows)
    for part, colour in (("derivatives", "#1f78b4"), ("factor", "#d95f02"), ("solve", "#1b9e77"), ("step", "#7570b3")):
        shares = [100 * row[f"{part}_us"] / row["sum_us"] for row in rows]
        axes.barh(names, shares, left=left, color=colour, label=part)
        for y, (start, share, row) in enumerate(zip(left, shares, rows)):
            if share > 6:
                axes.text(start + share / 2, y, f"{row[f'{part}_us']:,.0f} µs", ha="center", va="center", color="white", fontsize=8)
        left = [a + b for a, b in zip(left, shares)]
    axes.set(xlabel="share of an iteration, %", ylabel="tetrahedra", xlim=(0, 100))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    chart.write(file)


def draw(results, folder):
    for name, chart in (("speed_numerics", numerics), ("speed_model", model), ("speed_registers", registers), ("growth", growth),
                        ("parts", parts)):
        chart(results, folder / f"{name}.svg")
