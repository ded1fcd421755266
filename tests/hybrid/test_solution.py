"""The result of an integration: logs split and joined, pickled, empty, and long."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from bent_systems import bent, bent_params, bent_sparse
from hybrid_systems import ball, relay, sliding

from hopdata.hybrid import EventLog, solve

PARAMS = bent_params(
    [0.5, 0.7, 1.0], drive=0.3, tilts=[0.2, -0.3, 0.4], gains=[0.4, -0.8, -0.5]
)
COLUMNS = ("time", "guard", "direction", "before", "after", "mode")


def swing(until=2.0, **options):
    return solve(bent(3), (0, until), [0.0, 1.2], params=PARAMS, **options)


def rebuilt(log):
    columns = {name: getattr(log, name) for name in COLUMNS}
    return EventLog.of_columns(guard_names=log.guard_names, **columns)


@pytest.mark.parametrize("until", [2.0, 0.1], ids=["events", "none"])
def test_a_log_of_its_own_columns_is_the_same(until):
    log = swing(until).events
    again = rebuilt(log)
    assert (len(log) > 0) == (until == 2.0)
    assert len(again) == len(log)
    assert again.records.shape == log.records.shape
    assert again.records.tobytes() == log.records.tobytes()
    for name in COLUMNS:
        assert getattr(again, name).tolist() == getattr(log, name).tolist()


def test_whole_numbers_of_any_size_survive():
    log = EventLog.of_columns(
        time=np.array([0.1, 0.2]), guard=np.array([0, 1]), direction=np.array([1, -1]),
        before=np.zeros((2, 3)), after=np.ones((2, 3)),
        mode=np.array([[-(2**63), 2**63 - 1], [-1, 0]]), guard_names=("a", "b"),
    )  # fmt: skip
    assert log.mode.tolist() == [[-(2**63), 2**63 - 1], [-1, 0]]
    assert log.of("b").direction.tolist() == [-1]
    assert log.of("b").mode.tolist() == [[-1, 0]]
    assert log.of("b").after.tolist() == [[1.0, 1.0, 1.0]]


def test_shapes_of_an_empty_log():
    log = swing(0.1).events
    shapes = {name: getattr(log, name).shape for name in COLUMNS}
    assert shapes == {
        "time": (0,), "guard": (0,), "direction": (0,), "before": (0, 2), "after": (0, 2),
        "mode": (0, 3),
    }  # fmt: skip
    assert log.guard.dtype == log.mode.dtype == np.int64
    assert len(log.of("bar1")) == 0


def test_events_of_one_guard():
    log = solve(
        bent(3), (0, 20), [0.0, 1.2], params=bent_params([0.1, 0.3, 0.5])
    ).events
    for k, name in enumerate(log.guard_names):
        chosen = log.of(name)
        assert len(chosen) > 2
        assert set(chosen.guard.tolist()) == {k}
        assert chosen.time.tolist() == log.time[log.guard == k].tolist()
        ups, downs = log.of(name, direction=1), log.of(name, direction=-1)
        assert len(ups) + len(downs) == len(chosen)
        assert set(ups.direction.tolist()) == {1}
        assert ups.of(name).time.tolist() == ups.time.tolist()
        assert len(ups.of(name, direction=-1)) == 0


def test_a_guard_that_there_is_not_is_named():
    with pytest.raises((ValueError, KeyError), match="foot9"):
        swing().events.of("foot9")


def test_modes_of_a_log_hold_locks_and_the_scenes_own():
    log = solve(relay(), (0, 2), [0.0, 0.0], mode=[0]).events
    assert log.guard.tolist() == [0, 1]
    assert log.mode.tolist() == [[1, -1, 1], [1, 1, 1]]


def test_modes_of_a_log_of_sparse_guards_hold_the_scenes_own():
    log = solve(bent_sparse(3), (0, 2), [0.0, 1.2], params=PARAMS).events
    assert log.mode.shape == (len(log), 0)
    assert rebuilt(log).records.tobytes() == log.records.tobytes()


def test_parts_are_made_once_and_belong_to_nobody_else():
    solution = swing()
    assert solution.y is solution.y
    assert solution.events.before is solution.events.before
    before = solution.parts, solution.events.records.tobytes()
    for part in (solution.t, solution.y, solution.events.time, solution.events.mode):
        part[...] = 0
    assert solution.parts == before[0]
    assert solution.events.records.tobytes() == before[1]


def assert_equal(one, other):
    for name in (
        "t",
        "y",
        "y_end",
        "t_end",
        "mode",
        "status",
        "n_steps",
        "nfev",
        "n_rejected",
    ):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    assert one.n_guard_evaluations == other.n_guard_evaluations
    assert one.message == other.message
    assert one.events.guard_names == other.events.guard_names
    for name in COLUMNS:
        assert np.array_equal(getattr(one.events, name), getattr(other.events, name))


@pytest.mark.parametrize(
    "duplicate", [lambda s: pickle.loads(pickle.dumps(s)), copy.deepcopy]
)
@pytest.mark.parametrize("read_before", [False, True])
def test_copies(read_before, duplicate):
    solution = swing(jacobian=True, t_eval=[0.5, 1.0])
    if read_before:
        assert solution.y.shape == (2, 2)
        assert len(solution.events.time) > 0
    again = duplicate(solution)
    assert_equal(again, solution)
    assert again.jacobian.tobytes() == solution.jacobian.tobytes()
    failed = solve(sliding(), (0, 9), [1.0], params=(1.0, 2.0))
    assert_equal(duplicate(failed), failed)
    assert "'origin' is not live" in duplicate(failed).message


def test_long_integrations_are_joined_from_their_pieces():
    """About 7500 rows and 3000 events: memory is doubled six times."""
    system, options = ball(), {"params": (2.0, 0.0, 1.0), "max_step": 0.4}
    whole = solve(system, (0, 3001), [1.0, 0.0], **options)
    assert len(whole.events) == 3000
    assert whole.events.guard_names == ("floor",)
    assert np.array_equal(whole.events.direction, np.tile([1, -1], 1500))
    assert (np.diff(whole.t) > 0).all()
    assert len(whole.t) > 7500
    assert np.isin(whole.events.time, whole.t).all()
    start = solve(system, (0, 50), [1.0, 0.0], **options)
    kept = len(start.t) - 10
    assert whole.t[:kept].tobytes() == start.t[:kept].tobytes()
    assert whole.y[:, :kept].tobytes() == start.y[:, :kept].tobytes()
    few = len(start.events)
    assert whole.events.records[:few].tobytes() == start.events.records.tobytes()
    assert whole.y[:, -1].tolist() == whole.y_end.tolist()


def test_no_sample_is_not_every_step():
    solution = swing(t_eval=[])
    assert solution.t.shape == (0,)
    assert solution.y.shape == (2, 0)
    assert solution.y_end.tobytes() == swing().y_end.tobytes()
