"""The loop over systems in lanes: step, judge the guards, land on the first flip, process it.

Each lane has its own time, step and mode; when one ends, the lane takes the next
system. All operations apply to all lanes, and a mask selects the results that are kept,
so no lane depends on the others. The loop serves all systems: it calls field and guards
by their address, once for each group of lanes whose modes are the same to them.

Guards are judged by value and rate at both ends of a step and at a stage inside, whose
state is of fifth order. A cubic through the ends shows its error there and at an
earlier stage. Where they do not determine what a guard does, the step is halved. A flip
is located on the polynomial through all of them, the step is repeated up to there, and
its end is moved by the small remainder. In a lane most of whose steps end in flips,
flips are predicted, and the interpolant gives the state there if it is accurate enough.
Where several guards flip at one instant, they do so one after the other, in the
driver's order (see `driver.instant`). A system for which this fails (guards that graze
or slide, that flip a third time at one instant, vanishing steps, infinite fields) is
given up and left to the driver.
"""

from itertools import accumulate
from math import inf
from typing import Any

from numba import types

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import FLOATS, ON_EVENT, TABLE, caller, copy, kernel
from hopdata.hybrid.compiled.memory import Record, View, int_vector, reader_of, row
from hopdata.hybrid.driver import windows
from hopdata.hybrid.driver.end_step import SPARED
from hopdata.hybrid.driver.loop import END_STATE
from hopdata.hybrid.driver.problem import ROUNDING
from hopdata.hybrid.driver.watch import CLIP_MOST, OVERSHOOT
from hopdata.hybrid.lanes import method as written
from hopdata.hybrid.lanes import vectors
from hopdata.hybrid.lanes.method import (
    DENSE_ERROR,
    EARLY,
    EARLY_PLACE,
    FURTHER,
    INSIDE,
    ORDER,
    PLACE,
    STAGES,
    TINY,
)
from hopdata.hybrid.lanes.vectors import (
    ALL,
    WIDTH,
    absolute,
    bits,
    fma,
    lane,
    largest,
    least,
    mask_of,
    rough_power,
    spread,
    square_root,
    where,
    with_lane,
)
from hopdata.hybrid.methods.explicit import compose

# The interpolant, and the memory of the lanes.


@kernel
def interpolate(theta: Any, r: Any) -> None:
    """Write the states at `theta` of the steps into `work`."""
    count, rest = written.DENSE, 1.0 - theta
    for i in range(r.n):
        value = r.dense[count * i + count - 1]
        for q in range(count - 2, -1, -1):
            value = fma(rest if q % 2 == 0 else theta, value, r.dense[count * i + q])
        r.work[i] = fma(theta, value, r.y[i])


# Rows of `book`: the system, events, samples written, guards that flip now as bits,
# guards whose locks are open as bits, the guard that ended the run, and its status. For
# each group of lanes with the same modes: its first lane, and its members as bits. The
# number of groups. Of the present instant: the guard that flipped last (-1: none yet),
# whether its handler changed the state, and the guards that have flipped once and
# twice, as bits.
INDEX, EVENTS, SAMPLES, DUE, OPEN, CULPRIT, STATUS, LEAD, MEMBERS, N_GROUPS = range(10)
LAST, JUMPED, ONCE, TWICE = range(10, 14)
BOOK_ROWS = 14

# The room of the lanes: rows of a table, each as wide as there are lanes.
#
# y, early, inner, end: states at the start, at two places inside and at the end of the
# step; k: slopes of the stages, of the end, and of the dense stages; moved: the end,
# moved to the flip; dense: the interpolant; work, other: scratch; aim: margins and
# slopes of the guard expected to flip first, and its place. Guards: h0, rate0 at the
# start, early_h, early_rate and h, rate inside, h1, rate1 at the end of the step;
# along, along1, inside: rates along one direction, at the start, at the end and inside;
# size: largest recent value, the scale of rounding; leaving: 1 where a guard is at its
# surface, on its new side; lock; bend: change of the rate in the last step; other_h,
# other_rate: scratch.
#
# By lane: table: all rows, from y on; locks; params, or one row that all share; modes:
# a row for each; book. Of one lane, for the handler: own, own_params. read: places of
# the mode that are read; rules: of the layout. The next are given to `solve_batch` or
# returned by it, as in `driver.loop`: `given` are the parameters, and `mode` is the
# mode at the start. n_own: number of parameters of each lane, 0 if shared; n_given:
# number of rows of `given`; handler, field, guards: addresses.
STATES = {"y": 1, "k": written.SLOPES, "inner": 1, "early": 1, "end": 1, "moved": 1, "work": 1,
          "other": 1, "dense": written.DENSE}  # fmt: skip
