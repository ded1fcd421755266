"""Guards that sleep: the same events as in the plain form, with fewer evaluations."""

from __future__ import annotations

import heapq

import numba
import numpy as np
import pytest
from bent_systems import bent, bent_params, bent_sparse, turn_back
from equal_runs import assert_same_events
from hypothesis import given, settings
from hypothesis import strategies as st

from hopdata.hybrid import (
    System,
    field,
    guard,
    guards,
    layout,
    on_event,
    rate_bound,
    solve,
)
from hopdata.hybrid.compiled.memory import (
    float_table,
    float_vector,
    int_table,
    int_vector,
)
from hopdata.hybrid.driver import sleep as heap

FROM = [-1.2, 1.0]
GAINS = 0.01 * np.sin(np.arange(300))


def both(params, *, start=FROM, until=20.0, **options):
    n = (len(params) - 1) // 4
    sparse = {}
    if "rate_bound" in options:
        sparse["rate_bound"] = options.pop("rate_bound")
    return (
        solve(bent(n, **options), (0, until), start, params=params),
        solve(bent_sparse(n, **options, **sparse), (0, until), start, params=params),
    )


def test_back_and_forth_over_300_guards():
    params = bent_params(np.linspace(-1, 1, 300), gains=GAINS)
    plain, sparse = both(params)
    assert_same_events(plain, sparse)
    assert len(plain.events) > 1200
    assert sparse.n_guard_evaluations < 300 * plain.n_guard_evaluations / 10
    assert sparse.n_steps == plain.n_steps


def test_guards_far_away_cost_nothing():
    """20 near and 280 distant guards need about as many evaluations as the near ones alone."""
    near = np.linspace(-1, 1, 20)
    _, few = both(bent_params(near))
    _, many = both(bent_params(np.concatenate([near, np.linspace(20, 40, 280)])))
    assert len(many.events) == len(few.events)
    assert many.n_guard_evaluations - few.n_guard_evaluations < 5 * 280


@on_event
def lock_the_last(t, y, mode, params, guard, direction):
    n = (len(params) - 1) // 4
    mode[n - 1] = int(params[0])
    return 0


def test_an_invalid_lock_of_a_sleeping_guard_is_refused():
    """Else lock 0 would never flip again: the last guard, far away, sleeps at the event."""
    params = bent_params([0.0, 30.0])
    params[0] = 0.0
    system = bent_sparse(2, on_event=lock_the_last)
    refused = solve(system, (0, 5.0), FROM, params=params)
    assert refused.status == layout.NO_LOCK
    assert "guard 'bar1'" in refused.message
    params[0] = -1.0
    assert solve(system, (0, 5.0), FROM, params=params).status == 0


def test_guards_that_move_with_time():
    sways = np.linspace(-0.5, 0.5, 50)
    assert_same_events(
        *both(bent_params(np.linspace(-1, 1, 50), sways=sways, tilts=0.1))
    )


def test_guards_that_only_time_moves():
    """The point rests while guards sway across it."""
    params = bent_params(np.linspace(-0.5, 0.5, 21) + 1e-3, sways=1.0)
    plain, sparse = both(params, start=[0.0, 0.0])
    assert_same_events(plain, sparse, tolerance=1e-12)
    assert len(plain.events) > 100


@pytest.mark.parametrize("method", ["dopri5", "dop853", "rosenbrock"])
def test_each_method(method):
    params = bent_params(np.linspace(-1, 1, 50), gains=GAINS[:50])
    plain, sparse = (
        solve(make(50), (0, 10), FROM, params=params, method=method)
        for make in (bent, bent_sparse)
    )
    assert_same_events(plain, sparse)


def test_a_jump_of_the_state_wakes_all():
    tilts = np.where(np.arange(50) == 30, 2.0, 0.0)
    plain, sparse = both(
        bent_params(np.linspace(-1, 1, 50), tilts=tilts), on_event=turn_back
    )
    assert_same_events(plain, sparse, tolerance=1e-8)
    jumps = (plain.events.before != plain.events.after).any(axis=1)
    assert jumps.sum() > 2


def test_locks_at_the_start():
    """They are also those of guards that sleep from the first step on."""
    params = bent_params(np.linspace(-20, 30, 200))
    plain, sparse = both(params, until=1.0)
    assert sparse.mode.tolist() == plain.mode.tolist()
    assert sparse.mode.sum() == plain.mode.sum() < 0


def test_the_log_leaves_out_the_locks():
    _, sparse = both(bent_params(np.linspace(-1, 1, 50)))
    assert sparse.events.mode.shape == (len(sparse.events), 0)
    assert sparse.mode.shape == (50,)


@rate_bound
def odd_bound(t, y, dy, mode, params):
    """Return a bound of the right size, made negative, infinite, or NaN by the drive."""
    size = abs(dy[0]) + 1e-9
    if params[0] == 0.0:
        return -size
    return np.inf if params[0] < 1e-12 else np.nan


@pytest.mark.parametrize(
    "drive", [0.0, 1e-14, 1e-11], ids=["negative", "infinite", "nan"]
)
def test_odd_bounds(drive):
    """The sign does not matter; without a finite bound no guard sleeps."""
    params = bent_params(np.linspace(-1, 1, 50), drive=drive)
    plain, sparse = both(params, rate_bound=odd_bound)
    assert_same_events(plain, sparse)
    evaluations = (sparse.n_guard_evaluations, 50 * plain.n_guard_evaluations)
    assert (evaluations[0] < evaluations[1] / 2) == (drive == 0.0)


