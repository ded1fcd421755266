"""Prove the guards in the steps of all lanes, by the driver's own proof.

Whole steps are enclosed in all lanes at once, and the guards' own code is run for
ranges of lanes (see `ranges`): that each guard stays clear, or falls through zero once,
is mostly decided so. A step that needs more leaves the lane: its interpolant and the
guards at both of its ends are written into a memory like the driver's (`blocks`), and
the driver's kernel finds the first flip, or proves that there is none (see
`driver.proof`). A system in which it proves neither is left to the driver.
"""

from math import inf
from typing import Any

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import int_vector
from hopdata.hybrid.driver.enclosure import begin_enclosing
from hopdata.hybrid.driver.end_step import RETAKE_ABOVE
from hopdata.hybrid.driver.localise import NONE
from hopdata.hybrid.driver.loop import memory_of, problem_of
from hopdata.hybrid.driver.problem import ROUNDING, Problem, has_flipped, terms_at
from hopdata.hybrid.driver.proof import (
    END_ROUNDING,
    INTERPOLANT,
    NEARLY,
    STILL,
    proven_flip,
)
from hopdata.hybrid.lanes import method as written
from hopdata.hybrid.lanes.method import DENSE, STAGES
from hopdata.hybrid.lanes.room import (
    DUE,
    LOCATION,
    RANGE,
    TIME,
    call_guards,
    call_ranged,
    interpolate,
    state,
)
from hopdata.hybrid.lanes.vectors import (
    WIDTH,
    absolute,
    bits,
    fma,
    lane,
    largest,
    least,
    mask_of,
    spread,
    where,
    with_lane,
)
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.methods.explicit import compose

#: Steps of Newton's method for the root of a polynomial.
#: Unit: 1. Origin: chosen.
NEWTON_STEPS = 12

#: Change of a root, as a fraction of the step, at which its iteration ends: Newton's
#: next change is negligible.
#: Unit: 1. Origin: chosen.
ROOT_TOLERANCE = 1e-4

#: Largest distance by which a step's end is moved to a flip, as a fraction of the step.
#: Unit: 1. Origin: chosen.
NEAR = 1e-5


#: Largest such distance where only rounding says that the guard is at its surface.
#: Unit: fraction of the step. Origin: convention: as in `driver.end_step`.
FARTHEST_MOVE = RETAKE_ABOVE

#: Factor that leaves 21 of the 53 binary digits of a number. Where the driver's kernel
#: finds a flip, it calls functions of the C library, whose last digits differ between
#: processors; the step's end is moved by what this leaves, which is less than NEAR.
#: Unit: 1. Origin: chosen.
FEW_DIGITS = 2.0**32 + 1.0


@kernel
def in_few_digits(x: float) -> float:
    """Return a number to 21 binary digits (Veltkamp's splitting)."""
    many = FEW_DIGITS * x
    return many - (many - x)


@kernel
def resolution_of(t: Any, h: Any) -> Any:
    """Return the interval below which two instants coincide."""
    return ROUNDING * largest(absolute(t), absolute(t + h))


@kernel
def mark(lanes: int, g: int, margin: Any, rate: Any, noise: Any, r: Any) -> int:
    """Record in which of these lanes a guard flips now; return those where it does."""
    due = bits((margin < -noise) | ((margin <= noise) & (rate < 0.0))) & lanes
    for j in range(WIDTH if due != 0 else 0):
        r.book[DUE, j] |= 1 << g if due >> j & 1 else 0
    return due


# The memory of a lane.

UNKNOWN = -1.0  # size of the terms of a guard that has flipped, until it is asked for


@kernel
def problem_in(j: int, r: Any) -> Any:
    """Return the driver's problem of the system in lane j."""
    return problem_of(int_vector(r.blocks[0, j], 0))


@kernel
def memory_in(j: int, r: Any) -> Any:
    """Return the driver's memory for lane j."""
    return memory_of(int_vector(r.blocks[0, j], 0))


@kernel_apart
def begin_proofs(j: int, r: Any) -> None:
    """Let the memory of lane j be that of a system at its start."""
    m = memory_in(j, r)
    for one in range(at.COUNT_SLOTS):
        m.counts[one] = 0
    m.counts[at.N_AWAKE] = r.n_guards
    m.counts[at.DEGREE] = DENSE
    m.clock[at.INSTANT] = -inf
    m.clock[at.PIECE] = inf
    for g in range(r.n_guards):
        m.lists[at.AWAKE, g] = g
        m.flags[at.LAST_FLIP, g] = 0
        m.flags[at.FLIPS, g] = 0
        m.flags[at.BRANCHED, g] = 0
        m.guards[at.GRAIN, g] = 0.0
        m.guards[at.PARTS, g] = 0.0