GUARDS = (
    "h0 rate0 h rate h1 rate1 early_h early_rate along along1 size leaving lock inside bend "
    "other_h other_rate"
)
ROWS, INTS = vectors.Rows(None), View(types.int64, 2)
ITEMS = {
    **dict.fromkeys((*STATES, "aim", *GUARDS.split()), ROWS),
    **dict.fromkeys(("table", "locks", "params", "own", "own_params"), TABLE),
    **dict.fromkeys(("modes", "book", "read", "rules"), INTS),
    **{"y0": TABLE, "given": TABLE, "mode": INTS, "status": INTS, "ends": TABLE},
    **{
        "end_modes": INTS,
        "counts": INTS,
        "samples": TABLE,
        "times": FLOATS,
        "atol": FLOATS,
    },
    **dict.fromkeys(
        ("t_start", "t_end", "rtol", "max_step", "first_step"), types.float64
    ),
    **dict.fromkeys(
        ("max_steps", "max_events", "n", "n_guards", "n_own", "n_given"), types.int64
    ),
    **dict.fromkeys(("handler", "field", "guards"), types.int64),
}
_SLOTS = accumulate(
    (2 if isinstance(kind, View) else 1 for kind in ITEMS.values()), initial=0
)
ROOM = Record(
    "Room", dict(zip(ITEMS, zip(ITEMS.values(), _SLOTS, strict=False), strict=True))
)
room, state = reader_of(ROOM), vectors.part(None)


def first_rows(n: int, n_guards: int) -> dict[str, int]:
    """Return the first row of each part of the table; the parameters are the last part."""
    lengths = {name: count * n for name, count in STATES.items()}
    lengths |= {"aim": 7} | dict.fromkeys(GUARDS.split(), n_guards)
    return dict(
        zip([*lengths, "params"], accumulate(lengths.values(), initial=0), strict=True)
    )


def natives(states: Any, margins: Any) -> tuple[Any, Any]:
    """Return the signatures of field and guards, given the types of rows of states and guards."""
    field = types.void(vectors.lanes, states, ROOM, states)
    return field, types.void(vectors.lanes, states, states, ROOM, margins, margins)


call_field, call_guards = map(caller, natives(ROWS, ROWS))
take_step = kernel(compose("take_step", "t, h, r", written.step_code(), globals()))
prepare = kernel(compose("prepare", "t, h, r", written.dense_code(), globals()))


@kernel
def mark(lanes: int, g: int, margin: Any, rate: Any, noise: Any, r: Any) -> int:
    """Record in which of these lanes a guard flips now, and return them."""
    due = bits((margin < -noise) | ((margin <= noise) & (rate < 0.0))) & lanes
    for j in range(WIDTH if due != 0 else 0):
        r.book[DUE, j] |= 1 << g if due >> j & 1 else 0
    return due


@kernel
def group(r: Any) -> None:
    """Group the lanes by the entries of the mode that are read."""
    left, count = ALL, 0
    for first in range(WIDTH):
        if left >> first & 1:
            same = left
            for q in range(r.read.width):
                i, unlike = r.read[0, q], 0
                for j in range(WIDTH):
                    unlike |= 1 << j if r.modes[j, i] != r.modes[first, i] else 0
                same &= ~unlike
            r.book[LEAD, count], r.book[MEMBERS, count] = first, same
            left, count = left & ~same, count + 1
    r.book[N_GROUPS, 0] = count


# The guards within a step.

ITERATIONS, ROOT_TOLERANCE = (
    40,
    1e-6,
)  # fraction of a step: Newton's next change is negligible
# Flips are predicted in a lane where they end this fraction of steps. A few guards
# seldom do, and prediction would cost each step 5 %.
MOSTLY, FEW = 0.7, 4
NEAR = (
    1e-5  # fraction of the step: largest distance by which its end is moved to a flip
)
FIRST, REST = PLACE / 3.0, (1.0 - PLACE) / 3.0
# Fraction of its change by which a guard may be off its cubic at the two places inside.
# With 0.2, and one place, 22 of 200 sums of two sines lost events; with 0.1 none of
# 600, so this is twice as strict. If 1.5 times larger, some 15 % fewer steps for guards
# that bend quickly.
FOLLOWS = 0.05
PER_PLACE, PER_REST = 1.0 / PLACE, 1.0 / (1.0 - PLACE)


@kernel
def resolution_of(t: Any, h: Any) -> Any:
    """Return the interval below which two instants coincide."""
    return ROUNDING * largest(absolute(t), absolute(t + h))


@kernel
def rises(low: Any, high: Any, slack: Any) -> Any:
    """Return where the second of two margins may be above zero and the first below."""
    return ((low <= slack) & (high > slack)) | ((low <= -slack) & (high > -slack))


