"""Dual numbers: values to the bit, slopes against complex steps and differences, and kinks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid.compiled.memory import array_at
from hopdata.hybrid.numbers import duals

WIDTH = 2
FUNCTIONS = {"np": np, "math": math, "ROWS": array_at(duals.Dual(WIDTH))}
POINTS = np.random.default_rng(3).uniform(0.35, 0.95, (20, 2))

# Of x and z in (0.35, 0.95). These are analytic: a complex step gives the derivative.
ANALYTIC = (
    "x + z", "x - z", "x * z", "x / z", "2 * x", "x * 3.0", "x - 1", "1.5 - x", "2 / x",
    "x / 2", "-x", "+x", "x ** 2", "x ** 3", "x ** -2", "x ** 7", "x ** 2.5", "x ** z",
    "2 ** x", "2.5 ** z", "x ** 1", "x ** 0", "pow(x, 3)", "np.power(x, z)",
    "np.sin(x)", "np.cos(x)", "np.tan(x)", "np.arcsin(x)", "np.arccos(x)",
    "np.arctan(x)", "np.sinh(x)", "np.cosh(x)", "np.tanh(3.0 * x)", "np.arcsinh(x)",
    "np.arccosh(1.0 + x)", "np.arctanh(x)", "np.exp(x)", "np.log(x)", "np.log10(x)",
    "np.sqrt(x)", "np.square(x)", "np.reciprocal(x)", "np.exp(-x) * np.sin(z / x)",
    "np.sqrt(x * x + z * z) / (1 + np.cos(x) ** 2)", "np.negative(x)", "np.add(x, z)",
    "np.subtract(x, z)", "np.multiply(x, z)", "np.divide(x, z)",
)  # fmt: skip
# These are smooth at all points but one of each, where a difference would cross a jump.
REAL = (
    "math.sin(x)", "math.cos(x)", "math.tan(x)", "math.asin(x)", "math.acos(x)",
    "math.atan(x)", "math.sinh(x)", "math.cosh(x)", "math.tanh(x)", "math.asinh(x)",
    "math.acosh(1 + x)", "math.atanh(x)", "math.exp(x)", "math.expm1(x)", "math.log(x)",
    "math.log2(x)", "math.log10(x)", "math.log1p(x)", "math.sqrt(x)", "math.erf(x)",
    "math.erfc(x)", "math.pow(x, 2)", "math.pow(x, z)", "np.exp2(x)", "np.expm1(x)",
    "np.log2(x)", "np.log1p(x)", "np.degrees(x)", "np.deg2rad(x)", "math.radians(x)",
    "abs(x - z)", "np.abs(x - 0.6)", "math.fabs(x - z)", "min(x, z)", "max(x, z)",
    "max(x, 0.5)", "min(1, x)", "max(0.4, x, z)", "min(x, z, 0.9, 1)",
    "np.minimum(x, z)", "np.maximum(x, 0.5)", "np.fmin(x, z)", "np.fmax(x, z)",
    "np.hypot(x, z)", "math.hypot(x, 1.0)", "math.atan2(x, z)", "np.arctan2(1.0, z)",
    "np.arctan2(x, -1)", "math.copysign(x, z - 0.6)", "np.copysign(-x, z)",
    "(7.0 * x) % z", "(5 * x) % 1", "3 % x", "np.fmod(7.0 * x, z)", "np.mod(-5 * x, z)",
    "np.where(x > z, x * x, z)", "np.where(x > 0.5, x, 0)", "x if x else z",
    "x * (x > z) + (z if z > 0.6 else 0.0)", "z * (not x) + x", "float(x) * 2",
    "(5 * x) // z + x", "np.floor(5 * x) * z", "math.floor(5 * x) * z",
    "math.ceil(5 * x) * z", "np.ceil(5 * x) * z", "int(5 * x) * z", "np.rint(5 * x) * z",
    "round(5 * x) * z", "np.trunc(5 * x) * z", "np.sign(x - z) * z", "x * True",
    "np.interp(3.0 * x, TABLE_X, TABLE_Y) * z", "x if math.isfinite(z) else z",
    "x * (x != z) * (x >= z) + (x <= z) * (x == x) * z", "x * np.where(True, 2.0, 1.0)",
)  # fmt: skip
EXPRESSIONS = (*ANALYTIC, *REAL)
TABLES = {
    "TABLE_X": np.array([0.0, 1.1, 1.7, 2.2, 5.0]),
    "TABLE_Y": np.array([0.0, 2.0, -1.0, 0.5, 0.25]),
}


def composed(head, assigned):
    """Return a function of many lines, one for each expression."""
    lines = [f"    out[{k}] = {line}" for k, line in enumerate(EXPRESSIONS)]
    scope = {**FUNCTIONS, **TABLES}
    exec("\n".join([head, *assigned, *lines]), scope)
    return njit(error_model="numpy")(scope["made"])


@pytest.fixture(scope="module")
def of_duals():
    """Return values and slopes (E, 1 + WIDTH) of all expressions at duals of x and z."""
    count = len(EXPRESSIONS)
    made = composed(
        "def made(given, address):",
        [f"    out = ROWS(address, {count})", "    y = ROWS(given, 2)",
         "    x = y[0]", "    z = y[1]"],
    )  # fmt: skip

    def at(x, z, slopes=((1.0, 0.0), (0.0, 1.0))):
        given = np.array([[x, *slopes[0]], [z, *slopes[1]]])
        found = np.full((count, 1 + WIDTH), np.nan)
        made(given.ctypes.data, found.ctypes.data)
        return found

    return at


@pytest.fixture(scope="module")
def of_numbers():
    """Return all expressions (E,) at numbers."""
    made = composed("def made(x, z, out):", [])

    def at(x, z):
        found = np.full(len(EXPRESSIONS), np.nan)
        made(x, z, found)
        return found

    return at


def test_values_have_the_same_bits(of_duals, of_numbers):
    for x, z in POINTS:
        assert of_duals(x, z)[:, 0].tobytes() == of_numbers(x, z).tobytes()


def test_analytic_functions_have_the_derivative_of_a_complex_step(of_duals):
    tiny = 1e-200
    for x, z in POINTS:
        found = of_duals(x, z)[: len(ANALYTIC), 1:]
        for k, line in enumerate(ANALYTIC):
            names = {"np": np}
            by_x = eval(line, names, {"x": complex(x, tiny), "z": z}).imag / tiny
            by_z = eval(line, names, {"x": x, "z": complex(z, tiny)})
            by_z = np.imag(by_z) / tiny
            np.testing.assert_allclose(
                found[k], [by_x, by_z], rtol=4e-15, atol=1e-15, err_msg=line
            )


def test_other_functions_have_the_derivative_of_differences(of_duals, of_numbers):
    h = 1e-3
    shifts = np.array([-2.0, -1.0, 1.0, 2.0]) * h
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * h)
    n_compared = np.zeros(len(EXPRESSIONS))
    for x, z in POINTS:
        found = of_duals(x, z)
        by_x = weights @ [of_numbers(x + s, z) for s in shifts]
        by_z = weights @ [of_numbers(x, z + s) for s in shifts]
        # Where two increments disagree, a difference crosses a kink or a jump.
        again_x = (of_numbers(x + h, z) - of_numbers(x - h, z)) / (2.0 * h)
        again_z = (of_numbers(x, z + h) - of_numbers(x, z - h)) / (2.0 * h)
        off = np.maximum(np.abs(by_x - again_x), np.abs(by_z - again_z))
        smooth = off < 1e-3 * (1.0 + np.abs(by_x) + np.abs(by_z))
        n_compared += smooth
        near = np.isclose(found[:, 1], by_x, rtol=1e-7, atol=1e-8)
        near &= np.isclose(found[:, 2], by_z, rtol=1e-7, atol=1e-8)
        wrong = [EXPRESSIONS[k] for k in np.flatnonzero(smooth & ~near)]
        assert not wrong
    assert n_compared.min() >= 10


def test_slopes_are_linear_in_the_directions(of_duals):
    x, z = POINTS[0]
    unit = of_duals(x, z)
    other = of_duals(x, z, ((2.0, -1.0), (0.5, 3.0)))
    np.testing.assert_allclose(
        other[:, 1], 2.0 * unit[:, 1] + 0.5 * unit[:, 2], rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(
        other[:, 2], -unit[:, 1] + 3.0 * unit[:, 2], rtol=1e-12, atol=1e-12
    )


# At kinks and poles.

EDGES = {
    "abs(x)": (1.0, 1.0),
    "abs(-x)": (1.0, 1.0),
    "max(x, 0.0)": (1.0, 0.0),
    "max(0.0, x)": (1.0, 0.0),
    "min(x, 0.0)": (0.0, -1.0),
    "np.maximum(0.0, x)": (1.0, 0.0),
    "np.hypot(x, 0.0)": (1.0, 1.0),
    "math.hypot(x, 2.0 * x)": (math.sqrt(5.0), math.sqrt(5.0)),
    "np.sqrt(x)": (math.inf, -math.inf),
    "np.sqrt(x * x)": (0.0, 0.0),
    "np.sqrt(0.0 * x)": (0.0, 0.0),
    "x ** 0.5": (math.inf, -math.inf),
    "x ** 1.5": (0.0, 0.0),
    "x ** 0": (0.0, 0.0),
    "x ** 0.0": (0.0, 0.0),
    "0.0 ** (x + 1.0)": (0.0, 0.0),
    "np.sign(x) + x": (1.0, -1.0),
    "x % 1.0": (1.0, -1.0),
    "np.interp(x, KNOTS, HEIGHTS)": (2.0, -3.0),
    "math.acos(1.0 - 0.0 * x)": (0.0, 0.0),
}


@pytest.fixture(scope="module")
def at_zero():
    """Return values and slopes at x = 0, which rises along one direction and falls along one."""
    lines = [f"    out[{k}] = {line}" for k, line in enumerate(EDGES)]
    head = ["def made(given, address):", f"    out = ROWS(address, {len(EDGES)})",
            "    x = ROWS(given, 1)[0]"]  # fmt: skip
    knots = {"KNOTS": np.array([-1.0, 0.0, 1.0]), "HEIGHTS": np.array([-3.0, 0.0, 2.0])}
    scope = {**FUNCTIONS, **knots}
    exec("\n".join([*head, *lines]), scope)
    given = np.array([[0.0, 1.0, -1.0]])
    found = np.full((len(EDGES), 1 + WIDTH), np.nan)
    njit(error_model="numpy")(scope["made"])(given.ctypes.data, found.ctypes.data)
    return found


@pytest.mark.parametrize(("place", "line"), list(enumerate(EDGES)))
def test_slopes_at_a_kink_are_those_ahead(at_zero, place, line):
    assert at_zero[place, 1:].tolist() == pytest.approx(list(EDGES[line]), rel=1e-15)


# Code as users write it.


def as_written(t, y, mode, params, dy):
    n = len(y) // 2
    push = 0
    for leg in range(n):
        if mode[leg] > 0:
            push += params[leg] * (t - y[leg])
    dy[:] = 0.0
    dy[:n] = y[n:]
    for i, speed in enumerate(y[n:]):
        dy[n + i] -= speed * abs(speed)
    dy[-1] += push
    low, high = y[0], y[-1]
    if low > high:
        low, high = high, low
    dy[n] = dy[n] + low - np.where(high > 2, 1.0, high) ** 2


@pytest.mark.parametrize("width", [1, 8])
def test_arrays_slices_and_loops(width):
    y = np.array([0.3, -0.4, 0.8, 0.7])
    mode = np.array([1, -1])
    params = np.array([3.0, 5.0])
    rows = array_at(duals.Dual(width))
    inner = njit(as_written)
    seeds = np.random.default_rng(width).normal(size=(4, width))

    @njit
    def through(given, address):
        inner(0.25, rows(given, 4), mode, params, rows(address, 4))

    given = np.hstack([y[:, None], seeds])
    found = np.full((4, 1 + width), np.nan)
    through(given.ctypes.data, found.ctypes.data)
    expected = np.zeros(4)
    as_written(0.25, y, mode, params, expected)
    assert found[:, 0].tolist() == expected.tolist()
    step = 1e-6
    for column, direction in zip(found[:, 1:].T, seeds.T, strict=True):
        ahead = np.zeros(4)
        behind = np.zeros(4)
        as_written(0.25, y + step * direction, mode, params, ahead)
        as_written(0.25, y - step * direction, mode, params, behind)
        difference = (ahead - behind) / (2.0 * step)
        np.testing.assert_allclose(column, difference, rtol=1e-8, atol=1e-8)


def test_a_function_for_numbers_only_is_an_error():
    rows = array_at(duals.Dual(2))

    @njit
    def keeps_numbers(given):
        room = np.zeros(2)
        room[0] = rows(given, 1)[0]  # would forget the slopes
        return room[0]

    with pytest.raises(Exception, match=r"Dual|setitem"):
        keeps_numbers(np.zeros(3).ctypes.data)
