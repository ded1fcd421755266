"""Bouligand derivatives where guards are met again, and with laws for several guards."""

import numpy as np
import pytest

from hopdata.hybrid import System, field, guards, on_event, solve, together
from hopdata.hybrid.first_order import (
    NoDerivativeError,
    bouligand_derivative,
    check_c1,
)


@field
def free(t, y, mode, params, dy):  # places and velocities of three equal balls
    for i in range(3):
        dy[i], dy[3 + i] = y[3 + i], 0.0


@guards
def gaps(t, y, dy, mode, params, h, hdot):
    for i in range(2):
        h[i], hdot[i] = y[i + 1] - y[i], dy[i + 1] - dy[i]


@on_event
def swap(t, y, mode, params, guard, direction):
    if direction < 0:
        kept = y[3 + guard]
        y[3 + guard] = y[4 + guard]
        y[4 + guard] = kept
    return 0


@together
def sort(t, y, mode, params, due):
    """Elastic balls of one mass exchange their velocities until they are in order."""
    y[3:] = np.sort(y[3:])
    return 0


@together
def stop(t, y, mode, params, due):
    y[3:] = np.mean(y[3:])
    return 0


BALLS = {"n_states": 6, "guard_names": ("left", "right")}
MET = [0.0, 0.0, 0.0, 2.0, 1.0, -2.0]
OPEN = {"mode": [1, 1]}


def test_a_law_that_is_the_limit_of_the_handlers_has_the_derivative_of_these():
    """Elastic balls might as well pass: their deviations change places."""
    system = System(free, gaps, swap, together=sort, **BALLS)
    found = bouligand_derivative(system, MET, **OPEN)
    passed = [2, 1, 0, 5, 4, 3]
    for seed in (91, 92, 93, 94, 95):
        v = np.random.default_rng(seed).normal(size=6)
        np.testing.assert_allclose(found(v), v[passed], rtol=0, atol=1e-12)
    orders = {piece.guards for piece in found.pieces()}
    assert len(orders) == 2
    for piece in found.pieces():
        np.testing.assert_allclose(piece.matrix, np.eye(6)[passed], atol=1e-12)


def test_a_law_that_the_neighbours_do_not_follow_leaves_no_derivative():
    system = System(free, gaps, swap, together=stop, **BALLS)
    with pytest.raises(NoDerivativeError, match="the flow jumps"):
        bouligand_derivative(system, MET, **OPEN)(np.eye(6)[0])
    report = check_c1(system, MET, **OPEN)
    assert report.verdict != "C1"
    assert "the flow jumps" in report.products.detail
    assert "NO   all orders have one saltation product" in str(report)


@field
def circles(t, y, mode, params, dy):
    dy[0], dy[1] = -1.0 * mode[1], 1.0 * mode[0]


@guards
def axes(t, y, dy, mode, params, h, hdot):
    h[0], h[1], hdot[0], hdot[1] = y[0], y[1], dy[0], dy[1]


def test_neighbours_that_circle_about_a_corner_leave_no_derivative():
    named = {"n_states": 2, "guard_names": ("x", "y")}
    system = System(circles, axes, sliding=("x", "y"), **named)
    with pytest.raises(NoDerivativeError, match="again and again"):
        bouligand_derivative(system, [0.0, 0.0], mode=[1, 1])([1.0, 0.3])


@field
def folds(t, y, mode, params, dy):
    dy[0], dy[1] = 1.0, 0.0


def test_a_two_fold_is_refused():
    system = System(folds, axes, n_states=2, guard_names=("x", "y"), sliding=("y",))
    with pytest.raises(NoDerivativeError, match="two-fold"):
        bouligand_derivative(system, [0.0, 0.0], mode=[-1, 0])


ANGLES = 2.0 * np.pi / 3.0 * np.arange(3)
FEET = np.column_stack([np.ones(3), np.cos(ANGLES), np.sin(ANGLES)])


@field
def flies(t, y, mode, params, dy):  # height and two tilts of a tripod, and their rates
    for i in range(3):
        dy[i], dy[3 + i] = y[3 + i], 0.0


@guards
def tripod(t, y, dy, mode, params, h, hdot):
    for k in range(3):
        h[k] = FEET[k, 0] * y[0] + FEET[k, 1] * y[1] + FEET[k, 2] * y[2]
        hdot[k] = FEET[k, 0] * dy[0] + FEET[k, 1] * dy[1] + FEET[k, 2] * dy[2]


@on_event
def stops_foot(t, y, mode, params, guard, direction):
    """Stop a foot by an impulse at it; params[0] is the moment of inertia.

    A tenth of its speed is left: where a foot rests, rounding decides about its lock.
    """
    if direction < 0:
        n = FEET[guard]
        speed = n[0] * y[3] + n[1] * y[4] + n[2] * y[5]
        impulse = 0.9 * speed / (n[0] ** 2 + (n[1] ** 2 + n[2] ** 2) / params[0])
        y[3] -= n[0] * impulse
        y[4] -= n[1] * impulse / params[0]
        y[5] -= n[2] * impulse / params[0]
    return 0


@pytest.mark.parametrize("seed", [51, 52, 53])
def test_a_plastic_impact_of_three_feet_has_a_derivative_only_if_feet_do_not_couple(
    seed,
):
    """With a moment of inertia of 1/2, an impulse at a foot does not move the others."""
    names = {"n_states": 6, "guard_names": ("a", "b", "c")}
    system = System(flies, tripod, stops_foot, **names)
    landed = np.array([0.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    deviations = np.random.default_rng(seed).normal(size=(4, 6))
    apart = bouligand_derivative(system, landed, params=[0.5], mode=[1, 1, 1])
    coupled = bouligand_derivative(system, landed, params=[0.3], mode=[1, 1, 1])
    back = np.zeros(6)
    back[:3] = -0.5 * landed[3:]
    ends = {}
    for inertia in (0.5, 0.3):
        for number, v in enumerate([0.0 * landed, *deviations]):
            start = landed + back + 1e-6 * v
            found = solve(system, (0.0, 1.0), start, params=[inertia], mode=[1, 1, 1])
            ends[inertia, number] = found.y_end
    refused = 0
    for number, v in enumerate(deviations, 1):
        # The deviation at the instant of the landing, and its end, by the flow.
        met = v.copy()
        met[:3] += 0.5 * v[3:]
        after = apart(met)
        after[:3] += 0.5 * after[3:]
        moved = (ends[0.5, number] - ends[0.5, 0]) / 1e-6
        np.testing.assert_allclose(after, moved, rtol=0, atol=1e-5)
        jump = np.abs(ends[0.3, number] - ends[0.3, 0]).max()
        if jump < 1e-3:  # in the order of the numbers, as the trajectory itself
            assert np.isfinite(coupled(met)).all()
            continue
        refused += 1
        with pytest.raises(NoDerivativeError, match="the flow jumps"):
            coupled(met)
    assert refused > 0