@kernel
def note_instant(j: int, r: Any) -> None:
    """Note that an instant begins in lane j."""
    m = memory_in(j, r)
    m.counts[at.INSTANTS] += 1
    m.clock[at.INSTANT] = lane(r.course[TIME], j)


@kernel
def note_flip(j: int, g: int, r: Any) -> None:
    """Note that guard g flips at the present instant of lane j."""
    m = memory_in(j, r)
    m.flags[at.LAST_FLIP, g] = m.counts[at.INSTANTS]
    m.flags[at.FLIPS, g] = 1
    m.guards[at.PARTS, g] = UNKNOWN


# The proof of a step.


@kernel
def write_step(j: int, t: Any, h: Any, r: Any) -> bool:
    """Write the step of lane j into its memory; return whether its guards are finite.

    The interpolants must have been prepared.
    """
    m = memory_in(j, r)
    m.clock[at.T] = lane(t, j)
    m.clock[at.SPAN] = lane(h, j)
    s = m.states
    for i in range(r.n):
        s[at.Y, i] = lane(r.y[i], j)
        for q in range(DENSE):
            s[at.P1 + q, i] = lane(r.dense[DENSE * i + q], j)
    total = 0.0
    for k in range(r.n_guards):
        m.guards[at.H0, k] = lane(r.h0[k], j)
        m.guards[at.RATE0, k] = lane(r.rate0[k], j)
        m.guards[at.H1, k] = lane(r.h1[k], j)
        m.guards[at.RATE1, k] = lane(r.rate1[k], j)
        m.guards[at.SIZE, k] = lane(r.size[k], j)
        total += abs(m.guards[at.H1, k]) + abs(m.guards[at.RATE1, k])
    return total < inf


@kernel_apart
def measure_parts(p: Problem, m: Memory) -> None:
    """Measure the terms of the guards that have flipped since they were measured."""
    for k in range(m.guards.width):
        if m.guards[at.PARTS, k] == UNKNOWN:
            m.guards[at.PARTS, k] = terms_at(p, m, k, m.clock[at.T], at.Y)
        if has_flipped(m, k):
            parts = m.guards[at.PARTS, k]
            m.guards[at.SIZE, k] = max(m.guards[at.SIZE, k], parts)


@kernel_apart
def prove_one(j: int, t: Any, h: Any, r: Any) -> tuple[float, bool]:
    """Return where the first guard flips in the step of lane j, and if that is proven.

    The place is a fraction of the step, and infinite if none flips. IS_CLOSE of the
    lane's memory says whether a guard turns closer to its surface than the tolerance
    can tell.
    """
    if not write_step(j, t, h, r):
        return inf, False
    p = problem_in(j, r)
    m = memory_in(j, r)
    measure_parts(p, m)
    begin_enclosing(p, m)
    k, place, jumps = proven_flip(p, m, lane(h, j))
    if m.counts[at.UNPROVEN] != 0 or jumps:
        return inf, False
    if k == NONE:
        return inf, True
    return in_few_digits(place), True


@kernel
def do_not_count(lanes: int, r: Any) -> None:
    """Take back that the steps of these lanes are close, since they are taken again."""
    for j in range(WIDTH):
        memory_in(j, r).counts[at.CLOSE] -= 1 if lanes >> j & 1 else 0


# All lanes at once: the whole step as one piece. What is not decided so is left to the
# driver's kernel.


enclose = kernel(compose("enclose", "h, r", written.range_code(), globals()))


@kernel
def noise_of(g: int, rate: Any, resolution: Any, r: Any) -> Any:
    """Return the change of a margin that rounding, of h and of time, may cause."""
    size = largest(largest(absolute(r.h0[g]), absolute(r.h1[g])), r.size[g])
    return ROUNDING * size + resolution * absolute(rate)


@kernel
def is_past_at_end(g: int, resolution: Any, r: Any) -> Any:
    """Return where a guard is past its surface at the end of the step."""
    margin = r.lock[g] * r.h1[g]
    rate = r.lock[g] * r.rate1[g]
    noise = noise_of(g, rate, resolution, r)
    return (margin < -noise) | ((margin <= 0.0) & (rate < 0.0))


@kernel
def lowest(m0: Any, m1: Any, least_rate: Any, most_rate: Any, h: Any) -> Any:
    """Return a lower bound of margins that turn between the ends of their steps.

    It is that of `driver.proof.lowest`.
    """
    x = (m1 - m0 - most_rate * h) / (least_rate - most_rate)
    x = least(largest(x, 0.0), h)
    return least(m0 + least_rate * x, m1 - most_rate * (h - x))


