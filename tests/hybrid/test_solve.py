"""`solve` from its user's view: vocabulary, samples, logs, ends."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, growth, ladder, ladder_solution, rebound, throw
from scipy.integrate import solve_ivp

from hopdata.errors import ArgumentError
from hopdata.hybrid import System, solve
from hopdata.hybrid.workspace import Workspace


def test_no_guards_agrees_with_scipy():
    ours = solve(
        growth(), (0, 2), [1.0, 0.0], params=(0.7, 4.0), rtol=1e-10, atol=1e-12
    )
    theirs = solve_ivp(
        lambda t, y: [0.7 * y[0], np.sqrt(4.0 - t)],
        (0, 2),
        [1.0, 0.0],
        rtol=1e-10,
        atol=1e-12,
    )
    assert ours.success
    assert ours.y_end == pytest.approx(theirs.y[:, -1], rel=1e-8)
    assert ours.y_end[0] == pytest.approx(np.exp(1.4), rel=1e-9)
    assert ours.t[-1] == ours.t_end == 2.0
    assert ours.y[:, -1].tolist() == ours.y_end.tolist()
    assert len(ours.events) == 0


def test_samples_are_accurate():
    times = np.linspace(0, 2, 401)
    solution = solve(
        growth(), (0, 2), [1.0, 0.0], params=(0.7, 4.0), rtol=1e-9, t_eval=times
    )
    assert solution.t.tolist() == times.tolist()
    assert solution.y.shape == (2, 401)
    assert np.abs(solution.y[0] - np.exp(0.7 * times)).max() < 1e-8
    integral = 2 / 3 * (8 - (4 - times) ** 1.5)
    assert np.abs(solution.y[1] - integral).max() < 1e-8


def test_samples_do_not_change_the_steps():
    options = {"params": (0.7, 4.0), "rtol": 1e-9}
    dense = solve(
        growth(), (0, 2), [1.0, 0.0], t_eval=np.linspace(0, 2, 401), **options
    )
    bare = solve(growth(), (0, 2), [1.0, 0.0], **options)
    assert dense.y_end.tobytes() == bare.y_end.tobytes()
    assert dense.n_steps == bare.n_steps  # its interpolant takes extra evaluations


def test_samples_through_events():
    rungs, gains = [0.5, 1.0, 1.25], [0.5, -0.9, 3.0]
    times = np.linspace(0, 3, 301)
    solution = solve(
        ladder(3), (0, 3), [0.0, 0.0], params=(*rungs, *gains), t_eval=times
    )
    exact = [ladder_solution(rungs, gains, time)[1] for time in times]
    assert np.abs(solution.y[0] - exact).max() < 1e-13


def test_sample_at_an_event_is_the_state_after_it():
    solution = solve(
        ball(directions=(1,)),
        (0, 2),
        [1.0, 0.0],
        params=(2.0, 0.0, 0.5),
        t_eval=[0, 1.0, 1.5],
    )
    time = solution.events.time[0]
    assert time == pytest.approx(1.0, abs=1e-15)
    again = solve(
        ball(directions=(1,)),
        (0, 2),
        [1.0, 0.0],
        params=(2.0, 0.0, 0.5),
        t_eval=[0, time, 1.5],
    )
    assert again.y[1, 1] == pytest.approx(1.0, abs=1e-14)


def test_event_log():
    solution = solve(
        ball(directions=(1,)), (0, 2.5), [1.0, 0.0], params=(2.0, 0.0, 0.5)
    )
    log = solution.events
    assert log.time == pytest.approx([1.0, 2.0], abs=1e-13)
    assert log.before[:, 1] == pytest.approx([-2.0, -1.0], abs=1e-12)
    assert log.after[:, 1] == pytest.approx([1.0, 0.5], abs=1e-12)
    assert log.direction.tolist() == [1, 1]
    assert log.mode.tolist() == [[1], [1]]
    assert solution.mode.tolist() == [-1]
    assert len(log.of("floor")) == 2
    assert len(log.of("floor", direction=-1)) == 0


def test_two_way_bounce_flips_there_and_back():
    log = solve(ball(), (0, 1.5), [1.0, 0.0], params=(2.0, 0.0, 0.5)).events
    assert log.direction.tolist() == [1, -1]
    assert log.time[0] == log.time[1]


def test_every_step_and_event_is_kept():
    solution = solve(ladder(1), (0, 2), [0.0, 0.0], params=(1.0, 1.0), max_step=0.01)
    assert solution.t[0] == 0.0
    assert (np.diff(solution.t) > 0).all()
    assert solution.events.time[0] in solution.t
    assert len(solution.t) == solution.n_steps + 1 > 200


def test_long_output_grows():
    system, params = ball(directions=(1,)), (2.0, 0.0, 1.0)
    solution = solve(system, (0, 4001), [1.0, 0.0], params=params, max_step=0.5)
    assert solution.success
    assert len(solution.events) == 2000
    assert solution.events.time == pytest.approx(np.arange(1, 4001, 2), abs=1e-8)
    assert len(solution.t) > 8000
    assert (np.diff(solution.t) > 0).all()


def test_terminal_guard():
    solution = solve(
        ladder(2, terminal=(False, True)), (0, 9), [0.0, 0.0], params=(1, 2, 1, 0)
    )
    assert solution.status == 1
    assert solution.success
    assert "rung1" in solution.message
    assert solution.t_end == pytest.approx(1.5, abs=1e-14)
    assert solution.y_end[0] == pytest.approx(2.0, abs=1e-14)


def test_handler_ends_the_integration():
    from hybrid_systems import stop_at_once

    solution = solve(
        ball(on_event=stop_at_once), (0, 9), [1.0, 0.0], params=(2.0, 0.0, 0.5)
    )
    assert solution.status == 1
    assert solution.t_end == pytest.approx(1.0, abs=1e-14)
    assert len(solution.events) == 1


def test_samples_end_where_it_ended():
    solution = solve(
        ladder(1, terminal=(True,)),
        (0, 9),
        [0.0, 0.0],
        params=(1, 0),
        t_eval=[0.5, 0.9, 1.1],
    )
    assert solution.t.tolist() == [0.5, 0.9]
    assert solution.y.shape == (2, 2)


def test_directions():
    for direction, expected in ((0, [1, -1]), (1, [1]), (-1, [-1])):
        solution = solve(
            throw(directions=(direction,)), (0, 2), [0.0, 2.0], params=(2.0, 0.5)
        )
        assert solution.events.direction.tolist() == expected
        assert solution.mode.tolist() == [-1]


def test_a_guard_never_reached():
    solution = solve(ladder(1), (0, 1), [0.0, 0.0], params=(5.0, 1.0))
    assert solution.status == 0
    assert len(solution.events) == 0
    assert solution.mode.tolist() == [-1]


def test_empty_span():
    solution = solve(ladder(1), (1, 1), [0.0, 0.0], params=(5.0, 1.0))
    assert solution.status == 0
    assert solution.y_end.tolist() == [0.0, 0.0]


def test_two_runs_are_identical():
    def run():
        return solve(ball(directions=(1,)), (0, 8), [1.0, 0.0], params=(2.0, 0.0, 0.9))

    first, second = run(), run()
    assert first.y.tobytes() == second.y.tobytes()
    assert first.t.tobytes() == second.t.tobytes()
    assert first.events.time.tobytes() == second.events.time.tobytes()


def test_the_initial_state_is_not_changed():
    start, mode = np.array([1.0, 0.0]), np.array([-1])
    solve(ball(), (0, 3), start, params=(2.0, 0.0, 0.5), mode=mode)
    assert start.tolist() == [1.0, 0.0]
    assert mode.tolist() == [-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"t_span": (1, np.nan)}, "t_span"),
        ({"t_span": (1, -np.inf)}, "t_span"),
        ({"t_span": 1.0}, "t_span"),
        ({"t_span": (0, np.inf)}, "t_span"),
        ({"y0": [0.0]}, "y0"),
        ({"y0": [0.0, np.nan]}, "y0"),
        ({"rtol": -1.0}, "rtol"),
        ({"atol": -1.0}, "atol"),
        ({"atol": [1.0, 1.0, 1.0]}, "atol"),
        ({"max_step": 0.0}, "max_step"),
        ({"first_step": -1.0}, "first_step"),
        ({"t_eval": [0.5, 0.2]}, "t_eval"),
        ({"t_eval": [0.5, 9.0]}, "t_eval"),
        ({"mode": [1, 1, 1]}, "mode"),
        ({"mode": [7]}, "locks"),
        ({"max_events": 0}, "max_events"),
        ({"max_steps": np.inf}, "max_steps"),
        ({"max_steps": 1.5}, "max_steps"),
        ({"max_step": None}, "max_step"),
        ({"first_step": "0.1 s"}, "first_step"),
        ({"rtol": "fine"}, "rtol: expected a number"),
        ({"rtol": [1e-6, 1e-6]}, "rtol"),
        ({"atol": "small"}, "atol"),
        ({"y0": "ab"}, "y0: expected numbers"),
        ({"y0": [1j, 0.0]}, "y0"),
        ({"params": {"mass": 1.0}}, "params"),
        ({"params": None}, "params"),
        ({"params": [None, 1.0]}, "params"),
        ({"mode": [0.5]}, "mode: expected integers"),
        ({"t_eval": "now"}, "t_eval"),
        ({"method": np.array(["dopri5", "taylor"])}, "method"),
        ({"method": ["dopri5"]}, "method"),
        ({"jacobian": np.eye(2)}, "jacobian: expected True or False"),
        ({"jacobian": None}, "jacobian"),
        ({"method": "dopri"}, "did you mean 'dopri5'"),
        (
            {"rtoll": 1e-3},
            "solve: expected the arguments system, .* found 'rtoll'; did you mean 'rtol'",
        ),
    ],
)
def test_wrong_arguments_are_named(change, message):
    arguments = {"t_span": (0, 1), "y0": [0.0, 0.0], "params": (5.0, 1.0), **change}
    with pytest.raises(ArgumentError, match=message) as caught:
        solve(ladder(1), **arguments)
    assert caught.value._render_traceback_() == [f"ArgumentError: {caught.value}"]


def test_a_system_checks_itself():
    with pytest.raises(
        ArgumentError, match=r"System: expected the arguments .*'n_states'"
    ):
        System(rebound, n_state=1)
    with pytest.raises(ArgumentError, match="n_states: expected a whole number"):
        System(ladder(1).field, n_states="1")
    with pytest.raises(TypeError, match="@field"):
        System(rebound, n_states=1)
    with pytest.raises(ValueError, match="directions"):
        ladder(2, directions=(1,))


@pytest.mark.parametrize(
    ("options", "all_is_prepared"),
    [
        ({}, False),
        ({"t_eval": ()}, False),
        ({"t_eval": []}, False),
        ({"t_eval": np.empty(0)}, False),
        ({"events": "count"}, False),
        ({"t_eval": (), "events": "count"}, False),
        ({"t_eval": [0.5]}, False),
        ({"dense_output": True}, False),
        ({"dense_output": True, "t_eval": [0.5]}, False),
        ({"first_step": 0.01}, False),
        ({"first_step": np.float64(0.01)}, True),
        ({"events": len}, True),
    ],
)
def test_asking_for_less_is_no_new_preparation(monkeypatch, options, all_is_prepared):
    """A request that differs in numbers alone goes straight to the driver: 4 us, not 40."""
    system, call = ladder(2), {"params": (0.2, 0.4, 0, 0)}
    first = solve(system, (0, 1), [0.0, 0.0], **call, **options)
    solve(system, (0, 1), [0.0, 0.0], **call)
    asked, ask = [], Workspace.ask

    def watched_ask(*given):
        asked.append(given)
        ask(*given)

    monkeypatch.setattr(Workspace, "ask", watched_ask)
    again = solve(system, (0, 1), [0.0, 0.0], **call, **options)
    assert bool(asked) == all_is_prepared
    assert again.t.tolist() == first.t.tolist()
    assert again.y.shape == first.y.shape
    assert again.events.time.tolist() == first.events.time.tolist()
    assert again.n_events == 2
    if "t_eval" in options:
        assert again.t.tolist() == list(options["t_eval"])
    if options.get("events", "all") != "all":
        assert len(again.events) == 0


@pytest.mark.parametrize(
    "wrong", ["", np.empty(0, dtype="U3"), np.empty((0, 2)), np.empty((2, 0))]
)
def test_nothing_of_another_kind_is_refused_each_time(wrong):
    system, call = ladder(2), {"params": (0.2, 0.4, 0, 0)}
    for _ in range(2):
        solve(system, (0, 1), [0.0, 0.0], **call, t_eval=())
        with pytest.raises(ValueError, match="t_eval"):
            solve(system, (0, 1), [0.0, 0.0], **call, t_eval=wrong)
