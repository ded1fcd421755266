"""Random guards of all operations: no sample of them is outside of their ranges."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from range_harness import (
    COMPARED,
    OPEN,
    OUTSIDE,
    RATES_OUTSIDE,
    UNKNOWN,
    Ranged,
    boxes,
)

XS = np.linspace(-3.0, 3.0, 13)
ZS = np.cos(np.arange(13.0)) ** 3
LEAVES = ("y[0]", "y[1]", "y[2]", "t", "params[0]", "0.5", "-1.25", "2")
ONE = (
    "-{}", "abs({})", "math.sin({})", "np.cos({})", "math.tan(0.3 * {})",
    "math.exp(0.3 * {})", "np.expm1(-0.2 * {})", "math.sqrt(abs({}))", "np.cbrt({})",
    "math.log(1.5 + abs({}))", "np.log2(4.0 + np.tanh({}))", "math.log10(({}) ** 2)",
    "math.log1p(abs({}))", "math.asin(math.tanh({}))", "np.arccos(np.cos({}))",
    "math.atan({})", "math.sinh(0.2 * {})", "np.cosh(0.2 * {})", "math.tanh({})",
    "math.asinh({})", "math.acosh(1.0 + ({}) ** 2)", "np.arctanh(0.9 * np.sin({}))",
    "math.erf({})", "({}) ** 2", "({}) ** 3", "(4.5 + abs({})) ** -2", "({}) ** 5.0",
    "abs({}) ** 1.5", "2.0 ** np.tanh({})", "({}) % 1.7", "np.fmod({}, 0.9)",
    "({}) // 1.3", "math.floor({})", "np.ceil({})", "math.trunc({})", "np.rint({})",
    "np.sign({})", "np.interp({}, XS, ZS)", "np.square({})", "float({})",
    "math.sqrt({})", "math.log({})", "math.acos({})",
    "np.exp2(0.3 * {})", "math.erfc({})", "math.radians({})", "dy[1] * {}",
    "np.sum(y[1:]) * {}", "np.dot(W, y) - {}", "np.linalg.norm(y[:2]) + {}",
    "(1.0 if {} else -1.0)", "TABLE[int(4.0 + 3.0 * math.tanh({}))]",
)  # fmt: skip
TWO = (
    "({} + {})", "({} - {})", "({} * {})", "({} / {})", "({} / (2.0 + abs({})))",
    "min({}, {})", "np.maximum({}, {})", "math.atan2({}, {})", "np.hypot({}, {})",
    "math.copysign({}, {})", "({} if {} > 0.1 else 0.5)", "(0.5 + np.where({} <= {}, 1.0, -2))",
    "(1.0 if {} < 0.4 and {} > -0.8 else 0.0)", "(0.3 if {} > 1.0 or not {} < 0.5 else 1)",
    "(abs({}) + 0.1) ** {}", "(1.0 if {} != {} else 0.0)", "(({} > 0.0) * {})",
    "max({}, {}, 0.2)",
)  # fmt: skip
W = np.array([0.7, -1.0, 0.2])
TABLE = np.array([0.3, -0.5, 0.9, 1.4, -2.0, 0.0, 0.7, 0.1])


def expression(rng, depth):
    """Return the source of a random expression."""
    if depth == 0:
        return str(rng.choice(LEAVES))
    if rng.random() < 0.45:
        return str(rng.choice(ONE)).format(expression(rng, depth - 1))
    left = expression(rng, depth - 1)
    right = expression(rng, int(rng.integers(0, depth)))
    return str(rng.choice(TWO)).format(left, right)


def compiled(sources):
    """Return guards, one for each expression, in one function."""
    lines = ["def many(t, y, dy, mode, params, k, h, hdot):"]
    for k, source in enumerate(sources):
        lines.append(f"    if k == {k}: h[{k}] = {source}")
    made = {"math": math, "np": np, "XS": XS, "ZS": ZS, "TABLE": TABLE, "W": W}
    lines.append("    hdot[k] = 0.0")
    exec("\n".join(lines), made)
    return Ranged(made["many"], len(sources))


def every_operation():
    """Return an expression for each operation, of plain states."""
    singles = [one.format("(y[0] + 0.5 * t)") for one in ONE]
    return singles + [two.format("y[0]", "(y[1] * 0.4)") for two in TWO]


def judge(sources, rng, count):
    """Return the counts of some expressions, a row each, after a check of each."""
    ranged = compiled(sources)
    rows = []
    for k, source in enumerate(sources):
        found = ranged.over(boxes(rng, count), k, rng).sum(axis=0)
        assert found[OUTSIDE] == 0, source
        assert found[RATES_OUTSIDE] == 0, source
        rows.append(found)
    return np.array(rows)


def test_no_sample_of_an_operation_is_outside():
    rng = np.random.default_rng(np.random.SeedSequence(58))
    sources = every_operation()
    counts = judge(sources, rng, 250)
    assert counts[:, COMPARED].sum() > 500_000
    for source, found in zip(sources, counts, strict=True):
        assert found[UNKNOWN] + found[OPEN] < 450, source  # of 250 and 250


@pytest.mark.parametrize("seed", range(4 if "ALL" in os.environ else 1))
def test_no_sample_of_a_random_expression_is_outside(seed):
    rng = np.random.default_rng(np.random.SeedSequence((58, seed)))
    sources = [expression(rng, 3) for _ in range(12)]
    counts = judge(sources, rng, 350)
    assert counts[:, COMPARED].sum() > 100_000
    known = 1.0 - counts[:, UNKNOWN] / 350
    assert np.median(known) > 0.5
