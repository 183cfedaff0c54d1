#!/usr/bin/python3
"""scripts/lib/soak.py with the pack and the session of the system tests.

usage: soak_test.py BINARY_DIR SOURCE_DIR [arguments of soak.py, such as --seconds 3600]
"""
import subprocess
import sys

ARGUMENTS = sys.argv[3:]
sys.argv = sys.argv[:3]  # end_to_end takes these two
from end_to_end import BINARIES, PACK, SESSION, SOURCE, prepare  # noqa: E402

if __name__ == "__main__":
    prepare()
    program = [sys.executable, SOURCE / "scripts" / "lib" / "soak.py", BINARIES / "finsightd", PACK, SESSION]
    sys.exit(subprocess.run(program + ARGUMENTS).returncode)
