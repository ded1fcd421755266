"""The heap of sleeping guards is a heap."""

from __future__ import annotations

import heapq

import numba
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hopdata.hybrid.compiled.views import float_table, float_vector, int_table, int_vector
from hopdata.hybrid.driver import heap, layout

SIZE = 64


def memory_views(lists, wake_at, counts):
    table, empty = float_table(0, 0), float_vector(0, 0)
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


KEYS = st.lists(st.floats(0, 1e6) | st.sampled_from([0.0, 1.0, 2.0]), max_size=SIZE // 2)


class Heap:
    """The driver's heap in arrays of its own."""

    def __init__(self):
        self.lists = np.full((layout.LIST_ROWS, SIZE), -1, dtype=np.int64)
        self.wake_at = np.full(SIZE, np.nan)
        self.counts = np.zeros(layout.COUNT_SLOTS, dtype=np.int64)
        self.arrays = tuple(a.ctypes.data for a in (self.lists, self.wake_at, self.counts))

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
        """Keys and guards, in the order of the places."""
        size = self.counts[layout.N_ASLEEP]
        guards = self.lists[layout.HEAP, :size].tolist()
        return list(zip(self.wake_at[:size].tolist(), guards, strict=True))


@settings(deadline=None, max_examples=200)
@given(first=KEYS, second=KEYS, part=st.floats(0, 1))
def test_guards_come_out_by_their_keys(first, second, part):
    """Each once, with its own key, whatever goes in between."""
    ours, expected, keys = Heap(), sorted(first), first + second
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
    ours, expected = Heap(), [(key, k) for k, key in enumerate(keys)]
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
