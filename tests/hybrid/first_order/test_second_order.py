"""Table 1.1's second column on bodies that have the form, and on ones that miss one condition."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ladder

from hopdata.hybrid import System, field, guards, on_event
from hopdata.hybrid.first_order import check_c1
from hopdata.hybrid.first_order.second_order import ADDITIVE, BY_POSITION, GROUPED
from hopdata.hybrid.first_order.smoothness import IS_SELECTED

FEET = ("left", "middle", "right")
# Strengths of what breaks the form, by their places in the parameters.
STIFFNESS, COUPLING, DRIFT, OF_SPEED, OF_SPEED_SQUARED, OF_TIME, SWAP = range(7)


@field
def body(t, y, mode, params, dy):
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], -9.81, 0.0
    down = 0
    for leg, side in enumerate((-0.2, 0.0, 0.2)):
        if mode[leg] > 0:
            push = params[0] * (0.5 - y[0] - side * y[1]) - 3.0 * y[2]
            push *= 1.0 + params[1] * down
            dy[2] += push
            dy[3] += 10 * side * push
            dy[0] += params[2]
            down += 1


@guards
def feet(t, y, dy, mode, params, h, hdot):
    for leg, side in enumerate((-0.2, 0.0, 0.2)):
        h[leg] = 0.5 - y[0] - side * y[1] - params[3] * y[2] - params[4] * y[3] ** 2
        h[leg] -= params[5] * t
        hdot[leg] = (
            -dy[0] - side * dy[1] - params[3] * dy[2] - 2 * params[4] * y[3] * dy[3]
        )
        hdot[leg] -= params[5]


@on_event
def kick(t, y, mode, params, guard, direction):
    y[2] *= 0.9
    return 0


def report(handler=None, **broken):
    params = np.zeros(7)
    params[STIFFNESS] = 400.0
    for name, strength in broken.items():
        params[globals()[name]] = strength
    system = System(body, feet, handler, n_states=4, guard_names=FEET)
    state = [0.5, 0.0, -2.0, 0.0]
    return check_c1(system, state, params=params, mode=[-1, -1, -1], guards=FEET)


def missing(found):
    return [finding.condition for finding in found.fopas if not finding.passed]


def test_pushes_that_add_have_the_form():
    found = report()
    assert found.verdict == "C1"
    assert missing(found) == []
    assert found.is_fopas
    grouped = found.fopas[1]
    assert grouped.value == 2
    assert grouped.detail.endswith(
        "y[0] with its velocity y[2], y[1] with its velocity y[3]"
    )
    lines = str(found).split("\n")
    assert "(FoPAS), sufficient for C1 and not necessary" in lines[-6]
    assert [line[:3] for line in lines[-5:-1]] == ["yes"] * 4
    assert lines[-1] == "FoPAS: every line holds, and so the flow is C1"


@pytest.mark.parametrize(
    ("broken", "condition", "size"),
    [
        ({"COUPLING": 0.01}, ADDITIVE, 1e-2),
        ({"COUPLING": 1e-5}, ADDITIVE, 1e-5),
        ({"DRIFT": 0.1}, GROUPED, 0),
        ({"OF_SPEED": 0.01}, BY_POSITION, 1e-2),
        ({"OF_SPEED_SQUARED": 1.0}, BY_POSITION, 1e-3),
        ({"OF_TIME": 0.01}, BY_POSITION, 1e-2),
    ],
)
def test_what_breaks_the_form_is_the_line_that_fails(broken, condition, size):
    found = report(**broken)
    assert condition in missing(found)
    assert not found.is_fopas
    value = next(f.value for f in found.fopas if f.condition == condition)
    assert size / 5 <= value <= 5 * size
    assert missing(found) == [condition]
    assert str(found).split("\n")[-1] == found.of_second_column
    asked = "a line fails, which decides nothing"
    if condition == GROUPED:
        asked = "not asked without positions and velocities"
    assert asked in found.of_second_column


def test_coupled_feet_are_no_longer_one_map():
    assert report(COUPLING=0.5).verdict == "event-selected, not C1"


def test_a_jump_of_velocity_is_left_to_the_first_column():
    found = report(kick)
    assert found.verdict == "not event-selected"
    assert missing(found) == [IS_SELECTED]
    assert found.fopas[0].value == 1
    assert not found.is_fopas


def test_the_form_is_not_necessary():
    """One rung changes the speed of a point directly: C1, but by no acceleration."""
    found = check_c1(ladder(1), [1.0, 0.0], params=(1.0, 0.5), mode=[-1])
    assert found.verdict == "C1"
    assert len(missing(found)) > 0
    assert not found.is_fopas
    # NO is the mark of what a C1 flow needs, and "no" of what it can do without.
    told = str(found)
    assert "NO " not in told
    assert "does not hold" not in told
    assert len(missing(found)) == sum(line[:3] == "no " for line in told.split("\n"))


@field
def turned(t, y, mode, params, dy):
    """The same body with its coordinates in another order, and other units of its speeds."""
    dy[3], dy[1] = 2.0 * y[0], 3.0 * y[2] + 0.1 * y[3] * y[0]
    dy[0], dy[2] = -9.81 / 2.0, 0.0
    for leg, side in enumerate((-0.2, 0.0, 0.2)):
        if mode[leg] > 0:
            push = 400.0 * (0.5 - y[3] - side * y[1])
            dy[0] += push / 2.0
            dy[2] += 10 * side * push / 3.0


@guards
def turned_feet(t, y, dy, mode, params, h, hdot):
    for leg, side in enumerate((-0.2, 0.0, 0.2)):
        h[leg], hdot[leg] = 0.5 - y[3] - side * y[1], -dy[3] - side * dy[1]


def test_positions_may_be_given():
    system = System(turned, turned_feet, n_states=4, guard_names=FEET)
    options = {"mode": [-1, -1, -1], "guards": FEET}
    state = [-1.0, 0.0, 0.1, 0.5]
    guessed = check_c1(system, state, **options)
    assert guessed.verdict == "C1"
    assert missing(guessed)[:2] == [GROUPED, BY_POSITION]
    assert "may be given as positions=" in guessed.fopas[1].detail
    assert check_c1(system, state, positions=[3, 1], **options).is_fopas
    for wrong in ([3], [3, 1, 0], [0, 2], [3, 3]):
        assert GROUPED in missing(check_c1(system, state, positions=wrong, **options))


@field
def on_massless_feet(t, y, mode, params, dy):
    """A body on two legs with springs and dampers; their feet have no mass."""
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], -9.81, 0.0
    for leg, side in enumerate((-0.2, 0.2)):
        if mode[leg] > 0:
            push = 400.0 * (0.5 - y[0] - side * y[1])
            push -= params[0] * (y[2] + side * y[3])
            dy[2] += push
            dy[3] += 10 * side * push


@guards
def without_force(t, y, dy, mode, params, h, hdot):
    """A foot of no mass leaves the floor when its force vanishes, not at a length."""
    for leg, side in enumerate((-0.2, 0.2)):
        gap, gap_rate = y[0] + side * y[1] - 0.5, y[2] + side * y[3]
        h[leg] = -400.0 * gap - params[0] * gap_rate
        hdot[leg] = -400.0 * (dy[0] + side * dy[1])
        hdot[leg] -= params[0] * (dy[2] + side * dy[3])


@pytest.mark.parametrize(
    ("damping", "broken"),
    [(0.0, []), (10.0, [BY_POSITION])],
    ids=["springs", "dampers"],
)
def test_massless_feet_with_dampers_lift_off_by_velocity(damping, broken):
    """Their force vanishes before the leg has its rest length: at a gap of -c v / k."""
    system = System(
        on_massless_feet, without_force, n_states=4, guard_names=("left", "right")
    )
    speed = 2.0
    state = [0.5 - damping * speed / 400.0, 0.0, speed, 0.0]
    found = check_c1(system, state, params=[damping], mode=[1, 1])
    assert found.guards == ("left", "right")
    assert missing(found) == broken
    share = next(f.value for f in found.fopas if f.condition == BY_POSITION)
    assert share == pytest.approx(damping / (400.0 + damping))
