"""A declared law for several guards at one instant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hopdata.errors import ArgumentError
from hopdata.hybrid import System, field, guards, on_event, solve, solve_batch, together
from hopdata.hybrid.first_order import NoDerivativeError, bouligand_derivative
from hopdata.hybrid.layout import NO_LOCK, TIE_IN_JACOBIAN


@field
def free(t, y, mode, params, dy):
    n = len(y) // 2
    for i in range(n):
        dy[i], dy[n + i] = y[n + i], 0.0


@guards
def gaps(t, y, dy, mode, params, h, hdot):
    n = len(y) // 2
    for i in range(n - 1):
        h[i], hdot[i] = y[i + 1] - y[i], dy[i + 1] - dy[i]


@on_event
def swap(t, y, mode, params, guard, direction):
    n = len(y) // 2
    if direction < 0:
        kept = y[n + guard]
        y[n + guard] = y[n + guard + 1]
        y[n + guard + 1] = kept
    return 0


@together
def at_once(t, y, mode, params, due):
    """Moreau's law: impulses >= 0 where each gap opens as fast as it closed, or faster."""
    n = len(y) // 2
    v = y[n:]
    impulses = np.zeros(n - 1)
    before = v[1:] - v[:-1]
    for _ in range(300):
        for i in range(n - 1):
            if due[i] < 0:
                off = v[i + 1] - v[i] + before[i]
                change = max(-0.5 * off, -impulses[i])
                impulses[i] += change
                v[i] -= change
                v[i + 1] += change
    mode[n - 1] += 1
    return 0


row = System(
    free,
    gaps,
    swap,
    n_states=6,
    guard_names=("left", "right"),
    n_extra_modes=1,
    together=at_once,
)
START = [-2.0, -1.0, 2.0, 2.0, 1.0, -2.0]  # all three meet at t = 1


def test_the_law_gives_other_velocities_than_the_order():
    by_law = solve(row, (0.0, 2.0), START)
    in_order = solve(replace(row, together=None), (0.0, 2.0), START)
    # In order, equal balls swap. The law: gaps open at 1 and 3, as they closed.
    np.testing.assert_allclose(in_order.y_end[3:], [-2.0, 1.0, 2.0], atol=1e-14)
    np.testing.assert_allclose(by_law.y_end[3:], np.array([-4, -1, 8]) / 3, atol=1e-14)
    np.testing.assert_allclose(by_law.y_end[:3], np.array([-4, -1, 8]) / 3, atol=1e-14)


def test_the_log_has_a_row_for_each_guard():
    solution = solve(row, (0.0, 2.0), START, mode=[1, 1, 0])
    log = solution.events
    # The law is asked when they meet, and when the locks open again.
    np.testing.assert_array_equal(log.guard, [0, 1, 0, 1])
    np.testing.assert_array_equal(log.direction, [-1, -1, 1, 1])
    np.testing.assert_array_equal(log.mode[:, :2], [[-1, -1]] * 2 + [[1, 1]] * 2)
    np.testing.assert_array_equal(log.mode[:, 2], [1, 1, 2, 2])
    np.testing.assert_allclose(log.before[:2, 3:], [[2.0, 1.0, -2.0]] * 2)
    np.testing.assert_array_equal(solution.mode, [1, 1, 2])
    assert solution.n_events == 4


def test_a_single_impact_is_the_handlers():
    solution = solve(row, (0.0, 0.9), [-1.0, -0.5, 5.0, 1.0, 0.0, 0.0])
    np.testing.assert_array_equal(solution.mode, [1, 1, 0])
    np.testing.assert_allclose(solution.y_end[3:], [0.0, 1.0, 0.0])


def test_events_in_one_direction_only():
    falling = replace(row, directions=(-1, -1))
    solution = solve(falling, (0.0, 2.0), START)
    np.testing.assert_array_equal(solution.events.direction, [-1, -1])
    np.testing.assert_array_equal(solution.mode, [1, 1, 1])


@pytest.mark.parametrize("terminal", [(1, 0), (0, 1)])
def test_a_terminal_event_ends_the_run_after_the_law(terminal):
    solution = solve(replace(row, terminal=terminal), (0.0, 2.0), START)
    assert solution.status == 1
    assert ("left", "right")[terminal.index(1)] in solution.message
    np.testing.assert_allclose(solution.y_end[3:], np.array([-4, -1, 8]) / 3)


@together
def breaks(t, y, mode, params, due):
    mode[1] = 3
    return 0


