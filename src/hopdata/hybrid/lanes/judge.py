"""Judge the guards in the steps of all lanes, and find where the first one flips.

A guard is judged by value and rate at both ends of a step and at a stage inside, whose
state is of fifth order. A cubic through the ends shows its error there and at an
earlier stage. Where they do not determine what the guard does, no judgement is
possible. A flip is located on the polynomial through the two ends and the stage inside.
"""

from math import inf
from typing import Any

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.problem import ROUNDING, way
from hopdata.hybrid.lanes.method import EARLY_PLACE, PLACE
from hopdata.hybrid.lanes.room import DUE, LOCATION, call_guards
from hopdata.hybrid.lanes.vectors import (
    WIDTH,
    absolute,
    bits,
    fma,
    largest,
    least,
    mask_of,
    spread,
    where,
)

#: Most iterations for the location of a flip.
#: Unit: 1. Origin: chosen.
ITERATIONS = 40

#: Change of a location, as a fraction of the step, at which its iteration ends:
#: Newton's next change is negligible.
#: Unit: 1. Origin: chosen.
ROOT_TOLERANCE = 1e-6

#: Largest distance by which a step's end is moved to a flip, as a fraction of the step.
#: Unit: 1. Origin: chosen.
NEAR = 1e-5

#: Fraction of its change by which a guard may be off its cubic at the two places inside
#: a step. With 0.2, and one place, 22 of 200 sums of two sines lost events; with 0.1
#: none of 600, so this is twice as strict. If 1.5 times larger, some 15 % fewer steps
#: for guards that bend quickly.
#: Unit: 1. Origin: measured: half of what lost no event of 600 sums of two sines.
FOLLOWS = 0.05

#: Relative difference of a guard's rates along one direction, up to which it counts as
#: affine.
#: Unit: 1. Origin: chosen.
AFFINE = 1e-11

#: Fraction of its values by which a guard may be off its cubic.
#: Unit: 1. Origin: chosen.
FLOOR = 1e-9

#: Fraction of its change by which a guard that follows its cubic is off.
#: Unit: 1. Origin: chosen.
MOVES = 0.02

#: Longest step in which guards that bend are judged.
#: Unit: fraction of the run. Origin: chosen.
LONGEST = 1.0 / 64.0

#: The same if they follow their cubics.
#: Unit: fraction of the run. Origin: chosen.
LONGEST_IF_SURE = 1.0 / 8.0

#: Steps that are shorter than LONGEST by this factor need not resolve distant guards.
#: Unit: 1. Origin: chosen.
FINE = 2.0**-8

# Distances between the Bezier points of the two halves of a step, and one over their
# lengths.
FIRST = PLACE / 3.0
REST = (1.0 - PLACE) / 3.0
PER_PLACE = 1.0 / PLACE
PER_REST = 1.0 / (1.0 - PLACE)


@kernel
def resolution_of(t: Any, h: Any) -> Any:
    """Return the interval below which two instants coincide."""
    return ROUNDING * largest(absolute(t), absolute(t + h))


@kernel
def mark(lanes: int, g: int, margin: Any, rate: Any, noise: Any, r: Any) -> int:
    """Record in which of these lanes a guard flips now.

    Returns these lanes.
    """
    due = bits((margin < -noise) | ((margin <= noise) & (rate < 0.0))) & lanes
    for j in range(WIDTH if due != 0 else 0):
        r.book[DUE, j] |= 1 << g if due >> j & 1 else 0
    return due


@kernel
def rises(low: Any, high: Any, slack: Any) -> Any:
    """Return where the second of two margins may be above zero.

    The first may be below.
    """
    return ((low <= slack) & (high > slack)) | ((low <= -slack) & (high > -slack))


@kernel
def straight(g: int, r: Any) -> Any:
    """Return where a guard's rate along one direction is constant over the step."""
    along = absolute(r.along[g])
    same = absolute(r.inside[g] - r.along[g]) <= AFFINE * along
    return same & (absolute(r.along1[g] - r.along[g]) <= AFFINE * along) & (along > 0.0)


@kernel
def look_along(t: Any, h: Any, r: Any) -> None:
    """Evaluate the guards' rates along one direction.

    At start, inside and end of the steps.
    """
    for i in range(r.n):
        r.work[i] = way(i)
    call_guards(r.guards, t, r.y, r.work, r, r.other_h, r.along)
    call_guards(r.guards, fma(PLACE, h, t), r.inner, r.work, r, r.other_h, r.inside)
    call_guards(r.guards, t + h, r.end, r.work, r, r.other_h, r.along1)


@kernel
def off_cubic(
    place: float, m: Any, d: Any, m0: Any, d0: Any, bend: Any, twist: Any
) -> Any:
    """Return how far margin and slope at a place are from the cubic's.

    The cubic is that over the step.
    """
    value = m0 + place * (d0 + place * (bend + place * twist))
    slope = d0 + place * (2.0 * bend + 3.0 * place * twist)
    return absolute(m - value) + 0.25 * absolute(d - slope)