@kernel
def are_not_close(t: Any, h: Any, r: Any) -> Any:
    """Return where no guard turns closer to its surface than the tolerance can tell.

    Their least distances are in the rows `h`. Each state moves by its tolerance, as in
    `driver.proof.vary`; that time goes on, too, makes the guards' reach larger. The
    slopes of the states and the ranges of the guards are overwritten.
    """
    for i in range(r.n):
        k = RANGE * i
        size = largest(absolute(r.ranges[k]), absolute(r.ranges[k + 1]))
        reach = INTERPOLANT * fma(r.rtol, size, r.atol[i])
        r.ranges[k + 2] = -reach
        r.ranges[k + 3] = reach
    call_ranged(r.ranged, t, t + h, r)
    result = mask_of(-1)
    for g in range(r.n_guards):
        q = RANGE * g
        farther = (r.h[g] > -r.limits[q + 2]) & (r.h[g] > r.limits[q + 3])
        result = result & (farther | (r.h[g] == inf))
    return result


@kernel
def decide(t: Any, h: Any, fine: Any, r: Any) -> tuple[Any, Any]:
    """Decide the guards over whole steps by their ranges, as `driver.proof.judge` does.

    Returns where this decides all guards, and where at least one of these flips: once,
    and not from its surface.
    """
    enclose(h, r)
    call_ranged(r.ranged, t, t + h, r)
    resolution = resolution_of(t, h)
    decided = mask_of(-1)
    are_clear = mask_of(-1)  # or decided: where guards turn, perhaps too close to tell
    flips = mask_of(0)
    for g in range(r.n_guards):
        lock = r.lock[g]
        up = lock > 0.0
        q = RANGE * g
        low = where(up, r.limits[q], -r.limits[q + 1])
        high = where(up, r.limits[q + 1], -r.limits[q])
        least_rate = where(up, r.limits[q + 2], -r.limits[q + 3])
        most_rate = where(up, r.limits[q + 3], -r.limits[q + 2])
        m0 = lock * r.h0[g]
        m1 = lock * r.h1[g]
        d0 = lock * r.rate0[g]
        d1 = lock * r.rate1[g]
        noise = noise_of(g, d0, resolution, r)
        on = (m0 <= 0.0) | ((m0 <= noise) & (d0 > 0.0))
        past = is_past_at_end(g, resolution, r)
        # A rate that moves h by no more than its rounding counts as zero.
        size = largest(absolute(low), absolute(high))
        still = STILL * size / h
        still = where(still < inf, still, 0.0)
        falls = most_rate <= still
        rises = least_rate >= -still
        far = (low > 0.0) & ((low > NEARLY * (high - low)) | falls | rises)
        stays = ~past & (falls | (rises & (on | (m1 > 0.0))))
        once = past & falls & ~on
        finite = absolute(m1) + absolute(d1) < inf
        told = finite & (far | stays | once)
        doubt = END_ROUNDING * size
        bound = lowest(m0 - doubt, m1 - doubt, least_rate, most_rate, h)
        limited = absolute(least_rate) + absolute(most_rate) < inf
        off = (m0 > 0.0) & (m1 > 0.0) & ~on & limited
        clearance = where(low > 0.0, low, where(off, bound, -1.0))
        r.h[g] = where(told, inf, clearance)
        decided = decided & told
        are_clear = are_clear & (told | (finite & (clearance > 0.0)))
        flips = flips | (once & ~far)
    if bits(fine & are_clear & ~decided) != 0:
        decided = decided | (are_clear & are_not_close(t, h, r))
    return decided, flips & decided


@kernel
def locate(flips: Any, t: Any, h: Any, r: Any) -> None:
    """Write where the first guard flips in these steps into LOCATION.

    It is the root of a quartic: the cubic over the step, and a term that vanishes with
    its slope at both ends and makes up for the cubic's error at its own root, where the
    guard is evaluated on the interpolant. The error that is left shows when the step is
    repeated up to there.
    """
    place = spread(1.0)
    first = spread(-1.0)
    resolution = resolution_of(t, h)
    for g in range(r.n_guards):
        m0 = r.lock[g] * r.h0[g]
        m1 = r.lock[g] * r.h1[g]
        d0 = r.lock[g] * h * r.rate0[g]
        d1 = r.lock[g] * h * r.rate1[g]
        past = flips & (m0 > 0.0) & is_past_at_end(g, resolution, r)
        x = root(past, m0, d0, m1, d1, 0.0, m0 / (m0 - m1))
        sooner = past & (x < place)
        place = where(sooner, x, place)
        first = where(sooner, float(g), first)
    interpolate(place, r)
    end_slope = state(r.k, STAGES * r.n)
    call_guards(r.guards, fma(place, h, t), r.work, end_slope, r, r.h, r.rate)
    for g in range(r.n_guards):
        mine = first == float(g)
        if bits(mine) != 0:
            m0 = r.lock[g] * r.h0[g]
            m1 = r.lock[g] * r.h1[g]
            d0 = r.lock[g] * h * r.rate0[g]
            d1 = r.lock[g] * h * r.rate1[g]
            rest = place * (1.0 - place)
            quartic = r.lock[g] * r.h[g] / (rest * rest)
            x = root(mine, m0, d0, m1, d1, quartic, place)
            place = where(mine & (x > 0.0) & (x < 1.0), x, place)
            first = where(mine, -1.0, first)
    r.aim[LOCATION] = where(flips, place, r.aim[LOCATION])