def test_wrong_laws():
    assert solve(replace(row, together=breaks), (0.0, 2.0), START).status == NO_LOCK
    with pytest.raises(ArgumentError, match="backward"):
        solve(replace(row, undo=swap), (1.0, 0.0), START)


def test_there_is_no_derivative_through_a_law():
    solution = solve(row, (0.0, 2.0), START, jacobian=True)
    assert solution.status == TIE_IN_JACOBIAN
    state = [0.0, 0.0, 0.0, *START[3:]]
    with pytest.raises(NoDerivativeError, match="the flow jumps"):
        bouligand_derivative(row, state, mode=[1, 1, 0])(np.eye(6))
    # By the handlers in order there is one, for each order of the neighbours.
    in_order = replace(row, together=None)
    assert bouligand_derivative(in_order, state, mode=[1, 1, 0]) is not None


def test_a_batch_asks_the_law_too():
    starts = np.array([START, [-1.0, -0.5, 5.0, 1.0, 0.0, 0.0]])
    batch = solve_batch(row, (0.0, 2.0), starts, lanes=True)
    assert "law" in batch.lanes_reason
    for one, start in enumerate(starts):
        alone = solve(row, (0.0, 2.0), start)
        assert alone.y_end.tobytes() == batch.y_end[one].tobytes()
        np.testing.assert_array_equal(batch.mode[one], alone.mode)


@field
def clock(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def alarms(t, y, dy, mode, params, h, hdot):
    for i in range(len(h)):
        h[i], hdot[i] = y[0] - 1.0, dy[0]


@together
def count_alarms(t, y, mode, params, due):
    for i in range(len(due)):
        mode[len(due)] += due[i]
    return 0


@pytest.mark.parametrize("n", [2, 700])
def test_more_guards_at_once_than_the_log_has_room_for(n):
    system = System(
        clock,
        alarms,
        n_states=1,
        guard_names=tuple(f"alarm {i}" for i in range(n)),
        n_extra_modes=1,
        together=count_alarms,
    )
    for keep in (None, []):
        events = "all" if keep is None else keep.append
        solution = solve(system, (0.0, 2.0), [0.0], events=events)
        log = solution.events if keep is None else keep[-1]
        np.testing.assert_array_equal(log.guard, np.arange(n))
        np.testing.assert_array_equal(log.mode[:, -1], n)
        assert solution.mode[-1] == n
        assert solution.n_events == n


def free_and_relay(t, y, mode):
    return y[3], y[4], y[5], 0.0, 0.0, 0.0, -1.0 * mode[2]


def gaps_and_relay(t, y):
    return y[1] - y[0], y[2] - y[1], y[6]


@together
def law_with_relay(t, y, mode, params, due):
    """As `at_once`; mode[3] notes what is told of the relay."""
    mode[3] = due[2]
    velocities = y[3:6]
    impulses = np.zeros(2)
    before = velocities[1:] - velocities[:-1]
    for _ in range(300):
        for i in range(2):
            if due[i] < 0:
                off = velocities[i + 1] - velocities[i] + before[i]
                change = max(-0.5 * off, -impulses[i])
                impulses[i] += change
                velocities[i] -= change
                velocities[i + 1] += change
    return 0


@pytest.mark.parametrize(("relay", "told"), [(0.5, 0), (1.0, -2)])
def test_a_law_beside_a_guard_that_slides(relay, told):
    system = System(
        free_and_relay,
        gaps_and_relay,
        n_states=7,
        guard_names=("left", "right", "relay"),
        n_extra_modes=1,
        sliding=("relay",),
        together=law_with_relay,
    )
    # The relay reaches zero before the balls meet, or at the same instant.
    solution = solve(system, (0.0, 1.5), [*START, relay], mode=[1, 1, 1, 0])
    log = solution.events
    first = log.time < 1.0 + 1e-9
    met = log.mode[first & (log.guard < 2)]
    assert solution.success
    np.testing.assert_array_equal(log.direction[log.guard == 2], [-2])
    np.testing.assert_allclose(log.time[log.guard == 2], relay, rtol=1e-12)
    np.testing.assert_array_equal(met[:2, 3], [told, told])
    np.testing.assert_allclose(solution.y_end[3:6], np.array([-4, -1, 8]) / 3)
    np.testing.assert_allclose(solution.y_end[6], 0.0, atol=1e-14)
    np.testing.assert_array_equal(solution.mode[2:3], [0])
