"""The report's charts, from results.json. matplotlib draws: legends outside crowded axes, marks by group and hints, which gnuplot
makes hard to read; the pictures are SVG."""
import json
import math
import re
import textwrap
from collections import defaultdict

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.collections import PolyCollection  # noqa: E402
from matplotlib.ticker import LogLocator, NullFormatter  # noqa: E402

from report_claims import at  # noqa: E402

plt.rcParams.update({"svg.hashsalt": "finsight", "svg.fonttype": "none", "font.size": 9, "axes.grid": True, "axes.axisbelow": True,
                     "grid.color": "#e3e7ec", "axes.spines.top": False, "axes.spines.right": False})
COLOURS = {"measures": "#8a6d3b", "map": "#1b9e77", "contact": "#d95f02", "map+newton": "#7570b3", "newton": "#1f78b4",
           "converged": "#444444", "float": "#1f78b4", "double": "#33a0d1", "eigen": "#e7298a", "cholmod": "#66a61e",
           "published": "#a6761d"}
MARKS = "osD^vP*X<>"
METHODS = {"float": "ours, float", "double": "ours, double", "eigen": "Eigen's LDLT", "cholmod": "CHOLMOD",
           "published": "the published way"}


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
        for axis in [axis for axes in self.axes for axis in (axes.xaxis, axes.yaxis) if axis.get_scale() == "log"]:
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=(1,) if high > 300 * low else (1, 2, 5), numticks=12))
            axis.set_major_formatter(lambda value, _: f"{value:,.7g}")
            axis.set_minor_formatter(NullFormatter())
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
    rows = [row for row in results.get("speed_error") or []
            if row.get("worst_mm") and row.get("us_per_frame") and row["tier"] != "measures"]  # which has no nodes
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
        schedules = defaultdict(list)
        for row in here:
            schedules[row["tier"], row["factorisations"], row["chords"], row["scalar"]].append(row)
        front = _front([(max(row["us_per_frame"] for row in of), max(row["worst_mm"] for row in of)) for of in schedules.values()])
        axes.plot(*zip(*front), color="#999999", lw=1, zorder=0)
        axes.set(xscale="log", yscale="log", title=f"{mesh:,} tetrahedra", xlabel="µs per frame", ylabel="worst distance, mm")
    for axes in chart.axes[len(meshes):]:
        axes.set_visible(False)
    tiers = sorted({row["tier"] for row in rows})
    _outside(chart, [_key(tier, marker="s", color=COLOURS.get(tier, "#888888")) for tier in tiers] +
             [_key(motion, marker=MARKS[k % len(MARKS)], color="#555555") for k, motion in enumerate(motions)] +
             [plt.Line2D([], [], color="#999999", lw=1, label="nothing is better both ways (worst motion)")])
    chart.write(file)


