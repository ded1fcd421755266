"""The log of events: modes from their changes, any number of events at an instant, its memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from hopdata.hybrid import EventLog, System, field, guards, on_event, solve
from hopdata.hybrid.layout import UNKNOWN
from hopdata.hybrid.workspace import FIRST_EVENTS, Workspace

MANY = (
    3 * FIRST_EVENTS
)  # guards that flip at one instant: more than there is room for at first


@field
def advance(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def stairs(t, y, dy, mode, params, h, hdot):
    """Steps at 1, 2, 3 and so on, or all at the first one if params[0] is 0."""
    for k in range(len(h)):
        h[k] = y[0] - 1.0 - params[0] * k
        hdot[k] = dy[0]


def names(count):
    return tuple(f"g{k}" for k in range(count))


def recorded(n_guards, n_extra):
    """Return a system whose handler changes locks and integers, and the modes that it leaves."""
    modes = []

    @on_event(compiled=False)
    def meddle(t, y, mode, params, guard, direction):
        own = n_guards + len(modes) % n_extra
        mode[own] = UNKNOWN if len(modes) % 3 == 0 else len(modes)
        if len(modes) % 5 == 4:
            mode[n_guards:] += 7
        modes.append(mode.copy())
        return 0

    system = System(
        advance,
        stairs,
        meddle,
        n_states=1,
        guard_names=names(n_guards),
        n_extra_modes=n_extra,
    )
    return system, modes


@pytest.mark.parametrize("apart", [0.0, 0.01], ids=["at one instant", "one by one"])
def test_the_modes_of_the_log_are_those_that_the_handler_left(apart):
    system, modes = recorded(MANY, 4)
    solution = solve(system, (0, 5), [0.0], params=[apart], mode=[5, UNKNOWN, 0, -3])
    assert solution.success
    assert len(solution.events) == solution.n_events == MANY
    assert solution.events.mode.tolist() == np.array(modes).tolist()
    assert (solution.events.mode == UNKNOWN).any()
    assert solution.events.mode[-1].tolist() == solution.mode.tolist()
    assert len(np.unique(solution.events.time)) == (1 if apart == 0.0 else MANY)
    one = solution.events.of("g70")
    assert one.mode.tolist() == [modes[list(solution.events.guard).index(70)].tolist()]


@pytest.mark.parametrize("apart", [0.0, 0.01], ids=["at one instant", "one by one"])
def test_a_function_receives_the_same_events_in_pieces(apart):
    system, _ = recorded(MANY, 2)
    whole = solve(system, (0, 5), [0.0], params=[apart], mode=[0, 0]).events
    system, _ = recorded(MANY, 2)
    pieces: list[EventLog] = []
    solution = solve(
        system, (0, 5), [0.0], params=[apart], mode=[0, 0], events=pieces.append
    )
    assert solution.n_events == sum(map(len, pieces)) == MANY
    assert len(solution.events) == 0
    assert len(pieces) > 1
    joined = np.concatenate([one.records for one in pieces])
    assert joined.tobytes() == whole.records.tobytes()


def test_counted_events_leave_no_log():
    system, _ = recorded(MANY, 2)
    solution = solve(system, (0, 5), [0.0], params=[0.0], mode=[0, 0], events="count")
    assert solution.n_events == MANY
    assert len(solution.events) == 0
    assert solution.events.mode.shape == (0, MANY + 2)
    again = solve(recorded(MANY, 2)[0], (0, 5), [0.0], params=[0.0], mode=[0, 0])
    assert solution.mode.tolist() == again.mode.tolist()
    kept = solve(
        system, (0, 5), [0.0], params=[0.0], mode=[0, 0]
    )  # in the same workspace
    assert len(kept.events) == MANY


def test_what_a_function_raises_in_the_middle_of_an_instant_ends_the_run():
    system, _ = recorded(MANY, 2)

    def refuse(events):
        raise OSError("the disk is full")

    for _ in range(2):
        with pytest.raises(OSError, match="the disk is full") as caught:
            solve(system, (0, 5), [0.0], params=[0.0], mode=[0, 0], events=refuse)
        assert caught.value.solution.t_end <= 1.0
    assert len(solve(system, (0, 5), [0.0], params=[0.0], mode=[0, 0]).events) == MANY


@pytest.mark.parametrize("room", ["_make_event_room", "_make_change_room"])
def test_no_memory_for_more_events_is_an_error_with_the_events_so_far(
    monkeypatch, room
):
    system, modes = recorded(MANY, 300)
    start = np.zeros(300, dtype=int)
    whole = solve(system, (0, 5), [0.0], params=[0.0], mode=start)
    assert len(whole.events) == MANY
    system, modes = recorded(MANY, 300)
    solve(system, (0, 0.5), [0.0], params=[0.0], mode=start)

    def refuse(self, count):
        raise MemoryError(f"no room for {count}")

    with monkeypatch.context() as limited:
        limited.setattr(Workspace, room, refuse)
        with pytest.raises(MemoryError, match="no room") as caught:
            solve(system, (0, 5), [0.0], params=[0.0], mode=start)
    reached = caught.value.solution.events
    assert 0 < len(reached) < MANY
    assert reached.mode.tolist() == np.array(modes)[: len(reached)].tolist()
    assert solve(system, (0, 5), [0.0], params=[0.0], mode=start).success


@pytest.mark.parametrize("events", ["all", "count"])
def test_memory_grows_with_guards_plus_events_not_with_their_product(events):
    def most_used(count):
        system = System(advance, stairs, n_states=1, guard_names=names(count))
        tracemalloc.start()
        solution = solve(
            system, (0, 40.5), [0.0], params=[1.0], events=events, t_eval=()
        )
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert solution.n_events == 40
        return peak

    most_used(100)  # compiles
    few = most_used(2000)
    many = most_used(20_000)
    assert many < 12 * few  # with a mode for each row it was 100 times as much
    assert many < 30_000_000
