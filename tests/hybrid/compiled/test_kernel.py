"""Products of blocks of a table, in vector instructions: against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid.compiled.cache import with_digest
from hopdata.hybrid.compiled.memory import float_table
from hopdata.hybrid.methods import tangent as products

N = 0
MULTIPLY = ADD_PRODUCT = None


def both(address):
    table = float_table(address, N)
    MULTIPLY(table, 3 * N, N, 2 * N)
    ADD_PRODUCT(table, 4 * N, 0, N, 2 * N, 0.3)


def run(kind, n, table):
    made = {
        name.upper(): njit(with_digest(getattr(products, f"{name}_{kind}"), N=n))
        for name in ("multiply", "add_product")
    }
    njit(with_digest(both, N=n, **made))(table.ctypes.data)
    return table


@pytest.mark.parametrize("n", [1, 2, 6, 11, 17])
@pytest.mark.parametrize("kind", ["vectors", "numbers"])
def test_products(kind, n):
    before = np.random.default_rng(n).normal(size=(6 * n, n))
    after = run(kind, n, before.copy())
    base, left, right, product, sum_, beyond = after.reshape(6, n, n)
    assert product == pytest.approx(left @ right, abs=1e-13)
    assert sum_ == pytest.approx(before[:n] + 0.3 * left @ right, abs=1e-13)
    assert base.tobytes() == before[:n].tobytes()
    assert np.concatenate([left, right]).tobytes() == before[n : 3 * n].tobytes()
    assert beyond.tobytes() == before[5 * n :].tobytes()


def test_both_ways_round_alike():
    table = np.random.default_rng(5).normal(size=(30, 5))
    assert run("vectors", 5, table.copy()).tobytes() == run("numbers", 5, table.copy()).tobytes()