@kernel
def root(go: Any, r: Any) -> Any:
    """Return where the first guard falls through zero, as a fraction of the step.

    Bracketed Newton iteration on the polynomial through values and rates at three
    places.
    """
    m0, d0, mc, dc, m1, d1 = r.aim[0], r.aim[1], r.aim[2], r.aim[3], r.aim[4], r.aim[5]
    left, right = (mc - m0) * PER_PLACE, (m1 - mc) * PER_REST
    a, b = (left - d0) * PER_PLACE, (dc - left) * PER_PLACE
    c, d = (right - dc) * PER_REST, (d1 - right) * PER_REST
    e, f, k = (b - a) * PER_PLACE, c - b, (d - c) * PER_REST
    p, q = f - e, k - f
    x, low, high = r.aim[6], spread(0.0), spread(1.0)
    for _ in range(ITERATIONS):
        u, w = x - PLACE, x - 1.0
        value, slope = fma(w, q - p, p), q - p
        slope, value = fma(u, slope, value), fma(u, value, e)
        slope, value = fma(u, slope, value), fma(u, value, a)
        slope, value = fma(x, slope, value), fma(x, value, d0)
        slope, value = fma(x, slope, value), fma(x, value, m0)
        low, high = where(value > 0.0, x, low), where(value > 0.0, high, x)
        new = x - value / slope
        new = where((new > low) & (new < high), new, 0.5 * (low + high))
        far = absolute(new - x) > ROOT_TOLERANCE
        x, go = where(go, new, x), go & far
        if bits(go) == 0:
            break
    return x


@kernel
def straight(g: int, r: Any) -> Any:
    """Return where a guard's rate along one direction is constant over the step."""
    along = absolute(r.along[g])
    same = absolute(r.inside[g] - r.along[g]) <= windows.AFFINE * along
    return (
        same
        & (absolute(r.along1[g] - r.along[g]) <= windows.AFFINE * along)
        & (along > 0.0)
    )


# Weights of the slopes at the start, inside and at the end of a step in the bend at its
# end.
BY_START, BY_INSIDE = (1.0 - PLACE) / PLACE, -1.0 / (PLACE * (1.0 - PLACE))
BY_END = (2.0 - PLACE) / (1.0 - PLACE)

GIVEN_UP = -100  # status of a system left to the driver
HUGE, TINY_ERROR = 1e30, 1e-12
ALMOST_THERE = (
    1.01  # factor by which the last step may be stretched to avoid a tiny one
)
MOST_ROUNDS = 4  # rounds until open locks agree
MOST_TRIES = 60  # most tries for one step
# Fractions of the run. A step that is shorter, or lands in vain, makes no progress.
# Where flips follow so soon, rounding may hide the next one, as for a ball that comes
# to rest.
SHORTEST, SOON = 1e-12, 1e-8
IN_VAIN, MOST_IDLE = (
    1.5,
    8.5,
)  # idle steps in a row: a guard flips in place; system is given up
STIFF_STEPS = 15.0  # net number of steps too near the stability limit
SAFETY, SHRINK_MOST, GROW_MOST = 0.8, 0.2, 6.0

call_on_event = caller(ON_EVENT.native)


@kernel
def begin_instant(j: int, r: Any) -> None:
    """Forget the flips of the last instant in lane j."""
    r.book[LAST, j] = -1
    r.book[JUMPED, j] = 0
    r.book[ONCE, j] = 0
    r.book[TWICE, j] = 0


@kernel
def take_systems(want: int, first: int, last: int, r: Any) -> tuple[int, int]:
    """Give the next systems to these lanes; return the lanes that got one, and the next system."""
    started = 0
    for j in range(WIDTH):
        if want >> j & 1 == 0 or first == last:
            continue
        for i in range(r.n):
            r.table[i, j] = r.y0[first, i]
        for i in range(r.n_own):
            r.params[i, j] = r.given[first % r.n_given, i]
        copy(row(r.mode, 0), row(r.modes, j))
        r.book[INDEX, j], r.book[CULPRIT, j], r.book[STATUS, j] = first, -1, at.FINISHED
        r.book[EVENTS, j], r.book[SAMPLES, j], r.book[DUE, j], r.book[OPEN, j] = (
            0,
            0,
            0,
            0,
        )
        begin_instant(j, r)
        if r.times.width > 0 and r.times[0] == r.t_start:
            copy(row(r.y0, first), row(r.samples, first * r.times.width))
            r.book[SAMPLES, j] = 1
        first += 1
        started |= 1 << j
    return started, first


