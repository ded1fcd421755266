"""Memory is reused by the next integration, and never shared."""

from __future__ import annotations

import copy
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from equal_runs import same_bytes
from hybrid_systems import ball, growth, ladder, raising_field

from hopdata.hybrid import System, field, guards, solve, solve_batch, workspace

BOUNCES = {"params": (2.0, 0.0, 1.0), "max_step": 0.25}


def test_results_do_not_change_when_memory_is_used_again():
    system = ball(directions=(1,))
    kept = solve(system, (0, 3), [1.0, 0.0], **BOUNCES)
    copies = kept.t.copy(), kept.y.copy(), kept.events.before.copy(), kept.mode.copy()
    solve(system, (5, 9), [3.0, 1.0], **BOUNCES)
    for array, before in zip(
        (kept.t, kept.y, kept.events.before, kept.mode), copies, strict=True
    ):
        assert array.tobytes() == before.tobytes()


@pytest.mark.parametrize("end", [3, 30, 3000])
def test_an_integration_leaves_nothing_behind(end):
    system = ball(directions=(1,))
    fresh = solve(ball(directions=(1,)), (0, 3), [1.0, 0.0], **BOUNCES)
    solve(system, (0, end), [2.0, 0.5], t_eval=[0, 1], mode=[1], **BOUNCES)
    solve(system, (0, end), [2.0, 0.5], mode=[1], atol=[1.0, 1.0], **BOUNCES)
    again = solve(system, (0, 3), [1.0, 0.0], **BOUNCES)
    assert same_bytes(fresh, again)


KINDS = {
    "plain": {},
    "times": {"t_eval": [0.0, 0.5, 2.5]},
    "other times": {"t_eval": [0.5, 1.0, 1.5, 2.0]},
    "no times": {"t_eval": ()},
    "dense": {"dense_output": True},
    "dense at times": {"dense_output": True, "t_eval": [0.5, 2.0]},
    "first step": {"first_step": 1e-3},
    "counted": {"events": "count"},
    "derivative": {"jacobian": True},
    "mode": {"mode": [1]},
    "tolerances": {"atol": [1e-6, 1e-7]},
}


def test_each_kind_of_call_after_each_other():
    """They begin in memory as the last one has left it."""
    fresh = {}
    for kind, options in KINDS.items():
        system = ball(directions=(1,))
        fresh[kind] = solve(system, (0, 3), [1.0, 0.0], **BOUNCES, **options)
    assert len({one.y.tobytes() for one in fresh.values()}) >= 6
    system = ball(directions=(1,))
    for before in KINDS.values():
        for kind, options in KINDS.items():
            solve(system, (0, 3), [2.0, 0.5], **BOUNCES, **before)
            again = solve(system, (0, 3), [1.0, 0.0], **BOUNCES, **options)
            assert same_bytes(fresh[kind], again)
            if options.get("dense_output"):
                assert again([0.3, 1.2]).tobytes() == fresh[kind]([0.3, 1.2]).tobytes()
            if options.get("jacobian"):
                assert again.jacobian.tobytes() == fresh[kind].jacobian.tobytes()


@pytest.mark.parametrize("given", [[0.5, np.nan], [np.nan], [1.0, 0.5], [0.5, 4.0]])
def test_wrong_times_are_refused_by_a_system_that_has_run(given):
    system = ball(directions=(1,))
    solve(system, (0, 3), [1.0, 0.0], **BOUNCES)
    with pytest.raises(ValueError, match="t_eval"):
        solve(system, (0, 3), [1.0, 0.0], t_eval=given, **BOUNCES)
    with pytest.raises(ValueError, match="first_step"):
        solve(system, (0, 3), [1.0, 0.0], first_step=-1.0, **BOUNCES)


def test_a_failed_call_leaves_nothing_behind():
    system = System(raising_field, n_states=2)
    for _ in range(3):
        with pytest.raises(ValueError, match="beyond the edge"):
            solve(system, (0, 2), [0.0, 0.0], params=(1.0,), max_step=1e-3)
        with pytest.raises(ValueError, match="y0"):
            solve(system, (0, 2), [0.0, np.inf], params=(1.0,))
        assert solve(system, (0, 2), [0.0, 0.0], params=(5.0,)).y_end[
            0
        ] == pytest.approx(2.0)


def test_memory_is_found_again():
    system = ladder(2)
    for _ in range(3):
        solve(system, (0, 1), [0.0, 0.0], params=(0.2, 0.4, 0, 0))
        assert len(system.idle) == 1


