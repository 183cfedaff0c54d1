"""A step of tests/system/boot that reads the image's bill of materials against what is in the image."""
import json
import re
import shutil
import subprocess

import jsonschema

from bench import SOURCE, WORK, check, step

# Made by scripts/image, not out of a package.
MADE = re.compile(r"boot/(initrd|vmlinuz)|usr/lib/modules/[^/]+/modules\.[\w.]+|usr/lib/finsight/.*|usr/bin/finsight\S+|"
                  r"etc/machine-id")


# CycloneDX's own schema comes with its library; npm knows the archive's checksum.
SCHEMAS = "@cyclonedx/cyclonedx-library@10.3.0"
ANSWERS_AT = "http://cyclonedx.org/schema/"


def too_many(_, allowed, instance, schema):
    """jsonschema's own answer for lists of objects fails while it words it (version 4.10)."""
    if allowed is False and isinstance(schema.get("items"), list) and len(instance) > len(schema["items"]):
        yield jsonschema.ValidationError("too many items")


def against_the_standard(bill):
    """What CycloneDX's schema says against it, one line each."""
    folder = WORK / "cyclonedx"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    subprocess.run(["npm", "pack", "--silent", SCHEMAS], cwd=folder, check=True, capture_output=True)
    subprocess.run(["tar", "-xzf", *folder.glob("*.tgz")], cwd=folder, check=True)
    found = {name: json.loads((folder / "package/res/schema" / name).read_text())
             for name in (f"{of}.SNAPSHOT.schema.json" for of in ("bom-1.5", "spdx", "jsf-0.82"))}
    schema = found["bom-1.5.SNAPSHOT.schema.json"]
    resolver = jsonschema.RefResolver(schema["$id"], schema, store={ANSWERS_AT + name: of for name, of in found.items()})
    validator = jsonschema.validators.extend(jsonschema.Draft7Validator, {"additionalItems": too_many})
    return [f"{list(error.path)}: {error.message[:200]}" for error in validator(schema, resolver=resolver).iter_errors(bill)]


def files_in_system(bench):
    """Paths of the system's regular files, without their copyright files."""
    (WORK / "slot").write_bytes(bench.update().read_bytes()[4096:])
    listing = subprocess.run(["unsquashfs", "-lln", WORK / "slot"], capture_output=True, text=True, check=True).stdout
    lines = [line.split("squashfs-root/", 1) for line in listing.splitlines() if line.startswith("-")]
    return {line[1] for line in lines}


@step
def the_bill_names_all_that_is_there(bench):
    """Every file of the system comes from a package in the bill, or is ours; every package in it has files and licences."""
    bill = json.loads(next(bench.image_folder.glob("*.cdx.json")).read_text())
    named = {component["name"]: component for component in bill["components"]}
    archive = max((SOURCE / "build/image").glob("debian-*.packages.files"), key=lambda file: file.stat().st_mtime)
    owner = dict(line.split("\t") for line in archive.read_text().splitlines())
    owner = {path.removeprefix("./"): package for path, package in owner.items()}
    own = {str(path.relative_to(SOURCE / "boards/image/rootfs"))
           for path in (SOURCE / "boards/image/rootfs").rglob("*") if path.is_file()}
    files = files_in_system(bench)
    programs = {path for path in files if not path.startswith("usr/share/doc/")}
    unknown = {path for path in programs if path not in own and not MADE.fullmatch(path) and owner.get(path) not in named}
    check(not unknown, f"{len(unknown)} files of no package in the bill: {sorted(unknown)[:10]}")
    debian = {name: component for name, component in named.items() if component.get("purl")}
    used = {owner.get(path) for path in programs}
    # Headers that our programs are compiled with; what is on the boot partition; a package that holds nothing itself.
    compiled_in = {"libeigen3-dev", "nlohmann-json3-dev"}
    check(compiled_in <= set(debian), f"not named: {compiled_in - set(debian)}")
    unused = set(debian) - used - compiled_in - {"grub-efi-arm64-bin", "linux-image-arm64"}
    links = {name for name in unused if any(package == name for package in owner.values())}  # of which a link is left
    check(unused <= links, f"named and not there: {unused - links}")
    without = {name for name, component in debian.items() if not component.get("licenses")}
    check(not without, f"without licences: {without}")
    standard = "schema of CycloneDX not asked: no npm"
    if shutil.which("npm"):
        wrong = against_the_standard(bill)
        check(not wrong, f"{len(wrong)} times not as CycloneDX has it: {wrong[:5]}")
        check(against_the_standard({**bill, "version": "one"}), "its schema takes anything")
        standard = "valid by CycloneDX's schema"
    texts = {name for name in debian if f"usr/share/doc/{name}/copyright" in files}
    return f"{len(debian)} packages for {len(programs)} files, {len(texts)} copyright files (others link to them); {standard}"
