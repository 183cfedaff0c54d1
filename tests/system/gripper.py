#!/usr/bin/python3
"""A gripper in the loop: 100 random runs of each controller, and plots of some of them. Two controllers have one finger,
the third has a finger with a pack of its own as each jaw.

usage: gripper.py BINARY_DIR SOURCE_DIR [--runs N] [--seed N]
Plots go to BINARY_DIR/gripper. exit code 1: fewer than 95 of 100 runs succeeded
"""
import subprocess
import sys
from pathlib import Path

ARGUMENTS = sys.argv[3:]
sys.argv = sys.argv[:3]  # end_to_end takes these two
from end_to_end import BINARIES, PACK, SOURCE, SPEC, WORK  # noqa: E402
from several_fingers import RIGHT_PACK, RIGHT_SPEC, prepare_right  # noqa: E402

FOLDER = Path(__file__).resolve().parent / "gripper"
PLOT = """
set terminal svg size 900,600 background "white"
set output "{name}.svg"
set multiplot layout 2,1 title "{title}"
set grid
set key outside right
set ylabel "mm"
plot "{name}.dat" u 1:2 w l lw 2 t "true x", "" u 1:3 w l lw 2 t "true y", "" u 1:4 w p pt 7 ps 0.2 t "read x", \\
     "" u 1:5 w p pt 7 ps 0.2 t "read y"
set xlabel "s"
set ylabel "N"
set y2label "permille"
set y2tics
plot "{name}.dat" u 1:6 w l lw 2 t "true force", "" u 1:7 axes x1y2 w l t "level read"
unset multiplot
"""
TITLES = {"regrasp": "Regrasp towards the centre of the face: x 0, y 60 mm"}


def states(name, pack, spec, mesh):
    """The simulated finger: finite-element states of the pack's mesh, at other points and forces than it was trained on."""
    file = WORK / name
    if not file.exists() or file.stat().st_mtime < pack.stat().st_mtime:
        file.unlink(missing_ok=True)
        subprocess.run([BINARIES / "hostgen", "dataset", spec, "--scene", "probe", "--size", mesh, "-o", file, "--points", "48",
                        "--forces", "6", "--only-scene"], check=True)
    return file


def main():
    prepare_right()
    subprocess.run(["cmake", "--build", BINARIES, "--target", "gripper_loop", "gripper_two_jaws"], check=True, stdout=subprocess.DEVNULL)
    plots = BINARIES / "gripper"
    plots.mkdir(exist_ok=True)
    left = states("gripper-states.safetensors", PACK, SPEC, "default")
    right = states("right-states.safetensors", RIGHT_PACK, RIGHT_SPEC, "coarse")
    code = subprocess.run([BINARIES / "tests" / "gripper_loop", PACK, SPEC, left, FOLDER / "objects.csv",
                           "--plots", plots, *ARGUMENTS]).returncode
    code |= subprocess.run([BINARIES / "tests" / "gripper_two_jaws", PACK, SPEC, left, RIGHT_PACK, RIGHT_SPEC, right,
                            *ARGUMENTS]).returncode
    for data in sorted(plots.glob("*.dat")):
        title = TITLES.get(data.stem, f"Gentle grasp: {data.stem.removeprefix('gentle-')}, which creeps under the grip")
        script = PLOT.format(name=data.stem, title=title)
        subprocess.run(["gnuplot"], input=script, text=True, cwd=plots, check=True)
    print(f"plots: {plots}/*.svg")
    return code


if __name__ == "__main__":
    sys.exit(main())
