"""The flow's Jacobian through events: jumps of the field, moving guards, several at one instant."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from bent_systems import bent, bent_jacobian, bent_params, bent_sparse, turn_back
from hybrid_systems import ladder
from jacobian_checks import TIGHT, carried, differences, gap, saltation_product

from hopdata.hybrid import System, field, guards, on_event, solve, solve_batch
from hopdata.hybrid.first_order import check_c1, project_onto_section
from hopdata.hybrid.layout import GRAZING_IN_JACOBIAN as GRAZING
from hopdata.hybrid.layout import RATE_DIFFERS, TIE_IN_JACOBIAN
from hopdata.hybrid.methods.table import TABLEAUS

PLACES = [0.5, 0.7, 1.0]
TILTS = [0.2, -0.3, 0.4]
GAINS = [0.4, -0.8, -0.5]
STEADY = bent_params(PLACES, drive=0.3, tilts=TILTS, gains=GAINS)
MOVING = bent_params(
    PLACES, drive=0.3, tilts=TILTS, sways=[0.1, 0.2, -0.3], gains=GAINS
)
START = [0.0, 1.2]
METHODS = pytest.mark.parametrize("method", ["auto", *TABLEAUS])


@METHODS
@pytest.mark.parametrize("params", [STEADY, MOVING], ids=["steady", "moving"])
@pytest.mark.parametrize("make", [bent, bent_sparse])
def test_through_jumps_of_the_field(make, params, method):
    found = carried(make(3), (0, 2), START, params=params, method=method)
    assert len(found.events) >= 4
    assert (
        gap(found.jacobian, differences(bent(3), (0, 2), START, params=params)) < 1e-10
    )


@field
def pushed(t, y, mode, params, dy):
    dy[0] = y[2]
    dy[1] = -0.4 * y[0]
    dy[2] = -y[1] + 0.3 * np.cos(t)
    if mode[0] > 0:
        dy[1], dy[2] = dy[1] + 0.7, dy[2] - 0.5


@guards
def by_numbers(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] + 0.3 * y[1] * y[1] - 0.5
    hdot[0] = dy[0] + 0.6 * y[1] * dy[1]


@guards
def by_a_loop(t, y, dy, mode, params, h, hdot):
    gradient = np.array([1.0, 0.6 * y[1], 0.0])
    h[0] = y[0] + 0.3 * y[1] * y[1] - 0.5
    hdot[0] = 0.0 * t
    for i in range(3):
        hdot[0] += gradient[i] * dy[i]


@guards
def that_move(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] + 0.3 * y[1] * y[1] - 0.5 + 0.1 * np.sin(t)
    hdot[0] = dy[0] + 0.6 * y[1] * dy[1] + 0.1 * np.cos(t)


@pytest.mark.parametrize("one", [by_numbers, by_a_loop, that_move])
def test_whatever_the_code_of_a_guard_tells_of_what_it_depends_on(one):
    system = System(pushed, one, n_states=3, guard_names=("bend",))
    found = carried(system, (0, 4), [0.1, 0.4, 0.6])
    assert len(found.events) >= 1
    assert gap(found.jacobian, differences(system, (0, 4), [0.1, 0.4, 0.6])) < 1e-9


@guards
def by_velocities(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] + 0.3 * y[1] * y[1] - 0.5
    hdot[0] = y[2] + 0.6 * y[1] * dy[1]


def test_a_rate_need_not_follow_dy():
    """The derivative of the guard is that of its values."""
    system = System(pushed, by_velocities, n_states=3, guard_names=("bend",))
    found = carried(system, (0, 4), [0.1, 0.4, 0.6])
    assert len(found.events) >= 1
    assert gap(found.jacobian, differences(system, (0, 4), [0.1, 0.4, 0.6])) < 1e-9


@guards(compiled=False)
def by_velocities_in_python(t, y, dy, mode, params, h, hdot):
    by_velocities.function(t, y, dy, mode, params, h, hdot)


def test_a_rate_that_does_not_follow_dy_is_refused_if_only_rates_have_derivatives():
    system = System(pushed, by_velocities_in_python, n_states=3, guard_names=("bend",))
    assert solve(system, (0, 4), [0.1, 0.4, 0.6]).success
    found = solve(system, (0, 4), [0.1, 0.4, 0.6], jacobian=True)
    assert found.status == -12
    assert "'bend'" in found.message
    assert "dy[0]" in found.message
    assert "guards: it runs as plain Python" in found.message


@guards
def with_a_wrong_rate(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] + 0.3 * y[1] * y[1] - 0.5
    hdot[0] = 0.5 * (dy[0] + 0.6 * y[1] * dy[1])


def test_a_wrong_rate_is_refused():
    system = System(pushed, with_a_wrong_rate, n_states=3, guard_names=("bend",))
    found = solve(system, (0, 4), [0.1, 0.4, 0.6], jacobian=True)
    assert found.status == -12
    assert "'bend'" in found.message


@field
def falling(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -9.81 - 0.2 * y[1]


@guards
def floor(t, y, dy, mode, params, h, hdot):
    h[0] = -y[0]
    hdot[0] = -dy[0]


def bounce(t, y, mode, params, guard, direction):
    """Throw the ball up, from a place and at a speed that depend on state and time."""
    if direction > 0:
        y[0] = 0.1 * y[1] * t
        y[1] *= -0.8 * np.cos(0.1 * t)
    return 0


@pytest.mark.parametrize("compiled", [True, False])
def test_the_derivative_of_a_handler(compiled):
    handler = on_event(compiled=compiled)(bounce)
    names = {"n_states": 2, "guard_names": ("floor",), "directions": (1,)}
    ball = System(falling, floor, handler, **names)
    found = carried(ball, (0, 0.7), [1.0, 0.0])
    assert len(found.events) == 1
    assert gap(found.jacobian, differences(ball, (0, 0.7), [1.0, 0.0])) < 1e-9
    told = "" if compiled else "on_event: it runs as plain Python"
    assert found.by_differences == told


@field
def drifting(t, y, mode, params, dy):
    dy[0] = 2.0 if mode[0] > 0 else 1.0


@guards
def by_offset_and_turns(t, y, dy, mode, params, h, hdot):
    offset = params[0]
    turns = params[1]
    h[0] = np.sin(turns * ((y[0] + offset) - offset - 0.5))
    hdot[0] = turns * np.cos(turns * ((y[0] + offset) - offset - 0.5)) * dy[0]


@pytest.mark.parametrize("params", [(1e8, 1.0), (1e3, 1e3), (0.0, 1e7)])
def test_a_rate_that_follows_dy_is_believed_whatever_rounding_and_bends(params):
    system = System(drifting, by_offset_and_turns, n_states=1, guard_names=("turn",))
    start = 0.5 - 1.0 / params[1]
    found = solve(system, (0, 1.5 / params[1]), [start], params=params, jacobian=True)
    assert found.n_events == 1
    np.testing.assert_allclose(found.jacobian, 2.0, rtol=1e-6)


def test_a_guard_whose_inputs_are_named_costs_fewer_evaluations():
    named, looped = (
        System(pushed, one, n_states=3, guard_names=("bend",))
        for one in (by_numbers, by_a_loop)
    )
    assert named.methods("dopri5", True).scene.rate_inputs == (0, 1)
    assert looped.methods("dopri5", True).scene.rate_inputs == (0, 1, 2)


def test_ladder_of_speeds():
    """Positions shrink by the ratio of the speeds, whatever happens in between."""
    params = (0.5, 0.75, 1.0, 1.5, -1.0, 3.0)
    found = carried(ladder(3), (0, 1.5), [0.0, 0.0], params=params)
    assert found.jacobian[0] == pytest.approx([4.5, 0.0], abs=1e-12)
    assert (
        gap(found.jacobian, differences(ladder(3), (0, 1.5), [0.0, 0.0], params=params))
        < 1e-10
    )


@METHODS
def test_a_given_derivative_of_the_field(method):
    system = bent(3, jacobian=bent_jacobian)
    given = carried(system, (0, 2), START, params=MOVING, method=method)
    taken = carried(bent(3), (0, 2), START, params=MOVING, method=method)
    assert gap(taken.jacobian, given.jacobian) < 1e-11


@METHODS
def test_samples_do_not_change_it(method):
    options = {"params": STEADY, "method": method, "jacobian": True}
    bare = solve(bent(3), (0, 2), START, **options)
    sampled = solve(bent(3), (0, 2), START, t_eval=np.linspace(0, 2, 301), **options)
    assert sampled.jacobian.tobytes() == bare.jacobian.tobytes()
    assert sampled.y_end.tobytes() == bare.y_end.tobytes()


@METHODS
@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_guards_at_one_instant(tilt, method):
    """Three guards share one surface, so the flow is differentiable there."""
    params = bent_params([0.5] * 3, drive=0.3, tilts=tilt, gains=GAINS)
    found = carried(bent(3), (0, 1.2), START, params=params, method=method)
    assert len(set(found.events.time)) == 1
    assert (
        gap(found.jacobian, differences(bent(3), (0, 1.2), START, params=params))
        < 1e-10
    )


def test_the_order_does_not_matter_where_the_flow_is_c1():
    """The guards depend on the angle alone and torques jump, so no guard feels another's jump."""
    places = np.full(3, 0.5)
    sways = np.array([0.0, 0.1, -0.1])
    instant = carried(bent(3), (0, 2), START, params=bent_params(places)).events.time[0]
    places = places - sways * np.sin(
        instant
    )  # all at one instant, with different rates
    found = []
    for order in permutations(range(3)):
        at = list(order)
        params = bent_params(
            places[at], sways=sways[at], gains=np.array([0.3, -0.4, 0.2])[at]
        )
        found.append(carried(bent(3), (0, 0.6), START, params=params))
        assert np.ptp(found[-1].events.time) < 1e-14
        assert len(found[-1].events) == 3
    for other in found[1:]:
        assert gap(other.jacobian, found[0].jacobian) < 1e-12


