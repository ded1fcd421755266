"""`solve_batch`: the same bytes as `solve` with any threads; failures of rows and of functions."""

from __future__ import annotations

import os
import pickle
import signal
import threading
import time

import numpy as np
import pytest
from bent_systems import bent, bent_params
from equal_runs import assert_same_row
from hybrid_systems import ball, growth, ladder, py_raising, raising, sliding, throw

from hopdata.hybrid import System, field, solve, solve_batch
from hopdata.hybrid import batch as batches
from hopdata.hybrid.batch import CHUNK, run_in_threads

PARAMS = bent_params(
    [0.5, 0.7, 1.0],
    drive=0.3,
    tilts=[0.2, -0.3, 0.4],
    sways=0.1,
    gains=[0.4, -0.8, -0.5],
)
TIMES = np.linspace(0, 2, 11)


def starts(count, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (count, 2))


@pytest.mark.parametrize("jacobian", [False, True])
@pytest.mark.parametrize("t_eval", [None, TIMES])
def test_the_bytes_of_solve(t_eval, jacobian):
    system, y0 = bent(3), starts(130)
    options = {"params": PARAMS, "t_eval": t_eval, "jacobian": jacobian}
    batch = solve_batch(system, (0, 2), y0, **options)
    assert batch.success
    assert batch.n_events.max() > 4
    for place in range(len(y0)):
        assert_same_row(batch, place, solve(system, (0, 2), y0[place], **options))


@pytest.mark.parametrize("workers", [1, 2, 7, None])
def test_workers_and_places_do_not_matter(workers):
    system, y0 = bent(3), starts(200)
    plain = solve_batch(
        system, (0, 2), y0, params=PARAMS, workers=workers, jacobian=True
    )
    order = np.random.default_rng(1).permutation(200)
    mixed = solve_batch(system, (0, 2), y0[order], params=PARAMS, jacobian=True)
    assert mixed.y_end.tobytes() == plain.y_end[order].tobytes()
    assert mixed.jacobian.tobytes() == plain.jacobian[order].tobytes()
    errors = plain.jacobian_error
    assert mixed.jacobian_error.tobytes() == errors[order].tobytes()
    # That of one's own, and not of another.
    alone = solve(system, (0, 2), y0[7], params=PARAMS, jacobian=True)
    assert alone.jacobian_error == errors[7] > 0.0
    assert len({*errors}) == len(errors)
    assert mixed.n_steps.tolist() == plain.n_steps[order].tolist()


@pytest.mark.parametrize("method", ["dopri5", "dop853", "rosenbrock"])
def test_each_method(method):
    system, y0 = bent(3), starts(5)
    batch = solve_batch(system, (0, 2), y0, params=PARAMS, method=method)
    for place in range(5):
        assert_same_row(
            batch, place, solve(system, (0, 2), y0[place], params=PARAMS, method=method)
        )


def test_parameters_of_each():
    system, y0 = throw(), np.tile([0.0, 2.0], (70, 1))
    params = np.column_stack([np.linspace(1, 3, 70), np.linspace(0.2, 0.8, 70)])
    batch = solve_batch(system, (0, 2), y0, params=params)
    for place in range(70):
        assert_same_row(
            batch, place, solve(system, (0, 2), y0[place], params=params[place])
        )
    assert len(np.unique(batch.y_end[:, 0])) == 70


def test_an_initial_mode():
    """A given lock is not decided by h: guard 0 of the ladder fires at once."""
    options = {"params": (1.0, 2.0, 0.5, 0.25), "mode": [1, -1]}
    batch = solve_batch(ladder(2), (0, 3), np.zeros((3, 2)), **options)
    assert_same_row(batch, 2, solve(ladder(2), (0, 3), [0, 0], **options))


def test_terminal_events_end_each_at_its_own_time():
    system, y0 = (
        ladder(1, terminal=(True,)),
        np.column_stack([np.linspace(0, 0.8, 9), np.zeros(9)]),
    )
    batch = solve_batch(
        system, (0, 1), y0, params=(0.5, 0.0), t_eval=[0.0, 0.25, 0.45, 1.0]
    )
    below = y0[:, 0] < 0.5
    assert batch.status.tolist() == below.astype(int).tolist()
    assert batch.t_end == pytest.approx(np.where(below, 0.5 - y0[:, 0], 1.0), abs=1e-14)
    assert np.isfinite(batch.y).sum(axis=(1, 2)).tolist() == [
        2 * int((t >= np.array([0.0, 0.25, 0.45, 1.0])).sum()) for t in batch.t_end
    ]
    for place in range(9):
        single = solve(system, (0, 1), y0[place], params=(0.5, 0.0), t_eval=batch.t)
        assert_same_row(batch, place, single)


