"""A start on a guard's surface: is it told that no derivative exists there?"""

import numpy as np
import pytest

from hopdata.hybrid import System, solve


def flight(t, y):  # height (m), climb (m/s), spin (rad/s), angle (rad)
    return y[1], -9.81, 0.0, y[2]


def apex(t, y):
    return y[1]


def brake(t, y, direction):
    return y[0], y[1], 0.5 * y[2], y[3]


def nothing(t, y, direction):
    return y[0], y[1], y[2], y[3]


def braked(handler, **options):
    return System(flight, apex, handler, n_states=4, guard_names=("apex",), **options)


ON = (1.0, 0.0, 2.0, 0.0)
BESIDE = (1.0, 1e-9, 2.0, 0.0)


def angle_after(system, start):
    return solve(system, (0.0, 0.3), start).y_end[3]


def test_a_start_on_a_guard_whose_handler_moves_the_state_is_told():
    system = braked(brake)
    solution = solve(system, (0.0, 0.3), ON, jacobian=True)
    assert solution.surfaces_at_start == ("apex",)
    assert "The start lies on the surface of 'apex'" in solution.message
    # Indeed: starts on the two sides of it end apart.
    assert angle_after(system, BESIDE) < 0.6 * angle_after(system, ON)


@pytest.mark.parametrize(
    ("system", "start", "options"),
    [
        (braked(brake), BESIDE, {"jacobian": True}),
        (braked(nothing), ON, {"jacobian": True}),
        (braked(None), ON, {"jacobian": True}),
        (braked(brake, directions=(1,)), ON, {"jacobian": True}),
        (braked(brake), ON, {"jacobian": True, "mode": (-1,)}),
        (braked(brake), ON, {}),
    ],
    ids=["beside", "identity", "no handler", "other way", "mode", "no derivative"],
)
def test_elsewhere_nothing_is_said(system, start, options):
    solution = solve(system, (0.0, 0.3), start, **options)
    assert solution.surfaces_at_start == ()
    assert "start" not in solution.message


def spring(t, y, mode):
    push = np.where(mode[0] > 0, 50.0 * (0.02 - y[0]), 0.0)
    return y[1], -9.81 + push


def foot(t, y):
    return -y[0]


def test_a_start_at_a_contact_whose_force_jumps_is_told():
    leg = System(spring, foot, n_states=2, guard_names=("foot",))
    on = solve(leg, (0.0, 0.1), (0.0, -1.0), jacobian=True)
    above = solve(leg, (0.0, 0.1), (1e-9, -1.0), jacobian=True)
    assert on.surfaces_at_start == ("foot",)
    assert above.surfaces_at_start == ()
    assert np.abs(on.jacobian - above.jacobian).max() > 1e-2


def test_a_system_with_a_guard_that_slides_tells_nothing():
    system = braked(brake, sliding=("apex",))
    solution = solve(system, (0.0, 0.3), ON, jacobian=True)
    assert solution.surfaces_at_start == ()
