"""The first flip in a step is the first of all guards, whichever guard is examined first."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, ladder, ladder_solution, throw

from hopdata.hybrid import System, affine, field, guards, solve

# params: the two instants, and half the width of the dip


@field
def turning(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -y[0]


@affine
def turning_affine(mode, params, a, b):
    a[0, 1] = 1.0
    a[1, 0] = -1.0
    b[:] = 0.0


@guards
def one_crossing_and_a_dip(t, y, dy, mode, params, h, hdot):
    """Fill in sin(t - params[0]) and cos(params[2]) - cos(t - params[1]); y = (cos t, -sin t)."""
    s = np.sin(params[0])
    c = np.cos(params[0])
    h[0] = -s * y[0] - c * y[1]
    hdot[0] = -s * dy[0] - c * dy[1]
    s = np.sin(params[1])
    c = np.cos(params[1])
    h[1] = np.cos(params[2]) - c * y[0] + s * y[1]
    hdot[1] = -c * dy[0] + s * dy[1]


SYSTEM = System(
    turning,
    one_crossing_and_a_dip,
    affine=turning_affine,
    n_states=2,
    guard_names=("line", "dip"),
)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_dip_beside_a_crossing_is_neither_lost_nor_late(method):
    rng = np.random.default_rng(8)
    for _ in range(500):
        half = 10.0 ** rng.uniform(-3, -0.5)
        dip = rng.uniform(half, 3.0 - half)
        line = dip + half * rng.uniform(-2.0, 2.0)
        if (
            not 0.01 < line < 2.99
            or min(abs(abs(line - dip) - half), 3 - half - dip) < 1e-4
        ):
            continue
        start = rng.uniform(0.0, 6.0)
        solution = solve(
            SYSTEM, (start, start + 3.0), [np.cos(start), -np.sin(start)],
            params=[start + line, start + dip, half], method=method, rtol=1e-10, atol=1e-12,
        )  # fmt: skip
        wanted = sorted([(line, 0), (dip - half, 1), (dip + half, 1)])
        assert solution.events.guard.tolist() == [guard for _, guard in wanted], (
            start,
            wanted,
        )
        times = solution.events.time - start
        assert times == pytest.approx([time for time, _ in wanted], abs=1e-6), (
            start,
            wanted,
        )


# Order of the method through events, and instants to the last digits.


def test_impacts_of_a_parabola_are_exact_at_any_tolerance():
    solution = solve(
        ball(directions=(1,)), (0, 5), [1.0, 0.0], params=(2.0, 0.0, 1.0), rtol=1e-3
    )
    assert solution.events.time == pytest.approx([1.0, 3.0], abs=1e-12)
    assert solution.events.before[:, 0] == pytest.approx([0.0, 0.0], abs=1e-14)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e6, 1e9])
def test_lengths_do_not_matter(scale):
    rungs = np.array([0.5, 0.7])
    gains = np.array([0.5, -0.2])
    instants, end = ladder_solution(rungs, gains, 1.0)
    solution = solve(
        ladder(2),
        (0, 1 * scale),
        [0.0, 0.0],
        params=(*(rungs * scale), *gains),
        atol=0.0,
    )
    assert solution.events.time / scale == pytest.approx(instants, rel=1e-14)
    assert solution.y_end[0] / scale == pytest.approx(end, rel=1e-14)


@pytest.mark.parametrize("offset", [1e3, 1e6])
def test_late_times(offset):
    solution = solve(ladder(1), (offset, offset + 1), [0.0, 0.0], params=(0.5, 1.0))
    assert solution.events.time[0] - offset == pytest.approx(0.5, abs=4e-16 * offset)
    assert solution.y_end[0] == pytest.approx(1.5, abs=4e-15 * offset)


@pytest.mark.parametrize("clearance", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_touch_and_go_within_a_step(clearance):
    """The apex rises `clearance` above the ceiling, and a single step would span all of it."""
    ceiling = 1.0 - clearance
    solution = solve(throw(), (0, 2), [0.0, 2.0], params=(2.0, ceiling), first_step=2.0)
    half = np.sqrt(clearance)
    assert solution.events.direction.tolist() == [1, -1]
    resolution = 1e-15 / half
    assert solution.events.time == pytest.approx(
        [1 - half, 1 + half], abs=1e-14 + resolution
    )


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-8, 1e-12, 1e-14])
def test_an_apex_below_the_ceiling_is_no_event(gap):
    solution = solve(
        throw(), (0, 2), [0.0, 2.0], params=(2.0, 1.0 + gap), first_step=2.0
    )
    assert solution.status == 0
    assert len(solution.events) == 0


def test_random_throws_are_neither_missed_nor_invented():
    rng = np.random.default_rng(5)
    for _ in range(300):
        height = 10.0 ** rng.uniform(-14, -1) * rng.choice([-1, 1])
        solution = solve(
            throw(), (0, 2), [0.0, 2.0], params=(2.0, 1.0 + height),
            first_step=10.0 ** rng.uniform(-4, 0.3), rtol=10.0 ** -rng.integers(3, 13),
        )  # fmt: skip
        assert solution.events.direction.tolist() == ([] if height > 0 else [1, -1])


@field
def clock_field(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def jumping_guard(t, y, dy, mode, params, h, hdot):
    """Fill in a height that falls, jumps through zero and falls on: place, margins, slopes."""
    x = y[0] - params[0]
    h[0] = params[1] - params[2] * x if x < 0.0 else -params[3] - params[4] * x
    hdot[0] = -(params[2] if x < 0.0 else params[4]) * dy[0]


@pytest.mark.parametrize("method", ["dopri5", "dop853"])
def test_an_event_function_that_jumps_while_it_falls_is_landed_on_where_it_jumps(
    method,
):
    """Newton's method leads away from the jump on either side of it."""
    clock = System(clock_field, jumping_guard, n_states=1, guard_names=("height",))
    rng = np.random.default_rng(4)
    for _ in range(300):
        place = rng.uniform(0.3, 2.7)
        margins = 10.0 ** rng.uniform(-6, 0, 2)
        slopes = 10.0 ** rng.uniform(-3, 1, 2)
        params = [place, margins[0], slopes[0], margins[1], slopes[1]]
        solution = solve(
            clock, (0, 3), [0.0], params=params, rtol=1e-9, atol=1e-12, method=method
        )
        assert solution.events.time == pytest.approx([place], abs=1e-12), params
