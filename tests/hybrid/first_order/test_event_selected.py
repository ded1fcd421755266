"""Definitions 1.2.1 and 1.2.2 and table 1.1's first column, each line broken alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hybrid_systems import ladder

from hopdata.hybrid import System, field, guards, on_event
from hopdata.hybrid.first_order import check_c1
from hopdata.hybrid.first_order.event_selected import (
    CONTINUOUS,
    EVENT_FUNCTIONS,
    EXTENDED,
    KEPT,
    ONCE,
    SURFACES,
    liveness_constant,
)
from hopdata.hybrid.first_order.linearise import instant

ALL = (EVENT_FUNCTIONS, EXTENDED, CONTINUOUS, SURFACES, ONCE, KEPT)
# Strengths of what breaks a line, by their places in the parameters.
STOP, TURN, GRAZE, JUMP, BEND, KINK, CUSP, STEP = range(8)


@field
def crossing(t, y, mode, params, dy):
    """A point moves along x and y at speed 1; crossings may stop or turn it."""
    dy[0] = 1.0 - params[2]
    dy[1] = 1.0
    if mode[0] > 0:
        dy[0] -= params[0]
        dy[1] -= params[1]
    dy[0] += params[5] * abs(y[2]) + params[6] * abs(y[2]) ** 1.5
    dy[0] += params[7] * np.sign(y[2])
    dy[2] = 0.0


@guards
def planes(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] + params[4] * abs(y[2])
    hdot[0] = dy[0] + params[4] * np.sign(y[2]) * dy[2]
    h[1] = y[1]
    hdot[1] = dy[1]


@on_event
def push(t, y, mode, params, guard, direction):
    y[2] += params[3]
    return 0


SYSTEM = System(crossing, planes, push, n_states=3, guard_names=("x", "y"))


def report(**broken):
    params = np.zeros(8)
    for name, strength in broken.items():
        params[globals()[name]] = strength
    return check_c1(SYSTEM, np.zeros(3), params=params, mode=[-1, -1])


def missing(found):
    return [f.condition for f in found.selection if not f.passed]


def value(found, condition):
    return next(f.value for f in found.selection if f.condition == condition)


def test_every_line_holds():
    found = report()
    assert missing(found) == []
    assert found.verdict == "C1"
    assert [f.condition for f in found.selection[1:]] == list(ALL)
    assert found.fopas[0].passed


@pytest.mark.parametrize(
    ("broken", "lines", "condition", "size"),
    [
        ({"JUMP": 0.1}, [CONTINUOUS], CONTINUOUS, 0.2),
        # Slopes of 0.5 and 1.5, over the one ahead.
        ({"BEND": 0.5}, [SURFACES], SURFACES, 1.0 / 1.5),
        # Beyond x the point goes back in y: a contact in y would be broken again. A
        # line of the checklist fails with the definition that it puts in words.
        ({"TURN": 1.5}, [EVENT_FUNCTIONS, ONCE], EVENT_FUNCTIONS, -1.0),
        ({"TURN": 1.5}, [EVENT_FUNCTIONS, ONCE], ONCE, 2.0),
        # All velocity is lost in x: it stays on the surface.
        ({"STOP": 1.0}, [EVENT_FUNCTIONS, KEPT], KEPT, 0.0),
        # No velocity to begin with: the surface of x is touched, not crossed.
        ({"GRAZE": 1.0}, [EVENT_FUNCTIONS, ONCE], EVENT_FUNCTIONS, 0.0),
        ({"KINK": 0.3}, [EXTENDED], EXTENDED, 0.6),
        # A jump: its slope doubles when the step is halved.
        ({"STEP": 0.1}, [EXTENDED], EXTENDED, 1.0),
    ],
)
def test_what_breaks_a_line_is_the_line_that_fails(broken, lines, condition, size):
    found = report(**broken)
    assert missing(found) == lines
    assert found.verdict == "not event-selected"
    assert value(found, condition) == pytest.approx(size, rel=0.1, abs=1e-12)
    assert found.fopas[0].value == len(lines)
    assert not found.is_fopas


@pytest.mark.parametrize("broken", [{"TURN": 0.9}, {"STOP": 0.9}, {"GRAZE": 0.9}])
def test_almost_broken_is_not_broken(broken):
    found = report(**broken)
    assert missing(found) == []


def test_a_field_need_be_no_smoother_than_c1():
    """|z| to the power 3/2 has a slope everywhere, and no curvature at z = 0."""
    assert missing(report(CUSP=1.0)) == []


def test_where_a_guard_and_a_mode_fail_is_told():
    detail = next(f.detail for f in report(TURN=1.5).ess if f.condition == ONCE)
    assert "of 8, in which" in detail
    assert detail.endswith("first: y with x crossed")


def test_where_a_field_has_a_kink_is_told():
    """Beyond either plane x has a kink along z; without one nothing is named."""
    for crossed in ({"KINK": 0.3}, {"STEP": 0.1}):
        (extended,) = [
            f for f in report(**crossed).selection if f.condition == EXTENDED
        ]
        assert "; first and worst: dy[0] with none crossed; a max" in extended.detail
    (extended,) = [f for f in report(CUSP=1.0).selection if f.condition == EXTENDED]
    assert "worst" not in extended.detail


def test_the_liveness_constant_is_the_smallest_rate_nearby():
    """On a ladder the speed is 1 before the first rung, and never less than 0.25."""
    params = (1.0, 1.0, 1.0, -0.5, -0.25, 0.75)
    state = [1.0, 0.0]
    start = instant(ladder(3), state, params=params, mode=[-1, -1, -1], t=0.0)
    size = np.ones(2)
    for radius in (1e-3, 0.3):
        found = liveness_constant(ladder(3), start, (0, 1, 2), size, radius)
        assert found == pytest.approx(0.25, abs=1e-12)


@field
def slowing(t, y, mode, params, dy):
    dy[0] = 1.0 - y[1]
    dy[1] = 0.0


@guards
def first(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    hdot[0] = dy[0]


def test_the_neighbourhood_is_the_users():
    """x moves at 1 - y: an event function near y = 0, but not as far as y = 1."""
    system = System(slowing, first, n_states=2, guard_names=("x",))
    constants = {}
    for radius in (0.01, 1.0, 4.0):
        start = instant(system, [0.0, 0.0], params=(), mode=[-1], t=0.0)
        constants[radius] = liveness_constant(system, start, (0,), np.ones(2), radius)
        found = check_c1(system, [0.0, 0.0], mode=[-1], radius=radius)
        assert found.verdict == "C1"  # whatever the radius: the definition is local
        detail = found.definitions[1].detail
        assert f"within {radius:g} of the state" in detail
        assert f"the constant is {constants[radius]:.3g} (x)" in detail
    assert 0.99 <= constants[0.01] < 1.0
    assert 0.0 <= constants[1.0] < 0.8
    assert constants[4.0] < 0.0
    with pytest.raises(ValueError, match="radius"):
        check_c1(system, [0.0, 0.0], mode=[-1], radius=0.0)


@field
def rubbed(t, y, mode, params, dy):
    """A foot with Coulomb friction: params[1] is the speed below which it is smooth."""
    dy[0], dy[1], dy[2] = y[1], -9.81, 0.0
    if mode[0] > 0:
        push = params[0] - 100.0 * y[0]
        dy[1] += push
        if params[1] > 0:
            dy[2] = -0.4 * push * y[2] / math.hypot(y[2], params[1])
        else:
            dy[2] = -0.4 * push * np.sign(y[2])


@guards
def foot(t, y, dy, mode, params, h, hdot):
    h[0] = -y[0]
    hdot[0] = -dy[0]


@pytest.mark.parametrize(
    ("slide", "smooth_below", "lines"),
    [(0.0, 0.0, [EXTENDED]), (0.0, 0.1, []), (0.3, 0.0, [])],
    ids=["from rest", "regularised", "sliding"],
)
def test_coulomb_friction_has_no_extension_where_it_turns(slide, smooth_below, lines):
    system = System(rubbed, foot, n_states=3, guard_names=("foot",))
    found = check_c1(system, [0.0, -2.0, slide], params=[20.0, smooth_below], mode=[-1])
    assert missing(found) == lines


# Three feet whose impacts change each other's speeds: how a speed answers an impulse.
ANSWERS = np.array([[1.0, 0.4, -0.3], [0.4, 1.5, 0.2], [-0.3, 0.2, 0.8]])


@field(compiled=False)
def falling_feet(t, y, mode, params, dy):
    dy[:3] = y[3:]
    dy[3:] = 0.0


@guards(compiled=False)
def floors(t, y, dy, mode, params, h, hdot):
    h[:] = y[:3]
    hdot[:] = dy[:3]


@on_event(compiled=False)
def impact(t, y, mode, params, guard, direction):
    order = params[1:].astype(int)  # which foot a guard is of
    answers = ANSWERS[np.ix_(order, order)]
    y[3:] -= answers[:, guard] * params[0] * y[3 + guard] / answers[guard, guard]
    return 0


FEET = System(
    falling_feet, floors, impact, n_states=6, guard_names=("one", "two", "three")
)


@pytest.mark.parametrize("lost", [0.0, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0), (2, 1, 0)])
def test_what_an_impact_leaves_of_a_speed_is_its_own_share_in_any_order(lost, order):
    start = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    found = check_c1(FEET, start, params=[lost, *order], mode=[-1, -1, -1])
    assert value(found, KEPT) == pytest.approx(1.0 - lost, abs=1e-12)
    assert (KEPT in missing(found)) == (lost == 1.0)
