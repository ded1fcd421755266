"""Table 1.1 on systems with a known verdict."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, ladder, relay, sliding, throw

from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.hybrid.first_order import bouligand_derivative, check_c1
from hopdata.hybrid.first_order.event_selected import (
    CONTINUOUS,
    EVENT_FUNCTIONS,
    KEPT,
    ONCE,
    RATES,
    SURFACES,
    event_selection,
)
from hopdata.hybrid.first_order.finding import Finding
from hopdata.hybrid.first_order.linearise import instant, lock_combinations
from hopdata.hybrid.first_order.smoothness import LANDING, spread


def test_sliding_and_rigid_bounce_are_not_event_selected():
    slide = check_c1(sliding(), [0.0], params=(1.0, 2.0), mode=[-1])
    bounce = check_c1(ball(), [0.0, -2.0], params=(9.81, 0.0, 0.8), mode=[-1])
    plastic = check_c1(ball(), [0.0, -2.0], params=(9.81, 0.0, 0.0), mode=[-1])
    assert {r.verdict for r in (slide, bounce, plastic)} == {"not event-selected"}
    assert EVENT_FUNCTIONS in slide.reasons
    assert "contact keeps penetration velocity" in plastic.reasons


def test_one_guard_is_c1_without_forces_that_add():
    """A point changes speed at one rung; its flow has a single saltation matrix."""
    report = check_c1(ladder(1), [1.0, 0.0], params=(1.0, 0.5), mode=[-1])
    assert report.verdict == "C1"
    assert report.reasons == ()


@field
def point_field(t, y, mode, params, dy):
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], 0.0, 0.0
    if mode[0] > 0:
        dy[2] += 1.0


@guards
def kinked_guard(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] + params[0] * abs(y[1])
    hdot[0] = dy[0] + params[0] * np.sign(y[1]) * dy[1]
    hdot[0] *= params[1]


def kinked(*params):
    system = System(point_field, kinked_guard, n_states=4, guard_names=("wedge",))
    return check_c1(system, [0, 0, 1, 0], params=params, mode=[-1])


def test_a_kink_of_a_guard_is_found_and_a_wrong_rate():
    assert kinked(0.0, 1.0).verdict == "C1"
    report = kinked(0.2, 1.0)
    assert report.verdict == "not event-selected"
    assert report.reasons == (SURFACES,)
    assert kinked(0.0, 1.5).reasons[0] == RATES


def test_spread_is_relative_to_the_effect():
    one = np.array([[1.0, 0.0], [3.0, 1.0]])
    other = np.array([[1.0, 0.0], [4.0, 1.0]])
    assert spread([one, other, one]) == pytest.approx(0.25)
    assert spread([one, one]) == 0
    assert spread([np.eye(2)]) == 0


@field
def coupled_pads(t, y, mode, params, dy):
    """Pads of stiffness and damping, each stiffer by a share while the other touches."""
    stiffness, damping, power, coupling = params[0], params[1], params[2], params[3]
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], 9.81, 9.81
    factor = 1.0
    if mode[0] > 0 and mode[1] > 0:
        factor += coupling
    for pad in range(2):
        if mode[pad] > 0:
            pressed = y[pad]
            if power > 1.0:
                pressed = max(y[pad], 0.0) ** power
            dy[2 + pad] -= factor * (stiffness * pressed + damping * y[2 + pad])


@guards
def pads(t, y, dy, mode, params, h, hdot):
    h[0], h[1] = y[0], y[1]
    hdot[0], hdot[1] = dy[0], dy[1]


PADS = System(coupled_pads, pads, n_states=4, guard_names=("left", "right"))


@pytest.mark.parametrize("power", [1.0, 1.5])
@pytest.mark.parametrize("off", [0.0, 1e-16, 2e-12])
@pytest.mark.parametrize(
    ("damping", "coupling", "verdict"),
    [
        (0.0, 0.3, "C1"),
        (10.0, 0.0, "C1"),
        (10.0, 0.3, "event-selected, not C1"),
        (10.0, 1e-6, "event-selected, not C1"),
    ],
)
def test_a_state_beside_the_surfaces_is_judged_as_on_them(
    power, off, damping, coupling, verdict
):
    """There a force is not quite zero, and what couples it not quite nothing."""
    params = (1e4, damping, power, coupling)
    report = check_c1(PADS, [off, off, 1.0, 1.2], params=params, mode=[-1, -1])
    assert report.verdict == verdict
    if off > 1e-15:  # closer, it may be rounded to nothing
        told = "does not count" in report.products.detail
        assert told == (damping == 0)


# Event-selection: liveness in all modes, continuity, one crossing each.

FREE = [-1, -1, -1]


def selected(system, state, *, scale=None, **options):
    """Return values of the conditions of event-selection, and names of those that fail."""
    report = check_c1(system, state, scale=scale, **options)
    wanted = (EVENT_FUNCTIONS, CONTINUOUS, ONCE, KEPT)
    own = [f for f in report.selection if f.condition in wanted]
    return {f.condition: f.value for f in own}, [
        f.condition for f in own if not f.passed
    ]


def test_sliding_is_not_event_selected():
    found, failed = selected(sliding(), [0.0], params=(1.0, 2.0), mode=[-1])
    assert EVENT_FUNCTIONS in failed
    assert found[KEPT] == -0.5
    found, failed = selected(sliding(), [0.0], params=(-1.0, 2.0), mode=[-1])
    assert failed == []
    assert found[KEPT] == 0.5


@pytest.mark.parametrize("restitution", [0.0, 0.8])
def test_a_rigid_bounce_is_not(restitution):
    found, failed = selected(
        ball(), [0, -2.0], params=(9.81, 0, restitution), mode=[-1]
    )
    assert {CONTINUOUS, KEPT} <= set(failed)
    assert found[KEPT] == pytest.approx(-restitution, abs=1e-15)
    assert found[CONTINUOUS] == pytest.approx(1 + restitution)


def test_a_velocity_lost_in_part_is_only_a_jump():
    found, failed = selected(ball(), [0, -2.0], params=(9.81, 0, -0.7), mode=[-1])
    assert failed == [CONTINUOUS]
    assert found[KEPT] == pytest.approx(0.7)


def test_falling_guards_count_in_their_own_direction():
    throws = {"params": (9.81, 1.0)}
    assert selected(throw(), [1.0, -3.0], mode=[1], **throws)[1] == []
    assert EVENT_FUNCTIONS in selected(throw(), [1.0, -3.0], mode=[-1], **throws)[1]


def test_a_handler_that_pushes_another_guard_across_is_found():
    found, failed = selected(relay(), [1.0, 0.0], mode=FREE, guards=("first", "second"))
    assert found[ONCE] >= 1
    assert ONCE in failed


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
def test_shares_do_not_depend_on_units(unit):
    found, failed = selected(
        throw(),
        [1.0, -3 * unit],
        params=(9.81 * unit, 1.0),
        mode=[1],
        scale=[1.0, unit],
    )
    assert failed == []
    assert found[EVENT_FUNCTIONS] == pytest.approx(1.0)


def test_more_than_eight_guards_are_sampled():
    rungs = np.r_[np.ones(10), 0.1 * np.ones(10)]
    start = instant(ladder(10), [1.0, 0.0], params=rungs, mode=[-1] * 10, t=0.0)
    findings = event_selection(ladder(10), start, range(10), np.ones(2), 0, 1e-8)
    assert all(finding.passed for finding in findings)
    combinations = list(lock_combinations(range(10)))
    assert len(set(combinations)) == len(combinations) == 256
    assert {(), tuple(range(10)), *((k,) for k in range(10))} <= set(combinations)
    assert len(list(lock_combinations((5, 2)))) == 4


# Findings and their table.


def test_bounds():
    assert Finding.at_most("a", 1.0, 1.0, "").passed
    assert not Finding.at_most("a", 1.1, 1.0, "").passed
    assert not Finding.above("a", 1.0, 1.0, "").passed
    assert Finding.above("a", 1.1, 1.0, "").passed
    assert not Finding.at_most("a", np.nan, 1.0, "").passed
    assert not Finding.above("a", np.nan, 1.0, "").passed


def test_columns_are_aligned():
    table = Finding.table(
        [
            Finding.at_most("short", 0.123456, 1, "one"),
            Finding("longer", False, np.nan, "x", "two"),
        ]
    )
    assert table.split("\n") == [
        "     condition  found  needed  the number is",
        "yes  short      0.123  <= 1    one",
        "NO   longer     -      x       two",
    ]


# A plank that lands on two feet, each of which takes a share of its velocity.

HALF = 0.2
TAKEN = 0.3
# Of a mass of 1: either foot is the centre of percussion of the other.
APART = HALF**2


@field
def plank_field(t, y, mode, params, dy):
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], -9.81, 0.0
    for foot, side in enumerate((-HALF, HALF)):
        if mode[foot] > 0:
            force = -400.0 * (y[0] + side * y[1])
            dy[2] += force
            dy[3] += side * force / params[0]


@guards
def plank_feet(t, y, dy, mode, params, h, hdot):
    for foot, side in enumerate((-HALF, HALF)):
        h[foot] = -y[0] - side * y[1]
        hdot[foot] = -dy[0] - side * dy[1]


@on_event
def impulse(t, y, mode, params, guard, direction):
    if direction > 0:
        side = HALF * (2 * guard - 1)
        taken = -TAKEN * (y[2] + side * y[3]) / (1.0 + side**2 / params[0])
        y[2] += taken
        y[3] += side * taken / params[0]
    return 0


PLANK = System(
    plank_field, plank_feet, impulse, n_states=4, guard_names=("left", "right")
)
TOUCH = np.array([0.0, 0.0, -1.0, 0.3])
BOTH = {"mode": [-1, -1], "guards": ("left", "right")}


def before_contact(state, duration=0.03):
    """Return where a plank in flight was before, m, rad and their rates."""
    y = np.array(state)
    y[:2] -= duration * y[2:]
    y[0] -= 9.81 * duration**2 / 2.0
    y[2] += 9.81 * duration
    return y


def landed(state, inertia):
    """Return the state 20 ms after a touch, of a flight that passes near `state`."""
    start = before_contact(state)
    options = {"params": [inertia], "rtol": 1e-12, "atol": 1e-14}
    return solve(PLANK, (0.0, 0.05), start, **options).y_end


@pytest.mark.parametrize(("inertia", "is_one"), [(APART, True), (0.5 * APART, False)])
def test_a_landing_with_impulses_that_commute_has_one_derivative(inertia, is_one):
    """The flow jumps at each contact, and yet the landing is smooth at this state."""
    report = check_c1(PLANK, TOUCH, params=[inertia], **BOTH)
    assert report.verdict == "not event-selected"
    assert report.landing_has_one_derivative == report.ends_as_one == is_one
    assert (LANDING in str(report)) == is_one

    # Landings on both sides of the simultaneous contact, in either order, say the same.
    roll = np.array([0.3, 1.0, 0.2, 0.5])
    step = 1e-5
    at = landed(TOUCH, inertia)
    left = (landed(TOUCH + step * roll, inertia) - at) / step
    right = (at - landed(TOUCH - step * roll, inertia)) / step
    assert (np.abs(left - right).max() < 0.05) == is_one
    if is_one:
        flow = bouligand_derivative(PLANK, TOUCH, params=[inertia], **BOTH)
        orders = flow.pieces()
        assert len(orders) == 2
        np.testing.assert_allclose(orders[0].matrix, orders[1].matrix, atol=1e-9)


def test_a_flow_without_jumps_needs_no_words_on_the_landing():
    """Nor has a landing whose products differ one derivative."""
    smooth = check_c1(ladder(2), [1.0, 0.0], params=(1, 1, 0.5, 0.2), mode=[-1, -1])
    assert smooth.landing_has_one_derivative
    assert LANDING not in str(smooth)
    slide = check_c1(sliding(), [0.0], params=(1.0, 2.0), mode=[-1])
    assert not slide.landing_has_one_derivative
    bounce = check_c1(ball(), [0.0, -2.0], params=(9.81, 0.0, 0.8), mode=[-1])
    assert not bounce.landing_has_one_derivative
