"""Sliding along guards: exact answers, what is told, and the derivative."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from sliding_systems import corner, dry, folded, folded_field, foot, relay

from hopdata.errors import ArgumentError
from hopdata.hybrid import System, guard, solve, solve_batch
from hopdata.hybrid.first_order import NoDerivativeError, bouligand_derivative
from hopdata.hybrid.gradients import gradient
from hopdata.hybrid.layout import GUARD_NOT_FINITE, NOT_UNIQUE, TIE_IN_JACOBIAN


def test_a_relay_rests_as_long_as_its_drive_is_weaker():
    solution = solve(relay, (0.0, 10.0), [0.0], params=[1.5, 0.0])
    log = solution.events
    # Let go where 1.5 sin(t) = 1 and -1; back where the integral from there is zero.
    leaves = np.arcsin(1.0 / 1.5) + np.array([0.0, np.pi, 2.0 * np.pi])
    assert solution.success
    np.testing.assert_array_equal(log.direction, [2, 3, -2, -3, 2, 3, -2])
    np.testing.assert_allclose(log.time[1::2], leaves, rtol=0, atol=1e-8)
    back = log.time[2::2] - leaves
    np.testing.assert_allclose(back, back[0], rtol=1e-8)
    start = leaves[0]
    area = 1.5 * (np.cos(start) - np.cos(start + back[0])) - back[0]
    assert abs(area) < 1e-8
    assert abs(solution.y_end[0]) < 1e-15


def test_handler_and_records_tell_what_a_guard_does():
    solution = solve(relay, (0.0, 5.0), [0.7], params=[1.5, 0.0])
    log = solution.events
    # mode[1] has the directions as its digits, mode[2] the lock that the handler saw.
    np.testing.assert_array_equal(log.direction, [-2, -3])
    np.testing.assert_array_equal(log.mode, [[0, -2, 0], [-1, -23, -1]])
    np.testing.assert_array_equal(solution.mode, [-1, -23, -1])
    assert "zero falls to zero and slides" in repr(log)
    assert len(log.of("zero", direction=-3)) == 1
    chunks = []
    solve(relay, (0.0, 5.0), [0.7], params=[1.5, 0.0], events=chunks.append)
    np.testing.assert_array_equal(chunks[0].direction, log.direction)


def test_a_block_with_dry_friction_stops_where_its_spring_is_too_weak():
    solution = solve(dry, (0.0, 20.0), [1.0, 0.0], params=[0.15, 0.0, 0.15])
    log = solution.events
    # It loses 2 x 0.15 m of its amplitude in each half turn: 1, -0.7, 0.4, -0.1.
    np.testing.assert_allclose(log.time, np.pi * np.arange(1, 4), rtol=0, atol=1e-8)
    np.testing.assert_array_equal(log.direction, [1, -1, 2])
    np.testing.assert_allclose(log.after[:, 0], [-0.7, 0.4, -0.1], atol=1e-8)
    np.testing.assert_allclose(solution.y_end, [-0.1, 0.0], atol=1e-8)


@pytest.mark.parametrize("belt", [0.1, 0.5, 2.0])
def test_a_block_on_a_belt_sticks_until_the_spring_tears_it_off(belt):
    solution = solve(dry, (0.0, 10.0), [0.0, belt], params=[0.15, belt, 0.15])
    assert solution.success
    log = solution.events
    np.testing.assert_allclose(log.time[:2], [0.0, 0.15 / belt], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(log.direction[:2], [2, -3])
    # Then it swings about 0.15 m.
    swing = np.hypot(solution.y_end[0] - 0.15, solution.y_end[1])
    np.testing.assert_allclose(swing, belt, rtol=1e-8)


@pytest.mark.parametrize("bend", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("x", [-4.0, -1.0, 0.5])
def test_a_segment_that_slides_ends_at_the_fold(x, bend):
    solution = solve(folded, (0.0, 9.0), [x, bend * x**2], params=[bend])
    log = solution.events
    fold = 0.5 - (0.5 * x - 0.25 * np.log(3.0 - 2.0 * x))
    np.testing.assert_allclose(log.time, [0.0, fold], rtol=1e-8)
    np.testing.assert_allclose(log.after[1], [1.0, bend], atol=1e-7)
    since = 9.0 - fold
    end = 1.0 + since
    height = 0.5 * since**2 + bend * end**2
    np.testing.assert_allclose(solution.y_end, [end, height], rtol=1e-7)


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_what_is_left_of_a_bent_surface_stays_near_the_tolerance(rtol):
    options = {"params": [0.7], "rtol": rtol, "atol": rtol / 1e3}
    solution = solve(folded, (0.0, 60.0), [-99.0, 0.7 * 99.0**2], **options)
    assert solution.success
    x, y = solution.y[:, solution.t <= solution.events.time[1]]
    assert np.abs(y - 0.7 * x**2).max() < 10.0 * rtol * 0.7 * 99.0**2


def test_two_surfaces_at_once():
    solution = solve(corner, (0.0, 5.0), [1.0, 1.0, 0.0], params=[0.5, 0.5, 0.0])
    log = solution.events
    # x' = -1.5, y' = -0.5; on x = 0 the share of its lock is 0.25, and y' = -0.875.
    np.testing.assert_allclose(log.time, [2.0 / 3.0, 2.0 / 3.0 + 16.0 / 21.0])
    np.testing.assert_array_equal(solution.mode, [0, 0])
    third = 3.0 * 2.0 / 3.0 + (2.0 + 0.25) * 16.0 / 21.0 + 1.0 * (5.0 - log.time[1])
    np.testing.assert_allclose(solution.y_end, [0.0, 0.0, third], atol=1e-9)


def test_a_mix_that_is_not_unique_is_told():
    solution = solve(corner, (0.0, 5.0), [1.0, 1.0, 0.0], params=[0.5, 0.5, 0.2])
    assert solution.status == NOT_UNIQUE
    assert "'y'" in solution.message
    batch = solve_batch(corner, (0.0, 5.0), [[1.0, 1.0, 0.0]], params=[0.5, 0.5, 0.2])
    assert batch.status[0] == NOT_UNIQUE
    assert batch.culprit[0] == 1


JACOBIANS = [
    (folded, 3.0, [-1.0, -0.3], [0.0], [2, 3]),
    (folded, 3.0, [-1.0, 0.1], [0.7], [2, 3]),
    (dry, 20.0, [1.0, 0.0], [0.15, 0.5, 0.15], [1, -1, 2, -3]),
    (corner, 5.0, [1.0, 0.8, 0.0], [0.5, 0.5, 0.0], [-2, -2]),
]
#: Each system compiles for 6 to 14 s; `bent` below slides along one surface, too.
SOME_JACOBIANS = JACOBIANS if "ALL" in os.environ else JACOBIANS[-1:]


@pytest.mark.parametrize(
    ("system", "end", "start", "params", "directions"), SOME_JACOBIANS
)
def test_the_derivative_through_sliding(system, end, start, params, directions):
    options = {"params": params, "rtol": 1e-11, "atol": 1e-13}
    solution = solve(system, (0.0, end), start, jacobian=True, **options)
    n = len(start)
    apart = 1e-5 * np.vstack([np.eye(n), -np.eye(n)])
    ends = solve_batch(system, (0.0, end), start + apart, **options).y_end
    slopes = (ends[:n] - ends[n:]).T / 2e-5
    np.testing.assert_array_equal(
        solution.events.direction[: len(directions)], directions
    )
    np.testing.assert_allclose(solution.jacobian, slopes, atol=1e-6)


def landed(start, params, end=2.0):
    """Return a run of a foot with its derivative, and the latter by differences."""
    options = {"params": params, "rtol": 1e-11, "atol": 1e-13}
    solution = solve(foot, (0.0, end), start, jacobian=True, **options)
    apart = 1e-5 * np.vstack([np.eye(4), -np.eye(4)])
    ends = solve_batch(foot, (0.0, end), start + apart, **options).y_end
    return solution, (ends[:4] - ends[4:]).T / 2e-5


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for 15 s: ALL=1")
@pytest.mark.parametrize("seed", range(5))
def test_the_derivative_through_an_impact_that_ends_in_sticking(seed):
    """The impact puts the neighbours onto the slip's surface, too: all go on sliding."""
    rng = np.random.default_rng(seed)
    sticks = 0
    for _ in range(4):
        start = rng.uniform([-0.2, 0.02, -1.0, -0.3], [0.2, 0.2, 1.0, 0.3])
        params = [rng.uniform(0.2, 1.2), rng.uniform(-0.8, 0.8), 0.0, 1.0]
        solution, slopes = landed(start, params)
        log = solution.events
        at_landing = log.of("floor", direction=1).time
        sticks += np.isin(at_landing, log.of("slip").time).any()
        np.testing.assert_allclose(solution.jacobian, slopes, atol=1e-6)
    assert sticks >= 2


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for 15 s: ALL=1")
def test_an_impact_after_which_one_start_alone_sticks_has_no_derivative():
    start = np.array([0.0, 0.05, 0.3, 0.0])
    before = landed(start, [0.6, 0.3, 0.0, 0.0])[0].events.before[0, 2]
    for more in (1.01, 0.99):  # it goes on slipping, backward or ahead
        solution, slopes = landed(start, [0.6, 0.3, more * before, 0.0])
        np.testing.assert_allclose(solution.jacobian, slopes, atol=1e-6)
    refused, _ = landed(start, [0.6, 0.3, before, 0.0])
    assert refused.status == TIE_IN_JACOBIAN
    assert len(refused.events) == 1


