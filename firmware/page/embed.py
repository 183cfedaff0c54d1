#!/usr/bin/env python3
"""Writes the page's files, compressed, as a C++ file: embed.py OUTPUT.cpp FOLDER. Same files, same bytes."""
import gzip
import pathlib
import sys

TYPES = {".html": "text/html; charset=utf-8", ".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8",
         ".svg": "image/svg+xml"}
LIMIT = 300 * 1000


def main() -> None:
    output, folder = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    arrays, entries, total = [], [], 0
    for number, file in enumerate(sorted(f for f in folder.rglob("*") if f.suffix in TYPES)):
        data = gzip.compress(file.read_bytes(), 9, mtime=0)
        total += len(data)
        arrays.append(f"const unsigned char kFile{number}[] = {{{','.join(map(str, data))}}};\n")
        entries.append(f'    {{"/{file.relative_to(folder)}", "{TYPES[file.suffix]}", kFile{number}}},\n')
    if total > LIMIT:
        sys.exit(f"embed: the page's files have {total} bytes compressed, expected at most {LIMIT}")
    output.write_text('#include "firmware/page/api.h"\n\nnamespace finsight::page {\nnamespace {\n' + "".join(arrays) +
                      "constexpr Asset kAssets[] = {\n" + "".join(entries) +
                      "};\n}  // namespace\nstd::span<const Asset> assets() { return kAssets; }\n"
                      "}  // namespace finsight::page\n")


main()
