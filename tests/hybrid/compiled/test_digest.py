"""Digests change with everything that a compiled function is made from, and with nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid.compiled.digest import driver_digest, function_digest

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


def test_driver_digest():
    assert driver_digest() == driver_digest()
