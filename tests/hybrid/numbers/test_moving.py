"""Numbers that move: rates against differences, of numbers, of themselves, of ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid.numbers import answers, operators, ranges
from hopdata.hybrid.numbers.moving import moving

FUNCTIONS = {"np": np, "math": math, "moving": moving, "make": ranges.make}
POINTS = np.random.default_rng(5).uniform(0.35, 0.95, (12, 2))
WAY = np.array([0.7, -0.4])  # in which x and z move
assert operators  # gives ranges their operations

# Of x and z in (0.35, 0.95), without kinks there.
SMOOTH = (
    "x + z", "x + 1", "2 - x", "x - z", "x * z", "3.0 * x", "x / z", "2 / x", "x / 3",
    "-x", "x ** 2", "x ** 3", "x ** -1", "x ** 2.5", "x ** z", "2.0 ** x",
    "np.sin(x)", "math.cos(x)", "np.tan(x)", "np.arcsin(x)", "math.acos(x)",
    "np.arctan(x)", "np.sinh(x)", "np.cosh(x)", "np.tanh(x)", "np.arcsinh(x)",
    "np.arccosh(1.0 + x)", "np.arctanh(x)", "np.exp(x)", "np.exp2(x)", "np.expm1(x)",
    "np.log(x)", "np.log2(x)", "np.log10(x)", "np.log1p(x)", "np.sqrt(x)",
    "np.cbrt(x)", "math.erf(x)", "math.erfc(x)", "np.square(x)", "np.degrees(x)",
    "math.radians(x)", "np.hypot(x, z)", "math.atan2(x, z)", "abs(x - 2.0)",
    "np.interp(x, TABLE_X, TABLE_Y) * z", "np.exp(-x * z) * np.sin(z / x)",
)  # fmt: skip
# With kinks and jumps at single places, and conditions.
OTHERS = (
    "min(x, z)", "max(x, 0.6)", "max(0.4, x, z)", "abs(x - z)", "np.sign(x - z) * x",
    "(5.0 * x) % 1.0", "(5.0 * x) % z", "np.fmod(5.0 * x, z)", "np.floor(4.0 * x) * z",
    "(4.0 * x) // 1.0 + x * z", "math.copysign(x, z - 0.6)", "int(4.0 * x) * z",
    "np.where(x > z, x * z, z)", "x if x > 0.6 else z * z", "x * (x > z) + z * (not x)",
    "np.interp(4.0 * x, TABLE_X, TABLE_Y)",
)  # fmt: skip
EXPRESSIONS = (*SMOOTH, *OTHERS)
TABLES = {
    "TABLE_X": np.array([0.0, 1.1, 1.7, 2.2, 5.0]),
    "TABLE_Y": np.array([0.0, 2.0, -1.0, 0.5, 0.25]),
}


def made(head, before, line, expressions=EXPRESSIONS):
    """Return a compiled function of many lines, one for each expression."""
    lines = [line.format(k=k, of=of) for k, of in enumerate(expressions)]
    scope = {**FUNCTIONS, **TABLES}
    exec("\n".join([head, *before, *lines]), scope)
    return njit(error_model="numpy")(scope["made"])


@pytest.fixture(scope="module")
def of_numbers():
    compiled = made("def made(x, z, out):", [], "    out[{k}] = {of}")

    def at(point):
        found = np.full(len(EXPRESSIONS), np.nan)
        compiled(*point, found)
        return found

    return at


@pytest.fixture(scope="module")
def twice():
    """Return value, rate, rate, and rate of the rate (E, 4) of all expressions."""
    compiled = made(
        "def made(a, b, u, v, out):",
        ["    x = moving(moving(a, u), u)", "    z = moving(moving(b, v), v)",
         "    one = moving(moving(1.0, 0.0), 0.0)"],
        "    r = one * ({of})\n    out[{k}, 0] = r.value.value\n"
        "    out[{k}, 1] = r.value.rate\n    out[{k}, 2] = r.rate.value\n"
        "    out[{k}, 3] = r.rate.rate",
    )  # fmt: skip

    def at(point):
        found = np.full((len(EXPRESSIONS), 4), np.nan)
        compiled(*point, *WAY, found)
        return found

    return at


def test_rates_and_their_rates_are_those_of_differences(of_numbers, twice):
    h = 1e-3
    n_compared = np.zeros(len(EXPRESSIONS))
    for point in POINTS:
        found = twice(point)
        np.testing.assert_allclose(found[:, 0], of_numbers(point), rtol=1e-15)
        np.testing.assert_allclose(found[:, 1], found[:, 2], rtol=1e-13, atol=1e-14)
        values = [of_numbers(point + s * h * WAY) for s in (-2, -1, 0, 1, 2)]
        rate = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) @ values / (12.0 * h)
        bend = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) @ values / (12.0 * h * h)
        again = (values[3] - values[1]) / (2.0 * h)
        bent = (values[3] - 2.0 * values[2] + values[1]) / (h * h)
        # Where two increments disagree, a difference crosses a kink or a jump.
        clear = np.abs(rate - again) < 1e-3 * (1.0 + np.abs(rate))
        clear &= np.abs(bend - bent) < 1e-2 * (1.0 + np.abs(bend))
        n_compared += clear
        near = np.isclose(found[:, 1], rate, rtol=1e-7, atol=1e-8)
        near &= np.isclose(found[:, 3], bend, rtol=1e-5, atol=1e-5)
        assert not [EXPRESSIONS[k] for k in np.flatnonzero(clear & ~near)]
    assert n_compared.min() >= 6


def test_ranges_of_rates_contain_the_rates_of_numbers(twice):
    """Of a number that moves at WAY while the range moves at another rate."""
    compiled = made(
        "def made(box, at, out):",
        ["    x = moving(make(box[0], box[1], 1.0, 1.0, at), 0.7)",
         "    z = moving(make(box[2], box[3], 1.0, 1.0, at), -0.4)",
         "    one = moving(make(1.0, 1.0, 0.0, 0.0, at), 0.0)"],
        "    r = (one * ({of})).rate\n"
        "    out[{k}, 0] = r.lo\n    out[{k}, 1] = r.hi\n"
        "    out[{k}, 2] = r.dlo\n    out[{k}, 3] = r.dhi",
        SMOOTH,
    )  # fmt: skip
    rng = np.random.default_rng(8)
    known = 0
    for point in POINTS:
        wide = 10.0 ** rng.uniform(-6.0, -1.5)
        memory = np.zeros(answers.N_SLOTS, dtype=np.int64)
        box = np.repeat(point, 2) + wide * np.array([-1.0, 1.0, -1.0, 1.0])
        found = np.full((len(SMOOTH), 4), np.nan)
        compiled(box, memory.ctypes.data, found)
        least, most, slowest, fastest = found.T
        before = None
        for along in np.linspace(-1.0, 1.0, 9):
            place = point + along * wide  # both move at the rate 1
            rate = twice(place)[: len(SMOOTH), 1]
            margin = 1e-12 * (1.0 + np.abs(rate))
            off = (rate < least - margin) | (rate > most + margin)
            assert not [SMOOTH[k] for k in np.flatnonzero(off)]
            if before is not None:
                slope = (rate - before) / (0.25 * wide)
                margin = 1e-12 * (1.0 + np.abs(rate)) / wide
                off = (slope < slowest - margin) | (slope > fastest + margin)
                assert not [SMOOTH[k] for k in np.flatnonzero(off)]
            before = rate
        # They are no wider than they must be.
        known += np.sum((most - least < 40.0 * wide + 1e-11) & np.isfinite(fastest))
    assert known > 0.85 * len(SMOOTH) * len(POINTS)