@kernel
def settle(started: int, t: Any, r: Any) -> int:
    """Decide open locks by the guards' sides; return the lanes with a guard on its surface.

    Such a lock stays open, because the guard's rate decides it.
    """
    for i in range(r.n):
        r.work[i] = 0.0
    for j in range(WIDTH):
        for g in range(r.n_guards if started >> j & 1 else 0):
            r.book[OPEN, j] |= 1 << g if r.modes[j, g] == 0 else 0
            r.modes[j, g] = -1 if r.modes[j, g] == 0 else r.modes[j, g]
    group(r)
    call_guards(r.guards, t, r.y, r.work, r, r.h, r.rate)
    mine, open_ones = mask_of(started), 0
    for g in range(r.n_guards):
        r.size[g] = where(mine, absolute(r.h[g]), r.size[g])
        above, level = bits(r.h[g] > 0.0), bits(r.h[g] == 0.0)
        for j in range(WIDTH):
            if started >> j & 1:
                if r.book[OPEN, j] >> g & 1 and above >> j & 1:
                    r.modes[j, g] = 1
                if level >> j & 1 == 0:
                    r.book[OPEN, j] &= ~(1 << g)
                r.locks[g, j] = r.modes[j, g]
                open_ones |= 1 << j if r.book[OPEN, j] != 0 else 0
    return open_ones


@kernel
def close(open_ones: int, r: Any) -> tuple[int, int]:
    """Decide the locks still open in these lanes by their guards' rates.

    Returns the lanes in which a lock has changed, and those with a rate of zero, to be
    given up.
    """
    changed = resting = 0
    for g in range(r.n_guards):
        rising, still = bits(r.rate0[g] > 0.0), bits(r.rate0[g] == 0.0)
        for j in range(WIDTH):
            if open_ones >> j & 1 and r.book[OPEN, j] >> g & 1:
                lock, resting = 1 if rising >> j & 1 else -1, resting | (still & 1 << j)
                if lock != r.modes[j, g]:
                    r.modes[j, g] = r.locks[g, j] = lock
                    r.book[DUE, j], changed = 0, changed | 1 << j
    return changed, give_up(resting, r)


@kernel
def next_to_flip(j: int, r: Any) -> int:
    """Return the guard that flips next in lane j: see `driver.instant` for the order."""
    due, last = r.book[DUE, j], r.book[LAST, j]
    if (
        r.book[JUMPED, j] != 0 and due >> last & 1
    ):  # a bounce is over before the next one begins
        return last
    first = -1
    for place in range(r.n_guards):
        g = place if r.rules[at.WAY, place] > 0 else r.n_guards - 1 - place
        if due >> g & 1:
            if last < 0 or r.rules[at.WAY, g] * (g - last) > 0:
                return g
            first = g if first < 0 else first
    return first


@kernel
def fire(lanes: int, t: Any, r: Any) -> int:
    """Flip one of the guards that are due in each of these lanes, and call the handler.

    Returns the lanes that end or are given up. A lane is given up if its handler
    changes parameters that all systems share or makes the state NaN or infinite, if a
    guard flips for a third time at this instant, or if an event ends the run while
    other guards are due.
    """
    over, own, own_params = 0, row(r.own, 0), row(r.own_params, 0)
    for j in range(WIDTH):
        if lanes >> j & 1 == 0:
            continue
        now, g = lane(t, j), next_to_flip(j, r)
        others = r.book[DUE, j] & ~(1 << g)
        lost = r.book[TWICE, j] >> g & 1 != 0
        r.book[TWICE, j] |= r.book[ONCE, j] & 1 << g
        r.book[ONCE, j] |= 1 << g
        r.book[DUE, j], r.book[LAST, j], r.book[JUMPED, j] = 0, g, 0
        for i in range(r.n if r.handler != 0 else 0):
            own[i] = r.table[i, j]
        for i in range(len(own_params) if r.handler != 0 else 0):
            own_params[i] = r.params[i, j] if r.n_own > 0 else r.params[0, i]
        direction = -r.modes[j, g]
        r.modes[j, g] = direction
        if r.rules[at.DIRECTION, g] * direction >= 0:
            stop, mode = r.rules[at.TERMINAL, g], row(r.modes, j)
            if r.handler != 0:
                stop |= call_on_event(
                    r.handler, now, own, mode, own_params, g, direction
                )
            r.book[EVENTS, j] += 1
            r.book[CULPRIT, j] = g
            if stop != 0:
                r.book[STATUS, j] = at.TERMINATED
                over |= 1 << j
                lost |= others != 0
        lost |= r.book[EVENTS, j] >= r.max_events and over >> j & 1 == 0
        for k in range(r.n_guards):
            r.locks[k, j] = r.modes[j, k]
            lost |= r.modes[j, k] * r.modes[j, k] != 1
        for i in range(r.n if r.handler != 0 else 0):
            r.book[JUMPED, j] |= 1 if own[i] != r.table[i, j] else 0
            lost |= not abs(own[i]) < inf
            r.table[i, j] = own[i]
        for i in range(len(own_params) if r.handler != 0 else 0):
            if r.n_own > 0:
                r.params[i, j] = own_params[i]
            lost |= r.n_own == 0 and own_params[i] != r.params[0, i]
        if lost:
            r.book[STATUS, j] = GIVEN_UP
            over |= 1 << j
    return over