def test_where_the_order_matters_each_order_has_its_own():
    params = bent_params(
        [0.5 + 0.9 * 0.2, 0.5 - 0.9 * 0.3, 9.0], tilts=TILTS, gains=[0.4, -2.8, 0]
    )
    state = [0.5, 0.9]
    locks = [-1, -1, -1]
    there = solve(bent(3), (0, 1e-13), state, params=params, mode=locks)
    assert there.events.guard.tolist() == [0, 1]
    of_log = saltation_product(bent(3), state, [0, 1], params=params, mode=locks)
    other = saltation_product(bent(3), state, [1, 0], params=params, mode=locks)
    assert gap(other, of_log) > 1e-2
    none = solve(bent(3), (0, 1e-13), state, params=params, mode=locks, jacobian=True)
    assert none.status == TIE_IN_JACOBIAN


@pytest.mark.parametrize("method", ["dop853", "auto"])
def test_one_by_one_or_all_at_once_the_order_is_the_same(method):
    params = bent_params([0.5] * 3, drive=0.3, gains=GAINS)
    plain, sparse = (
        solve(make(3), (0, 1.2), START, params=params, method=method, **TIGHT)
        for make in (bent, bent_sparse)
    )
    assert plain.events.guard.tolist() == [0, 1, 2]
    assert sparse.events.guard.tolist() == [0, 1, 2]


