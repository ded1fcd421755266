"""Two files use private parts of Numba, and each of those names still exists."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import numba
import pytest
from hybrid_systems import throw
from packaging.version import Version

import hopdata
from hopdata.hybrid.compiled import kernel, linking

LIBRARY = Path(hopdata.__file__).parent
PUBLIC = {"numba", "numba.extending", "numba.types", "numba.typed", "numba.errors"}
PUBLIC |= {"llvmlite", "llvmlite.binding"}
MAY = {"private_numba.py", "hybrid/compiled/linking.py"}
# A module of Numba's that is imported by a name in quotation marks.
QUOTED = re.compile(
    r"""["'](?:numba|llvmlite)\.(?!types|extending|errors|binding)\w+"""
)


def private_names(paths):
    """Return (file, module, name) of each import of a private name."""
    for path in sorted(paths):
        text = path.read_text()
        named = (
            "numba" in text or "llvmlite" in text
        )  # parsing all files would take a second
        for node in ast.walk(ast.parse(text)) if named else ():
            if isinstance(node, ast.ImportFrom) and node.module:
                modules = [(node.module, one.name) for one in node.names]
            elif isinstance(node, ast.Import):
                modules = [(one.name, None) for one in node.names]
            else:
                continue
            for module, name in modules:
                hidden = module not in PUBLIC or (name or "").startswith("_")
                if hidden and module.split(".")[0] in ("numba", "llvmlite"):
                    yield path.relative_to(LIBRARY).as_posix(), module, name


def test_two_files_use_what_is_private():
    every = private_names(LIBRARY.rglob("*.py"))
    assert {file for file, _, _ in every} == MAY


def test_no_other_file_imports_it_by_a_name_in_quotation_marks():
    found = []
    for path in sorted(LIBRARY.rglob("*.py")):
        if path.relative_to(LIBRARY).as_posix() not in MAY:
            found += QUOTED.findall(path.read_text())
    assert not found
    assert QUOTED.search('import_module("numba.core.config")')


@pytest.mark.parametrize(
    ("file", "module", "name"),
    sorted(private_names(LIBRARY / file for file in MAY), key=str),
)
def test_each_private_name_is_there(file, module, name):
    found = importlib.import_module(module)
    assert (
        name is None
        or hasattr(found, name)
        or importlib.import_module(f"{module}.{name}")
    )
    part = module.removeprefix("numba.core.").removeprefix("numba.")
    if not module.startswith("llvmlite"):
        text = ast.get_docstring(ast.parse((LIBRARY / file).read_text()))
        words = {part, name} if part in ("core", "numba") else {part}
        assert any(f"`{word}`" in text for word in words), (
            f"{file} does not say why it uses {part}"
        )


def test_kernels_are_linked_and_not_compiled_one_by_one():
    """With a Numba that lacks a name, the driver would take five times as long to compile."""
    assert kernel.ENTRY["pipeline_class"] is linking.Entry
    assert Version(numba.__version__) >= Version("0.61")


def test_what_is_made_of_it_integrates():
    from hopdata.hybrid import solve

    assert solve(throw(), (0.0, 3.0), [0.0, 2.5], params=(2.0, 1.0)).success
