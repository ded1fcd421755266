"""End a step before a guard's code takes another branch, and step across separately.

Within a step the guards then follow one smooth formula, as the search for flips
assumes. The states of the step's interpolant are enclosed in ranges over a piece of the
step, and the guards are evaluated for these ranges (see `numbers.ranges`): this proves
that no comparison in their code has two answers there, or else the piece is divided.
The short step across a branch is judged by the signs of the guards at its ends, because
a guard may jump in it.

Where a branch stays open over a stretch (a comparison of two numbers that rounding
alone tells apart), steps across it double in length, and are counted in UNPROVEN once
they are no longer short. Guards without code for ranges are sampled in every step, and
so are those that branch again and again without a flip.
"""

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver.dense import prepare_interpolant
from hopdata.hybrid.driver.paths import first_path, is_bent
from hopdata.hybrid.driver.problem import EPS, Problem, guards_at_end, time_resolution
from hopdata.hybrid.driver.stepping import take_step
from hopdata.hybrid.layout import Memory

AT_BRANCH = 3  # value of WATCHED: the step crosses a branch
Pair = tuple[float, float]

#: Bound on the rounding of a step's interpolant, as a fraction of the state.
#: Unit: 1. Origin: rounding: 64 units in the last place of a double.
GRAIN = 64.0 * EPS

#: Length of a step across a branch, and of the shortest piece that is examined.
#: Unit: time resolutions. Origin: chosen.
SHORTEST = 8.0

#: A step across a branch that is longer than SHORTEST by this factor counts as not
#: proven.
#: Unit: 1. Origin: chosen.
SURE = 2.0**12

MOST_DOUBLED = 60  # doublings of that length: it then exceeds any run

#: Pieces examined in one step; a branch takes some 100.
#: Unit: 1. Origin: chosen.
MOST_LOOKS = 500

#: How often a step is taken again up to the branch, which moves by the step's error.
#: Unit: 1. Origin: chosen.
MOST_RETAKES = 8

#: Steps across branches, since the last event, after which guards are sampled for the
#: rest of the run: they branch all the time, as noise made by `%` does, and not where
#: they flip. If 1.5 times larger, a run with such a guard takes some 10 ms more before
#: it is sampled.
#: Unit: 1. Origin: chosen.
MOST_BARREN = 500

#: Fraction of the run between two samples of guards that branch and have no code for
#: ranges.
#: Unit: 1. Origin: chosen.
SAMPLED = 2.0**-8


@kernel_in_loop
def times(lo: float, hi: float, a: float, b: float) -> Pair:
    """Return the product of the ranges [lo, hi] and [a, b], where a >= 0."""
    low = lo * a if lo >= 0.0 else lo * b
    high = hi * b if hi >= 0.0 else hi * a
    return low, high


@kernel_in_loop
def range_of(
    m: Memory, i: int, a: float, b: float, in_powers: bool
) -> tuple[Pair, Pair]:
    """Return ranges of state i and its slope per step on [a, b].

    They are found by Horner's scheme.
    """
    s = m.states
    last = m.counts[at.DEGREE] - 1
    lo = s[at.P1 + last, i]
    hi = lo
    slope_lo = 0.0
    slope_hi = 0.0
    for j in range(last - 1, -1, -1):
        falls = j % 2 == 0 and not in_powers  # the factor is 1 - x
        first = 1.0 - b if falls else a
        end = 1.0 - a if falls else b
        slope_lo, slope_hi = times(slope_lo, slope_hi, first, end)
        slope_lo += -hi if falls else lo
        slope_hi += -lo if falls else hi
        lo, hi = times(lo, hi, first, end)
        lo += s[at.P1 + j, i]
        hi += s[at.P1 + j, i]
    slope_lo, slope_hi = times(slope_lo, slope_hi, a, b)
    slope_lo += lo
    slope_hi += hi
    lo, hi = times(lo, hi, a, b)
    return (s[at.Y, i] + lo, s[at.Y, i] + hi), (slope_lo, slope_hi)


