"""The page for contributors names files and objects that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
CHANGES = (ROOT / "CONTRIBUTING.md").read_text().split("## Changes, and")[1]


def test_names_of_the_changes_stand_in_the_source():
    names = set(re.findall(r"`(_?[A-Za-z]\w*)`", CHANGES))
    files = [*(ROOT / "src/hopdata").rglob("*.py"), *(ROOT / "benchmarks").glob("*.py")]
    words = set(re.findall(r"\w+", " ".join(path.read_text() for path in files)))
    prefixes = {name for name in names if name.endswith("_")}
    assert names - prefixes <= words, (
        f"nothing is called {sorted(names - prefixes - words)}"
    )
    assert all(prefix in " ".join(words) for prefix in prefixes)


def test_files_of_the_changes_are_there():
    paths = set(
        re.findall(r"`((?!tables/|build/)[\w/]+/[\w.]*)`", CHANGES)
    )  # tables are results, and commands make build/
    lost = [
        path
        for path in paths
        if not (ROOT / path).exists() and not [*(ROOT / "src/hopdata").rglob(path)]
    ]
    assert paths
    assert not lost, f"no such file: {sorted(lost)}"