@kernel
def refresh(fresh: int, t: Any, r: Any) -> int:
    """Evaluate field and guards again in these lanes; return those with guards that are due."""
    group(r)
    slope, mine = state(r.k, STAGES * r.n), mask_of(fresh)
    call_field(r.field, t, r.y, r, slope)
    for i in range(r.n):
        r.k[i] = where(mine, slope[i], r.k[i])
    call_guards(r.guards, t, r.y, slope, r, r.h, r.rate)
    resolution, flipping = resolution_of(t, spread(0.0)), 0
    for g in range(r.n_guards):
        r.h0[g], r.rate0[g] = (
            where(mine, r.h[g], r.h0[g]),
            where(mine, r.rate[g], r.rate0[g]),
        )
        margin, rate = r.lock[g] * r.h0[g], r.lock[g] * r.rate0[g]
        noise = ROUNDING * r.size[g] + resolution * absolute(rate)
        r.leaving[g] = where(mine, where(margin <= noise, 1.0, 0.0), r.leaving[g])
        flipping |= mark(fresh, g, margin, rate, noise, r)
    return flipping


@kernel
def first_step(t: Any, longest: Any, r: Any) -> Any:
    """Return a first step from two slopes (Hairer, Norsett, Wanner, section II.4)."""
    slope = state(r.k, STAGES * r.n)
    size = steep = bent = spread(0.0)
    for i in range(r.n):
        per = 1.0 / largest(fma(r.rtol, absolute(r.y[i]), r.atol[i]), TINY)
        size, steep = (
            largest(absolute(r.y[i]) * per, size),
            largest(absolute(r.k[i]) * per, steep),
        )
    trial = where((size > 0.0) & (steep > 0.0), 0.01 * size / steep, 1e-3 * longest)
    trial = least(trial, longest)
    for i in range(r.n):
        r.work[i] = fma(trial, r.k[i], r.y[i])
    call_field(r.field, t + trial, r.work, r, slope)
    for i in range(r.n):
        per = 1.0 / (trial * largest(fma(r.rtol, absolute(r.y[i]), r.atol[i]), TINY))
        bent = largest(absolute(slope[i] - r.k[i]) * per, bent)
    steepest = largest(largest(steep, bent), TINY)
    return least(
        least(100.0 * trial, rough_power(0.01 / steepest, 1.0 / ORDER)), longest
    )


@kernel
def clipped(t: Any, h: Any, before: Any, r: Any) -> Any:
    """Return the steps, or slightly more than the time to the first predicted flip.

    It is predicted from value, rate, and the rate's change in the last step, of length
    `before`.
    """
    shortest, per_s = CLIP_MOST * resolution_of(t, h), 1.0 / before
    for g in range(r.n_guards):
        value, rate = largest(r.lock[g] * r.h0[g], 0.0), r.lock[g] * r.rate0[g]
        bend = r.lock[g] * r.bend[g] * per_s
        room = rate * rate - 2.0 * value * bend
        side = square_root(largest(room, 0.0))
        time = (
            where(rate < 0.0, 2.0 * value / (side - rate), -(side + rate) / bend)
            * OVERSHOOT
        )
        h = where((room > 0.0) & (time > shortest) & (time < h), time, h)
    return h


@kernel
def look_along(t: Any, h: Any, r: Any) -> None:
    """Evaluate the guards' rates along one direction at start, inside and end of the steps."""
    for i in range(r.n):
        r.work[i] = windows.way(i)
    call_guards(r.guards, t, r.y, r.work, r, r.other_h, r.along)
    call_guards(r.guards, fma(PLACE, h, t), r.inner, r.work, r, r.other_h, r.inside)
    call_guards(r.guards, t + h, r.end, r.work, r, r.other_h, r.along1)