def place_and_speed(t, y, params):
    return y[0] + 0.3 * y[2] + 0.2 * y[1] - 0.7 * y[3]


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for a minute: ALL=1")
def test_the_gradient_through_an_impact_is_refused_where_one_start_alone_sticks():
    options = {"rtol": 1e-11, "atol": 1e-13}
    start = np.array([0.0, 0.05, 0.3, 0.0])
    before = landed(start, [0.6, 0.3, 0.0, 0.0])[0].events.before[0, 2]
    weights = np.array([1.0, 0.2, 0.3, -0.7])
    # The impulse of friction that stops all neighbours, then blows of a fixed size.
    for blow in (0.0, 1.01 * before, 0.99 * before):
        params = [0.6, 0.3, blow, 0.0]
        given = {"params": params, "at_end": place_and_speed}
        found = gradient(foot, (0.0, 2.0), start, **given, **options)
        slopes = weights @ landed(start, params)[1]
        np.testing.assert_allclose(found.by_start, slopes, atol=1e-6)
    given = {"params": [0.6, 0.3, before, 0.0], "at_end": place_and_speed}
    refused = gradient(foot, (0.0, 2.0), start, **given, **options)
    assert refused.status == TIE_IN_JACOBIAN
    assert np.isnan(refused.by_params).all()