def test_a_copy_has_memory_of_its_own():
    system = ball(directions=(1,))
    fresh = solve(system, (0, 3), [1.0, 0.0], **BOUNCES)
    assert len(copy.deepcopy(system.idle)) == 0
    assert same_bytes(solve(copy.copy(system), (0, 3), [1.0, 0.0], **BOUNCES), fresh)


def test_threads_do_not_share_memory():
    system, ends = growth(), [0.5, 1.0, 1.5, 2.0] * 10
    options = {"params": (0.7, 4.0), "max_step": 1e-3}

    def run(end):
        return solve(system, (0, end), [1.0, 0.0], **options)

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(run, ends))
    assert all(
        same_bytes(run(end), one)
        for end, one in zip(ends[:4], together[:4], strict=True)
    )
    assert all(
        same_bytes(one, other)
        for one, other in zip(together[:4], together[4:8], strict=True)
    )


@pytest.mark.parametrize(
    "state", [[0, 0], (0.0, 0.0), np.zeros(4)[::2], np.zeros(2, dtype=np.float32)]
)
def test_any_form_of_a_state_will_do(state):
    end = solve(ladder(1), (0, 1), state, params=np.array([[5.0, 1.0]])).y_end
    assert end[0] == pytest.approx(1.0, abs=1e-15)


def test_arrays_that_may_not_be_written_to():
    state, params = np.zeros(2), np.array([0.5, 1.0])
    state.flags.writeable = params.flags.writeable = False
    assert solve(ladder(1), (0, 1), state, params=params).y_end[0] == pytest.approx(1.5)


@pytest.mark.parametrize(
    "state", [[0.0], [0.0, 0.0, 0.0], [[0.0], [0.0]], [[0.0, 0.0]], 0.0, ["a", "b"]]
)
def test_a_state_of_another_shape(state):
    system = ladder(1)
    for given in (
        state,
        np.array(state),
    ):  # the second call finds everything but the numbers ready
        with pytest.raises(
            ValueError, match=r"y0: expected shape \(2,\)|expected numbers"
        ):
            solve(system, (0, 1), given, params=(5.0, 1.0))
        solve(system, (0, 1), (0.0, 0.0), params=(5.0, 1.0))


@pytest.mark.parametrize("params", [(5.0,), (5.0, 1.0, 7.0), [[5.0], [1.0]], 5.0])
def test_numbers_that_do_not_fit_are_not_written_one_into_the_other(params):
    system = ladder(1)
    fresh = outcome(system, np.zeros(2), params)
    solve(system, (0, 1), (0.0, 0.0), params=(5.0, 1.0))
    assert outcome(system, np.zeros(2), params) == fresh
    with pytest.raises(ValueError, match="y0: expected shape"):
        solve(system, (0, 1), (0.0, 0.0, 5.0), params=(1.0,))  # four numbers, all equal


def test_a_refused_first_call_leaves_no_way_past_the_checks():
    for wrong in ({"params": ()}, {"y0": (1.0,)}, {"params": (2.0, 0.0)}):
        system = ball()
        good = {"y0": (1.0, 0.0), "params": (2.0, 0.0, 1.0), "atol": 0.0}
        for options in (good | wrong, good | {"params": ()}):
            with pytest.raises(ValueError, match=r"expected|uses params"):
                solve(system, (0, 1), **options)


def test_exceptions_are_not_kept():
    system = System(raising_field, n_states=2)
    with pytest.raises(ValueError, match="beyond the edge"):
        solve(system, (0, 2), [0.0, 0.0], params=(1.0,), max_step=1e-3)
    assert [len(work.caught) for work in system.idle] == [0]


def outcome(system, y0, params):
    try:
        return solve(system, (0, 1), y0, params=params).y_end.tobytes()
    except ValueError as error:
        return str(error)


def test_arrays_tuples_and_lists_give_the_same_bytes():
    system = ball(directions=(1,))
    forms = [tuple, list, np.array, lambda numbers: np.array(numbers, dtype=object)]
    ends = [
        solve(system, (0, 3), form([1.0, 0.0]), params=form([2.0, 0.0, 1.0]))
        for form in forms * 2
    ]
    assert all(same_bytes(ends[0], end) for end in ends[1:])


def test_tolerances_may_be_numbers_of_numpy():
    system, options = growth(), {"params": (0.7, 4.0)}
    first = solve(system, (0, 1), [1.0, 0.0], rtol=1e-5, atol=1e-5, **options)
    for number in (np.float64(1e-5), np.array(1e-5)):
        again = solve(system, (0, 1), [1.0, 0.0], rtol=number, atol=number, **options)
        assert same_bytes(again, first)
    assert (
        solve(system, (0, 1), [1.0, 0.0], atol=np.float64(1e-9), **options).n_steps > 0
    )


