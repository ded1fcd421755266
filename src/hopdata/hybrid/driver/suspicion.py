"""Which guards may flip within a step, and about where: judged by the cubics between its knots.

A cubic takes values and rates at both ends of its piece of the step. Where it falls through zero
the guard is past its surface, where it only comes near the interpolant has to tell.
"""

from __future__ import annotations

from math import inf

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.hermite import NOWHERE, cubic, cubic_root, turning_points
from hopdata.hybrid.driver.knots import ends_between, piece_before
from hopdata.hybrid.driver.layout import CLEARANCE, H0, N_NEAR, NEAR, PIECES, SIZE, H, Memory, T
from hopdata.hybrid.driver.near import GRAZE, clearance
from hopdata.hybrid.driver.problem import Problem
from hopdata.hybrid.driver.surface import blur, time_resolution

PASS, CROSSING, DIP = 0, 1, 2
NONE = -1  # no guard

EDGE = 1e-6  # a dip this near to an end of its piece is that end
STEEPEST = 0.34  # rise over slope, from which a cubic cannot turn back: a third
UNSURE = 0.5  # of a dip's depth: by so much may its cubic be wrong


@kernel
def is_monotone(rise: float, d0: float, d1: float) -> bool:
    """Tell whether a cubic with these slopes is sure to be monotone (Fritsch and Carlson)."""
    if d0 >= 0.0:
        return d1 >= 0.0 and rise >= STEEPEST * max(d0, d1)
    return d1 <= 0.0 and rise <= STEEPEST * min(d0, d1)


@kernel
def suspect(g0: float, d0: float, g1: float, d1: float, noise: float) -> tuple[int, float, float]:
    """Judge a guard by its cubic, which does not stay clear.

    Takes margin and slope (per step) at both ends, and what rounding may make of a margin that is
    zero; returns the kind of suspicion, where to look first, and a place before that.
    """
    # A guard that has just flipped, and leaves, may still be on its old side by rounding.
    crossed = g1 < -noise or (g1 <= 0.0 and d1 < 0.0)
    if not crossed and is_monotone(g1 - g0, d0, d1):
        return PASS, 1.0, 0.0
    top, bottom = turning_points(g0, d0, g1, d1)
    low = top if g0 == 0.0 and top < bottom else 0.0
    deep = inf
    if EDGE < bottom < 1.0 - EDGE:
        deep = cubic(g0, d0, g1, d1, bottom)
    if crossed:
        high = bottom if deep < 0.0 and bottom > low else 1.0
        return CROSSING, cubic_root(g0, d0, g1, d1, low, high), low
    if g0 <= noise and (d0 < 0.0 or g1 <= noise) and deep >= -noise:
        return PASS, 1.0, 0.0  # at its surface for all that rounding can tell, and stays there
    if deep < max(GRAZE * max(g0, g1), UNSURE * (min(g0, g1) - deep)):
        return DIP, bottom, low
    return PASS, 1.0, 0.0


@kernel
def suspect_before(
    m: Memory, k: int, lock: int, dt: float, end: float, resolution: float
) -> tuple[int, float, float, int]:
    """Judge a guard between each two knots of the step that ends at its part `end`.

    Returns what `suspect` does of the first piece in which it does not stay clear, and that.
    """
    g = m.guards
    for piece in range(m.counts[PIECES]):
        last, start, part = piece_before(m, piece, end)
        if not part > 0.0:
            break
        g0, d0, g1, d1 = ends_between(m, k, lock, H0 + 2 * piece, last, part * dt)
        if clearance(g0, d0, g1, d1) > 0.0:
            continue
        noise = blur(g[SIZE, k], g[last + 1, k], resolution)
        kind, guess, low = suspect(max(g0, 0.0), d0, g1, d1, noise)
        if kind != PASS:
            return kind, start + guess * part, start + low * part, piece
    return PASS, 1.0, 0.0, 0


@kernel
def first_suspect(p: Problem, m: Memory, dt: float) -> tuple[int, int, float, float, int]:
    """Return (kind, guard, guess, low, piece) of the suspect guard with the earliest guess.

    All that are near are asked; those that are suspect have no clearance at all from then on.
    """
    best = (PASS, NONE, NOWHERE, 0.0, 0)
    resolution = time_resolution(m.clock[T], dt)
    for a in range(m.counts[N_NEAR]):
        k = m.lists[NEAR, a]
        kind, guess, low, piece = suspect_before(m, k, p.mode[k], dt, 1.0, resolution)
        if kind != PASS:
            m.guards[CLEARANCE, k] = -inf
            if guess < best[2]:
                best = (kind, k, guess, low, piece)
    return best


@kernel
def first_rival(
    p: Problem, m: Memory, dt: float, k: int, end: float
) -> tuple[int, int, float, float, int]:
    """Return the same of the guards that may flip before guard k does, at `end`.

    Asked are those that are suspect, and those past their surface in row H.
    """
    g = m.guards
    best = (PASS, NONE, NOWHERE, 0.0, 0)
    resolution = time_resolution(m.clock[T], dt)
    for a in range(m.counts[N_NEAR]):
        j = m.lists[NEAR, a]
        lock = p.mode[j]
        if j == k or not (g[CLEARANCE, j] == -inf or lock * g[H, j] < 0.0):
            continue
        kind, guess, low, piece = suspect_before(m, j, lock, dt, end, resolution)
        if kind != PASS and guess < best[2]:
            best = (kind, j, guess, low, piece)
    return best