def test_rows_that_fail_do_not_disturb_the_others():
    params = np.array([[0.7, 4.0], [0.7, 1.0]] * 40)
    batch = solve_batch(growth(), (0, 2), np.tile([1.0, 0.0], (80, 1)), params=params)
    assert batch.status.tolist() == [0, -2] * 40
    assert not batch.success
    first, second = batch.message.splitlines()
    assert first.startswith("40 of 80, such as number 1: The field is NaN or infinite")
    assert second.startswith(
        "40 of 80, such as number 0: The integration reached the end"
    )


def test_the_message_names_the_guard():
    system = ladder(2, terminal=(False, True))
    ended = solve_batch(system, (0, 9), np.zeros((3, 2)), params=(1, 2, 1, 0))
    assert "'rung1'" in ended.message
    stuck = solve_batch(sliding(), (0, 9), [[1.0]], params=(1.0, 2.0))
    assert solve(sliding(), (0, 9), [1.0], params=(1.0, 2.0)).message in stuck.message


def test_limits():
    options = {"params": (0.5, 0.6, 1.0, 1.0)}
    few_steps = solve_batch(
        ladder(2), (0, 2), np.zeros((3, 2)), max_step=0.01, max_steps=7, **options
    )
    assert few_steps.status.tolist() == [-4] * 3
    assert few_steps.n_steps.tolist() == [7] * 3
    few_events = solve_batch(
        ladder(2), (0, 2), np.zeros((3, 2)), max_events=1, **options
    )
    assert few_events.status.tolist() == [-5] * 3
    assert few_events.n_events.tolist() == [1] * 3


def test_more_events_than_there_is_room_for():
    """The log of a batch is discarded when it is full."""
    system, options = (
        ball(directions=(1,)),
        {"params": (2.0, 0.0, 1.0), "t_eval": [3.0, 1200.5]},
    )
    batch = solve_batch(system, (0, 1201), np.tile([1.0, 0.0], (3, 1)), **options)
    single = solve(system, (0, 1201), [1.0, 0.0], **options)
    assert len(single.events) == 600
    for place in range(3):
        assert_same_row(batch, place, single)


def test_more_steps_than_the_driver_takes_in_one_call():
    system, options = (
        ball(directions=(1,)),
        {"params": (2.0, 0.0, 0.5), "max_step": 5e-6},
    )
    batch = solve_batch(system, (0, 1.1), np.tile([1.0, 0.0], (2, 1)), **options)
    assert batch.n_steps.min() > 200_000
    assert_same_row(
        batch, 1, solve(system, (0, 1.1), [1.0, 0.0], t_eval=[1.0], **options)
    )


@pytest.mark.parametrize("count", [0, 1, 64, 65, 66])
def test_sizes(count):
    batch = solve_batch(
        ladder(1),
        (0, 1),
        np.zeros((count, 2)),
        params=(0.5, 1.0),
        t_eval=[0.25],
        jacobian=True,
    )
    assert len(batch) == count
    assert batch.success
    shapes = [batch.y_end.shape, batch.mode.shape, batch.y.shape, batch.jacobian.shape]
    assert shapes == [(count, 2), (count, 1), (count, 2, 1), (count, 2, 2)]
    assert batch.y_end[:, 0] == pytest.approx(np.full(count, 1.5), abs=1e-14)


def test_what_is_not_asked_for_is_none():
    batch = solve_batch(ladder(1), (0, 1), np.zeros((2, 2)), params=(0.5, 1.0))
    assert batch.t is batch.y is batch.jacobian is batch.jacobian_error is None


def test_an_empty_batch_of_parameters():
    assert (
        len(solve_batch(ladder(1), (0, 1), np.zeros((0, 2)), params=np.zeros((0, 2))))
        == 0
    )


def test_pickling():
    batch = solve_batch(ladder(1), (0, 1), np.zeros((2, 2)), params=(0.5, 1.0))
    again = pickle.loads(pickle.dumps(batch))
    assert again.y_end.tobytes() == batch.y_end.tobytes()
    assert again.message == batch.message