@kernel
def off_cubic(
    place: float, m: Any, d: Any, m0: Any, d0: Any, bend: Any, twist: Any
) -> Any:
    """Return how far margin and slope at a place are from those of the cubic over the step."""
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
        rough = (
            error
            > FOLLOWS * change + windows.FLOOR * (absolute(m0) + absolute(m1)) + noise
        )
        rough = rough & (h > windows.FINE * windows.LONGEST * run_s)
        slow = (h > windows.LONGEST * run_s) & (error > windows.MOVES * change)
        doubtful = (rough | slow | (h > windows.LONGEST_IF_SURE * run_s)) & told & fine
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
def cut(crossed: Any, place: Any, t: Any, h: Any, error: Any, r: Any) -> Any:
    """End steps at these places on the interpolant if it is accurate enough; return where.

    This costs less than repeating the step, but all lanes pay for it.
    """
    slope, new = state(r.k, STAGES * r.n), state(r.k, (STAGES + 1) * r.n)
    prepare(t, h, r)
    interpolate(place, r)
    span = place * h
    call_field(r.field, t + span, r.work, r, new)
    call_guards(r.guards, t + span, r.work, new, r, r.h, r.rate)
    worst = 4.0 * place * (1.0 - place)
    good = crossed & (DENSE_ERROR * error * worst * worst <= SPARED)
    resolution, on_one = resolution_of(t, span), mask_of(0)
    for g in range(r.n_guards):
        margin, rate = r.lock[g] * r.h[g], r.lock[g] * r.rate[g]
        noise = ROUNDING * largest(absolute(r.h0[g]), absolute(r.h1[g]))
        near = largest(-0.1 * NEAR * span * rate, noise + resolution * absolute(rate))
        touches = (rate < 0.0) & (absolute(margin) <= near)
        good, on_one = good & ((margin > 0.0) | touches), on_one | touches
    good = good & on_one
    for i in range(r.n):
        r.end[i], slope[i] = (
            where(good, r.work[i], r.end[i]),
            where(good, new[i], slope[i]),
        )
    for g in range(r.n_guards):
        r.h1[g], r.rate1[g] = (
            where(good, r.h[g], r.h1[g]),
            where(good, r.rate[g], r.rate1[g]),
        )
    return good


@kernel
def land(
    landing: int, t: Any, h: Any, soonest: Any, idle: Any, run_s: float, r: Any
) -> tuple[Any, int, int]:
    """Move the ends of these steps to their surfaces; return the shifts, and where guards are due.

    The third result are the lanes in which several guards are due, and one of them is
    past its surface by more than rounding: the driver must say what belongs to this
    instant.

    In lanes that have landed in vain before, the state cannot come any nearer to the
    surface: the rounding of state or guard is larger than the guard's values suggest.
    It flips from there.
    """
    mine, slope = mask_of(landing), state(r.k, STAGES * r.n)
    shift = where(mine, soonest * h, 0.0)
    for i in range(r.n):
        bend = BY_START * r.k[i] + BY_INSIDE * r.k[INSIDE * r.n + i] + BY_END * slope[i]
        half = 0.5 * where(mine, soonest, 0.0) * bend
        r.moved[i] = fma(shift, slope[i] + half, r.end[i])
    resolution = resolution_of(t, h)
    call_guards(r.guards, t + h + shift, r.moved, slope, r, r.h, r.rate)
    more = spread(inf)
    for g in range(r.n_guards):
        margin, rate = r.lock[g] * r.h[g], r.lock[g] * r.rate[g]
        close = (rate < 0.0) & (absolute(margin) <= NEAR * h * absolute(rate))
        more = where(close, least(more, -margin / rate), more)
    more = where(mine & (more < inf), more, 0.0)
    for i in range(r.n):
        r.moved[i] = fma(more, slope[i], r.moved[i])
    shift, flipping, past = shift + more, 0, 0
    call_guards(r.guards, t + h + shift, r.moved, slope, r, r.h, r.rate)
    for g in range(r.n_guards):
        size = largest(absolute(r.h0[g]), absolute(r.h1[g]))
        margin, rate = r.lock[g] * r.h[g], r.lock[g] * r.rate[g]
        stuck = (idle > IN_VAIN) & (
            absolute(margin) <= SHORTEST * run_s * absolute(rate)
        )
        size = where(stuck, largest(size, 2.0 / ROUNDING * absolute(margin)), size)
        r.size[g] = where(
            mine, largest(size, where(r.leaving[g] > 0.5, r.size[g], 0.0)), r.size[g]
        )
        noise = ROUNDING * r.size[g] + resolution * absolute(rate)
        flipping |= mark(landing, g, margin, rate, noise, r)
        past |= bits(margin < -noise) & landing
        r.h1[g], r.rate1[g] = (
            where(mine, r.h[g], r.h1[g]),
            where(mine, r.rate[g], r.rate1[g]),
        )
    torn = 0
    for j in range(WIDTH if past != 0 else 0):
        several = r.book[DUE, j] & (r.book[DUE, j] - 1) != 0
        torn |= 1 << j if past >> j & 1 and several else 0
    return shift, flipping, torn


