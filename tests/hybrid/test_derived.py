"""Integration backwards in time: from the end to the start, through the same events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from equal_runs import same_instants, there_and_back
from hybrid_systems import ball, fall_field, floor_guard, ladder, relay

from hopdata.hybrid import (
    System,
    field,
    guard,
    guards,
    on_event,
    rate_bound,
    solve,
    solve_batch,
)

RTOLS = (1e-4, 1e-7, 1e-10)


@field
def body(t, y, mode, params, dy):
    dy[0], dy[1], dy[2], dy[3] = y[2], y[3], -9.81, 0.0
    for leg in range(len(mode)):
        side = 0.4 * leg / (len(mode) - 1) - 0.2
        if mode[leg] > 0:
            push = params[0] * (0.5 - y[0] - side * y[1]) - params[1] * (
                y[2] + side * y[3]
            )
            dy[2], dy[3] = dy[2] + push, dy[3] + 10.0 * side * push


@guards
def feet(t, y, dy, mode, params, h, hdot):
    for leg in range(len(h)):
        side = 0.4 * leg / (len(h) - 1) - 0.2
        h[leg], hdot[leg] = 0.5 - y[0] - side * y[1], -dy[0] - side * dy[1]


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize("n_legs", [2, 3, 6])
def test_a_body_on_legs_returns_to_its_start(n_legs, rtol):
    names = tuple(f"foot{leg}" for leg in range(n_legs))
    system, rng = (
        System(body, feet, n_states=4, guard_names=names),
        np.random.default_rng(n_legs),
    )
    for _ in range(5):
        start = np.array([0.7, *rng.normal(scale=0.05, size=3)])
        options = {"params": (800.0 / n_legs, 4.0 / n_legs), "rtol": rtol, "atol": rtol}
        there, back, off = there_and_back(system, (0.0, 0.6), start, **options)
        assert len(there.events) >= 2 * n_legs
        assert off.max() < 100 * rtol
        assert same_instants(there, back) < 100 * rtol


@on_event
def bounce_undone(t, y, mode, params, guard, direction):
    if direction > 0:
        y[1] = -y[1] / params[2]
    return 0


def test_a_reset_is_undone_by_its_inverse():
    system, options = replace(ball(), undo=bounce_undone), {"params": (2.0, 0.0, 0.5)}
    there, back, off = there_and_back(system, (0.0, 2.7), [1.0, 0.3], **options)
    assert off.max() < 1e-7
    assert len(there.events) == len(back.events) == 6
    assert np.unique(back.events.time)[::-1] == pytest.approx(
        np.unique(there.events.time)[::-1]
    )
    forgotten = solve(
        replace(ball(), undo=ball().on_event), (2.7, 0.0), there.y_end, **options
    )
    assert np.abs(forgotten.y_end - [1.0, 0.3]).max() > 0.1  # that is not its inverse


def test_without_an_inverse_a_handler_is_refused():
    for system in (ball(), relay()):
        with pytest.raises(
            ValueError, match=r"end not before the start.*System\(undo=\.\.\.\)"
        ):
            solve(system, (1.0, 0.0), [0.5, 0.0], params=(2.0, 0.0, 0.5))
    with pytest.raises(TypeError, match="@on_event"):
        System(
            fall_field, floor_guard, undo=fall_field, n_states=2, guard_names=("floor",)
        )


def test_times_samples_directions_and_ends_are_those_of_the_way():
    options = {"params": (1.0, 1.0), "t_eval": [2.0, 1.5, 1.0, 0.5]}
    system = ladder(1, directions=(-1,))
    back = solve(system, (2.0, 0.0), [3.0, 0.0], **options)
    assert back.t.tolist() == options["t_eval"]
    assert back.y[0] == pytest.approx([3.0, 2.0, 1.0, 0.5], abs=1e-13)
    assert back.events.time == pytest.approx([1.0], abs=1e-13)
    assert back.events.direction.tolist() == [-1]
    assert (
        len(solve(ladder(1, directions=(1,)), (2.0, 0.0), [3.0, 0.0], **options).events)
        == 0
    )
    ended = solve(
        ladder(1, terminal=(True,)), (2.0, 0.0), [3.0, 0.0], params=(1.0, 1.0)
    )
    assert ended.status == 1
    assert ended.t_end == pytest.approx(1.0, abs=1e-13)
    assert "t = 1" in ended.message or "t = 0.99" in ended.message
    with pytest.raises(ValueError, match=r"decreasing times within \(2\.0, 0\.0\)"):
        solve(system, (2.0, 0.0), [3.0, 0.0], params=(1.0, 1.0), t_eval=[0.5, 1.0])


PLACES = np.linspace(0.1, 0.9, 5)


@field(compiled=False)
def slow_fall(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -params[0] * (1.0 + t) - sum(0.1 for lock in mode if lock > 0)


@guards(compiled=False)
def slow_planes(t, y, dy, mode, params, h, hdot):
    h[:], hdot[:] = y[0] - PLACES - 0.1 * t, dy[0] - 0.1


@guard
def one_plane(t, y, dy, mode, params, k, h, hdot):
    h[k], hdot[k] = y[0] - 0.1 - 0.2 * k - 0.1 * t, dy[0] - 0.1


@rate_bound
def planes_bound(t, y, dy, mode, params):
    return abs(dy[0]) + 0.1


def test_python_functions_and_guards_that_sleep_go_back():
    names, options = tuple("abcde"), {"params": (9.81,), "rtol": 1e-9}
    plain = System(slow_fall, slow_planes, n_states=2, guard_names=names)
    asleep = System(
        slow_fall,
        guard=one_plane,
        rate_bound=planes_bound,
        n_states=2,
        guard_names=names,
    )
    ends = []
    for system in (plain, asleep):
        there, back, off = there_and_back(system, (0.0, 0.8), [0.0, 4.5], **options)
        assert len(there.events) >= 8
        assert off.max() < 1e-7
        assert same_instants(there, back) < 1e-7
        ends.append(there.y_end)
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


@field
def rise(t, y, mode, params, dy):
    dy[0], dy[1] = 0.3, 1.0


@guards
def same_line(t, y, dy, mode, params, h, hdot):
    for k in range(3):
        h[k], hdot[k] = y[1] - 1.0, dy[1]


@on_event
def grow(t, y, mode, params, guard, direction):
    y[0] = (2.0 * y[0], y[0] + 1.0, 3.0 * y[0])[guard]
    return 0


@on_event
def shrink(t, y, mode, params, guard, direction):
    y[0] = (y[0] / 2.0, y[0] - 1.0, y[0] / 3.0)[guard]
    return 0


def test_what_happened_at_one_instant_is_undone_in_reverse():
    names = ("twice", "one_more", "three_times")
    system = System(rise, same_line, grow, n_states=2, guard_names=names, undo=shrink)
    there = solve(system, (0, 2), [1.0, 0.0])
    back = solve(system, (2, 0), there.y_end)
    assert there.events.guard.tolist() == [0, 1, 2]
    assert back.events.guard.tolist() == [2, 1, 0]
    assert back.y_end == pytest.approx([1.0, 0.0], abs=1e-14)
    again = solve(system, (2, 0), there.y_end, debug=True)
    assert again.y_end.tobytes() == back.y_end.tobytes()
    batch = solve_batch(system, (2, 0), [there.y_end] * 3, lanes=True)
    assert batch.lanes.all(), batch.lanes_reason
    assert batch.y_end == pytest.approx(np.tile([1.0, 0.0], (3, 1)), abs=1e-12)