def test_neighbours_of_a_corner_have_the_bouligand_derivative():
    """They meet both surfaces in either order, and slide along one and then both."""
    apart = 1e-5
    for seed in (101, 102, 103, 104, 105):
        draw = np.random.default_rng(seed)
        params = [*draw.uniform(-1.4, 0.8, 2), 0.0]
        options = {"params": params, "mode": [1, 1]}
        start = [2.0 - params[0], 1.0 - params[1], -3.0]  # in the corner after 1 s
        nominal = solve(corner, (0.0, 2.0), start, **options)
        np.testing.assert_array_equal(nominal.mode, [0, 0])
        found = bouligand_derivative(corner, np.zeros(3), **options)
        for v in draw.normal(size=(3, 3)):
            beside = solve(corner, (0.0, 2.0), start + apart * v, **options)
            moved = (beside.y_end - nominal.y_end) / apart
            np.testing.assert_allclose(found(v), moved, rtol=0, atol=1e-7)
        assert {order.guards[-1] for order in found.pieces()} == {0, 1}


def test_neighbours_that_part_at_a_corner_leave_no_derivative():
    """Whoever slides along one surface moves away from the other."""
    options = {"params": [-2.0, -2.0, 0.0], "mode": [1, 1]}
    with pytest.raises(NoDerivativeError, match="part there"):
        bouligand_derivative(corner, np.zeros(3), **options)(np.eye(3))


def stribeck(t, y, mode, p):  # weaker at speed, with a kink on the surface
    grip = 0.6 + 0.4 * np.exp(-3.0 * abs(y[1] - p[1]))
    return y[1], -y[0] - p[0] * mode[0] * grip