def test_an_event_next_to_the_end():
    instant = carried(bent(3), (0, 2), START, params=STEADY).events.time[1]
    after = carried(bent(3), (0, instant + 1e-9), START, params=STEADY)
    before = carried(bent(3), (0, instant - 1e-9), START, params=STEADY)
    assert len(after.events) == 2
    assert len(before.events) == 1
    matrix = saltation_product(
        bent(3),
        before.y_end,
        [after.events.guard[1]],
        params=STEADY,
        mode=before.mode,
        t=instant,
    )
    assert gap(after.jacobian, matrix @ before.jacobian) < 1e-7
    assert gap(after.jacobian, before.jacobian) > 1e-2


def test_an_event_at_the_end():
    """At the event's instant it has happened, so the Jacobian is that of the other side."""
    instant = carried(bent(3), (0, 2), START, params=STEADY).events.time[1]
    at = carried(bent(3), (0, instant), START, params=STEADY, max_steps=1000)
    after = carried(bent(3), (0, instant + 1e-9), START, params=STEADY)
    assert at.status == 0
    assert at.events.guard.tolist() == after.events.guard.tolist()
    assert gap(at.jacobian, after.jacobian) < 1e-8


@pytest.mark.parametrize("params", [STEADY, MOVING], ids=["steady", "moving"])
def test_the_impact_state_at_a_terminal_event(params):
    """The field after the event projects the state onto the guard, as the field before it would."""
    system = bent(3, terminal=(False, True, False))
    found = carried(system, (0, 2), START, params=params)
    assert found.status == 1
    rate = np.empty(2)
    system.field.function(found.t_end, found.y_end, found.mode, params, rate)
    tilt = params[1 + 3 + 1]
    sway = params[1 + 6 + 1]
    impact = project_onto_section(
        found.jacobian, rate, [1.0, tilt], time_rate=-sway * np.cos(found.t_end)
    )
    assert (
        np.abs(impact - differences(system, (0, 2), START, params=params)).max() < 1e-9
    )