@pytest.mark.parametrize("place", [0, 1, 70, 129])
def test_an_exception_of_machine_code_is_raised(place):
    y0 = np.tile([-5.0, 0.0], (130, 1))
    y0[place] = 0.0
    with pytest.raises(ValueError, match=r"^beyond the edge of the map$"):
        solve_batch(raising(), (0, 2), y0, params=(1.0,))
    assert threading.active_count() == 1


@pytest.mark.parametrize("place", [0, 1, 70])
def test_an_exception_of_python_is_raised_unchanged(place):
    y0 = np.tile([-5.0, 0.0], (71, 1))
    y0[place] = 0.0
    with pytest.raises(LookupError) as caught:
        solve_batch(py_raising(), (0, 2), y0, params=(1.0,), method="dopri5")
    assert caught.value.args == ("no such place", 3)
    assert threading.active_count() == 1
    assert solve_batch(
        py_raising(), (0, 2), y0[-1:] - 5, params=(1.0,), method="dopri5"
    ).success


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y0": np.zeros(2)}, r"y0: expected shape \(B, 2\), found \(2,\)"),
        ({"y0": np.zeros((3, 3))}, r"y0: expected shape \(B, 2\)"),
        (
            {"y0": [[0, 0], [0, np.nan], [np.inf, 0]]},
            r"y0: expected finite .* in row 1",
        ),
        ({"params": np.zeros((3, 2))}, r"params: expected shape \(p,\) or \(2, p\)"),
        ({"params": np.zeros((2, 2, 2))}, r"params: expected shape"),
        ({"memory": [1.0]}, "memory: expected 0 numbers"),
        ({"mode": [1, 1, 1]}, "mode"),
        ({"atol": -1.0}, "atol"),
        ({"t_eval": [3.0]}, "t_eval"),
        ({"method": "dop835"}, "did you mean 'dop853'"),
        ({"max_steps": 0}, "max_steps"),
        ({"workers": "two"}, "workers: expected a number"),
        ({"workers": 1.5}, "workers: expected a whole number"),
        ({"jacobian": "yes"}, "jacobian: expected True or False"),
        ({"lanes": "yes"}, "lanes: expected True or False"),
        ({"jacobian": True, "method": "rosenbrock"}, "jacobian"),
    ],
)
def test_wrong_arguments_are_named(change, message):
    arguments = {
        "t_span": (0, 1),
        "y0": np.zeros((2, 2)),
        "params": (5.0, 1.0),
        **change,
    }
    with pytest.raises(ValueError, match=message):
        solve_batch(ladder(1), **arguments)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y0": np.zeros(2)}, r"y0: expected shape \(B, 2\), found \(2,\)"),
        (
            {"params": np.ones((2, 2))},
            r"params: expected shape \(p,\) or \(3, p\), found \(2, 2\)",
        ),
        ({"params": np.ones((2, 3, 2))}, r"params: expected shape"),
        ({"params": [5.0, np.nan]}, r"params: expected finite numbers, found .* nan"),
    ],
)
def test_wrong_arguments_are_named_where_parameters_are_states(change, message):
    arguments = {"y0": np.zeros((3, 2)), "params": (5.0, 1.0), **change}
    with pytest.raises(ValueError, match=message):
        solve_batch(ladder(1), (0, 1), jacobian="params", **arguments)


def test_params_are_a_vector_whatever_their_shape():
    found = [
        solve(
            ladder(1), (0, 1), [0.0, 0.0], params=params, jacobian="params"
        ).sensitivity.tobytes()
        for params in ([0.5, 1.0], [[0.5, 1.0]], [[0.5], [1.0]])
    ]
    assert len(set(found)) == 1


@pytest.mark.parametrize("params", [(2.0, 0.0), np.ones((3, 2))])
def test_missing_parameters_are_named(params):
    with pytest.raises(ValueError, match=r"uses params\[2\]"):
        solve_batch(ball(), (0, 1), np.ones((3, 2)), params=params)


def remembering(t, y, mode, params, dy):
    dy[0] = params[0] + params[1]


def test_one_parameter_for_each_system_beside_memory():
    """Joined column by column, each system got the numbers of another."""
    system = System(field(remembering), n_states=1, n_memory=2)
    rates = np.arange(1.0, 6.0)
    batch = solve_batch(system, (0, 1), np.zeros((5, 1)), params=rates[:, None])
    assert batch.y_end[:, 0] == pytest.approx(rates)


