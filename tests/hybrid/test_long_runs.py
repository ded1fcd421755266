"""Runs that are long, interrupted, or end badly: the results so far are available."""

from __future__ import annotations

import os
import resource
import signal
import sys
import threading
import time
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hybrid_systems import ball, fall_field, growth, ladder, py_raising, raising

from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.hybrid import solve as solve_again
from hopdata.hybrid.layout import GUARD_NOT_FINITE, RAISED, STEP_UNDERFLOW, ZENO

BOUNCES = {"params": (2.0, 0.0, 1.0), "max_events": 10**9, "t_eval": ()}


def test_events_are_counted_in_bounded_memory():
    """4 10^5 bounces with two events each; their log would take 58 MB."""
    count = 400_000
    solve(ball(), (0, 200_001), [1.0, 0.0], events="count", **BOUNCES)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    solution = solve(ball(), (0, 2 * count), [1.0, 0.0], events="count", **BOUNCES)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    assert solution.success
    assert solution.n_events == 2 * count
    assert len(solution.events) == 0
    assert grown < 10  # MB


def test_events_are_handed_over_as_they_come():
    whole, parts = solve(ball(), (0, 3001), [1.0, 0.0], **BOUNCES), []
    solution = solve(ball(), (0, 3001), [1.0, 0.0], events=parts.append, **BOUNCES)
    assert len(parts) > 3
    assert (
        np.concatenate([part.time for part in parts]).tobytes()
        == whole.events.time.tobytes()
    )
    assert sum(len(part) for part in parts) == solution.n_events == whole.n_events
    assert parts[0].guard_names == ("floor",)
    with pytest.raises(
        ValueError, match="events: expected 'all', 'count' or a function"
    ):
        solve(ball(), (0, 1), [1.0, 0.0], params=(2.0, 0.0, 1.0), events="none")
    with pytest.raises(ValueError, match="dense_output"):
        solve(
            ball(),
            (0, 1),
            [1.0, 0.0],
            params=(2, 0, 1),
            events="count",
            dense_output=True,
        )


def test_the_second_event_ends_it():
    for count in (1, 2, 3):
        solution = solve(
            ball(terminal=(count,), directions=(1,)),
            (0, 9),
            [1.0, 0.0],
            params=(2.0, 0.0, 1.0),
        )
        assert solution.status == 1
        assert len(solution.events) == count
        assert solution.t_end == pytest.approx(2 * count - 1, abs=1e-12)
    with pytest.raises(ValueError, match="terminal"):
        ball(terminal=(-1,))


@field
def laborious(t, y, mode, params, dy):
    total = 0.0
    for i in range(int(params[0])):
        total += np.sin(t + i)
    dy[0] = 1.0 + 1e-30 * total


@pytest.mark.parametrize("work", [0, 100_000])
def test_an_interrupt_returns_what_was_reached(work):
    system, options = (
        System(laborious, n_states=1),
        {"max_step": 1e-4, "max_steps": 10**9},
    )
    solve(system, (0.0, 1e-3), [0.0], params=[work], **options)  # compile
    sent = []

    def interrupt():
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.5, interrupt)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt) as stopped:
            solve(system, (0.0, 1e9), [0.0], params=[work], t_eval=[1e9], **options)
        late = time.monotonic() - sent[0]
        timer.join()
    finally:
        signal.signal(signal.SIGINT, before)
    reached = stopped.value.solution
    assert reached.status == RAISED
    assert not reached.success
    assert reached.y_end[0] == pytest.approx(reached.t_end)
    assert reached.t_end > 0.0
    assert reached.n_steps > 0
    assert late < 2.0  # 0.05 s on an idle machine
    assert solve(system, (0.0, 1e-3), [0.0], params=[work], **options).success


def test_a_long_run_says_how_far_it_is_on_a_terminal(monkeypatch, capsys):
    module = sys.modules[solve_again.__module__]
    monkeypatch.setattr(module, "SILENT_S", 0.0)
    solve(ball(), (0, 300_001), [1.0, 0.0], events="count", **BOUNCES)
    assert capsys.readouterr().err == ""  # stderr is not a terminal here
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    solve(ball(), (0, 300_001), [1.0, 0.0], events="count", **BOUNCES)
    told = capsys.readouterr().err
    assert told.startswith("\rt = ")
    assert told.endswith(" steps\n")


@pytest.mark.parametrize("make", [raising, py_raising])
def test_an_exception_brings_what_was_reached(make):
    with pytest.raises((ValueError, LookupError)) as error:
        solve(make(), (0.0, 9.0), [0.0, 0.0], params=(2.0,), max_step=0.1)
    reached = error.value.solution
    assert reached.status == RAISED
    assert 1.8 < reached.t_end <= 2.0
    assert reached.t[-1] == reached.t_end
    assert "a function of the system raised" in reached.message
    assert any("t = 1.9" in note or "t = 2" in note for note in error.value.__notes__)


