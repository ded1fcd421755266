"""Kernels are linked and optimised once, for their entry, and give the same results either way."""

from __future__ import annotations

import importlib.util
import itertools
import sys
from ctypes import CFUNCTYPE, c_double

import numba
import numpy as np
import pytest
from numba import njit
from numba.core import codegen, compiler, typed_passes
from numba.core.bytecode import FunctionIdentity

from hopdata.hybrid.compiled import kernel as kernels
from hopdata.hybrid.compiled.memory import view
from hopdata.hybrid.methods.tangent import add_product, multiply

NATIVE = numba.float64(numba.float64)


def made(how):
    """Return an entry and the kernels that it reaches, one of them by two paths."""

    @how.kernel_apart
    def total(x):
        result = 0.0
        for i in range(int(x)):
            result += x / (i + 1)
        return result

    @how.kernel_in_loop
    def shifted(x):
        return total(x) + 1.0

    @how.kernel
    def ratio(x):
        return shifted(x) / (x - 3.0)

    def entry(x):
        return ratio(x) + shifted(x) + total(2.0 * x)

    return numba.cfunc(NATIVE, **how.ENTRY)(entry), ratio


def value(code, x):
    return CFUNCTYPE(c_double, c_double)(code.address)(x)


TOTAL_OF_4, TOTAL_OF_8 = 25 / 3, 761 / 35
OF_4 = 2 * (TOTAL_OF_4 + 1.0) + TOTAL_OF_8


def test_all_is_optimised_once(monkeypatch):
    made(kernels)  # the part that Numba compiles for itself
    optimised, plainly = [], codegen.CPUCodeLibrary._optimize_final_module
    monkeypatch.setattr(
        codegen.CPUCodeLibrary, "_optimize_final_module",
        lambda library: (optimised.append(library.name), plainly(library)),
    )  # fmt: skip
    code, _ = made(kernels)
    assert [name.split(".")[-1] for name in optimised] == ["entry"]
    assert value(code, 4.0) == pytest.approx(OF_4, rel=1e-15)


def test_apart_is_not_put_into_its_callers():
    code, _ = made(kernels)
    defined = [
        line for line in code.inspect_llvm().splitlines() if line.startswith("define")
    ]
    assert sum("total" in line for line in defined) == 1
    assert not [
        line for line in defined if "shifted" in line and "alwaysinline" not in line
    ]


def test_division_by_zero():
    _, ratio = made(kernels)
    assert ratio(3.0) == float("inf")


def test_called_from_python_and_from_other_compiled_code():
    _, ratio = made(kernels)
    alone = ratio(4.0)

    @numba.njit
    def others(x):
        return ratio(x) + ratio(x + 4.0)

    assert alone == pytest.approx(TOTAL_OF_4 + 1.0, rel=1e-15)
    assert others(4.0) == pytest.approx(alone + (TOTAL_OF_8 + 1.0) / 5.0, rel=1e-15)
    assert ratio(4.0) == alone


@pytest.mark.parametrize(
    ("owner", "name"),
    [
        (codegen, "JITCodeLibrary"),
        (codegen.CPUCodeLibrary, "_get_module_for_linking"),
        (typed_passes, "NativeLowering"),
        (compiler, "CompilerBase"),
    ],
)
def test_with_a_numba_that_lacks_a_name(monkeypatch, owner, name):
    monkeypatch.delitem(sys.modules, "hopdata.hybrid.compiled.linking")
    monkeypatch.delattr(owner, name)
    spec = importlib.util.spec_from_file_location("kernels_elsewhere", kernels.__file__)
    elsewhere = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, elsewhere)
    spec.loader.exec_module(elsewhere)
    monkeypatch.undo()
    assert elsewhere.ENTRY == {"error_model": "numpy"}
    code, ratio = made(elsewhere)
    assert value(code, 4.0) == value(made(kernels)[0], 4.0)
    assert ratio(3.0) == float("inf")


# Products of blocks of a table, against NumPy.


@njit
def both(blocks):
    table, n = view(blocks), blocks.shape[1]
    multiply(table, 3 * n, n, 2 * n)
    add_product(table, 4 * n, 0, n, 2 * n, 0.3)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6, 11, 17])
def test_products(n):
    before = np.random.default_rng(n).normal(size=(6 * n, n))
    after = before.copy()
    both(after)
    base, left, right, product, sum_, beyond = after.reshape(6, n, n)
    assert product == pytest.approx(left @ right, abs=1e-13)
    assert sum_ == pytest.approx(before[:n] + 0.3 * left @ right, abs=1e-13)
    assert base.tobytes() == before[:n].tobytes()
    assert np.concatenate([left, right]).tobytes() == before[n : 3 * n].tobytes()
    assert beyond.tobytes() == before[5 * n :].tobytes()


def scaled(factor):
    """Return an entry that calls one function of a factory, as the only one does."""

    def factory():
        @kernels.kernel_apart
        def times(x):
            return factor * x

        return times

    times = factory()
    names = {"times": times, "__name__": __name__}
    exec(f"def entry_{factor}(x): return times(x)", names)
    return names[f"entry_{factor}"]


def test_functions_of_one_factory_are_not_taken_for_each_other(monkeypatch):
    # Two processes count from the same number, and one process loads what they compiled.
    values = []
    loaded = []
    for factor in (2, 3):
        monkeypatch.setattr(FunctionIdentity, "_unique_ids", itertools.count(10**6))
        loaded.append(numba.cfunc(NATIVE, **kernels.ENTRY)(scaled(factor)))
        values.append(value(loaded[-1], 1.0))
    assert values == [2.0, 3.0]
    names = [one._library.get_defined_functions() for one in loaded]
    hidden = [{one.name for one in every if "times" in one.name} for every in names]
    assert hidden[0] == hidden[1] != set()  # or this test would compare nothing