@rate_bound
def raising_bound(t, y, dy, mode, params):
    if y[0] > 0.0:
        raise ValueError("no bound beyond zero")
    return 5.0


def test_an_exception_of_the_bound_is_raised():
    with pytest.raises(ValueError, match=r"^no bound beyond zero(\n|$)"):
        both(bent_params(np.linspace(-1, 1, 50)), rate_bound=raising_bound)


@field
def burst_field(t, y, mode, params, dy):
    dy[0] = t * (params[0] - t)


@guards
def burst_guards(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - params[1]
    hdot[0] = dy[0]


@guard
def burst_guard(t, y, dy, mode, params, k, h, hdot):
    h[k] = y[0] - params[1]
    hdot[k] = dy[0]


@rate_bound
def burst_bound(t, y, dy, mode, params):
    return abs(dy[0])


def test_a_burst_of_speed_within_a_step():
    """Slow, fast, slow: the motion is a cubic, which the method integrates exactly in one step."""
    options = {"n_states": 1, "guard_names": ("line",)}
    plain, sparse = (
        solve(
            system, (0, 1.2), [0.0], params=(1.2, 0.15), first_step=0.1, method="dopri5"
        )
        for system in (
            System(burst_field, burst_guards, **options),
            System(burst_field, guard=burst_guard, rate_bound=burst_bound, **options),
        )
    )
    assert sparse.events.time == pytest.approx(plain.events.time, abs=1e-9)


# The heap of sleeping guards keeps the heap property.

SIZE = 64


def memory_views(lists, wake_at, counts):
    table = float_table(0, 0)
    empty = float_vector(0, 0)
    return layout.Memory(
        table, table, int_table(0, 0), int_table(lists, SIZE), float_vector(wake_at, SIZE), empty,
        int_vector(counts, layout.COUNT_SLOTS),
    )  # fmt: skip


views = numba.njit(memory_views)


@numba.njit
def push_all(lists, wake_at, counts, keys, first):
    m = views(lists, wake_at, counts)
    for k in range(len(keys)):
        heap.push(m, first + k, keys[k])


@numba.njit
def pop_some(lists, wake_at, counts, popped):
    m = views(lists, wake_at, counts)
    for place in range(len(popped)):
        popped[place] = heap.pop(m)


@numba.njit
def replace_first(lists, wake_at, counts, k, key):
    heap.replace_first(views(lists, wake_at, counts), k, key)


KEYS = st.lists(
    st.floats(0, 1e6) | st.sampled_from([0.0, 1.0, 2.0]), max_size=SIZE // 2
)


class Heap:
    """The driver's heap in separate arrays."""

    def __init__(self):
        self.lists = np.full((layout.LIST_ROWS, SIZE), -1, dtype=np.int64)
        self.wake_at = np.full(SIZE, np.nan)
        self.counts = np.zeros(layout.COUNT_SLOTS, dtype=np.int64)
        self.arrays = tuple(
            a.ctypes.data for a in (self.lists, self.wake_at, self.counts)
        )

    def push(self, keys, first):
        push_all(*self.arrays, np.array(keys, dtype=float), first)

    def pop(self, count):
        popped = np.empty(count, dtype=np.int64)
        pop_some(*self.arrays, popped)
        return popped.tolist()

    def replace_first(self, k, key):
        replace_first(*self.arrays, k, float(key))

    @property
    def inside(self):
        """Keys and guards in the order of their places."""
        size = self.counts[layout.N_ASLEEP]
        guards = self.lists[layout.HEAP, :size].tolist()
        return list(zip(self.wake_at[:size].tolist(), guards, strict=True))


@settings(deadline=None, max_examples=200)
@given(first=KEYS, second=KEYS, part=st.floats(0, 1))
def test_guards_come_out_by_their_keys(first, second, part):
    """Each comes out once, with its own key, whatever is inserted in between."""
    ours = Heap()
    expected = sorted(first)
    keys = first + second
    ours.push(first, 0)
    out = ours.pop(int(part * len(first)))
    assert [keys[k] for k in out] == expected[: len(out)]
    ours.push(second, len(first))
    inside = ours.inside
    assert all(keys[k] == key for key, k in inside)
    assert sorted(out + [k for _, k in inside]) == list(range(len(keys)))
    for place in range(1, len(inside)):
        assert inside[(place - 1) // heap.WIDTH][0] <= inside[place][0]
    rest = ours.pop(len(inside))
    assert [keys[k] for k in rest] == sorted(expected[len(out) :] + second)
    assert ours.counts[layout.N_ASLEEP] == 0


@settings(deadline=None, max_examples=100)
@given(keys=KEYS.filter(len), later=KEYS)
def test_the_first_may_sleep_on(keys, later):
    ours = Heap()
    expected = [(key, k) for k, key in enumerate(keys)]
    ours.push(keys, 0)
    heapq.heapify(expected)
    for key in later:
        k = ours.inside[0][1]
        expected.remove((ours.inside[0][0], k))
        heapq.heapify(expected)
        heapq.heappush(expected, (key, k))
        ours.replace_first(k, key)
        assert ours.inside[0][0] == expected[0][0]
    assert sorted(ours.inside) == sorted(expected)
