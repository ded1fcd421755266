"""Ranges of the guards that serve several steps: fewer runs, and the same events."""

import numpy as np
import pytest

from hopdata.hybrid import System, solve


def turn(t, y):
    return -y[1], y[0]


def far(t, y):
    return y[0] - 3.0


def test_steps_in_a_box_need_no_run_of_the_guards():
    system = System(turn, far, n_states=2, guard_names=("far",))
    done = solve(system, (0.0, 100.0), [1.0, 0.0], method="dopri5")
    assert done.proven
    assert len(done.events) == 0
    # Each step evaluates the guards at its end once.
    runs = done.n_guard_evaluations - done.n_steps - done.n_rejected
    assert runs < 0.5 * done.n_steps


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
@pytest.mark.parametrize("soon", [0.02, 0.1, 0.4])
def test_a_handler_that_moves_another_guard_ends_the_box(rtol, soon):
    """After the alarm at 5 s, a guard far away is met soon, and once in each turn."""
    level = np.cos(5.0 + soon)

    def alarm_and_gate(t, y, mode, params):
        height = params[0] if mode[2] > 0 else 50.0
        return t - 5.0, y[0] - height

    def lower(t, y, mode, guard):
        if guard == 0:
            mode[2] = 1

    system = System(
        turn, alarm_and_gate, lower, n_states=2, guard_names=("alarm", "gate"),
        n_extra_modes=1, directions=(1, 1),
    )  # fmt: skip
    done = solve(
        system, (0.0, 20.0), [1.0, 0.0], params=[level], rtol=rtol, atol=1e-3 * rtol,
        method="dopri5",
    )  # fmt: skip
    assert done.proven
    turns = 5.0 + soon + 2.0 * np.pi * np.arange(3)
    np.testing.assert_allclose(done.events.of("gate").time, turns, atol=1e4 * rtol)
