#!/usr/bin/python3
"""What an image holds, as CycloneDX 1.5: Debian's packages of which a file is left, the boot partition's, our programs
and the model. scripts/image calls it; written to standard output. Same input, same bytes.
"""
import argparse
import hashlib
import json
import re
import uuid
from datetime import datetime, timezone
from pathlib import Path
from urllib.parse import quote

# Short names of Debian's copyright files, and the identifiers of SPDX that mean the same.
SPDX = {"GPL-2": "GPL-2.0-only", "GPL-2+": "GPL-2.0-or-later", "GPL-3": "GPL-3.0-only", "GPL-3+": "GPL-3.0-or-later",
        "GPL-2.0": "GPL-2.0-only", "GPL-2.0+": "GPL-2.0-or-later", "GPL-3.0+": "GPL-3.0-or-later",
        "GPL-1+": "GPL-1.0-or-later", "LGPL-2": "LGPL-2.0-only", "LGPL-2+": "LGPL-2.0-or-later",
        "LGPL-2.1": "LGPL-2.1-only", "LGPL-2.1+": "LGPL-2.1-or-later", "LGPL-3": "LGPL-3.0-only",
        "LGPL-3+": "LGPL-3.0-or-later", "Expat": "MIT", "MIT": "MIT", "BSD-2-clause": "BSD-2-Clause",
        "BSD-2-Clause": "BSD-2-Clause", "BSD-3-clause": "BSD-3-Clause", "BSD-3-Clause": "BSD-3-Clause",
        "Apache-2": "Apache-2.0", "Apache-2.0": "Apache-2.0", "ISC": "ISC", "Zlib": "Zlib", "zlib": "Zlib",
        "CC0": "CC0-1.0", "CC0-1.0": "CC0-1.0", "MPL-2": "MPL-2.0", "MPL-2.0": "MPL-2.0", "Artistic": "Artistic-1.0-Perl",
        "OpenSSL": "OpenSSL", "BSL-1.0": "BSL-1.0", "curl": "curl", "FTL": "FTL", "Unlicense": "Unlicense",
        "GFDL-1.3": "GFDL-1.3-only", "GFDL-1.3+": "GFDL-1.3-or-later"}


def copyright_file(root, package):
    """Of a package's folder, which may be a link to that of another one."""
    file = root / "usr/share/doc" / package / "copyright"
    return file if file.exists() else None


def licences(file):
    """Of a machine-readable copyright file, each once; of another kind, that it is to be read."""
    text = file.read_text(errors="replace")
    if not text.lstrip().startswith("Format:"):
        return [{"license": {"name": "see the copyright file"}}]
    names = sorted({name.strip() for line in re.findall(r"^License:[ \t]*(\S.*)$", text, re.M)
                    for name in re.split(r"\s+(?:and/or|and|or)\s+|,|\|", line) if name.strip()})
    return [{"license": {"id": SPDX[name]} if name in SPDX else {"name": name}} for name in names]


def component_of(root, row):
    package, version, architecture, sha256, source, source_version = row
    file = copyright_file(root, package)
    purl = f"pkg:deb/debian/{quote(package)}@{quote(version)}?arch={architecture}&distro=trixie"
    component = {"type": "library", "bom-ref": purl, "name": package, "version": version,
                 "hashes": [{"alg": "SHA-256", "content": sha256}], "purl": purl,
                 "properties": [{"name": "debian:source", "value": f"{source} {source_version}"}]}
    if file:
        component["licenses"] = licences(file)
        component["properties"].append({"name": "finsight:copyright", "value": "/usr/share/doc/" + package + "/copyright"})
    return component


def own_component(root, kind, name, path, version):
    return {"type": kind, "bom-ref": "finsight:" + name, "name": name, "version": version,
            "hashes": [{"alg": "SHA-256", "content": hashlib.sha256((root / path).read_bytes()).hexdigest()}],
            "licenses": [{"license": {"name": "see LICENSE of Finsight"}}],
            "properties": [{"name": "finsight:file", "value": "/" + path}]}


def packages_in_image(root, files):
    """Those of which more is left than what says whose they are."""
    left = set()
    for line in files.read_text().splitlines():
        path, package = line.rsplit("\t", 1)
        path = path.removeprefix("./")
        if package in left or path.endswith("/") or path.startswith("usr/share/doc/"):
            continue
        file = root / path
        if file.is_file() or file.is_symlink():
            left.add(package)
    return left


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for option in ("root", "packages", "board", "version", "epoch", "elsewhere"):
        parser.add_argument("--" + option, required=True)
    arguments = parser.parse_args()
    root = Path(arguments.root)
    rows = [line.split("\t") for line in Path(arguments.packages).read_text().splitlines()]
    held = packages_in_image(root, Path(arguments.packages + ".files")) | {"busybox-static"}  # all of the initial RAM disk
    elsewhere = set(arguments.elsewhere.split(","))  # on the boot partition, or compiled into our programs
    # The kernel's package depends on the one that holds it.
    components = [component_of(root, row) for row in rows if row[0] in held | elsewhere]
    components += [own_component(root, "application", name, "usr/bin/" + name, arguments.version)
                   for name in ("finsightd", "finsight-page")]
    components.append(own_component(root, "data", "model pack", "usr/lib/finsight/model.safetensors", arguments.version))
    name = "finsight-" + arguments.board
    # The same image has the same number.
    serial = uuid.uuid5(uuid.NAMESPACE_URL, json.dumps([name, arguments.version, components], sort_keys=True))
    print(json.dumps({
        "bomFormat": "CycloneDX", "specVersion": "1.5", "serialNumber": f"urn:uuid:{serial}", "version": 1,
        "metadata": {"timestamp": datetime.fromtimestamp(int(arguments.epoch), timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
                     "component": {"type": "firmware", "bom-ref": name, "name": name, "version": arguments.version}},
        "components": components,
        "dependencies": [{"ref": name, "dependsOn": [component["bom-ref"] for component in components]}],
    }, indent=1))


if __name__ == "__main__":
    main()
