"""The loop over systems in lanes: step, judge the guards, land on a flip, fire it.

Each lane has its own time, step and mode; when one ends, the lane takes the next
system. All operations apply to all lanes, and a mask selects the results that are kept,
so no lane depends on the others. The loop serves all systems: it calls field and guards
by their address, once for each group of lanes whose modes are the same to them.

This is not the driver's source, because there an iteration ends before the next step
begins and a decision is an `if`: here one lane must not wait for another's, so a flip
that is not met is sought by another step of all lanes, and each decision is a mask.
What can be shared is: the proof of pieces, the method's numbers, and the constants.

The guards are proven in each step, as in the driver (see `proof`). The step to a flip
is repeated up to its location, and its end is moved by the small remainder. In a lane
most of whose steps end in flips, flips are predicted, and the interpolant gives the
state there if it is accurate enough. Where several guards flip at one instant, they do
so one after the other (see `instant`). A system for which this fails (steps that are
not proven, guards that slide or flip a third time at one instant, vanishing steps,
infinite fields) is left to the driver.
"""

from math import inf
from typing import Any

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import copy, kernel
from hopdata.hybrid.compiled.memory import int_vector, row
from hopdata.hybrid.driver.end_step import SPARED
from hopdata.hybrid.driver.loop import END_STATE
from hopdata.hybrid.driver.problem import ROUNDING
from hopdata.hybrid.driver.stepping import ALMOST_THERE, SHRINK_MOST
from hopdata.hybrid.driver.watch import CLIP_MOST, OVERSHOOT
from hopdata.hybrid.lanes import method as written
from hopdata.hybrid.lanes.instant import (
    begin_instant,
    fire,
    fire_until_none_is_due,
    settle,
    take_systems,
)
from hopdata.hybrid.lanes.method import (
    DENSE_ERROR,
    FURTHER,
    INSIDE,
    ORDER,
    PLACE,
    STAGES,
    TINY,
)
from hopdata.hybrid.lanes.proof import (
    NEAR,
    at_surface,
    do_not_count,
    mark,
    memory_in,
    prove,
    resolution_of,
)
from hopdata.hybrid.lanes.room import (
    COURSE_ROWS,
    CULPRIT,
    CUTS,
    DUE,
    EVENTS,
    HIT,
    IDLE,
    INDEX,
    LANDED,
    LAST_STEP,
    LOCATION,
    NEXT_STEP,
    RESUME,
    SAMPLES,
    STATUS,
    STIFF,
    TAKEN,
    TIME,
    TRIED,
    TRIES,
    call_field,
    call_guards,
    give_up,
    interpolate,
    room,
    state,
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
from hopdata.hybrid.methods.stiff import STIFF as STIFF_SCORE

#: Flips are predicted in a lane where they end this fraction of the steps.
#: Unit: 1. Origin: chosen.
MOSTLY = 0.7

#: Flips are predicted only where there are more guards than this: a few seldom end most
#: steps, and prediction would cost each step 5 %.
#: Unit: 1. Origin: chosen.
FEW = 4

#: Most tries for one step.
#: Unit: 1. Origin: chosen.
MOST_TRIES = 60

#: A step that is shorter than this fraction of the run, or lands in vain, makes no
#: progress.
#: Unit: 1. Origin: chosen.
SHORTEST = 1e-12

#: Where flips follow within this fraction of the run, rounding may hide the next one,
#: as for a ball that comes to rest.
#: Unit: 1. Origin: chosen.
SOON = 1e-8

#: Steps in a row without progress after which a guard flips where it is.
#: Unit: 1. Origin: chosen.
IN_VAIN = 1.5

#: Steps in a row without progress after which a system is given up.
#: Unit: 1. Origin: chosen.
MOST_IDLE = 8.5

#: Decrease, at each step within the stability limit, of the number of steps beyond it.
#: Unit: 1. Origin: chosen.
RELIEF = 0.1

#: Fraction of the step at which the expected error equals the tolerance.
#: Unit: 1. Origin: chosen.
SAFETY = 0.8

#: Largest factor between two steps.
#: Unit: 1. Origin: chosen.
GROW_MOST = 6.0

#: Largest error of the interpolant of a step in which a guard turns close to its
#: surface: a step with more is taken again, shorter.
#: Unit: tolerances. Origin: chosen: about half the step.
CLOSE_ERROR = 1e-3

HUGE = 1e30  # replaces an error that is not finite
TINY_ERROR = 1e-12  # avoids a power of zero

# Weights of the slopes at the start, inside and at the end of a step in the bend at its
# end.
BY_START = (1.0 - PLACE) / PLACE
BY_INSIDE = -1.0 / (PLACE * (1.0 - PLACE))
BY_END = (2.0 - PLACE) / (1.0 - PLACE)

take_step = kernel(compose("take_step", "t, h, r", written.step_code(), globals()))
prepare = kernel(compose("prepare", "t, h, r", written.dense_code(), globals()))


# The length of the next step.


@kernel
def first_step(t: Any, longest: Any, r: Any) -> Any:
    """Return a first step from two slopes (Hairer, Norsett, Wanner, section II.4)."""
    slope = state(r.k, STAGES * r.n)
    size = spread(0.0)
    steep = spread(0.0)
    for i in range(r.n):
        per = 1.0 / largest(fma(r.rtol, absolute(r.y[i]), r.atol[i]), TINY)
        size = largest(absolute(r.y[i]) * per, size)
        steep = largest(absolute(r.k[i]) * per, steep)
    trial = where((size > 0.0) & (steep > 0.0), 0.01 * size / steep, 1e-3 * longest)
    trial = least(trial, longest)
    for i in range(r.n):
        r.work[i] = fma(trial, r.k[i], r.y[i])
    call_field(r.field, t + trial, r.work, r, slope)
    bent = spread(0.0)
    for i in range(r.n):
        per = 1.0 / (trial * largest(fma(r.rtol, absolute(r.y[i]), r.atol[i]), TINY))
        bent = largest(absolute(slope[i] - r.k[i]) * per, bent)
    steepest = largest(largest(steep, bent), TINY)
    step = rough_power(0.01 / steepest, 1.0 / ORDER)
    return least(least(100.0 * trial, step), longest)


@kernel
def choose_first_steps(begun: int, run_s: float, r: Any) -> None:
    """Choose the first steps of the lanes that have begun."""
    step = first_step(r.course[TIME], spread(min(run_s, r.max_step)), r)
    if r.first_step > 0.0:
        step = spread(r.first_step)
    r.course[NEXT_STEP] = where(mask_of(begun), step, r.course[NEXT_STEP])


@kernel
def clipped(t: Any, h: Any, before: Any, r: Any) -> Any:
    """Return the steps, or slightly more than the time to the first predicted flip.

    It is predicted from value, rate, and the rate's change in the last step, of length
    `before`.
    """
    shortest = CLIP_MOST * resolution_of(t, h)
    per_s = 1.0 / before
    for g in range(r.n_guards):
        value = largest(r.lock[g] * r.h0[g], 0.0)
        rate = r.lock[g] * r.rate0[g]
        bend = r.lock[g] * r.bend[g] * per_s
        discriminant = rate * rate - 2.0 * value * bend
        side = square_root(largest(discriminant, 0.0))
        falling = 2.0 * value / (side - rate)
        turning = -(side + rate) / bend
        time = where(rate < 0.0, falling, turning) * OVERSHOOT
        sooner = (discriminant > 0.0) & (time > shortest) & (time < h)
        h = where(sooner, time, h)
    return h


@kernel
def flips_often(r: Any) -> Any:
    """Return where most steps end in flips, among guards that are not few."""
    if r.n_guards > FEW:
        return r.course[LANDED] > MOSTLY * r.course[TAKEN]
    return mask_of(0)


@kernel
def choose_steps(aimed: int, often: Any, r: Any) -> tuple[Any, Any]:
    """Return the lengths of the steps, and where they go to the end of the time span.

    A step in one of the lanes `aimed` is repeated up to a flip, and not stretched.
    """
    t = r.course[TIME]
    remaining = r.t_end - t
    h = least(r.course[NEXT_STEP], r.max_step)
    if bits(often) != 0:
        h = where(often, clipped(t, h, r.course[LAST_STEP], r), h)
    to_the_end = h * where(mask_of(aimed), 1.0, ALMOST_THERE) >= remaining
    return where(to_the_end, remaining, h), to_the_end


@kernel
def propose_steps(h: Any, error: Any, rejected: int, r: Any) -> None:
    """Propose the next steps, by the errors of the last ones, of length `h`.

    A step that was rejected before does not grow.
    """
    factor = SAFETY * rough_power(error + TINY_ERROR, -1.0 / ORDER)
    most = where(mask_of(rejected), 1.0, GROW_MOST)
    factor = largest(SHRINK_MOST, least(most, factor))
    r.course[NEXT_STEP] = h * factor


@kernel
def shorten_close(again: Any, h: Any, error: Any, r: Any) -> None:
    """Let the next steps of these lanes be such that CLOSE_ERROR is their error."""
    factor = rough_power(DENSE_ERROR / CLOSE_ERROR * error + TINY_ERROR, -1.0 / ORDER)
    next_step = least(SAFETY * factor * h, r.course[NEXT_STEP])
    r.course[NEXT_STEP] = where(again, next_step, r.course[NEXT_STEP])


# The end of a step on a flip.


@kernel
def cut(crossed: Any, location: Any, t: Any, h: Any, error: Any, r: Any) -> Any:
    """End steps at these locations on the interpolant if it is accurate enough.

    Returns where they are ended. This costs less than repeating the step, but all lanes
    pay for it.
    """
    slope = state(r.k, STAGES * r.n)
    new_slope = state(r.k, (STAGES + 1) * r.n)
    interpolate(location, r)
    span = location * h
    call_field(r.field, t + span, r.work, r, new_slope)
    call_guards(r.guards, t + span, r.work, new_slope, r, r.h, r.rate)
    # The interpolant's error is taken to be largest in the middle and zero at the ends.
    part = 4.0 * location * (1.0 - location)
    good = crossed & (DENSE_ERROR * error * part * part <= SPARED)
    resolution = resolution_of(t, span)
    on_one = mask_of(0)
    for g in range(r.n_guards):
        margin = r.lock[g] * r.h[g]
        rate = r.lock[g] * r.rate[g]
        noise = ROUNDING * largest(absolute(r.h0[g]), absolute(r.h1[g]))
        near = largest(-0.1 * NEAR * span * rate, noise + resolution * absolute(rate))
        touches = (rate < 0.0) & (absolute(margin) <= near)
        good = good & ((margin > 0.0) | touches)
        on_one = on_one | touches
    good = good & on_one
    for i in range(r.n):
        r.end[i] = where(good, r.work[i], r.end[i])
        slope[i] = where(good, new_slope[i], slope[i])
    for g in range(r.n_guards):
        r.h1[g] = where(good, r.h[g], r.h1[g])
        r.rate1[g] = where(good, r.rate[g], r.rate1[g])
    return good


@kernel
def move_ends(mine: Any, t: Any, h: Any, soonest: Any, r: Any) -> Any:
    """Move the ends of these steps to the soonest surface, and return the shifts, s.

    `soonest` is how far behind the end that surface is, in steps. The state is moved
    along slope and bend of its path, and then, by what the guards there still lack,
    along its slope. The guards are evaluated at the new ends.
    """
    slope = state(r.k, STAGES * r.n)
    shift = where(mine, soonest * h, 0.0)
    for i in range(r.n):
        bend = BY_START * r.k[i] + BY_INSIDE * r.k[INSIDE * r.n + i] + BY_END * slope[i]
        half = 0.5 * where(mine, soonest, 0.0) * bend
        r.moved[i] = fma(shift, slope[i] + half, r.end[i])
    call_guards(r.guards, t + h + shift, r.moved, slope, r, r.h, r.rate)
    more = spread(inf)
    for g in range(r.n_guards):
        margin = r.lock[g] * r.h[g]
        rate = r.lock[g] * r.rate[g]
        close = (rate < 0.0) & (absolute(margin) <= NEAR * h * absolute(rate))
        more = where(close, least(more, -margin / rate), more)
    more = where(mine & (more < inf), more, 0.0)
    for i in range(r.n):
        r.moved[i] = fma(more, slope[i], r.moved[i])
    shift = shift + more
    call_guards(r.guards, t + h + shift, r.moved, slope, r, r.h, r.rate)
    return shift


@kernel
def mark_landed(landing: int, t: Any, h: Any, run_s: float, r: Any) -> tuple[int, int]:
    """Mark the guards that flip at the ends of these steps.

    Returns the lanes with such guards, and those with a guard that is past its surface
    by more than rounding.

    In lanes that have landed in vain before, the state cannot come any nearer to the
    surface: the rounding of state or guard is larger than the guard's values suggest.
    It flips from there.
    """
    mine = mask_of(landing)
    resolution = resolution_of(t, h)
    in_vain = r.course[IDLE] > IN_VAIN
    flipping = 0
    past = 0
    for g in range(r.n_guards):
        margin = r.lock[g] * r.h[g]
        rate = r.lock[g] * r.rate[g]
        size = largest(absolute(r.h0[g]), absolute(r.h1[g]))
        stuck = in_vain & (absolute(margin) <= SHORTEST * run_s * absolute(rate))
        size = where(stuck, largest(size, 2.0 / ROUNDING * absolute(margin)), size)
        kept = where(r.leaving[g] > 0.5, r.size[g], 0.0)
        r.size[g] = where(mine, largest(size, kept), r.size[g])
        noise = ROUNDING * r.size[g] + resolution * absolute(rate)
        flipping |= mark(landing, g, margin, rate, noise, r)
        past |= bits(margin < -noise) & landing
        r.h1[g] = where(mine, r.h[g], r.h1[g])
        r.rate1[g] = where(mine, r.rate[g], r.rate1[g])
    return flipping, past


@kernel
def land(
    landing: int, t: Any, h: Any, soonest: Any, run_s: float, r: Any
) -> tuple[Any, int, int]:
    """Move the ends of these steps to their surfaces; return the shifts and two sets.

    They are the lanes in which guards are due, and those in which several are, one of
    them past its surface by more than rounding: the driver must say what belongs to
    this instant.
    """
    shift = move_ends(mask_of(landing), t, h, soonest, r)
    flipping, past = mark_landed(landing, t, h, run_s, r)
    torn = 0
    if past != 0:
        for j in range(WIDTH):
            several = r.book[DUE, j] & (r.book[DUE, j] - 1) != 0
            torn |= 1 << j if past >> j & 1 and several else 0
    return shift, flipping, torn


# What is written of a step, and of a run.


@kernel
def sample(lanes: int, t: Any, h: Any, t_new: Any, r: Any) -> int:
    """Write the states at the requested times in the steps of these lanes.

    Their interpolants must have been prepared. Returns the lanes in which one
    overflows, as it may near the largest number.
    """
    beyond = 0
    while True:
        now = t_new
        pending = 0
        for j in range(WIDTH):
            number = r.book[SAMPLES, j]
            if lanes >> j & 1 == 0 or number >= r.times.width:
                continue
            if r.times[number] <= lane(t_new, j):
                now = with_lane(now, j, r.times[number])
                pending |= 1 << j
        if pending == 0:
            return beyond
        interpolate((now - t) / h, r)
        for i in range(r.n):
            r.work[i] = where(now == t_new, r.moved[i], r.work[i])
            beyond |= pending & ~bits(absolute(r.work[i]) < inf)
        for j in range(WIDTH):
            if pending >> j & 1:
                target = r.book[INDEX, j] * r.times.width + r.book[SAMPLES, j]
                for i in range(r.n):
                    r.samples[target, i] = lane(r.work[i], j)
                r.book[SAMPLES, j] += 1


@kernel
def leave(lanes: int, r: Any) -> None:
    """Record how the integrations in these lanes have ended."""
    for j in range(WIDTH):
        if lanes >> j & 1:
            leave_one(j, r)


@kernel
def leave_one(j: int, r: Any) -> None:
    """Record how the integration in lane j has ended."""
    system = r.book[INDEX, j]
    r.status[system, 0] = r.book[STATUS, j]
    r.ends[system, 0] = lane(r.course[TIME], j)
    r.ends[system, 1] = 0.0
    r.ends[system, 2] = 0.0
    for i in range(r.n):
        r.ends[system, END_STATE + i] = r.table[i, j]
    copy(row(r.modes, j), row(r.end_modes, system))
    tries = int(lane(r.course[TRIED], j))
    steps = int(lane(r.course[TAKEN], j))
    cuts = int(lane(r.course[CUTS], j))
    events = r.book[EVENTS, j]
    row(r.counts, system)[:] = 0
    r.counts[system, at.NFEV] = STAGES * tries + (1 + FURTHER) * cuts + events + 2
    r.counts[system, at.STEPS] = steps
    r.counts[system, at.REJECTED] = tries - steps
    r.counts[system, at.EVENTS] = events
    r.counts[system, at.SAMPLES] = r.book[SAMPLES, j]
    r.counts[system, at.CULPRIT] = r.book[CULPRIT, j]
    r.counts[system, at.CLOSE] = memory_in(j, r).counts[at.CLOSE]


# The course of the runs.


@kernel
def clear(r: Any) -> None:
    """Set the course of all lanes to that before a run."""
    for one in range(COURSE_ROWS):
        r.course[one] = 0.0
    r.course[TIME] = r.t_start
    r.course[LAST_STEP] = 1.0


@kernel
def begin_runs(begun: int, r: Any) -> None:
    """Set the course of these lanes to the start of a run."""
    new = mask_of(begun)
    r.course[TIME] = where(new, r.t_start, r.course[TIME])
    r.course[HIT] = where(new, r.t_start, r.course[HIT])
    for one in (RESUME, TRIES, STIFF, TRIED, TAKEN, IDLE, LANDED, CUTS):
        r.course[one] = where(new, 0.0, r.course[one])


@kernel
def aim(
    crossed: Any, often: Any, t: Any, h: Any, error: Any, r: Any
) -> tuple[Any, Any]:
    """Try to end these steps at their first flips.

    Returns where steps have ended on the interpolant, and the locations of the flips,
    as fractions of the steps. All others are repeated up to there.
    """
    location = r.aim[LOCATION]
    r.course[RESUME] = where(crossed, largest(r.course[RESUME], h), r.course[RESUME])
    short = mask_of(0)
    if bits(crossed & often) != 0:
        short = cut(crossed & often, location, t, h, error, r)
        r.course[CUTS] = where(short, r.course[CUTS] + 1.0, r.course[CUTS])
    return short, location


@kernel
def resume_steps(landing: int, r: Any) -> None:
    """Let the next steps of these lanes be as long as those that were cut by flips."""
    mine = mask_of(landing)
    next_step = r.course[NEXT_STEP]
    r.course[NEXT_STEP] = where(mine, largest(next_step, r.course[RESUME]), next_step)
    r.course[RESUME] = where(mine, 0.0, r.course[RESUME])


@kernel
def move_on(accepted: Any, landing: int, t_new: Any, h: Any, hard: Any, r: Any) -> None:
    """Make the ends of the accepted steps the starts of the next ones, and count them.

    `hard` says where the field is too stiff for this step.
    """
    slope = state(r.k, STAGES * r.n)
    stiff = largest(r.course[STIFF] + where(hard, 1.0, -RELIEF), 0.0)
    r.course[STIFF] = where(accepted, stiff, r.course[STIFF])
    r.course[TRIES] = where(accepted, 0.0, r.course[TRIES] + 1.0)
    r.course[TRIED] = r.course[TRIED] + 1.0
    r.course[TIME] = where(accepted, t_new, r.course[TIME])
    r.course[TAKEN] = where(accepted, r.course[TAKEN] + 1.0, r.course[TAKEN])
    r.course[LAST_STEP] = where(accepted, h, r.course[LAST_STEP])
    landed = r.course[LANDED]
    r.course[LANDED] = where(mask_of(landing), landed + 1.0, landed)
    for i in range(r.n):
        r.y[i] = where(accepted, r.moved[i], r.y[i])
        r.k[i] = where(accepted, slope[i], r.k[i])
    for g in range(r.n_guards):
        r.bend[g] = where(accepted, r.rate1[g] - r.rate0[g], r.bend[g])
        r.h0[g] = where(accepted, r.h1[g], r.h0[g])
        r.rate0[g] = where(accepted, r.rate1[g], r.rate0[g])
        r.leaving[g] = where(accepted, 0.0, r.leaving[g])


@kernel
def lost_lanes(
    accepted: Any, landing: int, fresh: int, h: Any, run_s: float, r: Any
) -> Any:
    """Return where a run makes no progress any more, or exceeds its number of steps.

    In the lanes `fresh` a guard has just flipped.
    """
    flipped = mask_of(fresh)
    t = r.course[TIME]
    nowhere = (mask_of(landing) | (h < SHORTEST * run_s)) & ~flipped
    idle = where(nowhere, r.course[IDLE] + 1.0, 0.0)
    r.course[IDLE] = where(accepted, idle, r.course[IDLE])
    too_soon = flipped & (t - r.course[HIT] < SOON * run_s)
    r.course[HIT] = where(flipped, t, r.course[HIT])
    too_often = (r.course[TRIES] > MOST_TRIES) | (r.course[IDLE] > MOST_IDLE)
    too_stiff = r.course[STIFF] > STIFF_SCORE
    too_short = ~(h > ROUNDING * absolute(t))
    too_many = (r.course[TAKEN] >= float(r.max_steps)) & (t < r.t_end)
    return too_often | too_stiff | too_short | too_many | too_soon


@kernel
def judge(
    t: Any, h: Any, error: Any, fine: Any, aimed: int, r: Any
) -> tuple[Any, Any, Any, Any, Any]:
    """Judge all guards in the steps that are `fine`, and prepare their interpolants.

    A step that is repeated up to a flip, in the lanes `aimed`, was proven when it was
    longer: only its end counts, if it is on a surface and no guard is past its own.
    Elsewhere its own interpolant may have passed a surface and its way back.

    Returns five results by lane: where nothing is proven, where a guard flips inside
    the step, where one is at its surface at the end, the distance of the end from
    there, in steps, and where a guard turns so close that the step is to be taken
    again, with a smaller error.
    """
    end_slope = state(r.k, STAGES * r.n)
    call_guards(r.guards, t + h, r.end, end_slope, r, r.h1, r.rate1)
    touching, soonest, before = at_surface(t, h, r)
    open_ones = fine & ~(before & touching & mask_of(aimed))
    if r.times.width > 0 or (r.n_guards > 0 and bits(open_ones) != 0):
        prepare(t, h, r)
    lost, flips, close = prove(t, h, open_ones, r)
    again = close & (DENSE_ERROR * error > CLOSE_ERROR)
    if bits(again) != 0:
        do_not_count(bits(again), r)
    # The end of the step is moved to a flip next to it.
    by_the_end = touching & (r.aim[LOCATION] > 1.0 - 2.0 * NEAR)
    return lost, flips & ~by_the_end & ~again, touching, soonest, again


@kernel
def advance(
    active: int, rejected: int, aimed: int, run_s: float, r: Any
) -> tuple[int, int, int, int]:
    """Take a step in each active lane, to its end or to its first flip.

    Takes the lanes whose last step was rejected, and those whose step is repeated up to
    a flip; returns both anew, the lanes in which a guard has flipped, and those that
    are over.
    """
    often = flips_often(r)
    t = r.course[TIME]
    h, to_the_end = choose_steps(aimed, often, r)
    error, hard = take_step(t, h, r)
    error = where(error < HUGE, error, HUGE)
    fine = (error <= 1.0) & mask_of(active)
    lost, crossed, touching, soonest, again = judge(t, h, error, fine, aimed, r)
    propose_steps(h, error, rejected, r)
    shorten_close(again, h, error, r)
    accepted = fine & ~lost & ~crossed & ~again
    landing = bits(accepted & touching)
    aimed = bits(crossed)
    over = give_up(bits(lost), r)
    whole = h
    if aimed != 0:
        short, location = aim(crossed, often, t, h, error, r)
        accepted = accepted | short
        h = where(short, location * h, h)
        soonest = where(short, 0.0, soonest)
        to_the_end = to_the_end & ~short
        aimed &= ~bits(short)
        landing |= bits(short)
        r.course[NEXT_STEP] = where(mask_of(aimed), location * h, r.course[NEXT_STEP])
    shift = spread(0.0)
    fresh = 0
    if landing != 0:
        shift, fresh, torn = land(landing, t, h, soonest, run_s, r)
        over |= give_up(torn, r)
        fresh &= ~torn
        resume_steps(landing, r)
    t_new = where(to_the_end & (shift == 0.0), r.t_end, t + h + shift)
    if r.times.width > 0:
        over |= give_up(sample(bits(accepted), t, whole, t_new, r), r)
    move_on(accepted, landing, t_new, h, hard, r)
    over |= fire_first(fresh, r)
    stuck = lost_lanes(accepted, landing, fresh, h, run_s, r)
    over |= give_up(bits(stuck) & active & ~over, r)
    rejected = active & ~bits(accepted) & ~aimed
    return rejected, aimed, fresh, over


@kernel
def fire_first(fresh: int, r: Any) -> int:
    """Begin an instant in these lanes and flip a guard; return the lanes that end."""
    if fresh == 0:
        return 0
    for j in range(WIDTH):
        if fresh >> j & 1:
            begin_instant(j, r)
    return fire(fresh, r)


def run(first: int, last: int, block: int) -> int:
    """Integrate from the rows `first` to `last` of y0, as `driver.loop` does.

    `block` is the address of the argument block, which holds or points to everything
    else. The status of a system that is given up is GIVEN_UP.
    """
    r = room(int_vector(block, 0))
    run_s = r.t_end - r.t_start
    clear(r)
    # Lanes, as bits: with a system; whose guards have flipped; that are over; whose
    # last step was rejected, or is repeated up to a flip; that want another system.
    active = 0
    fresh = 0
    over = 0
    rejected = 0
    aimed = 0
    want = ALL
    while True:
        begun = 0
        open_ones = 0
        if want != 0:
            begun, first = take_systems(want, first, last, r)
            active = (active & ~want) | begun
            over &= ~want
            if active == 0:
                return last
            begin_runs(begun, r)
            open_ones = settle(begun, r)
            fresh |= begun
            rejected &= ~begun
            aimed &= ~begun
        over = fire_until_none_is_due(fresh, open_ones, over, r)
        fresh = 0
        if begun != 0:
            choose_first_steps(begun, run_s, r)
        want = (bits(r.course[TIME] >= r.t_end) & active) | over
        if want == 0:
            rejected, aimed, fresh, over = advance(active, rejected, aimed, run_s, r)
            at_end = bits(r.course[TIME] >= r.t_end)
            want = ((at_end & active & ~fresh) | over) & active
            fresh &= ~want
        if want != 0:
            leave(want, r)