def slip_in_short(t, y, p):
    return y[1] - p[1]


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for 12 s: ALL=1")
def test_the_derivative_where_the_field_has_a_kink_on_the_surface():
    """Neighbours that slide are on the surface, too."""
    named = {"n_states": 2, "guard_names": ("slip",), "sliding": ("slip",)}
    system = System(stribeck, slip_in_short, **named)
    params = [0.15, 0.5]
    start = np.array([0.0, 0.49])
    found = solve(system, (0.0, 2.0), start, params=params, jacobian=True)
    assert found.success, found.message
    assert found.by_differences == ""
    assert {2, 3} <= set(np.abs(found.events.direction))
    tight = {"params": params, "rtol": 1e-12, "atol": 1e-13}
    slopes = slopes_of_flow(
        start, lambda y0: solve(system, (0.0, 2.0), y0, **tight).y_end
    )
    np.testing.assert_allclose(found.jacobian, slopes, rtol=0, atol=1e-6)


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for 11 s: ALL=1")
def test_derivative_by_parameters():
    """The same is asked of `bent` below, more exactly."""
    params = np.array([0.15, 0.5, 0.15])
    start = [0.0, 0.5]
    solution = solve(dry, (0.0, 3.0), start, params=params, jacobian="params")
    # Kinetic and static friction change together.
    apart = 1e-6 * np.array([1.0, 0.0, 1.0])
    both = np.array([params + apart, params - apart])
    ends = solve_batch(dry, (0.0, 3.0), np.tile(start, (2, 1)), params=both).y_end
    slope = (ends[0] - ends[1]) / 2e-6
    found = solution.sensitivity[:, 0] + solution.sensitivity[:, 2]
    np.testing.assert_allclose(found, slope, atol=1e-5)


def bent_fields(t, y, mode, p):  # plain forms, whose rates are not written down
    side = 1.0 if mode[0] > 0 else -1.0
    return (
        -p[0] * side - 0.4 * np.tanh(y[0]) + p[1] * np.sin(1.7 * t) + 0.3 * y[1],
        0.5 * np.cos(y[0]) - 0.2 * y[1] * side,
        0.3 * y[0] * y[1] + 0.1 * side,
    )


def bent_surface(t, y, p):
    return y[0] + 0.2 * y[1] ** 2 - p[2] * np.sin(y[2]) + 0.1 * np.sin(2.0 * t)


bent = System(
    bent_fields, bent_surface, n_states=3, guard_names=("bent",), sliding=("bent",)
)


