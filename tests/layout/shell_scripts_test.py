#!/usr/bin/python3
"""Every shell script of the project is one that its shell can read."""
import os
import re
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
SKIPPED = {".git", "build", "node_modules"}


def shell_scripts():
    """(file, shell) of every file whose first line names a shell."""
    for root, folders, names in os.walk(SOURCE):
        folders[:] = [name for name in folders if name not in SKIPPED]
        for name in names:
            file = Path(root, name)
            if not file.is_file():
                continue
            with open(file, "rb") as opened:
                first = opened.readline(80)
            # Blanks are left out: a formatter that takes a script for another language puts some there.
            shell = re.match(rb"#!(?:/usr/bin/env|/usr/bin/|/bin/)(sh|bash)(?:-|$)", first.translate(None, b" \t\r\n"))
            if shell:
                yield file, shell[1].decode()


def main():
    scripts = list(shell_scripts())
    broken = 0
    for file, shell in scripts:
        checked = subprocess.run([shell, "-n", str(file)], capture_output=True, text=True)
        if checked.returncode:
            broken += 1
            print(f"{file}: {checked.stderr.strip()}")
    print(f"{len(scripts)} shell scripts, {broken} of them broken")
    return 1 if broken or not scripts else 0


if __name__ == "__main__":
    sys.exit(main())
