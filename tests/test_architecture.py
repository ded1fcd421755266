"""The house rules that a machine can check: imports between rooms, and what modules state."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import hopdata
from hopdata.products import installed

PACKAGE = Path(hopdata.__file__).parent
SHARED = {
    "arrays",
    "code_cache",
    "errors",
    "jobs",
    "messages",
    "products",
    "recording",
    "rigid",
    "seal",
}
MAY_USE = {
    "hybrid": set(),
    "scenes": {"hybrid"},
    "recordings": set(),
    "synthesis": {"hybrid", "scenes", "recordings"},
    "landings": {"recordings"},
    "maps": {"landings"},
    # A product: it may use the study's rooms, and none of them may use it.
    "steering": {
        *("recordings", "scenes", "synthesis", "figures", "report", "commands"),
        "provenance",
    },
    "figures": set(),
    "report": set(),
    "config": {"scenes", "synthesis"},
    "commands": {
        *("config", "recordings", "landings", "figures", "maps", "report"),
        *("analysis", "group", "provenance"),  # modules beside the rooms
    },
}
HEAVY = {
    "pandas",
    "scipy",
    "matplotlib",
    "statsmodels",
    "sklearn",
    "h5py",
    "jsonschema",
    "jinja2",
}


def modules(room):
    return sorted((PACKAGE / room).rglob("*.py"))


@cache
def walked(path):
    """Return the tree of a file and all its nodes."""
    tree = ast.parse(path.read_text())
    return tree, list(ast.walk(tree))


def imported(path, *, top_level_only=False):
    """Return the absolute names of modules that a file imports."""
    tree, every = walked(path)
    nodes = tree.body if top_level_only else every
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            if node.module == "hopdata":
                yield from (f"hopdata.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("room", MAY_USE)
def test_rooms_import_only_what_they_may(room):
    assert modules(room), f"the room {room} is empty"
    for path in modules(room):
        used = {
            name.split(".")[1]
            for name in imported(path)
            if name.startswith("hopdata.") and name.split(".")[1] != "__version__"
        }
        forbidden = used - MAY_USE[room] - SHARED - {room}
        assert not forbidden, f"{path.name} imports {sorted(forbidden)}"


def test_nothing_beside_a_product_names_its_modules():
    """A product is found by its entry point, so that its folder may be deleted."""
    for product in installed():
        named = re.compile(rf"\b{re.escape(product.package)}\b")
        others = [p for p in PACKAGE.rglob("*.py") if product.folder not in p.parents]
        others += [
            p for p in PACKAGE.rglob("*.toml") if product.folder not in p.parents
        ]
        assert len(others) > 100
        assert [path for path in others if named.search(path.read_text())] == []
        assert named.search((product.folder / "workflow/rules.smk").read_text()) is None


def test_every_room_is_listed():
    rooms = {
        p.name for p in PACKAGE.iterdir() if p.is_dir() and not p.name.startswith("_")
    }
    assert rooms == set(MAY_USE)


def test_the_library_does_not_know_snakemake():
    for path in PACKAGE.rglob("*.py"):
        assert not any(n.split(".")[0] == "snakemake" for n in imported(path)), path


def test_heavy_libraries_are_imported_where_they_are_used():
    """Each job pays for its imports, so only functions may import them (except in figures)."""
    for path in PACKAGE.rglob("*.py"):
        if path.parent.name == "figures":
            continue
        heavy = {n.split(".")[0] for n in imported(path, top_level_only=True)} & HEAVY
        assert not heavy, (
            f"{path.relative_to(PACKAGE)} imports {sorted(heavy)} at the top"
        )


def test_annotations_that_would_load_pandas_are_deferred():
    """`pd` of `hopdata.arrays` loads pandas when it is used, which includes annotations."""
    for path in PACKAGE.rglob("*.py"):
        if path.parent.name == "figures":
            continue
        nodes = walked(path)[1]
        told = [
            getattr(node, "annotation", None) or getattr(node, "returns", None)
            for node in nodes
        ]
        if any("pd." in ast.unparse(one) for one in told if one is not None):
            assert "from __future__ import annotations" in path.read_text(), path


def test_every_module_explains_itself():
    for path in PACKAGE.rglob("*.py"):
        assert ast.get_docstring(walked(path)[0]), path


def test_warnings_of_numpy_are_errors_in_tests_and_in_the_processes_that_they_start():
    with pytest.raises(RuntimeWarning, match="Mean of empty slice"):
        np.nanmean(np.empty(0))
    empty = "import numpy; numpy.nanmean(numpy.empty(0))"
    command = [sys.executable, "-c", empty]
    started = subprocess.run(command, check=False, capture_output=True, text=True)
    assert started.returncode == 1
    assert "RuntimeWarning: Mean of empty slice" in started.stderr
