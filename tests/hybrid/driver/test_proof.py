"""Guards are proven clear or flip: those that jump, bend, rest, or cannot be proven."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hopdata.hybrid import System, field, guard, guards, on_event, solve, solve_batch
from hopdata.hybrid.driver.problem import is_due, scale_of_residual
from hopdata.hybrid.layout import RATE_DIFFERS

TOLERANCES = (1e-3, 1e-9)


@field
def flight(t, y, mode, params, dy):
    dy[0] = y[2]
    dy[1] = y[3]
    dy[2] = 0.0
    dy[3] = -9.81


@field
def advance(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def box(t, y, dy, mode, params, h, hdot):
    """A box, params[0] high and params[2] wide, on a floor that rises by params[3]."""
    inside = params[1] < y[0] < params[1] + params[2]
    h[0] = y[1] - params[3] * y[0] - (params[0] if inside else 0.0)
    hdot[0] = dy[1] - params[3] * dy[0]


@guard
def box_alone(t, y, dy, mode, params, k, h, hdot):
    inside = params[1] < y[0] < params[1] + params[2]
    h[k] = y[1] - params[3] * y[0] - (params[0] if inside else 0.0)
    hdot[k] = dy[1] - params[3] * dy[0]


@guards
def box_by_arrays(t, y, dy, mode, params, h, hdot):
    """The same, in code that has no meaning for ranges."""
    edges = np.array([params[1], params[1] + params[2]])
    inside = np.linalg.det(np.diag(edges - y[0])) < 0.0
    h[0] = y[1] - params[3] * y[0] - (params[0] if inside else 0.0)
    hdot[0] = dy[1] - params[3] * dy[0]


@guards
def roof(t, y, dy, mode, params, h, hdot):
    """A roof over the place of the box: no jump, but three corners."""
    x = (y[0] - params[1]) / (0.5 * params[2]) - 1.0
    h[0] = y[1] - params[3] * y[0] - max(0.0, params[0] * (1.0 - abs(x)))
    slope = params[3]
    if abs(x) < 1.0:
        slope += -params[0] * np.sign(x) / (0.5 * params[2])
    hdot[0] = dy[1] - slope * dy[0]


@guards
def saw(t, y, dy, mode, params, h, hdot):
    h[0] = t % params[0] - 0.5 * params[0]
    hdot[0] = 1.0


@guards
def pulse(t, y, dy, mode, params, h, hdot):
    h[0] = (1.0 if params[0] <= t < params[0] + params[1] else 0.0) - 0.5
    hdot[0] = 0.0


def system(declared, of=flight, n_states=4, **others):
    name = "guard" if declared.signature.name == "guard" else "guards"
    return System(
        of, n_states=n_states, guard_names=("h",), **{name: declared}, **others
    )


def flights(share, count, seed):
    """Yield start, parameters and duration; the box is as wide as this share of the flight."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        height = rng.uniform(0.3, 1)
        forward = rng.uniform(2, 8)
        up = rng.uniform(0, 3)
        slope = rng.uniform(-0.2, 0.2)
        climb = up - slope * forward
        landing = (climb + math.sqrt(climb**2 + 2 * 9.81 * height)) / 9.81
        begin = rng.uniform(0.05, 0.9 - share) * landing
        params = [10.0, forward * begin, forward * share * landing, slope]
        yield [0.0, height, forward, up], params, landing, begin


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("share", [0.3, 0.02, 1e-4])
@pytest.mark.parametrize("declared", [box, box_alone, roof])
def test_a_ball_that_flies_into_something_on_the_floor(declared, share, rtol):
    ball = system(declared)
    for start, params, landing, begin in flights(share, 20, seed=3):
        solution = solve(
            ball, (0, landing + 0.3), start, params=params, rtol=rtol, atol=rtol
        )
        assert solution.success
        assert solution.n_unproven == 0
        assert solution.events.direction.tolist() == [-1, 1, -1]
        if declared is not roof:
            truth = [begin, begin + share * landing, landing]
            assert solution.events.time == pytest.approx(truth, rel=1e-12)
    assert ball.branches.address > 0


def test_what_counts_as_rounding_is_bounded():
    """A rest becomes the scale of rounding, but no more of it than the terms of h explain."""
    assert is_due(-1e-12, 1.0, scale_of_residual(1e-12, 1e-9), 0.0) is False
    assert is_due(-0.86, 1.0, scale_of_residual(0.86, 1e-9), 0.0) is True


