#!/usr/bin/python3
"""usage: scripts/report [--quick] [--resume] [--readme] [AREA...]
Measures and writes build/report/results.json, plots and index.html.
  AREA      what to measure, all when none is named; what is left out keeps its figures and their date:
            {areas}
  --quick   with the demo's model (quick profile), shorter motions: 3.6 minutes on idle cores once scripts/demo has run; the
            first time two more, for its benchmarks to be compiled
  --resume  leave out what has been measured at this commit and as thoroughly: to go on after an interruption
  --readme  also renew the claims and the plots in README.md; those of areas that were never measured here stay as they are
Area real needs FINSIGHT_DATA, a folder with touch-recordings/recordings.csv (hostgen import-recordings makes it); area
appliance takes the figures of the last image test (tests/system/boot). Each area's figures are kept as soon as they are
there. Times mean something on a machine that does nothing else: what other programs took meanwhile is measured, and the
page says so where it was much.
"""
import json
import os
import platform
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

SOURCE = Path(__file__).resolve().parent.parent.parent
FOLDER = SOURCE / "build" / "report"
BINARIES = SOURCE / "build" / "host"
SPEC = SOURCE / "hostgen" / "fingers" / "srm.toml"
HOSTGEN = BINARIES / "hostgen"


def run(*words):
    subprocess.run([str(word) for word in words], cwd=SOURCE, check=True)


def build(*targets):
    run("cmake", "--build", "--preset", "host", "--target", *targets)


def is_older(file, *than):
    return not file.exists() or any(file.stat().st_mtime < other.stat().st_mtime for other in than)


class Run:
    """What the areas share."""

    def __init__(self, is_quick):
        self.is_quick = is_quick
        folder = SOURCE / "build" / ("demo" if is_quick else "report")
        self.pack, self.states = folder / "srm.safetensors", folder / "srm.states.safetensors"

    def choose(self, quick, full):
        return quick if self.is_quick else full

    def make_pack(self):
        if is_older(self.pack, HOSTGEN, SPEC) or not self.states.exists():
            self.pack.parent.mkdir(parents=True, exist_ok=True)
            run(HOSTGEN, "build", SPEC, "-o", self.pack, "--profile", self.choose("quick", "full"), "--save-dataset", self.states)

    def session(self, size, *options):
        """The demo's session of this size, made again where it is out of date."""
        folder = SOURCE / "build" / "demo" / f"session-{size}"
        if is_older(folder / "truth.csv", HOSTGEN, SPEC):
            run(HOSTGEN, "render", SPEC, "-o", folder, "--size", size, *options)
        return folder

    def tool(self, name, *words):
        """Runs a program of scripts/lib; returns the file with its figures, or with why there are none."""
        file = FOLDER / f"{name}.json"
        file.unlink(missing_ok=True)
        try:
            run("/usr/bin/python3", SOURCE / "scripts" / "lib" / f"{name}.py", *words, "--json", file)
        except subprocess.CalledProcessError as error:
            figures = json.loads(file.read_text()) if file.exists() else {}
            file.write_text(json.dumps({**figures, "why": f"scripts/lib/{name}.py failed, exit code {error.returncode}"}))
        return file


def solver(report):
    counted = []
    run("cmake", SOURCE / "build" / "host")  # bench is there since its libraries are
    if platform.machine() == "x86_64":
        build("bench", "bench_instructions")
        counted = ["--instructions", BINARIES / "bench_instructions", "--pack", report.pack]
    else:
        build("bench")
    file = FOLDER / "bench.json"
    run(BINARIES / "bench", *report.choose(["--quick"], []), "--spec", SPEC, *counted, "-o", file)
    return {"bench": file}


def modbus(report):
    build("finsightd")
    session = report.session("640x480")
    figures = {"attack": report.tool("attack", HOSTGEN, BINARIES / "finsightd", report.pack, session, "--seconds",
                                     report.choose(2, 10), "--command-seconds", report.choose(3, 20))}
    figures["soak"] = report.tool("soak", BINARIES / "finsightd", report.pack, session, "--seconds", report.choose(3, 20))
    return figures


def page(report):
    build("finsightd", "finsight-page")
    return {"page": report.tool("page_cost", BINARIES, report.pack, report.session("1280x720", "--seconds", 6), "--rounds",
                                report.choose(2, 7), "--seconds", report.choose(2, 8))}


def fingers(report):
    build("finsightd")
    session = report.session("1280x720", "--seconds", 6)
    return {"fingers": report.tool("fingers", BINARIES / "finsightd", report.pack, session, "--seconds", report.choose(3, 20))}


def appliance(_):
    file = SOURCE / "build" / "image" / "appliance.json"
    return {"appliance": file} if file.exists() else {}


