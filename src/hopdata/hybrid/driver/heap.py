"""The heap of guards that sleep: the one that must wake first stands at its top.

Each place has four places below it, side by side: that makes the heap flat, and the least of the
four is found without branches that a processor would have to guess.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.layout import HEAP, N_ASLEEP, Memory

WIDTH = 4


@kernel
def put(m: Memory, place: int, k: int, wake_at: float) -> None:
    """Put guard k at a place of the heap."""
    m.lists[HEAP, place], m.wake_at[place] = k, wake_at


@kernel
def push(m: Memory, k: int, wake_at: float) -> None:
    """Put guard k into the heap."""
    place = m.counts[N_ASLEEP]
    m.counts[N_ASLEEP] += 1
    while place > 0:
        above = (place - 1) // WIDTH
        if m.wake_at[above] <= wake_at:
            break
        put(m, place, m.lists[HEAP, above], m.wake_at[above])
        place = above
    put(m, place, k, wake_at)


@kernel
def least_below(m: Memory, first: int, size: int) -> int:
    """Return which of the four places from `first` on, as far as they are there, is the first."""
    w = m.wake_at
    if first + WIDTH <= size:
        left = first + (1 if w[first + 1] < w[first] else 0)
        right = first + 2 + (1 if w[first + 3] < w[first + 2] else 0)
        return right if w[right] < w[left] else left
    least = first
    for place in range(first + 1, size):
        least = place if w[place] < w[least] else least
    return least


@kernel
def replace_first(m: Memory, k: int, wake_at: float) -> None:
    """Put guard k into the heap in the place of the one that must wake first."""
    size, place, below = m.counts[N_ASLEEP], 0, 1
    while below < size:
        least = least_below(m, below, size)
        if wake_at <= m.wake_at[least]:
            break
        put(m, place, m.lists[HEAP, least], m.wake_at[least])
        place, below = least, WIDTH * least + 1
    put(m, place, k, wake_at)


@kernel
def pop(m: Memory) -> int:
    """Take the guard that must wake first out of the heap."""
    first = m.lists[HEAP, 0]
    m.counts[N_ASLEEP] -= 1
    last = m.counts[N_ASLEEP]
    if last > 0:
        replace_first(m, m.lists[HEAP, last], m.wake_at[last])
    return first