@pytest.mark.parametrize("share", [0.1, 0.02])
def test_a_step_that_ends_on_an_edge_does_not_blind_the_guard(share):
    """A rest of 0.86 m at the edge of a box counted as rounding, and the floor was not seen."""
    ball = system(box_by_arrays)
    for start, params, landing, _ in flights(share, 60, seed=5):
        solution = solve(
            ball, (0, landing + 0.3), start, params=params, rtol=1e-6, atol=1e-9,
            max_step=0.1 * share * landing,
        )  # fmt: skip
        assert solution.events.direction.tolist() == [-1, 1, -1]


def test_guards_that_are_only_sampled_are_told():
    ball, (start, params, landing, _) = (
        system(box_by_arrays),
        next(flights(0.1, 1, seed=1)),
    )
    assert ball.branches.address < 0
    solution = solve(ball, (0, landing + 0.3), start, params=params)
    assert solution.n_unproven > 0
    assert "only sampled" in solution.message
    assert solution.n_events == 3  # a tenth of the flight is wider than a sample
    batch = solve_batch(ball, (0, landing + 0.3), [start], params=params)
    assert batch.n_unproven[0] == solution.n_unproven
    proven = solve(system(box), (0, landing + 0.3), start, params=params)
    assert "sampled" not in proven.message


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("period", [1.0, 0.37, 0.02])
def test_a_sawtooth(period, rtol):
    teeth = system(saw, advance, 1)
    solution = solve(teeth, (0, 20.1 * period), [0.0], params=[period], rtol=rtol)
    wanted = period * (0.5 + 0.5 * np.arange(40))
    assert solution.events.time == pytest.approx(wanted, rel=1e-12)
    assert solution.n_unproven == 0


@pytest.mark.parametrize("width", [0.1, 1e-3, 1e-7])
def test_a_pulse_in_ten_seconds(width):
    pulses = system(pulse, advance, 1)
    rng = np.random.default_rng(4)
    for begin in rng.uniform(0.0, 9.0, 20):
        solution = solve(pulses, (0, 10.0), [0.0], params=[begin, width])
        assert solution.events.time == pytest.approx([begin, begin + width], rel=1e-12)


@pytest.mark.parametrize("options", [{}, {"jacobian": "params"}, {"debug": True}])
def test_branches_are_found_in_derived_systems(options):
    ball, (start, params, landing, _) = system(roof), next(flights(0.02, 1, seed=2))
    plain = solve(ball, (0, landing + 0.3), start, params=params)
    solution = solve(ball, (0, landing + 0.3), start, params=params, **options)
    assert len(plain.events) == 3
    assert solution.events.time == pytest.approx(plain.events.time, rel=1e-9)
    back = solve(ball, (landing + 0.3, 0), solution.y_end, params=params, **options)
    assert back.events.time == pytest.approx(plain.events.time[::-1], rel=1e-9)
    assert solution.n_unproven == back.n_unproven == 0


def test_no_derivative_is_given_through_a_jump():
    """The instant is that of the edge, not that of a surface h = 0 which the rate describes."""
    ball, (start, params, landing, begin) = system(box), next(flights(0.02, 1, seed=2))
    solution = solve(ball, (0, landing + 0.3), start, params=params, jacobian=True)
    assert solution.status == RATE_DIFFERS
    assert solution.t_end == pytest.approx(begin, rel=1e-9)
    before = solve(ball, (0, 0.9 * begin), start, params=params, jacobian=True)
    assert before.jacobian[0, 2] == pytest.approx(0.9 * begin, rel=1e-9)


@field
def rest(t, y, mode, params, dy):
    dy[0] = 1.0
    dy[1] = 1e-18 * math.sin(1e3 * t)


@guards
def undecided(t, y, dy, mode, params, h, hdot):
    """The comparison is between numbers that differ by rounding."""
    h[0] = y[0] - 0.5
    hdot[0] = dy[0]
    if y[1] > params[0]:
        h[0] += 1e-15


def test_a_branch_that_stays_open_does_no_harm_if_both_answers_agree():
    resting = System(rest, undecided, n_states=2, guard_names=("h",))
    solution = solve(resting, (0, 2.0), [0.0, 1.0], params=[1.0], max_steps=10_000)
    assert solution.events.time == pytest.approx([0.5], rel=1e-12)
    assert solution.n_unproven == 0
    beside = solve(resting, (0, 2.0), [0.0, 1.0], params=[0.9])
    assert beside.n_unproven == 0


@on_event
def bounce(t, y, mode, params, guard, direction):
    if direction < 0:
        y[3] = abs(y[3]) * 0.9
    return 0


@guards
def stairs(t, y, dy, mode, params, h, hdot):
    h[0] = y[1] + params[0] * np.floor(y[0] / params[1])
    hdot[0] = dy[1]