def nothing(_):
    return {}


# Area: what hostgen does not measure by itself, and how many seconds it takes, quick and in full, where nobody has measured.
AREAS = {
    "solver": (solver, 25, 300), "hard": (nothing, 25, 450), "fem": (nothing, 2, 40), "touch": (nothing, 15, 150),
    "scene": (nothing, 30, 2000), "fit": (nothing, 30, 1200), "real": (nothing, 20, 310), "force": (nothing, 15, 75),
    "vision": (nothing, 20, 140), "modbus": (modbus, 30, 105), "page": (page, 30, 155), "fingers": (fingers, 10, 60),
    "pictures": (nothing, 25, 255), "appliance": (appliance, 1, 1),
}


def busy_seconds():
    """Processor time that the whole machine has spent working, and the part of it that programs of this run took."""
    numbers = [int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:]]
    whole = (sum(numbers[:8]) - numbers[3] - numbers[4]) / os.sysconf("SC_CLK_TCK")  # without idle and waiting
    ours = sum(u.ru_utime + u.ru_stime for u in (resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))
    return whole, ours


def commit():
    answer = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=SOURCE, stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL, text=True)
    return answer.stdout.strip()


def measured():
    file = FOLDER / "results.json"
    return json.loads(file.read_text()) if file.exists() else {}


def measure(area, report):
    """Measures an area; notes how long it took and how many processors other programs had meanwhile."""
    began, (whole, ours) = time.monotonic(), busy_seconds()
    figures = AREAS[area][0](report)
    words = [HOSTGEN, "report", area, *report.choose(["--quick"], []), "--pack", report.pack, "--spec", SPEC, "--dataset",
             report.states, "-o", FOLDER]
    for name, file in figures.items():
        words += ["--figures", f"{name}={file}"]
    recordings = Path(os.environ.get("FINSIGHT_DATA", "")) / "touch-recordings" / "recordings.csv"
    if os.environ.get("FINSIGHT_DATA") and recordings.exists():
        words += ["--recordings", recordings]
    run(*words)
    seconds, (whole_after, ours_after) = time.monotonic() - began, busy_seconds()
    results = measured()
    results["measured"][area] |= {"seconds": round(seconds, 1),
                                  "others": round(max(0, (whole_after - whole) - (ours_after - ours)) / seconds, 2)}
    whole = FOLDER / "results.json.new"
    whole.write_text(json.dumps(results, indent=1) + "\n")
    whole.replace(FOLDER / "results.json")


def expected_seconds(area, results, profile):
    before = results.get("measured", {}).get(area, {})
    return before["seconds"] if before.get("profile") == profile and "seconds" in before else AREAS[area][1 + (profile == "full")]


def is_done(area, results, profile):
    before = results.get("measured", {}).get(area, {})
    return before.get("commit") == commit() and before.get("profile") == profile and "seconds" in before


def main():
    words = sys.argv[1:]
    if "--help" in words:
        print(__doc__.format(areas=" ".join(AREAS)))
        return 0
    options = {word for word in words if word.startswith("--")}
    areas = list(dict.fromkeys(word for word in words if not word.startswith("--"))) or list(AREAS)
    known = {"--quick", "--resume", "--readme", "--arguments"}
    for word in sorted(options - known) + [area for area in areas if area not in AREAS]:
        print(f"report: unknown argument '{word}' (try --help)", file=sys.stderr)
        return 2
    if "--arguments" in options:  # scripts/report asks before it installs anything
        return 0
    report, profile = Run("--quick" in options), "quick" if "--quick" in options else "full"
    if "--resume" in options:
        areas = [area for area in areas if not is_done(area, measured(), profile)]
    FOLDER.mkdir(parents=True, exist_ok=True)
    build("hostgen")
    report.make_pack()
    for k, area in enumerate(areas):
        left = sum(expected_seconds(other, measured(), profile) for other in areas[k:])
        print(f"== {area} ({k + 1} of {len(areas)}, about {max(1, round(left / 60))} minutes left)", flush=True)
        measure(area, report)
    readme = ["--readme", SOURCE / "README.md"] if "--readme" in options else []
    run("/usr/bin/python3", SOURCE / "scripts" / "lib" / "report_page.py", FOLDER, *readme)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (subprocess.CalledProcessError, KeyboardInterrupt) as error:
        again = " ".join(["scripts/report", "--resume", *(word for word in sys.argv[1:] if word != "--resume")])
        is_interrupted = isinstance(error, KeyboardInterrupt) or error.returncode == -signal.SIGINT
        what = "interrupted" if is_interrupted else " ".join(str(word) for word in error.cmd) + " failed"
        print(f"report: {what}; {again} goes on from here", file=sys.stderr)
        sys.exit(130 if is_interrupted else 1)
