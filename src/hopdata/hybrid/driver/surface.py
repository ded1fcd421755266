"""When does a guard flip? Signs, locks and rounding.

The margin of a guard is g = b h, for its lock b = -1 or +1: positive on the side that the lock
names, and falling through zero when the guard flips. A guard that has just flipped is on its new
side by decree, whatever rounding makes of h.
"""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.layout import DUE, N_DUE, N_NEAR, NEAR, SIZE, Memory
from hopdata.hybrid.driver.problem import Problem

EPS = 2.0**-52
ROUNDING = 4 * EPS  # of h, relative to its largest value over the step
TIME_ROUNDING = 4 * EPS  # of an event's time


@kernel
def time_resolution(t: float, dt: float) -> float:
    """Return the interval below which two instants are one: rounding, not a tolerance."""
    return TIME_ROUNDING * max(abs(t), abs(t + dt), dt)


@kernel
def blur(size: float, rate: float, resolution: float) -> float:
    """Return by how much rounding, of h and of time, may change a margin."""
    return ROUNDING * size + resolution * abs(rate)


@kernel
def is_due(g: float, rate: float, size: float, resolution: float) -> bool:
    """Tell whether a guard flips now.

    Parameters
    ----------
    g, rate : float
        Distance to the surface, positive on the lock's side, and its rate.
    size : float
        Largest |h| lately: the scale of the rounding error in g.
    resolution : float
        Time below which two instants are one, s.
    """
    noise = blur(size, rate, resolution)
    return g < -noise or (g <= noise and rate < 0.0)


@kernel_apart
def mark_due(p: Problem, m: Memory, h: int, rate: int, resolution: float) -> int:
    """Put those of the guards in NEAR that flip now, by rows `h` and `rate`, into DUE."""
    g, total = m.guards, 0
    for a in range(m.counts[N_NEAR]):
        k = m.lists[NEAR, a]
        lock = p.mode[k]
        if is_due(lock * g[h, k], lock * g[rate, k], g[SIZE, k], resolution):
            m.lists[DUE, total] = k
            total += 1
    m.counts[N_DUE] = total
    return total


@kernel
def mark_one(m: Memory, k: int) -> int:
    """Put guard k, alone, into DUE; return 1."""
    m.lists[DUE, 0] = k
    m.counts[N_DUE] = 1
    return 1


@kernel
def remember_residuals(p: Problem, m: Memory, h: int) -> None:
    """Count what is left of h at guards that flip now, though on their old side, as rounding."""
    g = m.guards
    for a in range(m.counts[N_DUE]):
        k = m.lists[DUE, a]
        left = p.mode[k] * g[h, k]
        if left > 0.0:
            g[SIZE, k] = max(g[SIZE, k], 2.0 * left / ROUNDING)


@kernel
def next_due(m: Memory, last: int) -> int:
    """Return the first guard after `last` that flips now, by number, or -1: waking up shuffles."""
    found = -1
    for a in range(m.counts[N_DUE]):
        k = m.lists[DUE, a]
        if k > last and (found < 0 or k < found):
            found = k
    return found