@kernel
def sample(lanes: int, t: Any, h: Any, t_new: Any, ready: bool, r: Any) -> None:
    """Write the states at the requested times in the steps of these lanes."""
    while True:
        now, pending = t_new, 0
        for j in range(WIDTH):
            next_one = r.book[SAMPLES, j]
            if (
                lanes >> j & 1
                and next_one < r.times.width
                and r.times[next_one] <= lane(t_new, j)
            ):
                now, pending = with_lane(now, j, r.times[next_one]), pending | 1 << j
        if pending == 0:
            return
        if not ready:
            prepare(t, h, r)
            ready = True
        interpolate((now - t) / h, r)
        for i in range(r.n):
            r.work[i] = where(now == t_new, r.moved[i], r.work[i])
        for j in range(WIDTH):
            if pending >> j & 1:
                place = r.book[INDEX, j] * r.times.width + r.book[SAMPLES, j]
                for i in range(r.n):
                    r.samples[place, i] = lane(r.work[i], j)
                r.book[SAMPLES, j] += 1


@kernel
def sample_again(lanes: int, t: Any, r: Any) -> None:
    """Overwrite the states before an event with those after it, at a requested time."""
    for j in range(WIDTH):
        last = r.book[SAMPLES, j] - 1
        if lanes >> j & 1 and last >= 0 and r.times[last] == lane(t, j):
            for i in range(r.n):
                r.samples[r.book[INDEX, j] * r.times.width + last, i] = r.table[i, j]


@kernel
def give_up(lanes: int, r: Any) -> int:
    """Leave these lanes' systems to the driver; return the lanes."""
    for j in range(WIDTH if lanes != 0 else 0):
        if lanes >> j & 1:
            r.book[STATUS, j] = GIVEN_UP
    return lanes


@kernel
def leave(lanes: int, t: Any, tried: Any, taken: Any, cuts: Any, r: Any) -> None:
    """Record how the integrations in these lanes have ended."""
    for j in range(WIDTH):
        if lanes >> j & 1 == 0:
            continue
        b = r.book[INDEX, j]
        r.status[b, 0], r.ends[b, 0], r.ends[b, 1], r.ends[b, 2] = (
            r.book[STATUS, j],
            lane(t, j),
            0.0,
            0.0,
        )
        for i in range(r.n):
            r.ends[b, END_STATE + i] = r.table[i, j]
        copy(row(r.modes, j), row(r.end_modes, b))
        row(r.counts, b)[:] = 0
        steps, tries, short = (
            int(lane(taken, j)),
            int(lane(tried, j)),
            int(lane(cuts, j)),
        )
        r.counts[b, at.NFEV] = (
            STAGES * tries + (1 + FURTHER) * short + r.book[EVENTS, j] + 2
        )
        r.counts[b, at.STEPS], r.counts[b, at.REJECTED] = steps, tries - steps
        r.counts[b, at.EVENTS], r.counts[b, at.SAMPLES] = (
            r.book[EVENTS, j],
            r.book[SAMPLES, j],
        )
        r.counts[b, at.CULPRIT] = r.book[CULPRIT, j]


