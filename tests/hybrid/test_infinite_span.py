"""An infinite time span: an event, the handler or a limit ends the integration."""

from __future__ import annotations

from math import inf, log, pi, sqrt

import numpy as np
import pytest

from hopdata.hybrid import System, field, guards, on_event, solve, solve_batch
from hopdata.hybrid.layout import (
    FINISHED,
    NO_END,
    TERMINATED,
    TOO_MANY_EVENTS,
    TOO_MANY_STEPS,
)

G = 9.81


@field
def fall(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -9.81


@guards
def floor(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = -y[0], -dy[0]


@field
def decay(t, y, mode, params, dy):
    dy[0] = -params[0] * y[0]


@guards
def level(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = params[1] - y[0], -dy[0]


@field
def clock(t, y, mode, params, dy):
    dy[0] = params[0]


@guards
def sine(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = np.sin(y[0]), np.cos(y[0]) * dy[0]


@on_event
def third(t, y, mode, params, guard, direction):
    mode[1] += 1
    return 1 if mode[1] == 3 else 0


def falling(**options):
    return System(fall, floor, n_states=2, guard_names=("floor",), **options)


DROPPED = falling(terminal=(True,))
DECAYING = System(decay, level, n_states=1, guard_names=("level",), terminal=(True,))


@pytest.mark.parametrize("start", [0.0, -3.0, 1e6])
@pytest.mark.parametrize("height", [1e-6, 1.0, 1e6])
def test_a_terminal_event_ends_a_fall(start, height):
    solution = solve(DROPPED, (start, inf), [height, 0.0])
    assert solution.status == TERMINATED
    assert solution.t_end - start == pytest.approx(
        sqrt(2 * height / G), rel=1e-9, abs=1e-9
    )
    assert solution.y_end[1] == pytest.approx(-sqrt(2 * height * G), rel=1e-6)
    assert solution.n_steps < 100


@pytest.mark.parametrize("rate", [1e-9, 1.0, 1e9])
def test_time_scales_from_nanoseconds_to_decades(rate):
    solution = solve(DECAYING, (0, inf), [1.0], params=[rate, 0.01])
    assert solution.t_end * rate == pytest.approx(log(100), rel=1e-8)


def test_a_guard_that_bends_is_looked_at_as_densely_as_ever():
    system = System(clock, sine, n_states=1, guard_names=("sine",), terminal=(60,))
    solution = solve(system, (0, inf), [0.5], params=[1.0])
    assert solution.events.time == pytest.approx(pi * np.arange(1, 61) - 0.5, rel=1e-9)


def test_the_handler_may_end_it():
    system = System(
        clock, sine, third, n_states=1, guard_names=("sine",), n_extra_modes=1
    )
    solution = solve(system, (0, inf), [0.5], params=[1.0])
    assert solution.status == TERMINATED
    assert solution.t_end == pytest.approx(3 * pi - 0.5)


def test_limits_may_end_it():
    system = System(clock, sine, n_states=1, guard_names=("sine",))
    run = (0, inf), [0.5]
    assert solve(system, *run, params=[1.0], max_events=7).status == TOO_MANY_EVENTS
    assert solve(system, *run, params=[1.0], max_steps=99).status == TOO_MANY_STEPS


def solve_one_of_many(system, t_span, start):
    return solve_batch(system, t_span, [start])


@pytest.mark.parametrize("ask", [solve, solve_one_of_many])
def test_without_anything_that_may_end_it_it_is_refused(ask):
    with pytest.raises(
        ValueError, match=r"t_span: expected a finite end, .*terminal.*max_events"
    ):
        ask(falling(), (0, inf), [1.0, 0.0])
    assert solve(falling(), (0, 1), [1.0, 0.0]).status == FINISHED
    with pytest.raises(ValueError, match="t_span: expected a finite start"):
        ask(DROPPED, (-inf, inf), [1.0, 0.0])
    with pytest.raises(ValueError, match="t_span"):
        ask(DROPPED, (0, np.nan), [1.0, 0.0])


def test_an_event_that_never_comes_is_told():
    solution = solve(DECAYING, (0, inf), [1.0], params=[1.0, -1.0])
    assert solution.status == NO_END
    assert not solution.success
    assert "t_span is infinite" in solution.message
    assert solution.t_end > 1e300
    assert solution.n_steps < 5000


def test_time_runs_backward_without_end():
    solution = solve(DROPPED, (2, -inf), [1.0, 0.0])
    assert solution.status == TERMINATED
    assert solution.t_end == pytest.approx(2 - sqrt(2 / G))


def test_a_batch_has_the_same_bytes():
    heights = np.array([[0.5, 0.0], [1.0, 0.0], [2.0, 0.1], [0.5, 0.0]])
    for lanes in (False, True):
        batch = solve_batch(DROPPED, (0, inf), heights, jacobian=True, lanes=lanes)
        for row, start in enumerate(heights):
            alone = solve(DROPPED, (0, inf), start, jacobian=True)
            assert batch.t_end[row] == alone.t_end
            assert batch.y_end[row].tobytes() == alone.y_end.tobytes()
            assert batch.jacobian[row].tobytes() == alone.jacobian.tobytes()
    told = solve_batch(DROPPED, (0, inf), heights, lanes=True).lanes_reason
    assert told == "the end of t_span is infinite"


def test_derivative_samples_and_dense_output_are_those_of_a_finite_span():
    options = {"jacobian": True, "dense_output": True}
    endless = solve(DROPPED, (0, inf), [1.0, 0.0], **options)
    finite = solve(DROPPED, (0, 9), [1.0, 0.0], **options)
    assert endless.jacobian == pytest.approx(finite.jacobian, rel=1e-8)
    assert endless(0.2) == pytest.approx(finite(0.2), rel=1e-9)
    sampled = solve(DROPPED, (0, inf), [1.0, 0.0], t_eval=[0.0, 0.1, 0.3, 5.0])
    assert sampled.t.tolist() == [0.0, 0.1, 0.3]
    assert sampled.y[0] == pytest.approx([1.0, 1 - G * 0.01 / 2, 1 - G * 0.09 / 2])
    with pytest.raises(ValueError, match="t_eval"):
        solve(DROPPED, (0, inf), [1.0, 0.0], t_eval=[0.1, inf])


def test_a_finite_run_after_an_infinite_one_ends_where_it_should():
    system = falling(terminal=(True,))
    first = solve(system, (0, 0.1), [1.0, 0.0])
    solve(system, (0, inf), [1.0, 0.0])
    again = solve(system, (0, 0.1), [1.0, 0.0])
    assert again.status == FINISHED
    assert again.t.tobytes() == first.t.tobytes()