def test_parameters_of_another_length_than_before():
    system = ladder(1)
    few, more = (5.0, 1.0), (5.0, 1.0, 7.0)
    ends = [solve(system, (0, 1), (0.0, 0.0), params=p).y_end for p in (few, more, few)]
    assert ends[0].tobytes() == ends[1].tobytes() == ends[2].tobytes()


def test_the_tolerance_of_the_last_call_is_forgotten():
    system, options = growth(), {"params": (0.7, 4.0), "rtol": 0.0}
    loose, tight = ({**options, "atol": atol} for atol in (1e-4, 1e-10))
    first = solve(system, (0, 1), [1.0, 0.0], **loose)
    assert solve(system, (0, 1), [1.0, 0.0], **tight).n_steps > first.n_steps
    each = {**options, "atol": [1e-10, 1e-10]}
    assert same_bytes(
        solve(system, (0, 1), [1.0, 0.0], **each),
        solve(system, (0, 1), [1.0, 0.0], **tight),
    )
    assert same_bytes(solve(system, (0, 1), [1.0, 0.0], **loose), first)


@pytest.mark.parametrize(
    "wrong",
    [
        {"t_span": (1.0, np.nan)}, {"t_span": (0.0, np.nan)}, {"t_span": (-np.inf, 0.0)},
        {"t_span": (0.0, 1.0, 2.0)}, {"t_span": (0.0, "end")}, {"rtol": -1e-9}, {"rtol": 1.0},
        {"rtol": np.nan}, {"max_step": 0.0}, {"max_step": np.nan}, {"max_steps": 0},
        {"max_events": -1},
    ],
    ids=str,
)  # fmt: skip
def test_numbers_are_refused_in_the_same_words_by_the_driver_and_by_python(wrong):
    system, options = ladder(1), {"t_span": (0.0, 1.0), "params": (5.0, 1.0)}
    good = solve(
        system, y0=(0.0, 0.0), **options
    )  # the driver checks plain numbers from now on
    words = []
    for unusual in ({}, {"mode": (0,)}):  # which Python checks
        with pytest.raises(ValueError, match="expected") as refused:
            solve(system, y0=(0.0, 0.0), **{**options, **wrong, **unusual})
        words.append(str(refused.value))
    assert words[0] == words[1]
    assert same_bytes(solve(system, y0=(0.0, 0.0), **options), good)


def test_a_relative_tolerance_below_rounding_is_raised_to_it_on_both_ways():
    system, options = growth(), {"params": (0.7, 4.0), "rtol": 0.0, "atol": 0.0}
    in_full = solve(system, (0, 1), [1.0, 0.0], mode=(), **options)
    assert same_bytes(solve(system, (0, 1), [1.0, 0.0], **options), in_full)
    assert in_full.success


def test_counts_may_be_whole_numbers_of_another_type():
    options = {"params": (5.0, 1.0), "max_steps": 1e6, "max_events": np.int32(5)}
    system = ladder(1)
    for _ in range(2):
        assert solve(system, (0, 1), (0.0, 0.0), **options).success


@field
def shrinking(t, y, mode, params, dy):
    for i in range(len(y)):
        dy[i] = -y[i]


@guards
def half_of_first(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = 0.5 - y[0], -dy[0]


def peak_vectors(n, run):
    """Return the peak memory of a system of size n, in vectors of n numbers."""
    tracemalloc.start()
    try:
        run(System(shrinking, half_of_first, n_states=n, guard_names=("half",)))
        return tracemalloc.get_traced_memory()[1] / (8 * n)
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("method", ["auto", "dopri5", "dop853"])
def test_memory_grows_with_the_states_and_not_with_their_square(method):
    n = 300_000
    y0, options = np.ones(n), {"rtol": 1e-3, "method": method, "t_eval": [1.0]}

    def both(system):
        alone = solve(system, (0, 1), y0, **options)
        batch = solve_batch(system, (0, 1), y0[None], **options)
        assert alone.y_end.tobytes() == batch.y_end[0].tobytes()
        np.testing.assert_allclose(alone.y_end, np.exp(-1.0), rtol=1e-2)
        assert len(alone.events) == 1

    assert peak_vectors(n, both) < 200


def test_long_states_get_fewer_rows_at_a_time(monkeypatch):
    system = System(shrinking, half_of_first, n_states=3, guard_names=("half",))
    whole = solve(system, (0, 9), np.ones(3))
    monkeypatch.setattr(workspace, "LARGEST_ROOM", 8)
    few = System(shrinking, half_of_first, n_states=3, guard_names=("half",))
    parts = [solve(few, (0, 9), np.ones(3)) for _ in range(2)]
    assert len(whole.t) > 20
    assert all(same_bytes(whole, one) for one in parts)
