#!/usr/bin/python3
"""Eight clients that give commands at the same time (scripts/lib/hammer.py) to the real firmware.

usage: command_hammer.py BINARY_DIR SOURCE_DIR [--seconds N]   (4 by default)
"""
import json
import sys

SECONDS = float(sys.argv[4]) if sys.argv[3:4] == ["--seconds"] else 4
sys.argv = sys.argv[:3]  # end_to_end takes these two
from end_to_end import Firmware, prepare, session_source  # noqa: E402  # and scripts/lib is in the path from here on
from hammer import hammer  # noqa: E402
from register_block import Reader  # noqa: E402

if __name__ == "__main__":
    prepare()
    with Firmware(session_source()) as firmware:
        Reader(firmware.port).close()
        figures, problems = hammer(firmware.port, SECONDS)
    print(json.dumps(figures))
    for problem in problems[:20]:
        print("PROBLEM:", problem)
    sys.exit(1 if problems or figures["done"] < 8 else 0)