@pytest.mark.parametrize("terminal", [(False, False, False), (False, True, False)])
def test_through_a_reset_of_a_bent_system(terminal):
    """At a terminal event it is the Jacobian at this time, including the effect of the event."""
    params = bent_params([0.5, 2.0, 9.0], tilts=[0.0, 1.5, 0.0])
    system = bent(3, on_event=turn_back, terminal=terminal)
    found = carried(system, (0, 3), START, params=params)
    assert found.success
    assert (found.events.before != found.events.after).any()
    if not any(terminal):
        assert (
            gap(found.jacobian, differences(system, (0, 3), START, params=params))
            < 1e-8
        )
    options = {"params": params, "jacobian": True, "method": "dop853", **TIGHT}
    batch = solve_batch(system, (0, 3), [START] * 2, **options)
    assert batch.jacobian[1].tobytes() == found.jacobian.tobytes()


def test_a_handler_that_resets_nothing_is_no_reset():
    system = bent(3, on_event=turn_back)
    found = carried(system, (0, 2), START, params=STEADY)
    assert found.status == 0
    assert (
        gap(found.jacobian, carried(bent(3), (0, 2), START, params=STEADY).jacobian)
        == 0.0
    )


@field
def turning(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -np.sin(y[0])


@pytest.mark.parametrize(("turns", "method"), [(160, "dopri5"), (1600, "dop853")])
def test_an_angle_of_many_turns(turns, method):
    """Differences in proportion to the angle's size would be whole turns."""
    pendulum = System(turning, n_states=2)
    here, there = (
        carried(pendulum, (0, 4), [2 * np.pi * count, 3.0], method=method, rtol=1e-9)
        for count in (0, turns)
    )
    assert gap(there.jacobian, here.jacobian) < 2e-7


@field
def driven(t, y, mode, params, dy):
    dy[0] = np.cos(params[0] * t)


@pytest.mark.parametrize(
    ("frequency", "start"), [(10.0, 0.0), (200.0, 0.0), (10.0, 1000.0)]
)
def test_the_frequency_of_a_drive_after_many_periods(frequency, start):
    def slope(t):
        return (
            t * np.cos(frequency * t) / frequency - np.sin(frequency * t) / frequency**2
        )

    end = start + 5.0
    options = {"params": [frequency], "jacobian": "params", "rtol": 1e-11}
    found = solve(
        System(driven, n_states=1), (start, end), [0.0], **options
    ).sensitivity
    assert abs(found[0, 0] - slope(end) + slope(start)) < 1e-7 * end / frequency


@field
def with_spin(t, y, mode, params, dy):
    dy[0] = params[0] * y[1] * y[2]
    dy[1] = -params[0] * y[0] * y[2]
    dy[2] = ((0.1 + params[1]) - params[1] - 0.1) * y[0] * y[1]  # only rounding


def test_rounding_costs_no_digits():
    top = System(with_spin, n_states=3)
    options = {"params": (0.7, 0.3)}
    found = carried(top, (0, 5), [1.0, 0.2, 3.0], **options)
    assert (
        gap(found.jacobian, differences(top, (0, 5), [1.0, 0.2, 3.0], **options)) < 1e-9
    )


def falls(t, y):
    return y[1], -1.0


def one_or_minus_one(t, y):
    return 1.0 if y[0] > 0.3 else -1.0


def stairs(t, y):
    return np.floor(4.0 * y[0]) - 0.5


def touches(t, y):
    return y[0] - 1.9999999999


@pytest.mark.parametrize(
    ("guard", "status"),
    [(one_or_minus_one, RATE_DIFFERS), (stairs, RATE_DIFFERS), (touches, GRAZING)],
)
def test_a_guard_that_jumps_is_told_from_one_that_grazes(guard, status):
    system = System(falls, guard, n_states=2, guard_names=("h",))
    found = solve(system, (0.0, 3.0), [0.0, 2.0], jacobian=True)
    assert found.status == status
    assert solve(system, (0.0, 3.0), [0.0, 2.0]).success


def law(t, y, mode, p):
    """Return the rates of a unit mass on a leg with the force p[0] depth**p[1]."""
    depth = -y[0]
    push = 0.0
    if mode[0] > 0:
        push = p[0] * depth if p[1] == 1.0 else p[0] * max(depth, 0.0) ** p[1]
    return y[1], push - 9.81


def clipped(t, y, mode, p):
    """Return the rates on a spring whose depth is clipped, though the lock is read."""
    push = p[0] * max(-y[0], 0.0) if mode[0] > 0 else 0.0
    return y[1], push - 9.81


def sole(t, y):
    return -y[0]


PAD_SPAN = (0.0, 0.15)
PAD_START = np.array([0.05, -1.0])


def off(system, params, rtols):
    """Return the errors of derivatives through a landing, and the estimates of them."""
    columns = []
    for change in 1e-4 * np.eye(2):
        ends = [
            solve(
                system, PAD_SPAN, PAD_START + k * change, params=params, rtol=1e-13
            ).y_end
            for k in (-2, -1, 1, 2)
        ]
        columns.append((ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / 12e-4)
    exact = np.array(columns).T
    errors = []
    estimates = []
    for rtol in rtols:
        found = solve(
            system, PAD_SPAN, PAD_START, params=params, rtol=rtol, jacobian=True
        )
        errors.append(np.abs(found.jacobian - exact).max() / np.abs(exact).max())
        estimates.append(found.jacobian_error)
    return np.array(errors), np.array(estimates)


def test_the_derivative_through_a_landing_is_as_exact_as_the_reference_says():
    leg = System(law, sole, n_states=2, guard_names=("foot",))
    kinked = System(clipped, sole, n_states=2, guard_names=("foot",))
    rtols = np.array([1e-6, 1e-8, 1e-10])
    for stiffness in (400.0, 1000.0, 3000.0):
        for system, params in (
            (leg, [stiffness, 1.0]),
            (leg, [4.0 * stiffness, 1.5]),
            (kinked, [stiffness]),
        ):
            errors, estimates = off(system, params, rtols)
            assert (errors < 300.0 * rtols).all()
            assert (errors < 10.0 * estimates).all()


def test_only_a_derivative_that_is_not_smooth_takes_steps_of_its_own():
    leg = System(law, sole, n_states=2, guard_names=("foot",))
    for params, least, most in (([1000.0, 1.0], 1.0, 1.0), ([4000.0, 1.5], 1.3, 3.0)):
        steps = [
            solve(leg, PAD_SPAN, PAD_START, params=params, jacobian=wanted).n_steps
            for wanted in (False, True)
        ]
        assert least <= steps[1] / steps[0] <= most


def test_a_run_without_a_derivative_has_no_estimate_of_its_error():
    leg = System(law, sole, n_states=2, guard_names=("foot",))
    assert solve(leg, PAD_SPAN, PAD_START, params=[1000.0, 1.0]).jacobian_error is None


def test_check_c1_finds_the_kink_of_a_depth_that_is_clipped():
    leg = System(clipped, sole, n_states=2, guard_names=("foot",))
    report = check_c1(leg, [0.0, -1.0], params=[1000.0], mode=[-1])
    assert report.verdict == "not event-selected"
    smooth = System(law, sole, n_states=2, guard_names=("foot",))
    for law_params in ([1000.0, 1.0], [4000.0, 1.5]):
        report = check_c1(smooth, [0.0, -1.0], params=law_params, mode=[-1])
        assert report.verdict == "C1"