def model(results, file):
    rows = at(results, "shape.tiers") or []
    if not rows:
        return
    parts = [part for part in (("touch_point", "at the touched point"), ("front", "front face"), ("all", "all nodes"))
             if all(row.get(f"{part[0]}_noisy_mm") for row in rows)]
    chart = Chart(len(parts), 3.4)
    for axes, (key, title) in zip(chart.axes, parts):
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
    """The deformation depends on the tier; touch and force come from the network, whatever the tier."""
    rows = [row for row in at(results, "scene.shapes") or [] if row["level_95"] > 0]
    if not rows:
        return
    cases = [case for case in at(results, "scene.cases") or [] if case.get("touch_mm") and case.get("contained")]
    chart = Chart(3 if cases else 1, 4.2)
    axes, names = chart.axes[0], list(dict.fromkeys(row["case"] for row in rows))
    for row in rows:
        chart.point(axes, row["us"], 100 * row["level_95"], f"{row['tier']}, {row['case']}: {row['us']:.0f} µs, "
                    f"{100 * row['level_95']:.1f} % — scripts/report scene", marker="o", ms=5, alpha=0.8,
                    color=COLOURS.get(row["tier"], "#888888"))
    tiers = list(dict.fromkeys(row["tier"] for row in rows))
    middle = [(sorted(r["us"] for r in rows if r["tier"] == t)[len(names) // 2],
               sorted(100 * r["level_95"] for r in rows if r["tier"] == t)[len(names) // 2]) for t in tiers]
    axes.plot(*zip(*_front(middle)), color="#999999", lw=1, zorder=0)
    axes.set(xscale="log", yscale="log", xlabel="µs per frame", ylabel="deformation, 95 % of relative errors, %")
    for axes, what in zip(chart.axes[1:], ("touch", "force")):
        for place, case in enumerate(reversed(cases)):
            if what == "touch":
                values = (("mean", case["touch_mm"], "#1f78b4", "mm"), ("95 %", case["touch_95_mm"], "#d95f02", "mm"))
            else:
                values = (("normal, RMSE", case["force_rmse_n"][0], "#1f78b4", "N"),)
            for name, value, colour, unit in values:
                chart.point(axes, value, place, f"{case['case']}, {what}, {name}: {value:.2f} {unit} — scripts/report scene",
                            marker="o", ms=5, color=colour)
        axes.set_yticks(range(len(cases)), [case["case"] for case in reversed(cases)] if what == "touch" else [""] * len(cases),
                        fontsize=7)
        axes.set(xlabel="touch: mean error (blue), 95 % (orange), mm" if what == "touch" else "normal force: RMSE, N")
        axes.set_xlim(left=0)
    _outside(chart, [_key(tier, marker="s", color=COLOURS.get(tier, "#888888")) for tier in tiers])
    chart.write(file)


def _slope(points):
    x, y = [math.log(p[0]) for p in points], [math.log(p[1]) for p in points]
    mx, my = sum(x) / len(x), sum(y) / len(y)
    return sum((a - mx) * (b - my) for a, b in zip(x, y)) / sum((a - mx) ** 2 for a in x)


def _grown(chart, axes, points, label, unit, colour):
    """A line over the tetrahedra, with its exponent up to 16,000, as the claim has it."""
    points = sorted(points)
    fitted = [point for point in points if point[0] <= 16000]
    exponent = f", exponent {_slope(fitted):.2f}" if len(fitted) > 1 else ""
    axes.plot(*zip(*points), marker="o", color=colour, label=label + exponent)
    for tets, value in points:
        chart.point(axes, tets, value, f"{label}, {tets:,} tetrahedra: {value:.3g} {unit} — scripts/report solver", marker="o",
                    color=colour)


def growth(results, file):
    rows = at(results, "solver.iterations") or []
    ways = list(dict.fromkeys(row["way"] for row in rows))
    if not ways:
        return
    ours = [row for row in rows if row["way"] == "float"]
    operations = [(key, label, colour) for key, label, colour in
                  (("derivative_operations", "derivatives", "#999999"), ("factor_operations", "factor", "#444444"))
                  if all(row.get(key) for row in ours)]
    chart = Chart(2 if operations else 1, 4)
    for key, label, colour in operations:
        _grown(chart, chart.axes[1], [(row["mesh_tets"], row[key] / 1e6) for row in ours], label, "million multiply-adds", colour)
        chart.axes[1].set(xscale="log", yscale="log", xlabel="tetrahedra", ylabel="multiply-adds of ours, million")
        chart.axes[1].legend(frameon=False, fontsize=8)
    for way in ways:
        points = [(row["mesh_tets"], row["sum_us"] / 1000) for row in rows if row["way"] == way]
        _grown(chart, chart.axes[0], points, METHODS.get(way, way), "ms", COLOURS.get(way))
    chart.axes[0].set(xscale="log", yscale="log", xlabel="tetrahedra", ylabel="one Newton iteration, ms")
    _outside(chart, chart.axes[0].get_legend_handles_labels()[0])
    chart.write(file)


def parts(results, file):
    rows = sorted((row for row in at(results, "solver.iterations") or [] if row["way"] == "float"), key=lambda r: r["mesh_tets"])
    if not rows:
        return
    limit = at(results, "solver.limit") or {}
    chart = Chart(1, 3.2)
    axes, names = chart.axes[0], [f"{row['mesh_tets']:,}" for row in rows]
    left = [0.0] * len(rows)
    for part, colour in (("derivatives", "#1f78b4"), ("factor", "#d95f02"), ("solve", "#1b9e77"), ("step", "#7570b3")):
        if not any(row[f"{part}_us"] for row in rows):  # ours solves while it factors
            continue
        each = [1000 * row[f"{part}_us"] / row["mesh_tets"] for row in rows]
        axes.barh(names, each, left=left, color=colour, label="factor and solve" if part == "factor" else part)
        for y, (start, share, row) in enumerate(zip(left, each, rows)):
            if share > 0.08 * max(1000 * r["sum_us"] / r["mesh_tets"] for r in rows):
                axes.text(start + share, y, f"{row[f'{part}_us']:,.0f} µs ", ha="right", va="center", color="white", fontsize=8, zorder=5)
            for floor, line, meaning in ((_floor_us(part, row, limit), "-", "the multiply-adds alone, at the core's peak"),
                                         (_traffic_us(part, row, limit), ":", "the factor written and read once, at memory's peak")):
                if floor:
                    x = start + 1000 * floor / row["mesh_tets"]
                    axes.plot([x, x], [y - 0.4, y + 0.4], color="black", ls=line, lw=2, solid_capstyle="butt",
                              label=meaning if y == 0 and part == "factor" else None)
        left = [a + b for a, b in zip(left, each)]
    axes.set(xlabel="time per tetrahedron, ns", ylabel="tetrahedra")
    _outside(chart, axes.get_legend_handles_labels()[0])
    chart.write(file)


def _floor_us(part, row, limit):
    """What the multiply-adds of a part take at the measured peak. None where they are not counted."""
    operations = row.get({"derivatives": "derivative_operations", "factor": "factor_operations"}.get(part))
    if not operations or not limit:
        return None
    return operations / limit["multiply_adds_per_us"]


def _traffic_us(part, row, limit):
    """What memory needs to take the factor and give it back once at its measured peak: below that no factor can be."""
    if part != "factor" or not row.get("factor_mb") or not limit.get("memory_bytes_per_us"):
        return None
    return 2e6 * row["factor_mb"] / limit["memory_bytes_per_us"]


def touch_face(results, file):
    """Where on the face a touch is found how well."""
    rows = at(results, "touch.face") or []
    if not rows:
        return
    chart = Chart(2, 4.6)
    for axes, key, title in ((chart.axes[0], "mean_mm", "mean error"), (chart.axes[1], "error_95_mm", "95 % are smaller")):
        told = [row for row in rows if row[key] is not None]
        largest = max(row["error_95_mm"] for row in told)
        for row in told:
            colour = plt.get_cmap("viridis_r")(min(1.0, row[key] / largest))
            chart.point(axes, row["x_mm"], row["y_mm"], f"x {row['x_mm']:.1f}, y {row['y_mm']:.1f} mm: {row[key]:.2f} mm, "
                        f"{row['touches']} touches — scripts/report touch", marker="o", ms=15, color=colour)
            axes.annotate(f"{row[key]:.1f}", (row["x_mm"], row["y_mm"]), ha="center", va="center", fontsize=7,
                          color="white" if row[key] > largest / 2 else "black")
        for row in rows:
            if row[key] is None:
                axes.plot(row["x_mm"], row["y_mm"], marker="x", color="#888888")
        axes.margins(x=0.25, y=0.1)
        axes.set(title=f"{title}, mm", xlabel="x, across, mm", ylabel="y, up from the base, mm", aspect="equal")
    chart.write(file)


def _promised(chart, axes, largest_radius, file):
    """Writes a chart of coverage against the radius, with what a published radius promises."""
    for radius, share in ((1, 68), (2, 95)):
        chart.point(axes, radius, share, f"promised: {share} % inside {radius} published radii", marker="o", ms=7, color="black",
                    markerfacecolor="none")
    axes.set(xlabel="radius, in published radii", ylabel="errors inside, %", xlim=(0, largest_radius), ylim=(0, 101))
    _outside(chart, axes.get_legend_handles_labels()[0])
    chart.write(file)


def reliability(results, file):
    rows = [row for row in at(results, "touch.reliability") or [] if row["touches"] >= 20]
    if not rows:
        return
    chart = Chart(1, 3.8)
    axes, colours = chart.axes[0], plt.get_cmap("viridis")
    radii = [(k + 1) / 10 for k in range(len(rows[0]["inside"]))]
    for k, row in enumerate(rows):
        axes.plot(radii, [100 * share for share in row["inside"]], color=colours(0.9 * k / max(1, len(rows) - 1)),
                  label=f"plate motion from {row['from_mm']:g} mm ({row['touches']:,} touches)")
    curve = at(results, "touch.coverage_curve") or []
    axes.plot([(k + 1) / 10 for k in range(len(curve))], [100 * share for share in curve], ":", color="#555555",
              label="all, points held out at the build")
    _promised(chart, axes, radii[-1], file)


def scene_reliability(results, file):
    """The cases of the pack's scene whose radius is furthest off, by name; the others in grey."""
    rows = [row for row in at(results, "scene.cases") or [] if row.get("contained") and row.get("inside_curve")]
    if not rows:
        return
    chart, named = Chart(1, 4.2), 6
    axes = chart.axes[0]
    rows.sort(key=lambda row: -abs(row["inside_radius"] - 0.68))
    for k, row in reversed(list(enumerate(rows))):
        points = [0.0] + [100 * share for share in row["inside_curve"]]
        radii = [step / 10 for step in range(len(points))]
        style = {"lw": 1.8, "label": row["case"]} if k < named else {"color": "#b8bec6", "lw": 1}
        axes.plot(radii, points, **style)
    axes.plot([], [], color="#b8bec6", lw=1, label=f"the other {len(rows) - named}" if len(rows) > named else None)
    _promised(chart, axes, radii[-1], file)


def _by_band(rows, unit, decimals, lines, file, **axes_are):
    """Errors by band of a quantity: `lines` of key, label and colour over the places of the bands, which begin at from_mm or from_n."""
    if not rows:
        return
    chart = Chart(1, 3.6)
    axes, places, starts = chart.axes[0], range(len(rows)), [f"{row[f'from_{unit.lower()}']:g}" for row in rows]
    for key, label, colour in lines:
        axes.plot(places, [row[key] for row in rows], color=colour, label=label)
        for place, (row, start) in enumerate(zip(rows, starts)):
            chart.point(axes, place, row[key], f"from {start} {unit}, {label}: {row[key]:.{decimals}f} {unit}, {row['touches']} touches — "
                        "scripts/report touch", marker="o", ms=6, color=colour)
    axes.set_xticks(list(places), [f"{start}{end}" for start, end in zip(starts, [f"–{after}" for after in starts[1:]] + [" and more"])])
    axes.set(**axes_are)
    if axes.get_yscale() == "linear":
        axes.axhline(0, color="#888888", lw=1)
    _outside(chart, axes.get_legend_handles_labels()[0])
    chart.write(file)


def touch_error(results, file):
    _by_band(at(results, "touch.by_plate_motion") or [], "mm", 2,
             (("mean_mm", "mean", "#1f78b4"), ("error_95_mm", "95 % are smaller", "#d95f02")), file,
             yscale="log", xlabel="plate motion, mm", ylabel="error of the touched point, mm")


def force_error(results, file):
    _by_band([row for row in at(results, "touch.by_force") or [] if row["touches"]], "N", 3,
             (("bias_n", "mean error", "#1f78b4"), ("rmse_n", "RMSE", "#d95f02")), file,
             xlabel="true force, N", ylabel="error of the published force, N")


def contact_forces(results, file):
    rows = [row for row in at(results, "force.cases") or [] if row.get("lbfgs_curve")]
    if not rows:
        return
    chart = Chart(min(4, len(rows)), 3.2)
    for axes, row in zip(chart.axes, rows):
        for key, label, colour, mark in (("gauss_newton_curve", "Gauss-Newton", "#1f78b4", "o"),
                                         ("lbfgs_curve", "L-BFGS (paper)", "#d95f02", None)):
            points = [(max(1e-3, second), max(1e-3, objective)) for second, objective in row[key]]
            axes.plot(*zip(*points), color=colour, marker=mark, ms=3, label=label)
        axes.set(xscale="log", yscale="log", title=row["touch"], xlabel="processor time, s")
    chart.axes[0].set_ylabel("half of the misfit")
    _outside(chart, chart.axes[0].get_legend_handles_labels()[0])
    chart.write(file)


def hard_states(folder, file):
    """The shapes of the worst hard cases in front of the finger at rest, seen from the side and the front."""
    source = folder / "hard_states.json"
    if not source.exists():
        return
    figures = json.loads(source.read_text())
    tets, rest = np.array(figures["tet_nodes"]).reshape(-1, 4), np.array(figures["rest_mm_100"]).reshape(-1, 3) / 100
    faces = np.concatenate([tets[:, pick] for pick in ([0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3])])
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    faces = faces[first[counts == 1]]  # of one tetrahedron only
    columns = 5
    chart = Chart(columns, 3.4, math.ceil(len(figures["states"]) / columns))
    for axes, state in zip(chart.axes, figures["states"]):
        nodes = np.array(state["node_mm_100"]).reshape(-1, 3) / 100
        _draw_surface(axes, faces, rest, "#dddddd", 0.0)
        _draw_surface(axes, faces, nodes, None, 1.0, np.linalg.norm(nodes - rest, axis=1))
        axes.set(aspect="equal")
        axes.set_axis_off()
        axes.set_title("\n".join(textwrap.wrap(f"{state['name']}: {state['worst_mm']:.2g} mm", 30)), fontsize=7)
        axes.autoscale_view()
    for axes in chart.axes[len(figures["states"]):]:
        axes.set_visible(False)
    chart.write(file)


def _draw_surface(axes, faces, nodes, colour, order, displacement=None):
    azimuth, elevation = 0.75, 0.22  # as hostgen figure draws it
    right = np.array([-math.cos(azimuth), 0, -math.sin(azimuth)])
    viewer = np.array([math.sin(azimuth) * math.cos(elevation), math.sin(elevation), -math.cos(azimuth) * math.cos(elevation)])
    corners = nodes[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = normals @ viewer > 0
    corners, normals, shown = corners[facing], normals[facing], faces[facing]
    depth = np.argsort(corners.mean(axis=1) @ viewer)
    points = np.stack([corners @ right, corners @ np.cross(viewer, right)], axis=-1)[depth]
    colours = colour
    if displacement is not None:
        light = 0.55 + 0.45 * (normals @ viewer) / (np.linalg.norm(normals, axis=1) + 1e-12)
        colours = plt.get_cmap("viridis")(np.clip(displacement[shown].mean(axis=1) / max(1e-9, displacement.max()), 0, 1))
        colours[:, :3] *= light[:, None]
        colours = colours[depth]
    axes.add_collection(PolyCollection(points, facecolors=colours, edgecolors="face", linewidths=0.2, zorder=order, rasterized=True))


def draw(results, folder):
    for name, chart in (("speed_numerics", numerics), ("speed_model", model), ("speed_registers", registers), ("growth", growth),
                        ("parts", parts), ("touch_face", touch_face), ("reliability", reliability),
                        ("scene_reliability", scene_reliability), ("touch_error", touch_error), ("force_error", force_error), ("contact_forces", contact_forces)):
        chart(results, folder / f"{name}.svg")
    hard_states(folder, folder / "hard_states.svg")