@field
def beyond(t, y, mode, params, dy):
    for i in range(len(dy) + 1):
        dy[i] = 1.0


@guards
def guards_beyond(t, y, dy, mode, params, h, hdot):
    place = int(params[0])
    h[place], hdot[place] = y[0] - 1.0, dy[0]
    h[0], hdot[0] = y[0] - 1.0, dy[0]


def test_an_index_beyond_its_array_is_named():
    with pytest.raises(
        IndexError, match="index 2 is out of bounds for axis 0 with size 2"
    ) as error:
        solve(System(beyond, n_states=2), (0, 1), [0.0, 0.0], debug=True)
    assert any("field 'beyond'" in note for note in error.value.__notes__)
    system = System(fall_field, guards_beyond, n_states=2, guard_names=("one",))
    with pytest.raises(IndexError, match="index 3 is out of bounds"):
        solve(system, (0, 1), [0.0, 0.0], params=[3.0], debug=True)
    with pytest.raises(ValueError, match="debug: expected True or False"):
        solve(system, (0, 1), [0.0, 0.0], params=[0.0], debug="yes")


def test_debugging_changes_no_result():
    options = {"params": (2.0, 0.0, 0.5)}
    plain = solve(ball(), (0, 2.5), [1.0, 0.3], **options)
    slow = solve(ball(), (0, 2.5), [1.0, 0.3], debug=True, **options)
    assert slow.y_end == pytest.approx(plain.y_end, abs=1e-13)
    assert slow.events.time == pytest.approx(plain.events.time, abs=1e-13)


@guards
def guard_that_ends(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - params[1] if t < 1.0 else np.nan, dy[0]


@on_event
def kick_up(t, y, mode, params, guard, direction):
    y[0] += 1.0 if direction > 0 else -2.0  # beyond the surface, for ever
    return 0


def test_what_goes_wrong_ends_with_a_status_and_what_was_reached():
    lost = System(fall_field, guard_that_ends, n_states=2, guard_names=("lost",))
    for system, params, status in (
        (lost, (2.0, 9.0), GUARD_NOT_FINITE),
        (growth(), (0.7, 1.0), -2),
        (ball(on_event=kick_up), (2.0, 0.0, 1.0), ZENO),
        (ball(), (2.0, 0.0, 0.5), ZENO),
    ):
        solution = solve(system, (0, 9), [1.0, 0.0], params=params)
        assert solution.status == status, solution
        assert not solution.success
        assert solution.message
        assert 0.0 < solution.t_end < 9.0
        assert np.isfinite(solution.y_end).all()
        assert solution.n_events == len(solution.events)
        assert solution.t[-1] == solution.t_end


@field
def blows_up(t, y, mode, params, dy):
    dy[0] = y[0] ** 2


def test_a_step_that_falls_to_zero():
    solution = solve(System(blows_up, n_states=1), (0, 2), [1.0], method="dop853")
    assert solution.status == STEP_UNDERFLOW
    assert solution.t_end == pytest.approx(1.0, abs=1e-9)
    assert solution.y_end[0] > 1e9


def test_wrong_calls_neither_crash_nor_succeed():
    system = ladder(1)
    good = {"t_span": (0.0, 1.0), "y0": [0.0, 0.0], "params": (5.0, 1.0)}
    wrong = [
        np.nan, None, "x", [], [[1.0]], [1.0], [np.nan] * 2, [np.inf, 0.0], {}, (1.0, 2.0, 3.0),
        1j, np.zeros((2, 2)), object(),
    ]  # fmt: skip
    names = ["t_span", "y0", "rtol", "max_step", "mode", "t_eval", "atol"]
    for name, value in product(names, wrong):
        try:
            solution = solve(system, **{**good, name: value})
        except (ValueError, TypeError):
            continue
        # These are valid: no modes, no samples, a lock, and a component whose error
        # does not count.
        good_after_all = ("None", "[]", "{}", "[1.0]", "[[1.0]]", "[inf, 0.0]")
        assert name in ("mode", "t_eval", "atol"), (name, value, solution)
        assert repr(value) in good_after_all, (name, value, solution)


def test_times_are_those_of_the_way_when_counted_backward():
    system = replace(ladder(1), terminal=(1,))
    parts = []
    options = {"params": (1.0, 1.0), "events": parts.append}
    solution = solve(system, (2.0, 0.0), [3.0, 0.0], **options)
    assert solution.t_end == pytest.approx(1.0)
    assert parts[0].time == pytest.approx([1.0])
