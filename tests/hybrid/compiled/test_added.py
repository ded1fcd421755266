"""Functions that Numba lacks: as in Python for floats, and enclosed by ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from range_harness import COMPARED, OUTSIDE, RATES_OUTSIDE, UNKNOWN, Ranged, boxes

from hopdata.hybrid import System, solve

POINTS = np.array([[-1.0, 0.2], [0.1, -0.3], [0.8, 0.5]])
KNOTS = np.array([-1.5, -0.4, 0.3, 1.1])


def mixed(t, y):
    """Return a sum of functions that Numba lacks, or has not for ranges."""
    total = np.clip(y[0], -0.5, 0.8) + np.clip(y[1], 0, None)
    total += math.hypot(y[0], y[1], 0.3) + math.log(2.0 + y[2] ** 2, 2)
    total += np.polyval((0.3, -1.0, 0.2), y[0]) + math.remainder(y[1], 0.3)
    total += np.heaviside(y[0] - 0.1, 0.5) + round(y[1], 1) + float(y[2] > 0.3 * t)
    total += np.linalg.norm(y, np.inf) + np.interp(y[1], POINTS[:, 0], POINTS[:, 1])
    total += np.searchsorted(KNOTS, y[0]) + np.digitize(y[2], KNOTS)
    if any([y[0] > 0.5, y[1] > 0.5]) or math.isclose(y[1], 0.3, abs_tol=0.1):
        total += 0.5
    return total


def test_floats_are_as_in_python():
    compiled = njit(mixed)
    draw = np.random.default_rng(np.random.SeedSequence(584))
    for y in draw.uniform(-2.0, 2.0, (50, 3)):
        np.testing.assert_allclose(compiled(y[0], y), mixed(y[0], y), rtol=1e-13)
    at_edges = np.array([0.1, 0.0, -0.4])
    assert compiled(0.0, at_edges) == mixed(0.0, at_edges)


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for 16 s: ALL=1")
def test_no_sample_is_outside_of_ranges():
    inner = njit(error_model="numpy")(mixed)

    def fill(t, y, dy, mode, params, k, h, hdot):
        h[k], hdot[k] = inner(t, y), 0.0

    draw = np.random.default_rng(np.random.SeedSequence(586))
    found = Ranged(fill, 1).over(boxes(draw, 60), 0, draw).sum(axis=0)
    assert found[OUTSIDE] == 0
    assert found[RATES_OUTSIDE] == 0
    assert found[COMPARED] > 1000
    assert found[UNKNOWN] < 30


def circling(t, y):
    return y[1], -y[0]


def near_a_knot(t, y):
    return min(abs(y[0] - k) for k in KNOTS) - 0.1


WEIGHTS = (0.3, 0.2, 0.1)


def weighted(t, y):
    return sum(w * np.sin((i + 2) * y[0]) for i, w in enumerate(WEIGHTS)) - 0.1


def test_modules_that_only_a_generator_names_are_read():
    system = System(circling, weighted, n_states=2, guard_names=("sum",))
    assert solve(system, (0.0, 1.0), [0.0, 1.0], t_eval=()).proven


def test_generators_are_read():
    system = System(circling, near_a_knot, n_states=2, guard_names=("near",))
    found = solve(system, (0.0, 6.0), [0.0, 1.0], t_eval=())
    assert found.proven
    assert not system.branches.reason
    t = np.linspace(0.0, 6.0, 10_001)
    signs = [near_a_knot(0.0, (np.sin(one), np.cos(one))) > 0 for one in t]
    flips = t[1:][np.diff(signs)]
    np.testing.assert_allclose(found.events.time, flips, atol=1e-3)
    assert len(flips) >= 2
