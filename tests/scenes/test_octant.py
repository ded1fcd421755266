"""Table 4.3 against the exact flow: matrix exponentials and roots in 40 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from hopdata.hybrid import solve
from hopdata.scenes.octant import (
    INITIAL_STATE,
    T_SPAN,
    octant,
    octant_crossings,
    octant_end,
)


def affine_mode(locks):
    """Return the rows and constants of the table for locks (x, y, z)."""
    x, y, z = (lock > 0 for lock in locks)
    rows = mpmath.zeros(3)
    if x:
        rows[0, 0 if y else 1] = 10 if y else -2
        rows[1, 1 if y else 0] = 1 if y else mpmath.mpf(1) / 2
    else:
        rows[0, 1] = 1 if y else -1
        rows[1, 0] = -1 if y else 1
    rows[2, 2] = 3 if z else -1
    return rows, mpmath.matrix([1, 2 if x and not y else 1, -1])


def exact_flow(locks, start, time):
    rows, constants = affine_mode(locks)
    whole = mpmath.zeros(4)
    whole[:3, :3] = rows
    whole[:3, 3] = constants
    return (mpmath.expm(whole * time) * mpmath.matrix([*start, 1]))[:3]


def exact_crossing(locks, start, axis, guess):
    duration = mpmath.findroot(lambda time: exact_flow(locks, start, time)[axis], guess)
    return duration, exact_flow(locks, start, duration)


@pytest.fixture(scope="module")
def truth():
    """Return the instants at which y, z and x are crossed, and the state at the end."""
    with mpmath.workdps(40):
        start = [mpmath.mpf(text) for text in ("-0.4", "-0.15", "0.3")]
        to_y, start = exact_crossing((-1, -1, -1), start, 1, 0.2)
        to_z, start = exact_crossing((-1, 1, -1), start, 2, 0.05)
        to_x, start = exact_crossing((-1, 1, 1), start, 0, 0.1)
        times = [to_y, to_y + to_z, to_y + to_z + to_x]
        end = exact_flow((1, 1, 1), start, mpmath.mpf("0.5") - times[-1])
        return np.array(times, dtype=float), np.array(list(end), dtype=float)


def test_truth_is_the_published_one(truth):
    times, end = truth
    published = [0.20958807833464467, np.log(1.3), 0.36920715382175002]
    assert times == pytest.approx(published, abs=2e-16)
    published = [0.26985041783358990, 0.33789043824170391, -0.34663769842786600]
    assert end == pytest.approx(
        published, abs=1e-10
    )  # two of them are misprinted below that


def test_the_scene_has_the_exact_solution(truth):
    times, states = octant_crossings()
    assert times == pytest.approx(truth[0], abs=1e-15)
    assert states[[0, 1, 2], [1, 2, 0]] == pytest.approx(0.0, abs=1e-15)
    assert octant_end() == pytest.approx(truth[1], abs=1e-14)


def test_exact_to_1e_10(truth):
    times, end = truth
    solution = solve(octant(), T_SPAN, INITIAL_STATE, rtol=1e-12, atol=1e-14)
    assert solution.status == 0
    assert [solution.events.guard_names[k] for k in solution.events.guard] == [
        "y",
        "z",
        "x",
    ]
    assert solution.events.direction.tolist() == [1, 1, 1]
    assert np.abs(solution.events.time - times).max() < 1e-13
    assert np.abs(solution.y_end - end).max() < 1e-12
    assert np.abs(np.diagonal(solution.events.before[:, [1, 2, 0]])).max() < 1e-15


@pytest.mark.parametrize("method", ["dopri5", "dop853", "rosenbrock", "taylor"])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_error_follows_the_tolerance(truth, tolerance, method):
    solution = solve(
        octant(), T_SPAN, INITIAL_STATE, rtol=tolerance, atol=tolerance, method=method
    )
    assert np.abs(solution.y_end - truth[1]).max() < 10 * tolerance


def test_loose_tolerance_is_not_exact(truth):
    solution = solve(
        octant(), T_SPAN, INITIAL_STATE, rtol=1e-3, atol=1e-3, method="dopri5"
    )
    assert np.abs(solution.y_end - truth[1]).max() > 1e-7


@pytest.mark.parametrize(
    ("method", "coarsest", "least", "most"),
    [("dopri5", 0.025, 4.7, 5.6), ("dop853", 0.128, 7.0, 9.5)],
)
def test_order_through_events(truth, method, coarsest, least, most):
    steps = coarsest / 2.0 ** np.arange(0, 3, 0.5)
    errors = []
    for step in steps:
        solution = solve(
            octant(),
            T_SPAN,
            INITIAL_STATE,
            rtol=0.9,
            atol=1e9,
            max_step=step,
            first_step=step,
            method=method,
        )
        errors.append(np.abs(solution.y_end - truth[1]).max())
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert least < order < most
