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
    "bundled",
    "causes",
    "code_cache",
    "digests",
    "errors",
    "feet",
    "given",
    "interchange",
    "jobs",
    "messages",
    "notes",
    "private_numba",
    "products",
    "recording",
    "rigid",
    "scale",
    "seal",
    "time_stamps",
    "truth",
}
# The room of the one door, which uses no other, and which all others may use.
FOR_ALL = {"foreign"}
MAY_USE = {
    "foreign": set(),
    "hybrid": set(),
    "scenes": {"hybrid"},
    "recordings": set(),
    "synthesis": {"hybrid", "scenes", "recordings"},
    "landings": {"recordings"},
    "maps": {"landings"},
    # A product: it may use the study's rooms, and none of them may use it.
    "steering": {
        *("hybrid", "recordings", "scenes", "synthesis", "figures", "report"),
        *("commands", "provenance"),
    },
    # The product above all others: it may use everything.
    "dissertation": {
        *("hybrid", "scenes", "recordings", "synthesis", "landings", "maps"),
        *("steering", "figures", "report", "config", "commands"),
        *("analysis", "group", "line", "provenance", "samples", "stages"),
        "walk",
    },
    "inspecting": {"figures", "landings", "recordings"},
    "figures": set(),
    "report": set(),
    "config": {"scenes", "synthesis"},
    "commands": {
        *("config", "recordings", "landings", "figures", "maps", "report"),
        "inspecting",
        # Modules beside the rooms.
        *("analysis", "contact_times", "provenance", "samples", "stages", "walk"),
    },
}
# Modules beside the rooms that stand above them, and what they may use besides `SHARED`.
ABOVE = {
    "__init__": set(),
    "__main__": {"commands"},
    "provenance": set(),
    "forks": set(),
    "line": {"config"},
    "stages": {
        *("config", "landings", "line", "maps", "recordings", "synthesis"),
    },
    "walk": {
        *("config", "figures", "landings", "line", "maps", "recordings", "report"),
        *("stages", "provenance"),
    },
    "reading": {"config", "landings", "recordings"},
    "analysis": {"config", "maps", "reading", "recordings", "stages", "walk"},
    "contact_methods": {"landings", "report"},
    "contact_times": {
        *("config", "contact_methods", "landings", "reading", "recordings", "report"),
    },
    "saved": {"group", "line", "maps", "report", "stages", "walk"},
    "samples": {"config", "maps"},
    "group": {"config", "landings", "maps", "report", "walk"},
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


def used_rooms(path):
    """Return the rooms, and the modules beside them, that a file imports."""
    names = [name.split(".") for name in imported(path)]
    return {
        name[1]
        for name in names
        if name[0] == "hopdata" and len(name) > 1 and name[1] != "__version__"
    }


def run_time_imports(path):
    """Return the import statements of a file, in functions too, but not those for types."""
    every = walked(path)[1]
    for_types = {
        inner
        for node in every
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for statement in node.body
        for inner in ast.walk(statement)
    }
    statements = [n for n in every if isinstance(n, ast.Import | ast.ImportFrom)]
    return [statement for statement in statements if statement not in for_types]


def module_graph(package):
    """Return which modules of a package each of its modules imports, by their names."""
    files = {}
    for path in package.rglob("*.py"):
        parts = path.relative_to(package.parent).with_suffix("").parts
        files[".".join(parts).removesuffix(".__init__")] = path
    graph = {}
    for module, path in files.items():
        graph[module] = set()
        for statement in run_time_imports(path):
            if isinstance(statement, ast.Import):
                named = [alias.name for alias in statement.names]
            else:
                # A name that is imported is a module itself, or stands in one.
                within = [f"{statement.module}.{one.name}" for one in statement.names]
                named = [n if n in files else statement.module for n in within]
            graph[module] |= {name for name in named if name in files} - {module}
    return graph


def circles(graph):
    """Return the sets of nodes that reach one another in a graph of successors."""
    reached = {node: set() for node in graph}
    for node in graph:
        ahead = list(graph[node])
        while ahead:
            following = ahead.pop()
            if following not in reached[node]:
                reached[node].add(following)
                ahead.extend(graph[following])
    return {
        frozenset(other for other in reached[node] if node in reached[other])
        for node in graph
        if node in reached[node]
    }


def room_graph(graph):
    """Return which rooms and modules beside them each of these imports."""
    rooms = {}
    for module, successors in graph.items():
        if "." in module:
            used = {name.split(".")[1] for name in successors if "." in name}
            room = module.split(".")[1]
            rooms[room] = rooms.get(room, set()) | used - {room}
    return rooms


@pytest.mark.parametrize("room", MAY_USE)
def test_rooms_import_only_what_they_may(room):
    assert modules(room), f"the room {room} is empty"
    for path in modules(room):
        forbidden = used_rooms(path) - MAY_USE[room] - SHARED - FOR_ALL - {room}
        assert not forbidden, f"{path.name} imports {sorted(forbidden)}"


@pytest.mark.parametrize("name", sorted(SHARED))
def test_shared_modules_import_no_room(name):
    forbidden = used_rooms(PACKAGE / f"{name}.py") - SHARED - FOR_ALL
    assert not forbidden, f"{name}.py imports {sorted(forbidden)}"


@pytest.mark.parametrize("name", ABOVE)
def test_modules_above_the_rooms_import_only_what_they_may(name):
    forbidden = used_rooms(PACKAGE / f"{name}.py") - ABOVE[name] - SHARED - FOR_ALL
    assert not forbidden, f"{name}.py imports {sorted(forbidden)}"


def test_nothing_beside_a_product_names_its_modules():
    """A product is found by its entry point, so that its folder may be deleted.

    Another product may stand above it, and use it.
    """
    for product in installed():
        named = re.compile(rf"\b{re.escape(product.package)}\b")
        allowed = {product.folder}
        for other in installed():
            if product.name in MAY_USE[other.name]:
                allowed.add(other.folder)
        files = [*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.toml")]
        others = [file for file in files if not allowed & {*file.parents}]
        assert len(others) > 100
        assert [path for path in others if named.search(path.read_text())] == []
        assert named.search((product.folder / "workflow/rules.smk").read_text()) is None


def test_every_room_and_every_module_beside_them_is_listed():
    folders = [path for path in PACKAGE.iterdir() if path.is_dir()]
    rooms = {path.name for path in folders if not path.name.startswith("_")}
    assert rooms == set(MAY_USE)
    beside = {path.stem for path in PACKAGE.glob("*.py")}
    assert beside == SHARED | set(ABOVE)


def test_the_rooms_of_the_integrator_are_those_that_its_documents_name():
    folders = {path.parent.name for path in (PACKAGE / "hybrid").glob("*/__init__.py")}
    own = ast.get_docstring(walked(PACKAGE / "hybrid" / "__init__.py")[0])
    named = set(re.findall(r"^``(\w+)``$", own, re.MULTILINE))
    page = (PACKAGE.parents[1] / "docs" / "architecture.md").read_text()
    listed = set(re.findall(r"^\| `hybrid/(\w+)/` \|", page, re.MULTILINE))
    assert len(folders) >= 8
    assert named == listed == folders


def test_no_module_imports_one_that_imports_it():
    assert circles(module_graph(PACKAGE)) == set()


def test_no_arrow_leads_back_to_a_room():
    assert circles(room_graph(module_graph(PACKAGE))) == set()
    may_use = {**MAY_USE, **ABOVE, **{name: set() for name in SHARED}}
    assert circles(may_use) == set()


def test_circles_of_imports_are_found(tmp_path):
    """Three files in a circle through a function, and one that needs a type only."""
    package = tmp_path / "house"
    (package / "cellar").mkdir(parents=True)
    texts = {
        "__init__": "",
        "roof": "from house.cellar import wine",
        "cellar/__init__": "",
        "cellar/wine": "def drink():\n    from house import stairs",
        "stairs": "import house.roof",
        "garden": "from house.stairs import steps",
        "lamp": "import house.switch",
        "switch": "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from house.lamp import Lamp",
    }
    for name, text in texts.items():
        (package / f"{name}.py").write_text(text)
    graph = module_graph(package)
    found = frozenset(("house.roof", "house.cellar.wine", "house.stairs"))
    assert circles(graph) == {found}
    assert graph["house.garden"] == {"house.stairs"}
    arrows = frozenset(("roof", "cellar", "stairs"))
    assert circles(room_graph(graph)) == {arrows}
    (package / "stairs.py").write_text("import house")
    walked.cache_clear()
    assert circles(module_graph(package)) == set()


def test_the_library_does_not_know_snakemake():
    for path in PACKAGE.rglob("*.py"):
        assert not any(n.split(".")[0] == "snakemake" for n in imported(path)), path


def test_heavy_libraries_are_imported_where_they_are_used():
    """Each job pays for its imports, so only functions may import them (except in figures).

    Estimators need scikit-learn's classes; no job imports them.
    """
    estimators = "hopdata.maps.estimators"
    for path in PACKAGE.rglob("*.py"):
        assert estimators not in imported(path), path
        if path.parent.name == "figures" or path == PACKAGE / "maps" / "estimators.py":
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
        annotations = [
            getattr(node, "annotation", None) or getattr(node, "returns", None)
            for node in nodes
        ]
        if any("pd." in ast.unparse(one) for one in annotations if one is not None):
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
