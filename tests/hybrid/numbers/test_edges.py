"""Each operation of ranges at its edges: poles, jumps, ends of domains, thin ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from range_harness import Ranged

from hopdata.hybrid.numbers.answers import JUMPED, KINKED, LOST, OPENED

INF = math.inf
TINY = 1e-12


XS = np.array([0.0, 1.0, 3.0])
ZS = np.array([1.0, -1.0, 5.0])
SINGLE = (
    "math.sin(y[0]) + y[0]", "y[0] * y[1] * 0.0", "XS[int(y[0])] * 1.0",
    "ZS[(2 * math.floor(y[0]) + 3) % 3] + 0.0", "2.0 * y[0] - y[1] + 5.0 * t",
    "y[0] - 5.0 if y[1] < 0.25 else 1.0 + 0.0 * t", "y[0] - 5.0 if y[1] < 2.0 else 1.0",
    " + ".join(f"(1.0 if y[{k}] < 0.5 else 2.0)" for k in (0, 1, 2, 0)),
    " + ".join(f"(1.0 if y[{k}] < 0.5 else 2.0)" for k in (0, 1, 2, 0, 1)),
    "abs(y[0])", "np.abs(y[0])",
)  # fmt: skip


class One:
    """One of all guards here, which are compiled together."""

    def __init__(self, ranged, k):
        self._ranged = ranged
        self._k = k

    def at(self, lo, hi, *others, **more):
        """Return (lo, hi, dlo, dhi, paths) where all states have one range."""
        return self._ranged.at(self._k, lo, hi, *others, **more)

    @property
    def told(self):
        return self._ranged.told

    @property
    def first(self):
        return self._ranged.first


@pytest.fixture(scope="module")
def guard_of():
    """Return a function that returns the guard of an expression."""
    sources = [one[0] for one in (*SMOOTH, *JUMPS)]
    sources += [*BAD, *THIN, *SINGLE, *(f"2.0 if {one} else 3.0" for one, _ in PATHS)]
    sources = sorted(set(sources))
    lines = ["def one(t, y, dy, mode, params, k, h, hdot):", "    hdot[k] = 0.0"]
    for k, source in enumerate(sources):
        lines.append(f"    if k == {k}: h[k] = {source}")
    made = {"math": math, "np": np, "XS": XS, "ZS": ZS}
    exec("\n".join(lines), made)
    ranged = Ranged(made["one"], len(sources))
    return lambda source: One(ranged, sources.index(source))


# Expression, ends of y[0] and of its rate, and what is expected.
SMOOTH = [
    ("y[0] + 1.0", (0.0, 1.0), (2.0, 3.0), (1.0, 2.0, 2.0, 3.0)),
    ("2 - y[0]", (0.0, 1.0), (2.0, 3.0), (1.0, 2.0, -3.0, -2.0)),
    ("-3.0 * y[0]", (-1.0, 2.0), (-1.0, 2.0), (-6.0, 3.0, -6.0, 3.0)),
    ("y[0] * y[0]", (1.0, 2.0), (1.0, 1.0), (1.0, 4.0, 2.0, 4.0)),
    ("y[0] ** 2", (-1.0, 2.0), (1.0, 1.0), (0.0, 4.0, -2.0, 4.0)),
    ("y[0] ** 3", (-1.0, 2.0), (1.0, 1.0), (-1.0, 8.0, 0.0, 12.0)),
    ("y[0] ** -1", (1.0, 2.0), (1.0, 1.0), (0.5, 1.0, -1.0, -0.25)),
    ("y[0] ** 0", (-1.0, 2.0), (1.0, 1.0), (1.0, 1.0, 0.0, 0.0)),
    ("y[0] ** 0.5", (1.0, 4.0), (1.0, 1.0), (1.0, 2.0, 0.25, 0.5)),
    ("2.0 ** y[0]", (0.0, 1.0), (1.0, 1.0), (1.0, 2.0, 0.693147, 1.386295)),
    ("1.0 / y[0]", (-2.0, -1.0), (1.0, 1.0), (-1.0, -0.5, -1.0, -0.25)),
    ("math.sqrt(y[0])", (0.0, 4.0), (1.0, 2.0), (0.0, 2.0, 0.25, INF)),
    ("np.cbrt(y[0])", (-8.0, 8.0), (1.0, 1.0), (-2.0, 2.0, 1 / 12, INF)),
    ("math.log(y[0])", (0.0, 1.0), (1.0, 1.0), (-INF, 0.0, 1.0, INF)),
    ("math.log1p(y[0])", (-1.0, 0.0), (1.0, 1.0), (-INF, 0.0, 1.0, INF)),
    ("math.acos(y[0])", (0.0, 1.0), (1.0, 1.0), (0.0, math.pi / 2, -INF, -1.0)),
    ("math.asin(y[0])", (-0.5, 0.0), (1.0, 1.0), (-math.pi / 6, 0.0, 1.0, 1.154701)),
    ("math.acosh(y[0])", (1.0, 2.0), (1.0, 1.0), (0.0, math.acosh(2.0), 3**-0.5, INF)),
    ("math.atanh(y[0])", (-0.5, 0.5), (1.0, 1.0), (-0.549306, 0.549306, 1.0, 4 / 3)),
    ("math.tanh(y[0])", (-1.0, 1.0), (1.0, 1.0), (-0.761594, 0.761594, 0.419974, 1.0)),
    ("math.sinh(y[0])", (-1.0, 0.0), (1.0, 1.0), (-1.175201, 0.0, 1.0, 1.543081)),
    ("math.cosh(y[0])", (-1.0, 2.0), (1.0, 1.0), (1.0, 3.762196, -1.175201, 3.626860)),
    ("math.sin(y[0])", (0.0, math.pi), (1.0, 1.0), (0.0, 1.0, -1.0, 1.0)),
    ("math.sin(y[0])", (-0.1, 0.1), (1.0, 1.0), (-0.0998334, 0.0998334, 0.995004, 1.0)),
    ("math.cos(y[0])", (3.0, 3.3), (1.0, 1.0), (-1.0, -0.987480, -0.14112, 0.157746)),
    ("math.tan(y[0])", (-0.5, 0.5), (1.0, 1.0), (-0.546302, 0.546302, 1.0, 1.298446)),
    ("math.atan2(y[0], 1.0)", (-1.0, 1.0), (1.0, 1.0), (-0.785398, 0.785398, 0.5, 1.0)),
    ("abs(y[0])", (-2.0, 1.0), (1.0, 3.0), (0.0, 2.0, -3.0, 3.0)),
    ("max(y[0], 0.5)", (0.0, 1.0), (2.0, 3.0), (0.5, 1.0, 0.0, 3.0)),
    ("min(y[0], 2.0)", (0.0, 1.0), (2.0, 3.0), (0.0, 1.0, 2.0, 3.0)),
    ("math.hypot(y[0], 0.0)", (-1.0, 2.0), (2.0, 3.0), (0.0, 2.0, -3.0, 3.0)),
    ("np.interp(y[0], XS, ZS)", (0.5, 2.0), (1.0, 1.0), (-1.0, 2.0, -2.0, 3.0)),
    ("np.interp(y[0], XS, ZS)", (-2.0, -1.0), (1.0, 1.0), (1.0, 1.0, 0.0, 0.0)),
    ("np.interp(y[0], XS, ZS)", (-2.0, 9.0), (1.0, 1.0), (-1.0, 5.0, -2.0, 3.0)),
    ("y[0] % 1.0", (2.25, 2.5), (1.0, 2.0), (0.25, 0.5, 1.0, 2.0)),
    ("y[0] % -1.0", (2.25, 2.5), (1.0, 2.0), (-0.75, -0.5, 1.0, 2.0)),
    ("math.floor(y[0])", (2.25, 2.5), (1.0, 2.0), (2.0, 2.0, 0.0, 0.0)),
    ("np.sign(y[0])", (-2.0, -1.0), (1.0, 2.0), (-1.0, -1.0, 0.0, 0.0)),
    ("np.copysign(y[0], -1.0)", (1.0, 2.0), (1.0, 2.0), (-2.0, -1.0, -2.0, -1.0)),
    ("(y[0] + 1.0) * 0", (1.0, 2.0), (1.0, 2.0), (0.0, 0.0, 0.0, 0.0)),
    ("1.0 + (y[0] > 0.5) * y[0]", (1.0, 2.0), (1.0, 1.0), (2.0, 3.0, 1.0, 1.0)),
    ("np.where(y[0] > 3.0, y[0], 0.0) + 1", (1.0, 2.0), (1.0, 1.0), (1.0, 1.0, 0.0, 0.0)),
    ("y[0] if mode[0] > 0 else 0.0", (1.0, 2.0), (1.0, 1.0), (1.0, 2.0, 1.0, 1.0)),
    ("t - y[0]", (1.0, 2.0), (0.25, 0.5), (-2.0, -1.0, 0.5, 0.75)),
    ("dy[0]", (1.0, 2.0), (0.25, 0.5), (0.25, 0.5, -INF, INF)),
]  # fmt: skip


@pytest.mark.parametrize(("source", "ends", "rates", "expected"), SMOOTH)
def test_values_and_rates_without_a_jump(guard_of, source, ends, rates, expected):
    ranged = guard_of(source)
    *found, paths = ranged.at(*ends, rates)
    assert found == pytest.approx(expected, rel=2e-6, abs=1e-15)
    assert found[0] <= found[1]
    assert found[2] <= found[3]
    assert paths == 1
    assert ranged.told[[OPENED, JUMPED, LOST]].tolist() == [0, 0, 0]


# Expression, range of values, and where in [-1, 1] the jump is expected.
JUMPS = [
    ("math.floor(y[0] + 0.5)", (-1.0, 1.0), -0.5),
    ("np.ceil(y[0] + 0.25)", (0.0, 2.0), -0.25),
    ("np.rint(0.75 * y[0])", (-1.0, 1.0), -2 / 3),
    ("y[0] % 0.8", (0.0, 0.8), -0.8),
    ("y[0] // 0.8", (-2.0, 1.0), -0.8),
    ("np.sign(y[0] - 0.5)", (-1.0, 1.0), 0.5),
    ("np.copysign(2.0, y[0])", (-2.0, 2.0), 0.0),
    ("1.0 / (y[0] + 0.25)", (-INF, INF), -0.25),
    ("y[0] ** -2", (-INF, INF), 0.0),
    ("math.tan(2.0 * y[0])", (-INF, INF), -math.pi / 4),
    ("math.atan2(y[0], -1.0)", (-math.pi, math.pi), 0.0),
]


@pytest.mark.parametrize(("source", "values", "place"), JUMPS)
def test_a_jump_is_told_with_its_place(guard_of, source, values, place):
    ranged = guard_of(source)
    *found, _ = ranged.at(-1.0, 1.0, (1.0, 1.0))
    assert found == pytest.approx([*values, -INF, INF])
    assert ranged.told[JUMPED] > 0
    least, most, *rates = ranged.first
    part = -least / (most - least)
    assert -1.0 + 2.0 * part == pytest.approx(place, abs=1e-9)
    assert min(rates) > 0.0


@pytest.mark.parametrize("function", ["abs", "np.abs", "math.sqrt", "math.acosh"])
def test_a_kink_is_told(guard_of, function):
    ranged = guard_of(f"{function}(y[0])")
    low = {"math.sqrt": 0.0, "math.acosh": 1.0}.get(function, -1.0)
    ranged.at(low, low + 2.0)
    assert ranged.told[[OPENED, JUMPED, KINKED]].tolist() == [0, 0, 1]


BAD = (
    "math.sqrt(y[0])", "math.log(y[0])", "math.acos(2.0 * y[0])", "math.acosh(y[0])",
    "y[0] ** 0.5", "y[0] / y[0]", "math.cos(math.log(y[0]))", "max(1.0, math.sqrt(y[0]))",
)  # fmt: skip


@pytest.mark.parametrize("source", BAD)
def test_what_may_not_be_a_number_may_be_anything(guard_of, source):
    *found, _ = guard_of(source).at(-1.0, 1.0, (1.0, 1.0))
    assert found == [-INF, INF, -INF, INF]


@pytest.mark.parametrize("ends", [(math.nan, 1.0), (1.0, math.nan), (1.0, 0.0)])
def test_ends_that_make_no_range_may_be_anything(guard_of, ends):
    *found, _ = guard_of("math.sin(y[0]) + y[0]").at(*ends)
    assert found == [-INF, INF, -INF, INF]


def test_an_infinite_range_is_no_number_where_it_is_multiplied_by_zero(guard_of):
    *found, _ = guard_of("y[0] * y[1] * 0.0").at(-INF, INF)
    assert found == [-INF, INF, -INF, INF]


def test_an_index_that_may_be_one_of_many_loses_all(guard_of):
    ranged = guard_of("XS[int(y[0])] * 1.0")
    assert ranged.at(1.25, 1.5)[:2] == (1.0, 1.0)
    assert ranged.told[OPENED] == 0
    ranged.at(0.5, 1.5)  # one of two: it is asked which
    assert ranged.told[[OPENED, LOST]].tolist() == [1, 0]
    assert ranged.at(0.5, 2.5)[:4] == (-INF, INF, -INF, INF)
    assert ranged.told[LOST] == 1


def test_whole_numbers_stay_whole(guard_of):
    ranged = guard_of("ZS[(2 * math.floor(y[0]) + 3) % 3] + 0.0")
    assert ranged.at(1.25, 1.5)[:2] == (5.0, 5.0)
    assert ranged.told[LOST] == 0


THIN = (
    "y[0] * y[1] - t", "y[0] / (y[1] + 3.0)", "math.sin(y[0]) * np.exp(y[1])",
    "y[0] ** 3 - y[1] ** 2", "math.atan2(y[0], y[1])", "np.hypot(y[0], y[1])",
    "abs(y[0]) ** 1.7", "math.erf(y[0]) + np.cbrt(y[1])", "np.interp(y[0], XS, ZS)",
    "math.acos(0.1 * y[0]) + np.arcsinh(y[1])", "y[0] % 0.7 + np.fmod(y[1], 0.7)",
)  # fmt: skip


@pytest.mark.parametrize("source", THIN)
def test_a_thin_range_stays_thin(guard_of, source):
    """Its width is that of the rounding; with a width, it grows in proportion."""
    ranged = guard_of(source)
    lo, hi, dlo, dhi, _ = ranged.at(1.3, 1.3, (0.4, 0.4), (0.2, 0.2))
    assert hi - lo < 1e-13
    assert dhi - dlo < 1e-13
    for width in (1e-3, 1e-6):
        lo, hi, dlo, dhi, _ = ranged.at(1.3, 1.3 + width, (0.4, 0.4), (0.2, 0.2))
        assert hi - lo < 8.0 * width
        assert dhi - dlo < 8.0 * width


# Branches.

PATHS = [
    ("y[0] < 0.5 and y[1] < 0.25", 3),
    ("y[0] < 0.5 or y[1] < 0.25", 3),
    ("not (y[0] < 0.5)", 2),
    ("0.25 < y[0] <= 0.5", 3),
    ("y[0] == 0.5", 2),
    ("y[0] != 2.5", 1),
    ("y[0]", 2),
]


def test_an_open_comparison_leads_along_both_paths(guard_of):
    ranged = guard_of("y[0] - 5.0 if y[1] < 0.25 else 1.0 + 0.0 * t")
    *found, paths = ranged.at(0.0, 1.0, (1.0, 2.0))
    assert found == pytest.approx([-5.0, 1.0, 0.0, 2.0])
    assert paths == 2
    assert ranged.told[OPENED] == 1
    assert ranged.first == pytest.approx([-0.25, 0.75, 1.0, 2.0])


def test_a_comparison_that_is_sure_is_not_open(guard_of):
    ranged = guard_of("y[0] - 5.0 if y[1] < 2.0 else 1.0")
    *found, paths = ranged.at(0.0, 1.0, (1.0, 2.0))
    assert found == pytest.approx([-5.0, -4.0, 1.0, 2.0])
    assert paths == 1


@pytest.mark.parametrize(("condition", "paths"), PATHS)
def test_paths_through_a_condition(guard_of, condition, paths):
    ranged = guard_of(f"2.0 if {condition} else 3.0")
    lo, hi, _, _, found = ranged.at(0.0, 1.0)
    assert found == paths
    assert lo in (2.0, 3.0)
    assert (lo, hi) == ((2.0, 3.0) if paths > 1 else (lo, lo))


def test_beyond_sixteen_paths_nothing_is_known(guard_of):
    few, many = (one for one in SINGLE if " + (1.0 if " in one)
    assert guard_of(few).at(0.0, 1.0)[:2] == pytest.approx((4.0, 8.0))
    assert guard_of(many).at(0.0, 1.0)[:2] == (-INF, INF)


def waits(t, y, dy, mode, params, k, h, hdot):
    h[k] = y[0]
    while not h[k] < 0.1:
        h[k] = h[k] * 1.0
    hdot[k] = 0.0


def test_a_loop_that_waits_for_an_answer_ends():
    assert Ranged(waits, 1).at(0, 0.0, 1.0)[:2] == (-INF, INF)


def feet(t, y, dy, mode, params, k, h, hdot):
    h[k] = 1.0
    for foot in range(len(y)):
        if foot != k:
            h[k] = min(h[k], y[foot] - params[foot])
    hdot[k] = 0.0


def test_a_loop_over_feet():
    *found, paths = Ranged(feet, 2).at(1, 0.0, 0.5, (1.0, 1.0))
    assert found == pytest.approx([-2.0, -1.5, 1.0, 1.0])
    assert paths == 1


def test_with_radii_for_rates_the_rate_bounds_the_change(guard_of):
    ranged = guard_of("2.0 * y[0] - y[1] + 5.0 * t")
    _, _, dlo, dhi, _ = ranged.at(0.5, 0.5, (-1e-3, 1e-3), pace=0.0)
    assert (dlo, dhi) == pytest.approx((-3e-3, 3e-3))
