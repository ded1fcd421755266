"""Digests change with everything that a compiled function is made from, and with nothing else."""

from __future__ import annotations

import importlib
import shutil
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba import njit

import hopdata.hybrid
from hopdata.code_cache import function_digest
from hopdata.hybrid.compiled.digest import (
    NOT_IN_CODE,
    driver_digest,
    driver_sources,
    sources_digest,
)

PACKAGE = Path(hopdata.hybrid.__file__).parent

SOURCE = """
import numpy as np
import numba

FACTOR = {factor}
TABLE = np.arange(3.0) + {offset}

@numba.njit
def helper(x):
    return {helper}

def plain(x):
    return {plain}

def function(x):
    total = helper(x) + FACTOR * TABLE[0]
    return total + {own}

def unrelated(x):
    return {unrelated}
"""

AS_IT_WAS = {
    "factor": 2.0, "offset": 0.5, "helper": "x + plain(x)", "plain": "x + 3",
    "own": "7", "unrelated": "1",
}  # fmt: skip


def digest(**change):
    names: dict = {}
    exec(SOURCE.format(**{**AS_IT_WAS, **change}), names)
    return function_digest(names["function"])


def test_is_reproducible():
    assert digest() == digest()
    assert len(digest()) == 16


@pytest.mark.parametrize(
    "change",
    [
        {"factor": 2.5},
        {"offset": 0.75},
        {"helper": "x - plain(x)"},
        {"plain": "x + 4"},
        {"own": "8"},
    ],
)
def test_changes_with_what_the_function_reaches(change):
    assert digest(**change) != digest()


def test_does_not_change_with_the_rest():
    assert digest(unrelated="2") == digest()


def test_sees_closures_and_modules():
    def make(constant):
        @njit
        def inner(x):
            return np.sin(x) + constant

        def outer(x):
            return inner(x) + 1.0

        return outer

    assert function_digest(make(1.0)) == function_digest(make(1.0))
    assert function_digest(make(1.0)) != function_digest(make(2.0))


def test_recursion_ends():
    assert len(function_digest(test_recursion_ends)) == 16


def test_driver_digest_is_that_of_its_sources():
    assert driver_digest() == sources_digest(PACKAGE)
    assert len(driver_digest()) == 16


@pytest.fixture
def edited(tmp_path):
    """Return the digest of a copy of the package with an extra line in one of its files."""
    shutil.copytree(
        PACKAGE, tmp_path / "hybrid", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copy(PACKAGE.parent / "private_numba.py", tmp_path)

    def edit(name):
        path = tmp_path / "hybrid" / name
        path.write_text(path.read_text() + "\n# another line\n")
        return sources_digest(tmp_path / "hybrid")

    return edit


@pytest.mark.parametrize(
    "name",
    [
        "driver/loop.py", "driver/proof.py", "layout.py", "methods/stiff.py",
        "compiled/memory.py", "compiled/kernel.py", "compiled/linking.py",
        "../private_numba.py",
    ],
)  # fmt: skip
def test_driver_digest_changes_with_what_the_driver_imports(edited, name):
    assert edited(name) != driver_digest()


@pytest.mark.parametrize(
    "name",
    ["compiled/declare.py", "compiled/digest.py", "methods/table.py", "solve.py"],
)
def test_driver_digest_does_not_change_with_the_rest(edited, name):
    assert edited(name) == driver_digest()


def test_the_driver_is_found_by_what_python_imports():
    """Every module of the package that the driver's modules refer to is included."""
    sources = driver_sources(PACKAGE)
    for name in [name for name in sources if name.startswith("driver/")]:
        module = importlib.import_module(
            "hopdata.hybrid." + name.removesuffix(".py").replace("/", ".")
        )
        for value in vars(module).values():
            origin = getattr(getattr(value, "py_func", value), "__module__", None) or ""
            path = origin.removeprefix("hopdata.hybrid.").replace(".", "/") + ".py"
            if origin.startswith("hopdata.hybrid."):
                assert path in {*sources, *NOT_IN_CODE}


INTRINSIC = """
from numba import types
from numba.extending import intrinsic

def built(builder, x):
    return {built}

@intrinsic
def twice(typing, x):
    def generate(context, builder, sign, values):
        return built(builder, values[0])
    return types.float64(types.float64), generate

def function(x):
    return twice(x)
"""


def test_sees_what_an_intrinsic_builds_its_code_with(tmp_path, monkeypatch):
    """A function builds it that only the intrinsic's inner function calls."""
    monkeypatch.syspath_prepend(tmp_path)
    digests = []
    for name, built in (
        ("sums", "builder.fadd(x, x)"),
        ("products", "builder.fmul(x, x)"),
    ):
        (tmp_path / f"built_by_{name}.py").write_text(INTRINSIC.format(built=built))
        digests.append(
            function_digest(importlib.import_module(f"built_by_{name}").function)
        )
    assert digests[0] != digests[1]


LARGE = np.arange(5000.0)
outer = ModuleType("outer")
outer.inner = ModuleType("outer.inner")
outer.inner.level = 1.0


def of_tuple(x):
    return LARGE_PAIR[0][x]


def of_inner_function(x):
    def inside(y):
        return FACTOR_INSIDE * y

    return inside(x)


def of_module_in_module(x):
    return outer.inner.level * x


def changed_array(monkeypatch):
    """The middle of an array that is too long to be printed in full."""
    other = LARGE.copy()
    other[2500] += 1.0
    monkeypatch.setitem(globals(), "LARGE_PAIR", (other, 1))


def changed_factor(monkeypatch):
    monkeypatch.setitem(globals(), "FACTOR_INSIDE", 3.0)


def changed_level(monkeypatch):
    monkeypatch.setattr(outer.inner, "level", 2.0)


LARGE_PAIR = (LARGE, 1)
FACTOR_INSIDE = 2.0


@pytest.mark.parametrize(
    ("function", "change"),
    [
        (of_tuple, changed_array),
        (of_inner_function, changed_factor),
        (of_module_in_module, changed_level),
    ],
)
def test_what_is_reached_by_a_detour_counts(monkeypatch, function, change):
    before = function_digest(function)
    assert function_digest(function) == before
    with monkeypatch.context() as changed:
        change(changed)
        assert function_digest(function) != before
    assert function_digest(function) == before