@kernel
def root(go: Any, m0: Any, d0: Any, m1: Any, d1: Any, quartic: Any, x: Any) -> Any:
    """Return where a quartic falls through zero in the unit interval.

    It has these values and slopes at both ends; `quartic` is its leading coefficient,
    and x the first guess. It is sought in the lanes `go`.
    """
    rise = m1 - m0
    bend = 3.0 * rise - 2.0 * d0 - d1
    twist = d0 + d1 - 2.0 * rise
    low = spread(0.0)
    high = spread(1.0)
    for _ in range(NEWTON_STEPS):
        rest = x * (1.0 - x)
        value = m0 + x * (d0 + x * (bend + x * twist)) + quartic * rest * rest
        steep = d0 + x * (2.0 * bend + 3.0 * x * twist)
        steep = steep + 2.0 * quartic * rest * (1.0 - 2.0 * x)
        low = where(value > 0.0, x, low)
        high = where(value > 0.0, high, x)
        new = x - value / steep
        new = where((new > low) & (new < high), new, 0.5 * (low + high))
        far = absolute(new - x) > ROOT_TOLERANCE
        x = where(go, new, x)
        go = go & far
        if bits(go) == 0:
            break
    return x


@kernel
def prove(t: Any, h: Any, fine: Any, r: Any) -> tuple[Any, Any, Any]:
    """Prove the guards in the steps that are `fine`.

    Their interpolants must have been prepared. Returns where nothing is proven, where a
    guard flips (LOCATION says at which fraction of the step), and where one turns
    closer to its surface than the tolerance can tell.
    """
    lost = 0
    seen = 0
    close = 0
    r.aim[LOCATION] = spread(1.0)
    mine = bits(fine)
    if r.n_guards == 0 or mine == 0:
        return mask_of(0), mask_of(0), mask_of(0)
    if r.ranged != 0:
        decided, flips = decide(t, h, fine, r)
        mine &= ~bits(decided)
        seen = bits(flips & fine)
        if seen != 0:
            locate(mask_of(seen), t, h, r)
    for j in range(WIDTH if mine != 0 else 0):
        if mine >> j & 1:
            there, is_proven = prove_one(j, t, h, r)
            if not is_proven:
                lost |= 1 << j
                continue
            close |= 1 << j if memory_in(j, r).counts[at.IS_CLOSE] != 0 else 0
            if there < inf:
                seen |= 1 << j
                r.aim[LOCATION] = with_lane(r.aim[LOCATION], j, there)
    return mask_of(lost), mask_of(seen), mask_of(close)


@kernel
def at_surface(t: Any, h: Any, r: Any) -> tuple[Any, Any, Any]:
    """Return where a guard is at its surface at the end of the step.

    Returns the distance of the end from there, too, in steps, and where each guard is
    at its surface or before it.
    """
    before = mask_of(-1)
    touching = mask_of(0)
    soonest = spread(inf)
    resolution = resolution_of(t, h)
    for g in range(r.n_guards):
        margin = r.lock[g] * r.h1[g]
        rate = r.lock[g] * h * r.rate1[g]
        size = largest(absolute(r.h0[g]), absolute(r.h1[g]))
        noise = ROUNDING * largest(size, r.size[g]) + resolution * absolute(r.rate1[g])
        touches = (rate < 0.0) & (absolute(margin) <= largest(-NEAR * rate, noise))
        touching = touching | touches
        before = before & (touches | (margin >= -noise))
        # Where rounding hides a slow guard, its rate does not tell how far it is.
        shift = -margin / rate
        shift = where(absolute(shift) <= FARTHEST_MOVE, shift, 0.0)
        soonest = where(touches, least(soonest, shift), soonest)
    return touching, soonest, before
