"""A release's list of parts (SBOM, CycloneDX 1.6), and the licences of what is locked.

The parts are those of the lock files, with the hashes that an installation requires.
Their licences stand in docs/licences.md, which `tests/test_supply_chain.py` compares
with the locks and with what the installed packages say of themselves.

python packaging/sbom.py dist/hopdata.cdx.json    write the list
python packaging/sbom.py --licences               write the page's table of packages
"""

import argparse
import hashlib
import json
import os
import re
import sys
import tomllib
import uuid
from datetime import UTC, datetime
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "licences.md"
#: What an installation runs, and what it is built with.
LOCKS = {"requirements.lock": "required", "requirements-build.lock": "excluded"}

# Words of packages' metadata that mean one licence.
SPDX = {
    "MIT": "MIT",
    "MIT License": "MIT",
    "BSD-3-Clause": "BSD-3-Clause",
    "BSD 3-Clause License": "BSD-3-Clause",
    "2-clause BSD": "BSD-2-Clause",
    "Apache-2.0": "Apache-2.0",
    "Apache License, Version 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "MPL-2.0": "MPL-2.0",
}
# Packages whose metadata do not say which licence, or not exactly: read in their files.
READ = {
    "conda-inject": "MIT",
    "cycler": "BSD-3-Clause",
    "docutils": (
        "LicenseRef-public-domain AND PSF-2.0 AND BSD-2-Clause AND GPL-3.0-or-later"
    ),
    "gitdb": "BSD-3-Clause",
    "jinja2": "BSD-3-Clause",
    "kiwisolver": "BSD-3-Clause",
    "matplotlib": "LicenseRef-Matplotlib",
    "numba": "BSD-2-Clause",
    "packaging": "Apache-2.0 OR BSD-2-Clause",
    "pyreadline3": "BSD-3-Clause",
    "scipy": "BSD-3-Clause",
    "snakemake-interface-common": "MIT",
    "snakemake-interface-logger-plugins": "MIT",
    "snakemake-interface-report-plugins": "MIT",
    "snakemake-interface-scheduler-plugins": "MIT",
    "snakemake-interface-storage-plugins": "MIT",
}


class Part(NamedTuple):
    """A locked package."""

    name: str
    version: str
    marker: str
    hashes: tuple[str, ...]


def parts(lock: str) -> list[Part]:
    """Return what a lock file lists."""
    text = (ROOT / lock).read_text(encoding="utf-8").replace("\\\n", " ")
    found = []
    for line in text.splitlines():
        entry = re.match(r"([a-z0-9._-]+)==([^\s;]+)(?: ; (.*?))?\s+--hash", line)
        if entry:
            hashes = tuple(re.findall(r"--hash=sha256:([0-9a-f]{64})", line))
            found.append(Part(entry[1], entry[2], entry[3] or "", hashes))
    return found


def stated_licence(name: str) -> str:
    """Return the licence that a package states; nothing if it is not installed."""
    if name in READ:
        return READ[name]
    try:
        of = distribution(name)
    except PackageNotFoundError:
        return ""
    return _of_metadata(of)


def _of_metadata(of: Distribution) -> str:
    expression = of.metadata.get("License-Expression")
    if expression:
        return str(expression)
    classifiers = of.metadata.get_all("Classifier") or []
    words = [text.rpartition(" :: ")[2] for text in classifiers if "License ::" in text]
    words.insert(0, str(of.metadata.get("License") or "").strip().partition("\n")[0])
    for said in words:
        if said in SPDX:
            return SPDX[said]
    raise SystemExit(f"{of.name}: expected a known licence, found {words}; see READ")


def page_licences() -> dict[str, str]:
    """Return the licence of each locked package, as the page says."""
    text = PAGE.read_text(encoding="utf-8").partition("## Locked packages")[2]
    rows = re.findall(r"^\| `([^`]+)` \| ([^|]+) \|$", text, re.MULTILINE)
    return {name: licence.strip() for name, licence in rows}


def write_page_licences() -> None:
    """Write the page's table anew; a package that is not installed keeps its line."""
    known = page_licences()
    names = sorted({part.name for lock in LOCKS for part in parts(lock)})
    rows = []
    for name in names:
        licence = stated_licence(name) or known.get(name, "")
        if not licence:
            raise SystemExit(f"{name}: expected it installed, or its licence in READ")
        rows.append(f"| `{name}` | {licence} |\n")
    before, head, _ = PAGE.read_text(encoding="utf-8").partition(
        "| package | licence |\n"
    )
    table = f"{head}|---|---|\n{''.join(rows)}"
    PAGE.write_text(before + table, encoding="utf-8", newline="\n")


def component(part: Part, scope: str, licence: str) -> dict[str, object]:
    """Return the entry of a package."""
    properties = [
        {"name": "hopdata:file:sha256", "value": digest} for digest in part.hashes
    ]
    if part.marker:
        properties.append({"name": "hopdata:marker", "value": part.marker})
    purl = f"pkg:pypi/{part.name}@{part.version}"
    return {
        "type": "library",
        "bom-ref": purl,
        "name": part.name,
        "version": part.version,
        "scope": scope,
        "licenses": [{"expression": licence}],
        "purl": purl,
        "properties": properties,
    }


def sbom() -> dict[str, object]:
    """Return the list of parts; the same for the same lock files and time of commit."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    licences = page_licences()
    entries = []
    for lock, scope in LOCKS.items():
        for part in parts(lock):
            entry = component(part, scope, licences[part.name])
            if entry["bom-ref"] not in {one["bom-ref"] for one in entries}:
                entries.append(entry)
    purl = f"pkg:pypi/{project['name']}@{project['version']}"
    needed = {re.match(r"[\w.-]+", text)[0].lower() for text in project["dependencies"]}
    digest = hashlib.sha256(json.dumps(entries).encode()).hexdigest()
    made = int(os.environ.get("SOURCE_DATE_EPOCH", "0"))
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, purl + digest)}",
        "version": 1,
        "metadata": {
            "timestamp": datetime.fromtimestamp(made, UTC).isoformat(),
            "component": {
                "type": "application",
                "bom-ref": purl,
                "name": project["name"],
                "version": project["version"],
                "licenses": [{"expression": project["license"]}],
                "purl": purl,
            },
        },
        "components": entries,
        "dependencies": [
            {
                "ref": purl,
                "dependsOn": [
                    entry["bom-ref"] for entry in entries if entry["name"] in needed
                ],
            }
        ],
    }


def main(arguments: list[str]) -> None:
    """Write what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", nargs="?", type=Path)
    parser.add_argument("--licences", action="store_true")
    options = parser.parse_args(arguments)
    if options.licences:
        write_page_licences()
    if options.out is not None:
        text = json.dumps(sbom(), indent=1)
        options.out.write_text(text + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