def run(first: int, last: int, desk: int) -> int:
    """Integrate from the rows `first` to `last` of y0, as `driver.loop` does.

    `desk` is the address of the desk, which holds or points to everything else. The
    status of a system that is given up is GIVEN_UP.
    """
    r = room(int_vector(desk, 0))
    t, run_s, before = spread(r.t_start), r.t_end - r.t_start, spread(1.0)
    h_next = resume = tries = stiff = tried = taken = idle = landed = hit = cuts = (
        spread(0.0)
    )
    active, fresh, over, rejected, aimed, want = 0, 0, 0, 0, 0, ALL
    while True:
        begun = open_ones = rounds = 0
        if want != 0:
            begun, first = take_systems(want, first, last, r)
            active, over, new = (active & ~want) | begun, over & ~want, mask_of(begun)
            if active == 0:
                return last
            t, tries, stiff = (
                where(new, r.t_start, t),
                where(new, 0.0, tries),
                where(new, 0.0, stiff),
            )
            idle, cuts, tried = (
                where(new, 0.0, idle),
                where(new, 0.0, cuts),
                where(new, 0.0, tried),
            )
            resume, taken = where(new, 0.0, resume), where(new, 0.0, taken)
            landed, hit = where(new, 0.0, landed), where(new, r.t_start, hit)
            open_ones = settle(begun, t, r)
            fresh, rejected, aimed = fresh | begun, rejected & ~begun, aimed & ~begun
        while fresh != 0:
            due = refresh(fresh, t, r) & ~over
            fresh, resting = close(open_ones, r) if open_ones != 0 else (0, 0)
            over, rounds = over | resting, rounds + 1
            fresh, due = fresh & ~over, due & ~(fresh | over)
            open_ones = (
                fresh if rounds < MOST_ROUNDS else 0
            )  # rates may depend on other locks
            if due != 0:
                over |= fire(due, t, r)
                sample_again(due, t, r)
                fresh = (fresh | due) & ~over
        if begun != 0:
            guess = first_step(t, spread(min(run_s, r.max_step)), r)
            h_next = where(
                mask_of(begun), r.first_step if r.first_step > 0.0 else guess, h_next
            )
        want = (bits(t >= r.t_end) & active) | over
        if want != 0:
            leave(want, t, tried, taken, cuts, r)
            continue
        left = r.t_end - t
        h, often = least(h_next, r.max_step), landed > MOSTLY * taken
        if r.n_guards > FEW and bits(often) != 0:
            h = where(often, clipped(t, h, before, r), h)
        whole = h * where(mask_of(aimed), 1.0, ALMOST_THERE) >= left
        h = where(whole, left, h)
        error, hard = take_step(t, h, r)
        error = where(error < HUGE, error, HUGE)
        middle, slope = state(r.k, INSIDE * r.n), state(r.k, STAGES * r.n)
        call_guards(r.guards, fma(PLACE, h, t), r.inner, middle, r, r.h, r.rate)
        call_guards(r.guards, t + h, r.end, slope, r, r.h1, r.rate1)
        early = state(r.k, EARLY * r.n)
        call_guards(
            r.guards, fma(EARLY_PLACE, h, t), r.early, early, r, r.early_h, r.early_rate
        )
        live = mask_of(active)
        fine = (error <= 1.0) & live
        unclear, far, touching, soonest = judge(t, h, fine, run_s, r)
        crossed, accepted = fine & ~unclear & far, fine & ~unclear & ~far
        aimed, landing, full, ready = bits(crossed), bits(accepted & touching), h, False
        factor = SAFETY * rough_power(error + TINY_ERROR, -1.0 / ORDER)
        factor = largest(
            SHRINK_MOST, least(where(mask_of(rejected), 1.0, GROW_MOST), factor)
        )
        h_next = h * where(fine & unclear, 0.5, factor)
        if aimed != 0:
            place = root(crossed, r)
            resume = where(crossed, largest(resume, h), resume)
            ready = r.n_guards > FEW and bits(crossed & often) != 0
            if ready:
                short = cut(crossed & often, place, t, h, error, r)
                cuts = where(short, cuts + 1.0, cuts)
                accepted, h = accepted | short, where(short, place * h, h)
                soonest, whole = where(short, 0.0, soonest), whole & ~short
                aimed, landing = aimed & ~bits(short), landing | bits(short)
            h_next = where(mask_of(aimed), place * h, h_next)
        rejected = active & ~bits(accepted) & ~aimed
        shift = spread(0.0)
        if landing != 0:
            shift, fresh, torn = land(landing, t, h, soonest, idle, run_s, r)
            over |= give_up(torn, r)
            fresh &= ~torn
            h_next = where(mask_of(landing), largest(h_next, resume), h_next)
            resume = where(mask_of(landing), 0.0, resume)
        t_new = where(whole & (shift == 0.0), r.t_end, t + h + shift)
        if r.times.width > 0:
            sample(bits(accepted), t, full, t_new, ready, r)
        stiff = where(accepted, largest(stiff + where(hard, 1.0, -0.1), 0.0), stiff)
        tries, tried = where(accepted, 0.0, tries + 1.0), tried + 1.0
        t, taken = where(accepted, t_new, t), where(accepted, taken + 1.0, taken)
        before = where(accepted, h, before)
        landed = where(mask_of(landing), landed + 1.0, landed)
        for i in range(r.n):
            r.y[i], r.k[i] = (
                where(accepted, r.moved[i], r.y[i]),
                where(accepted, slope[i], r.k[i]),
            )
        for g in range(r.n_guards):
            r.bend[g] = where(accepted, r.rate1[g] - r.rate0[g], r.bend[g])
            r.h0[g] = where(accepted, r.h1[g], r.h0[g])
            r.rate0[g] = where(accepted, r.rate1[g], r.rate0[g])
            r.leaving[g] = where(accepted, 0.0, r.leaving[g])
        if fresh != 0:
            for j in range(WIDTH):
                if fresh >> j & 1:
                    begin_instant(j, r)
            over |= fire(fresh, t, r)
            sample_again(fresh, t, r)
        nowhere = (mask_of(landing) | (h < SHORTEST * run_s)) & ~mask_of(fresh)
        idle = where(accepted, where(nowhere, idle + 1.0, 0.0), idle)
        lost = (
            (tries > MOST_TRIES) | (stiff > STIFF_STEPS) | ~(h > ROUNDING * absolute(t))
        )
        lost = (
            lost | (idle > MOST_IDLE) | ((taken >= float(r.max_steps)) & (t < r.t_end))
        )
        soon, hit = (
            mask_of(fresh) & (t - hit < SOON * run_s),
            where(mask_of(fresh), t, hit),
        )
        over |= give_up(bits((lost | soon) & live) & ~over, r)
        want = ((bits(t >= r.t_end) & active & ~fresh) | over) & active
        if want != 0:
            leave(want, t, tried, taken, cuts, r)
            fresh &= ~want