@kernel
def judge(t: Any, h: Any, fine: Any, run_s: float, r: Any) -> tuple[Any, Any, Any, Any]:
    """Judge all guards in the steps that are `fine`.

    Returns four results by lane: where no judgement is possible, where a guard is past
    its surface, where a guard is at its surface at the end, and the distance of the end
    from there, in steps. Margins are positive on the side that the lock names. Each
    half of the step has a cubic, whose Bezier points bound it; they show that a guard
    stays clear, or falls through zero once.
    """
    unclear, far, touching, soonest = mask_of(0), mask_of(0), mask_of(0), spread(inf)
    r.aim[6], looked = 1.0, False
    resolution = resolution_of(t, h)
    for g in range(r.n_guards):
        lock, left = r.lock[g], r.leaving[g] > 0.5
        per_step = lock * h
        m0, d0 = where(left, 0.0, lock * r.h0[g]), per_step * r.rate0[g]
        mc, dc = lock * r.h[g], per_step * r.rate[g]
        m1, d1 = lock * r.h1[g], per_step * r.rate1[g]
        rise = m1 - m0
        bend, twist = 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise
        error = off_cubic(PLACE, mc, dc, m0, d0, bend, twist)
        early_m, early_d = lock * r.early_h[g], per_step * r.early_rate[g]
        error = largest(
            error, off_cubic(EARLY_PLACE, early_m, early_d, m0, d0, bend, twist)
        )
        slack, size = 0.25 * error, largest(absolute(m0), absolute(m1))
        noise = ROUNDING * largest(size, r.size[g]) + resolution * absolute(r.rate1[g])
        p1, p2, q1, q2 = (
            m0 + FIRST * d0,
            mc - FIRST * dc,
            mc + REST * dc,
            m1 - REST * d1,
        )
        clear = least(least(p1, p2), least(mc, least(q1, q2))) > slack
        again = rises(p1, p2, slack) | rises(p2, mc, slack)
        again = (
            again | rises(mc, q1, slack) | rises(q1, q2, slack) | (left & ~(p1 > slack))
        )
        near = largest(-NEAR * d1, noise)
        touches = (d1 < 0.0) & (absolute(m1) <= near)
        past = (m1 <= 0.0) & ~touches
        told = (clear & ~past) | ((past | touches) & ~again)
        change = largest(largest(m0, mc), m1) - least(least(m0, mc), m1)
        rough = error > FOLLOWS * change + FLOOR * (absolute(m0) + absolute(m1)) + noise
        rough = rough & (h > FINE * LONGEST * run_s)
        slow = (h > LONGEST * run_s) & (error > MOVES * change)
        doubtful = (rough | slow | (h > LONGEST_IF_SURE * run_s)) & told & fine
        if bits(doubtful) != 0:
            if not looked:
                look_along(t, h, r)
                looked = True
            doubtful = doubtful & ~straight(g, r)
        unclear = unclear | ~told | doubtful
        far, touching = far | past, touching | touches
        if bits(touches) != 0:
            soonest = where(touches, least(soonest, -m1 / d1), soonest)
        if bits(past) != 0:
            early = mc <= 0.0
            fall = where(early, m0 - mc, mc - m1)
            place = where(early, PLACE * m0, (1.0 - PLACE) * mc) / fall  # on the chord
            place = where(early & left, 0.5 * PLACE, place)  # it starts on its surface
            place = where(early, place, PLACE + place)
            sooner = past & (place < r.aim[6])
            for i, value in enumerate((m0, d0, mc, dc, m1, d1, place)):
                r.aim[i] = where(sooner, value, r.aim[i])
    return unclear, far, touching, soonest


@kernel
def root(go: Any, r: Any) -> Any:
    """Return where the first guard falls through zero, as a fraction of the step.

    Bracketed Newton iteration on the polynomial through values and rates at three
    places.
    """
    m0 = r.aim[0]
    d0 = r.aim[1]
    mc = r.aim[2]
    dc = r.aim[3]
    m1 = r.aim[4]
    d1 = r.aim[5]
    # Newton's divided differences, of first order (a to d), second (e, f, k) and third.
    left = (mc - m0) * PER_PLACE
    right = (m1 - mc) * PER_REST
    a = (left - d0) * PER_PLACE
    b = (dc - left) * PER_PLACE
    c = (right - dc) * PER_REST
    d = (d1 - right) * PER_REST
    e = (b - a) * PER_PLACE
    f = c - b
    k = (d - c) * PER_REST
    p = f - e
    q = k - f
    x = r.aim[LOCATION]
    low = spread(0.0)
    high = spread(1.0)
    for _ in range(ITERATIONS):
        u = x - PLACE
        w = x - 1.0
        value = fma(w, q - p, p)
        slope = q - p
        slope = fma(u, slope, value)
        value = fma(u, value, e)
        slope = fma(u, slope, value)
        value = fma(u, value, a)
        slope = fma(x, slope, value)
        value = fma(x, value, d0)
        slope = fma(x, slope, value)
        value = fma(x, value, m0)
        low = where(value > 0.0, x, low)
        high = where(value > 0.0, high, x)
        new = x - value / slope
        new = where((new > low) & (new < high), new, 0.5 * (low + high))
        far = absolute(new - x) > ROOT_TOLERANCE
        x = where(go, new, x)
        go = go & far
        if bits(go) == 0:
            break
    return x