@kernel_apart
def enclose(p: Problem, m: Memory, dt: float, a: float, b: float) -> None:
    """Write ranges of states and slopes over a piece of the step.

    They are written to the rows LEAST to MOST_SLOPE. The range by Horner's scheme is
    narrowed by the value in the middle and the range of the slope, whose error falls
    with the square of the piece.
    """
    s = m.states
    half = 0.5 * (b - a)
    middle = 0.5 * (a + b)
    in_powers = p.methods[m.counts[at.METHOD], at.IN_POWERS] != 0
    for i in range(s.width):
        (lo, hi), (slope_lo, slope_hi) = range_of(m, i, a, b, in_powers)
        (center, _), _ = range_of(m, i, middle, middle, in_powers)
        reach = half * max(abs(slope_lo), abs(slope_hi))
        grain = GRAIN * max(abs(lo), abs(hi), abs(s[at.Y, i]))
        s[at.LEAST, i] = max(lo, center - reach) - grain
        s[at.MOST, i] = min(hi, center + reach) + grain
        steep = GRAIN * max(abs(slope_lo), abs(slope_hi)) + grain
        s[at.LEAST_SLOPE, i] = (slope_lo - steep) / dt
        s[at.MOST_SLOPE, i] = (slope_hi + steep) / dt


@kernel_apart
def is_open(p: Problem, m: Memory, dt: float, a: float, b: float) -> bool:
    """Return whether a guard may take another branch within a piece of the step.

    Overwrites the rows H_LEAST to RATE_MOST of the guards.
    """
    enclose(p, m, dt, a, b)
    t = m.clock[at.T]
    m.counts[at.NGEV] += 1
    first_path(p, m, t + a * dt, t + b * dt, 1.0)
    return is_bent(m)


@kernel_apart
def clear_until(p: Problem, m: Memory, dt: float, shortest: float) -> float:
    """Return the fraction of the step up to which no branch is open.

    It is found to within `shortest`. Pieces are halves of halves, so that their ends
    are exact.
    """
    low = 0.0
    width = 1.0
    for _ in range(MOST_LOOKS):
        if low >= 1.0:
            break
        if not is_open(p, m, dt, low, low + width):
            low += width
            while width < 1.0 and low % (2.0 * width) == 0.0:
                width *= 2.0
        elif width > shortest:
            width *= 0.5
        else:
            break
    return low


@kernel_apart
def cross_branch(p: Problem, m: Memory, dt: float, span: float) -> float:
    """Take a step across a branch, and return its length.

    If it is too long to be judged by signs, the guards in it are examined as those that
    bend.
    """
    span = min(span, dt)
    take_step(p, m, m.clock[at.T], span)
    guards_at_end(p, m, m.clock[at.T] + span)
    m.counts[at.MEASURED] = -1  # on the other side a guard may be another plane
    m.counts[at.BARREN] += 1
    m.counts[at.CROSSINGS] = min(m.counts[at.CROSSINGS] + 1, MOST_DOUBLED)
    if span > SURE * SHORTEST * time_resolution(m.clock[at.T], span):
        m.counts[at.UNPROVEN] += 1
        bend_all(m)
    else:
        m.counts[at.WATCHED] = AT_BRANCH
    return span


@kernel
def bend_all(m: Memory) -> None:
    """Mark all guards as guards that bend, so that they are examined in windows."""
    for k in range(m.flags.width):
        m.flags[at.BENT, k] = 1
    m.counts[at.N_BENT] = m.flags.width


@kernel_apart
def end_at_branch(p: Problem, m: Memory, dt: float) -> float:
    """Shorten the step to where no guard takes another branch in it; return its length.

    WATCHED says whether it is a step across a branch.
    """
    m.counts[at.WATCHED] = 0
    if p.branches < 0 or m.counts[at.BARREN] > MOST_BARREN:
        m.counts[at.UNPROVEN] += 1
        bend_all(m)
        m.clock[at.WINDOW] = min(m.clock[at.WINDOW], SAMPLED * (p.t_end - p.t_start))
        return dt
    for _ in range(MOST_RETAKES):
        prepare_interpolant(p, m, dt)
        shortest = SHORTEST * time_resolution(m.clock[at.T], dt)
        part = clear_until(p, m, dt, shortest / dt)
        if part >= 1.0:
            if dt > shortest * 2.0 ** m.counts[at.CROSSINGS]:
                m.counts[at.CROSSINGS] = 0
            return dt
        across = shortest * 2.0 ** m.counts[at.CROSSINGS]
        if part * dt <= across:
            return cross_branch(p, m, dt, across)
        dt *= part
        take_step(p, m, m.clock[at.T], dt)
        guards_at_end(p, m, m.clock[at.T] + dt)
    m.counts[at.UNPROVEN] += 1
    bend_all(m)
    return dt