@pytest.mark.parametrize("workers", [0, -1])
def test_workers_are_checked(workers):
    with pytest.raises(ValueError, match=r"^workers"):
        solve_batch(
            ladder(1), (0, 1), np.zeros((2, 2)), params=(5.0, 1.0), workers=workers
        )


def test_progress(capsys):
    solve_batch(ladder(1), (0, 1), np.zeros((200, 2)), params=(5.0, 1.0), progress=True)
    captured = capsys.readouterr()
    assert captured.out == ""
    last = captured.err.splitlines()[-1]
    assert last.startswith("200 of 200 integrations")
    assert captured.err.endswith("\n")
    solve_batch(ladder(1), (0, 1), np.zeros((200, 2)), params=(5.0, 1.0))
    assert capsys.readouterr().err == ""


def test_ctrl_c_ends_the_threads():
    """Chunks in progress run to their ends, and no more are started."""
    system, options = (
        ball(directions=(1,)),
        {"params": (2.0, 0.0, 0.5), "max_step": 1e-4},
    )
    solve_batch(
        system, (0, 2.1), [[1.0, 0.0]], **options
    )  # a compiler may lose an interrupt
    # A process started in the background ignores Ctrl-C by inheritance; this one must
    # not.
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    before = threading.active_count()
    interrupter = threading.Thread(
        target=interrupt_when_threads_run, args=(before + 1,)
    )
    interrupter.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            solve_batch(
                system, (0, 2.1), np.tile([1.0, 0.0], (20_000, 1)), workers=2, **options
            )
        interrupter.join()
    finally:
        signal.signal(signal.SIGINT, handler)
    assert threading.active_count() == before


def test_long_integrations_are_taken_one_at_a_time(monkeypatch):
    """Ctrl-C need not wait for 64 of them."""
    chunks, run = [], run_in_threads
    monkeypatch.setattr(
        batches, "run_in_threads", lambda *a: chunks.append(a[-1]) or run(*a)
    )
    monkeypatch.setattr(batches, "WORTH_THREADS", 0.0)
    for max_step in (4e-6, 0.1):
        options = {"params": (5.0, 1.0), "max_step": max_step}
        assert solve_batch(ladder(1), (0, 1), np.zeros((3, 2)), **options).success
    assert chunks == [1, CHUNK]


def test_short_integrations_run_in_no_threads(monkeypatch):
    used = []
    monkeypatch.setattr(batches, "run_in_threads", lambda *_: used.append(True))
    monkeypatch.setattr(batches, "WORTH_THREADS", np.inf)
    options = {"params": (0.5, 1.0), "t_eval": [0.25]}
    starts = np.linspace(0.0, 0.1, 400).reshape(200, 2)
    many = solve_batch(ladder(1), (0, 1), starts, **options)
    one = solve(ladder(1), (0, 1), starts[150], **options)
    assert many.y_end[150].tobytes() == one.y_end.tobytes()
    assert many.y[150].tobytes() == one.y.tobytes()
    assert not used


def test_a_batch_is_pickled():
    options = {"params": (0.5, 1.0), "t_eval": [0.25], "jacobian": True}
    batch = solve_batch(ladder(1), (0, 1), np.zeros((3, 2)), **options)
    again = pickle.loads(pickle.dumps(batch))
    for name in ("y_end", "y", "jacobian", "status", "lanes"):
        assert getattr(again, name).tobytes() == getattr(batch, name).tobytes()
    assert again.message == batch.message


def interrupt_when_threads_run(others):
    """Send Ctrl-C once threads other than these run, which may take long on a busy machine."""
    give_up = time.monotonic() + 60.0
    while threading.active_count() <= others and time.monotonic() < give_up:
        time.sleep(0.001)
    time.sleep(0.05)
    while threading.active_count() > others:  # finalisers of Python ignore an interrupt
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(2.0)


def test_one_worker_is_the_thread_that_calls():
    seen = set()

    def run(first, last):
        seen.add(threading.get_ident())
        return last - first

    run_in_threads(run, 1, 200, 1, progress=False)
    assert seen == {threading.get_ident()}
    run_in_threads(run, 1, 200, 2, progress=False)
    assert len(seen) > 1