def test_a_ball_that_bounces_down_a_staircase():
    """Between two bounces the floor is lowered several times, which is no event."""
    ball = System(flight, stairs, bounce, n_states=4, guard_names=("h",))
    solution = solve(ball, (0, 3.0), [0.01, 0.5, 1.0, 0.0], params=[0.2, 0.3])
    x = 0.01
    v = 0.0
    t = 0.0
    y = 0.5
    truth = []
    while True:  # by hand, from edge to edge
        edge = t + (0.3 * (math.floor(x / 0.3 + 1e-9) + 1) - x)
        floor = -0.2 * math.floor(x / 0.3 + 1e-9)
        hit = t + (v + math.sqrt(v * v + 2 * 9.81 * (y - floor))) / 9.81
        new = min(edge, hit)
        if new > 3.0:
            break
        y = y + v * (new - t) - 4.905 * (new - t) ** 2
        v = v - 9.81 * (new - t)
        x = x + new - t
        t = new
        if hit < edge:
            v = 0.9 * abs(v)
            y = floor
            truth.append(t)
    falls = solution.events.of("h", direction=-1).time
    assert falls == pytest.approx(truth, rel=1e-9)
    assert solution.n_unproven == 0


@guards
def roof_by_where(t, y, dy, mode, params, h, hdot):
    """A roof in code that lanes could run."""
    x = (y[0] - params[1]) / (0.5 * params[2]) - 1.0
    h[0] = y[1] - params[3] * y[0] - max(0.0, params[0] * (1.0 - abs(x)))
    steep = np.where(x > 0.0, -params[0], params[0]) / (0.5 * params[2])
    hdot[0] = dy[1] - (params[3] + np.where(abs(x) < 1.0, steep, 0.0)) * dy[0]


def test_lanes_prove_kinks_and_leave_branches_to_the_driver():
    start, params, landing, _ = next(flights(0.02, 1, seed=2))
    for one, in_lanes in ((roof_by_where, True), (box, False)):
        batch = solve_batch(
            system(one), (0, landing + 0.3), [start] * 3, params=params, lanes=True
        )
        assert batch.lanes.all() == in_lanes
        assert bool(batch.lanes_reason) != in_lanes
        assert batch.proven.all()
        assert batch.n_events.tolist() == [3, 3, 3]


@guards
def steep(t, y, dy, mode, params, h, hdot):
    """Exponential less a level; far away it is the level, to all digits, and its rate is 0."""
    power = params[2] * math.exp(params[0] * (y[0] - 1))
    h[0] = power - params[1]
    hdot[0] = params[3] * params[0] * power * dy[0]


@pytest.mark.parametrize("right", [1.0, 1.5])
@pytest.mark.parametrize("gain", [10, 300, 1000, 1e5])
@pytest.mark.parametrize("size", [1e10, 1.0, 1e-10])
@pytest.mark.parametrize("level", [0.5, 1e-30, 1e-100, 1e-250, 1e-300, 1e-307])
def test_a_steep_guard_is_crossed_even_if_its_rate_is_wrong(gain, size, level, right):
    """Where numbers underflow, rates and values disagree as well; nothing rests on that."""
    if level * size < 1e-307:
        size = 1.0  # the level itself would be rounded
    crossed = 1 + math.log(level) / gain
    found = solve(
        system(steep, advance, 1), (0, min(1.2, 1 + 600 / gain)), [0.0],
        params=[gain, level * size, size, right],
    )  # fmt: skip
    assert found.success, found.message
    truth = [crossed] if crossed > 0 else []
    assert found.events.time == pytest.approx(truth, abs=1e-7)
    assert found.proven


@guards
def touching(t, y, dy, mode, params, h, hdot):
    """A double root at params[0], or params[1] above it."""
    h[0] = (y[0] - params[0]) ** 2 + params[1]
    hdot[0] = 2.0 * (y[0] - params[0]) * dy[0]


def test_what_cannot_be_proven_is_told():
    one = system(touching, advance, 1)
    doubtful = solve(one, (0, 2.0), [0.0], params=[0.7, 0.0])
    assert doubtful.n_events in (0, 2)  # rounding decides
    assert not doubtful.proven
    assert "not proven" in doubtful.message
    assert 0 < doubtful.n_unproven < 5
    sure = solve(one, (0, 2.0), [0.0], params=[0.7, -1e-3])
    assert sure.n_events == 2
    assert sure.proven
    assert "proven" not in sure.message


@field
def orbit(t, y, mode, params, dy):
    dy[0] = -y[1]
    dy[1] = y[0]