def slopes_of_flow(numbers, end_of):
    """Return the derivative of an end state by some numbers, by differences."""
    columns = []
    for j in range(len(numbers)):
        way = 1e-4 * np.eye(len(numbers))[j]
        ends = [end_of(numbers + k * way) for k in (2.0, 1.0, -1.0, -2.0)]
        slope = (8.0 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / 12e-4
        columns.append(slope)
    return np.transpose(columns)


@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_exact_derivatives_and_proof_where_rates_are_not_given(seed):
    draw = np.random.default_rng(np.random.SeedSequence([58, seed]))
    start = draw.normal(0.0, 0.6, 3)
    params = np.array([0.6, 1.0, 0.3]) + draw.uniform(-0.1, 0.1, 3)
    options = {"rtol": 1e-10, "atol": 1e-12}
    tight = {"rtol": 1e-12, "atol": 1e-13}
    solution = solve(
        bent, (0.0, 4.0), start, params=params, jacobian="params", **options
    )
    assert solution.success
    assert solution.proven
    assert solution.n_unproven == 0
    assert solution.by_differences == ""
    assert {abs(one) for one in solution.events.direction} >= {2, 3}
    by_start = slopes_of_flow(
        start, lambda y0: solve(bent, (0.0, 4.0), y0, params=params, **tight).y_end
    )
    by_params = slopes_of_flow(
        params, lambda p: solve(bent, (0.0, 4.0), start, params=p, **tight).y_end
    )
    np.testing.assert_allclose(solution.jacobian, by_start, rtol=0, atol=1e-7)
    np.testing.assert_allclose(solution.sensitivity, by_params, rtol=0, atol=1e-7)


def of_end(t, y, params):
    return y[0] + 0.5 * y[1] ** 2 + np.sin(y[2])


def test_the_gradient_through_sliding_is_the_forward_derivative_transposed():
    slid = []
    for seed in (81, 82, 83, 84, 85):
        draw = np.random.default_rng(np.random.SeedSequence([58, seed]))
        start = draw.normal(0.0, 0.6, 3)
        params = np.array([0.6, 1.0, 0.3]) + draw.uniform(-0.1, 0.1, 3)
        options = {"params": params, "rtol": 1e-11, "atol": 1e-13, "method": "dop853"}
        span = (0.0, 4.0)
        found = gradient(bent, span, start, at_end=of_end, **options)
        forward = solve(bent, span, start, jacobian="params", **options)
        end = forward.y_end
        slope = np.array([1.0, end[1], np.cos(end[2])])
        by_params = slope @ forward.sensitivity
        assert found.success
        np.testing.assert_allclose(
            found.by_start, slope @ forward.jacobian, rtol=0, atol=1e-9
        )
        np.testing.assert_allclose(found.by_params, by_params, rtol=0, atol=1e-9)
        slid += forward.events.direction.tolist()
    assert {-2, 2, 3} <= set(slid)


def of_time(t, before, after, guard, direction, params):
    return t * direction


def test_losses_of_events_see_what_the_user_is_told():
    """Their slope is that of central differences."""
    start = np.array([0.3, -0.2, 0.5])
    options = {"params": [0.6, 1.0, 0.3], "rtol": 1e-11, "atol": 1e-13}
    found = gradient(bent, (0.0, 4.0), start, at_event=of_time, **options)
    np.testing.assert_array_equal(found.solution.events.direction, [-2, 3])

    def loss(y0):
        log = solve(bent, (0.0, 4.0), y0, **options).events
        return np.array([log.time @ log.direction])

    assert found.value == pytest.approx(loss(start)[0], rel=1e-9)
    slope = slopes_of_flow(start, loss)[0]
    np.testing.assert_allclose(found.by_start, slope, rtol=0, atol=1e-6)


def brief_field(t, y, mode):
    """The drive exceeds the relay for 4 ms."""
    return 1.0 + 1e-3 - 250.0 * (t - 2.123) ** 2 - 1.0 * mode[0]


def narrow_dip(t, y):
    """Return a second guard, too, below zero for 4 ms of the time that y[0] slides."""
    return y[0], (t - 2.163) ** 2 - 4e-6


def test_a_brief_end_of_sliding_and_a_narrow_dip_meanwhile_are_seen():
    system = System(
        brief_field,
        narrow_dip,
        n_states=1,
        guard_names=("zero", "dip"),
        sliding=("zero",),
    )
    solution = solve(system, (2.0, 2.2), [0.0])
    log = solution.events
    assert solution.proven
    np.testing.assert_array_equal(log.guard, [0, 0, 0, 1, 1])
    np.testing.assert_array_equal(log.direction[:3], [2, 3, -2])
    # Back where the integral of 1e-3 - 250 (t - 2.123)^2 from 2.121 is zero.
    np.testing.assert_allclose(log.time[1:3], [2.121, 2.127], rtol=0, atol=1e-9)
    np.testing.assert_allclose(log.time[3:], [2.161, 2.165], rtol=0, atol=1e-12)


def in_blocks(t, y):  # arrays made inside have no code for ranges or duals
    both = np.array([y[0], 1.0])
    return both[:1] * both[1]


def relay_in_blocks(t, y, mode):
    return np.array([1.5 * np.sin(t), 0.0])[:1] - 1.0 * mode[0]


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for 16 s: ALL=1")
def test_what_does_not_compile_for_other_numbers_is_told():
    system = System(
        relay_in_blocks,
        in_blocks,
        n_states=1,
        guard_names=("zero",),
        sliding=("zero",),
    )
    solution = solve(system, (0.0, 5.0), [0.7], jacobian=True)
    assert not solution.proven
    assert "guards" in solution.by_differences
    exact = solve(relay, (0.0, 5.0), [0.7], params=[1.5, 0.0])
    np.testing.assert_allclose(solution.y_end, exact.y_end, atol=1e-8)
    # Sliding forgets where it began.
    np.testing.assert_allclose(solution.jacobian, 0.0, atol=1e-8)


def test_static_friction_above_the_kinetic_one():
    solution = solve(dry, (0.0, 12.0), [0.0, 0.5], params=[0.1, 0.5, 0.3])
    log = solution.events
    # Torn off at 0.3 m, it swings about 0.1 m until it has the belt's speed again.
    swing = 2.0 * np.pi - 2.0 * np.arctan2(0.2, 0.5)
    expected = np.cumsum([0.0, 0.6, swing, 0.8])
    np.testing.assert_array_equal(log.direction, [2, -3, 2, -3])
    np.testing.assert_allclose(log.time, expected, rtol=0, atol=1e-8)


def test_static_friction_holds_where_the_kinetic_one_lets_the_block_cross():
    solution = solve(dry, (0.0, 9.0), [0.0, 0.5], params=[0.1, 0.5, 0.5])
    log = solution.events
    # Torn off at 0.5 m, it swings about 0.1 m and comes back at -0.3 m.
    swing = 2.0 * np.pi - 2.0 * np.arctan2(0.4, 0.5)
    expected = np.cumsum([0.0, 1.0, swing, 0.0, 1.6])
    np.testing.assert_array_equal(log.direction, [2, -3, 1, -2, -3])
    np.testing.assert_allclose(log.time, expected, rtol=0, atol=1e-8)


def test_the_past_of_a_state_that_slides_is_refused():
    with pytest.raises(ArgumentError, match="unique past"):
        solve(dry, (1.0, 0.0), [0.0, 0.5], params=[0.15, 0.5, 0.15])


def test_a_batch_has_the_same_bytes_and_leaves_lanes():
    starts = [[1.0, 0.0], [0.3, 0.2]]
    batch = solve_batch(dry, (0.0, 9.0), starts, params=[0.15, 0.5, 0.15], lanes=True)
    assert "slide" in batch.lanes_reason
    for one, start in enumerate(starts):
        alone = solve(dry, (0.0, 9.0), start, params=[0.15, 0.5, 0.15])
        assert alone.y_end.tobytes() == batch.y_end[one].tobytes()
        np.testing.assert_array_equal(alone.mode, batch.mode[one])
        assert alone.n_events == batch.n_events[one]


def test_a_run_goes_on_from_a_state_that_slides():
    first = solve(relay, (0.0, 3.7), [0.7], params=[1.5, 0.0])
    assert first.mode[0] == 0
    second = solve(relay, (3.7, 10.0), first.y_end, params=[1.5, 0.0], mode=first.mode)
    whole = solve(relay, (0.0, 10.0), [0.7], params=[1.5, 0.0])
    np.testing.assert_allclose(second.y_end, whole.y_end, atol=1e-8)
    # It begins to slide once more.
    np.testing.assert_array_equal(
        second.events.direction[1:], whole.events.direction[1:]
    )


@guard
def one_by_one(t, y, dy, mode, params, k, h, hdot):
    h[k], hdot[k] = y[0], dy[0]


def test_wrong_declarations():
    with pytest.raises(ValueError, match="sliding"):
        replace(dry, sliding=("stick",))
    with pytest.raises(ValueError, match="directions"):
        replace(dry, directions=(1,))
    with pytest.raises(ValueError, match="sliding"):
        System(
            folded_field,
            guard=one_by_one,
            n_states=2,
            guard_names=("a",),
            sliding=("a",),
        )


def driven(t, y, mode, p):
    push = p[0] if t % 0.7 < 0.35 else -p[0]
    if mode[0] > 0:
        return -2.0 + 0.5 * push, push
    return 2.0 + 0.5 * push, push


def first_state(t, y, mode, p):
    return y[0]


def run_with_drive(**options):
    system = System(driven, first_state, n_states=2, guard_names=("s",), sliding=("s",))
    system = replace(system, **options)
    return solve(system, (0.0, 2.0), [0.3, 0.0], params=[1.0], rtol=1e-8)


def test_instants_of_its_own_are_found_while_it_slides():
    found = run_with_drive()
    assert abs(found.y_end[0]) < 1e-15  # it slides
    assert found.n_rejected == 0
    assert found.y_end[1] == pytest.approx(0.1, abs=1e-14)


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for 5 s: ALL=1")
def test_instants_that_are_not_sought_reject_steps():
    assert run_with_drive(find_tstops=False).n_rejected > 10


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_a_guard_that_is_not_a_number_while_it_slides_ends_the_run(value):
    run = solve(relay, (0.0, 2.0), [0.5], params=[0.5, value])
    assert run.events.direction.tolist() == [-2]  # it slides from 0.58 on
    if value == 0.0:
        assert run.success
    else:
        assert run.status == GUARD_NOT_FINITE
        assert run.t_end == pytest.approx(0.9, abs=1e-9)
