#!/usr/bin/python3
"""The board's shape solver really works on four floats at a time: its kernels hold NEON's fused multiply-add of whole
vectors, and the dense ones hardly anything of single numbers.

usage: neon_test.py LIBFIRMWARE_SHAPE
"""
import collections
import re
import shutil
import subprocess
import sys

SKIPPED = 77
# Function (float), vector instructions at least: a tile of 6 columns and 4 vectors of rows alone has 24.
KERNELS = {"dense::multiply<float, 6,": 48, "element_hessian<float": 40, "element_gradient<float": 20}

if not shutil.which("llvm-objdump-19"):
    print("skipped: llvm-objdump-19 is missing (scripts/setup --cross)")
    sys.exit(SKIPPED)
text = subprocess.run(["llvm-objdump-19", "-d", "--demangle", "--no-show-raw-insn", sys.argv[1]], check=True,
                      stdout=subprocess.PIPE, text=True).stdout
vectors, singles, function = collections.Counter(), collections.Counter(), ""
for line in text.splitlines():
    if line.endswith(">:"):
        function = line
    elif re.search(r"\bfml[as]\b.*\.4s", line):
        vectors[function] += 1
    elif re.search(r"\bfn?m(add|sub)\b", line):
        singles[function] += 1
failed = 0
for kernel, least in KERNELS.items():
    versions = [name for name in vectors if kernel in name]
    found = max((vectors[name] for name in versions), default=0)
    scalar = max((singles[name] for name in versions), default=0)
    good = found >= least and scalar * 4 <= found
    failed += not good
    print(f"{'ok    ' if good else 'FAILED'} {kernel}...>: {found} multiply-adds of four floats, {scalar} of one")
sys.exit(failed)