@guards
def reach(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - params[0]
    hdot[0] = dy[0]


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_a_turn_closer_than_the_tolerance_is_counted(rtol):
    one = system(reach, orbit, 2)
    start = [math.cos(-1.0), math.sin(-1.0)]
    options = {"rtol": rtol, "atol": rtol}
    for gap in (0.2 * rtol, 0.1):
        for side in (1.0, -1.0):
            found = solve(one, (0, 2.0), start, params=[1.0 + side * gap], **options)
            assert found.success
            is_close = gap < 0.1
            assert found.n_events == (0 if side > 0 else 2) or is_close
            assert (found.n_close > 0) == is_close
            assert ("tolerance cannot tell" in found.message) == is_close
    close = [1.0 + 0.2 * rtol]
    batch = solve_batch(one, (0, 2.0), [start], params=close, **options)
    assert batch.proven.tolist() == [True]
    assert batch.n_close[0] > 0


@guards
def shivering(t, y, dy, mode, params, h, hdot):
    """It comes to within a thousandth of its surface a million times, or crosses it."""
    h[0] = 1.001 + math.sin(6e6 * y[0]) - (2.5 if y[0] > params[0] else 0.0)
    hdot[0] = 6e6 * math.cos(6e6 * y[0]) * dy[0]


def test_a_guard_that_takes_too_long_to_prove_exhausts_its_budget_and_is_told():
    one = system(shivering, advance, 1)
    solution = solve(one, (0, 1.0), [0.0], params=[2.0])
    assert solution.success
    assert solution.n_events == 0
    assert not solution.proven
    assert "not proven" in solution.message
    crossed = solve(one, (0, 1.0), [0.0], params=[0.5])
    assert crossed.events.time[0] == pytest.approx(0.5, abs=0.2)
    assert not crossed.proven


def test_no_guard_no_doubt():
    free = System(advance, n_states=1)
    assert solve(free, (0, 1.0), [0.0]).proven


@guards
def told_by_a_table(t, y, dy, mode, params, h, hdot):
    """An index computed from the state: over several knots no range can tell what it does."""
    place = 10.0 * y[0]
    k = int(np.floor(place))
    rise = params[k + 1] - params[k]
    h[0] = params[k] + (place - k) * rise
    hdot[0] = 10.0 * rise * dy[0]


def test_what_no_range_can_tell_is_not_taken_for_clear():
    heights = [1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    found = solve(system(told_by_a_table, advance, 1), (0, 1.0), [0.0], params=heights)
    assert found.events.time == pytest.approx([0.15, 0.25, 0.65, 0.75], abs=1e-9)


HEIGHTS = np.array([0.3, 0.2, 0.4, 0.1, 0.25, -0.3, -0.2, -0.4, -0.1, 0.15, 0.3])


def along(t, y):
    return 1.0


def levels(t, y):
    return HEIGHTS[int(y[0])] + 0.05 * np.sin(20.0 * y[0])


def ramps(t, y):
    k = int(np.floor(y[0]))
    return HEIGHTS[k] + (y[0] - k) * (HEIGHTS[k + 1] - HEIGHTS[k])


def rounded(t, y):
    return HEIGHTS[round(4.0 + 4.0 * np.sin(3.0 * y[0]))]


def by_newton(t, y):
    x = 1.0
    for _ in range(50):
        change = (x * x - y[0] - 1.0) / (2.0 * x)
        x -= change
        if abs(change) < 1e-12:
            break
    return x - 2.0


@pytest.mark.parametrize("guard", [levels, ramps, rounded])
def test_an_index_of_a_state_is_proven(guard):
    system = System(along, guard, n_states=1, guard_names=("h",))
    places = 0.1 + np.linspace(0.0, 9.3, 100_001)
    sides = np.sign([guard(0.0, (one,)) for one in places])
    for rtol in TOLERANCES:
        found = solve(system, (0.0, 9.3), [0.1], rtol=rtol)
        assert found.success
        assert found.proven, found.message
        assert found.n_events == np.count_nonzero(np.diff(sides))


def test_a_loop_that_waits_is_not_proven_and_all_paths_say_so():
    """A control of the test above: nothing but the message knows."""
    system = System(along, by_newton, n_states=1, guard_names=("h",))
    options = {"rtol": 1e-3, "max_step": 4.0}
    for jacobian in (False, True):
        found = solve(system, (0.0, 5.0), [0.1], jacobian=jacobian, **options)
        assert found.n_events == 1
        assert not found.proven
        assert "not proven" in found.message
        batch = solve_batch(
            system, (0.0, 5.0), [[0.1]], jacobian=jacobian, lanes=True, **options
        )
        assert batch.n_unproven[0] == found.n_unproven
        assert "not proven" in batch.message
    sure = solve_batch(replace(system, guards=levels), (0.0, 5.0), [[0.1]], **options)
    assert "proven" not in sure.message
