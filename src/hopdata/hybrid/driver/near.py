"""The guards that a step may concern: of many, only these few are looked at closely.

Left out are guards whose cubic, through values and rates at both ends of the step, stays clear of
their surface, at an instant those that have not come to it, and before a step those that will not,
by what is known at its start.
"""

from __future__ import annotations

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver.knots import piece_ends
from hopdata.hybrid.driver.layout import (
    BEND,
    CLEARANCE,
    H0,
    H1,
    N_AWAKE,
    N_NEAR,
    NEAR,
    PIECES,
    RATE0,
    RATE1,
    SIZE,
    Memory,
)
from hopdata.hybrid.driver.problem import Problem, awake
from hopdata.hybrid.driver.surface import blur

GRAZE = 1e-2  # look closer at a dip that comes nearer than this, relative to the step's margins
THIRD = 1.0 / 3.0


@kernel
def clearance(g0: float, d0: float, g1: float, d1: float) -> float:
    """Return a number that is positive if the cubic with these margins and slopes stays clear.

    Slopes are per step. The least of its Bezier points is a lower bound of the cubic.
    """
    lowest = min(g0, g0 + THIRD * d0, g1 - THIRD * d1, g1)
    return lowest - GRAZE * max(g0, g1)


@kernel
def after(g: float, d: float, c: float, dt: float) -> float:
    """Return the least that a margin with this rate and bend can be within `dt`."""
    return g + dt * (min(d, 0.0) + 0.5 * dt * min(c, 0.0))


@kernel
def facing(lock: int, value: float) -> float:
    """Return the value as seen from the lock's side: ``lock * value``, without a conversion."""
    return value if lock > 0 else -value


@kernel_in_loop
def gather_unclear(p: Problem, m: Memory, unclear: int, first: int) -> int:
    """Put the guards that have no clearance into NEAR; return how many they are: `unclear`.

    The clearances are worked out and counted before, and the `first` place without one is found,
    in loops that are compiled into vector instructions, as the one here is not. Mostly there is
    nothing left to do, or a single guard to write down.
    """
    count, a = 0, first
    while count < unclear:
        k = awake(p, m, a)
        m.lists[NEAR, count] = k
        count += 0 if m.guards[CLEARANCE, k] > 0.0 else 1
        a += 1
    m.counts[N_NEAR] = count
    return count


@kernel_apart
def gather_near(p: Problem, m: Memory, dt: float) -> int:
    """Put the guards that may flip within the step, by its ends, into NEAR; return their number."""
    g, unclear, first = m.guards, 0, m.counts[N_AWAKE]
    for a in range(m.counts[N_AWAKE]):
        k = awake(p, m, a)
        lock = p.mode[k]
        g[CLEARANCE, k] = clearance(
            facing(lock, g[H0, k]), facing(lock, g[RATE0, k]) * dt,
            facing(lock, g[H1, k]), facing(lock, g[RATE1, k]) * dt,
        )  # fmt: skip
        unclear += 0 if g[CLEARANCE, k] > 0.0 else 1
        first = min(first, m.counts[N_AWAKE] if g[CLEARANCE, k] > 0.0 else a)
    return gather_unclear(p, m, unclear, first)


@kernel_apart
def gather_near_by_pieces(p: Problem, m: Memory, dt: float) -> int:
    """Do the same by all knots of the step: a guard must stay clear between each two."""
    g, unclear, first = m.guards, 0, m.counts[N_AWAKE]
    for a in range(m.counts[N_AWAKE]):
        k = awake(p, m, a)
        lock, least = p.mode[k], np.inf
        for piece in range(m.counts[PIECES]):
            g0, d0, g1, d1 = piece_ends(m, k, lock, piece, dt)
            least = min(least, clearance(g0, d0, g1, d1))
        g[CLEARANCE, k] = least
        unclear += 0 if least > 0.0 else 1
        first = min(first, m.counts[N_AWAKE] if least > 0.0 else a)
    return gather_unclear(p, m, unclear, first)


@kernel_apart
def gather_reached(p: Problem, m: Memory, h: int, rate: int, resolution: float) -> int:
    """Put the guards that are at their surface or past it, by rows `h` and `rate`, into NEAR."""
    g, unclear, first = m.guards, 0, m.counts[N_AWAKE]
    for a in range(m.counts[N_AWAKE]):
        k = awake(p, m, a)
        noise = blur(g[SIZE, k], g[rate, k], resolution)
        g[CLEARANCE, k] = facing(p.mode[k], g[h, k]) - noise
        unclear += 0 if g[CLEARANCE, k] > 0.0 else 1
        first = min(first, m.counts[N_AWAKE] if g[CLEARANCE, k] > 0.0 else a)
    return gather_unclear(p, m, unclear, first)


@kernel_apart
def gather_coming(p: Problem, m: Memory, dt: float) -> int:
    """Put the guards that rate and bend would take to their surface within `dt` into NEAR."""
    g, unclear, first = m.guards, 0, m.counts[N_AWAKE]
    for a in range(m.counts[N_AWAKE]):
        k = awake(p, m, a)
        lock = p.mode[k]
        g[CLEARANCE, k] = after(
            facing(lock, g[H0, k]), facing(lock, g[RATE0, k]), facing(lock, g[BEND, k]), dt
        )
        unclear += 0 if g[CLEARANCE, k] > 0.0 else 1
        first = min(first, m.counts[N_AWAKE] if g[CLEARANCE, k] > 0.0 else a)
    return gather_unclear(p, m, unclear, first)
