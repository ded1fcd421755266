"""Shorten a step to the part in which its ends reveal the guards' behaviour.

A guard that is affine in state and time follows the step's own polynomial, so the ends
suffice. A guard that bends (a sine, a product, a table) may rise and fall unseen within
the step, so it is examined in windows. The cubic through values and rates at a window's
ends predicts both in its middle; the error there shows whether the guard is resolved.
Windows have their own size control. The step ends before the first window in which a
bending guard may flip, and the next step is that window.
"""

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver.branches import MOST_BARREN, SAMPLED
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.localise import cubic, just_left, turning_points
from hopdata.hybrid.driver.problem import (
    Problem,
    awake,
    blur,
    eval_guards,
    guards_at_end,
    time_resolution,
    way,
)
from hopdata.hybrid.driver.stepping import take_step
from hopdata.hybrid.driver.watch import facing, look
from hopdata.hybrid.layout import Memory

AFFINE = 1e-11  # fraction of a guard's values: rounding error of an affine guard
ERROR_IF_EVEN = 0.05  # fraction of the slope: error over a step whose ends suffice
# Fraction of the change over a window: error of a guard that follows its cubic
MOVES = 0.02
# Lengths of a step in which all guards were straight: up to here they stay straight
LEAP = 8.0
LONGEST, LONGEST_IF_SURE = 1.0 / 64.0, 1.0 / 8.0  # fractions of the run: longest window
OF_PATH = 0.05  # fraction of the change: allowed error of a step's cubic from its path
SHORTEST = 2.0**-26  # fraction of the step: a shorter window is not divided
INSTANTS = 16.0  # time resolutions: the change of a guard within this time is noise
FINE = (
    2.0**-8
)  # fraction of the longest window: shorter ones need not resolve distant guards
SURE = 2.0  # times the error in the middle: a larger margin is clear
OWN, FLOOR = (
    0.2,
    1e-9,
)  # fractions of a window's change, of the margin: errors allowed anywhere
RESOLVED = 0.05  # fraction of that change: error below which the ends reveal a flip
ROOMY, GROW = (
    40.0,
    2.0,
)  # allowed error over error at which the next window grows, and its factor
# Disagreement of values and rates that numbers without all their digits may cause:
# those below 2e-308, times a factor that may be large. Below it, nothing is said
# against the rates. If it were 1.5 times larger, guards that are as small as this would
# be trusted a little more, and no others.
UNDERFLOW = 1e-300
MOST_ROOM = 1e300
MOST_ROUGH = (
    2000  # twice the windows whose rates and values disagree, minus the other windows
)
CLEAR, OPEN, DIVIDE = 0, 1, 2
UNEVEN, EVEN, AFAR = 0, 1, 2
BY_ENDS, BY_WINDOWS, NONE_NEAR = 0, 1, 2  # values of WATCHED: what remains to be done


@kernel_in_loop
def set_way(m: Memory) -> None:
    """Write the fixed direction of `way` into SLOPE."""
    for i in range(m.states.width):
        m.states[at.SLOPE, i] = way(i)


@kernel_in_loop
def measure(p: Problem, m: Memory) -> None:
    """Store the guards' rates along one direction.

    For an affine guard they are constant in a mode.
    """
    m.counts[at.MEASURED] = m.counts[at.INSTANTS]
    set_way(m)
    eval_guards(p, m, m.clock[at.T], at.Y, at.SLOPE, at.H, at.RATE_ALONG)


@kernel_in_loop
def look_on_cubic(p: Problem, m: Memory, dt: float, theta: float, along: bool) -> None:
    """Evaluate the guards at `theta` on the states' cubic over the step.

    They are written into H and RATE. Rates are along the cubic or, if `along`, along
    the direction of `measure`.
    """
    s, per_s = m.states, 1.0 / dt
    for i in range(s.width):
        rise, d0, d1 = s[at.END, i] - s[at.Y, i], dt * s[at.K1, i], dt * s[at.KEND, i]
        bend, twist = 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise
        slope = per_s * (d0 + theta * (2.0 * bend + 3.0 * theta * twist))
        s[at.SCRATCH, i] = s[at.Y, i] + theta * (d0 + theta * (bend + theta * twist))
        s[at.SLOPE, i] = way(i) if along else slope
    eval_guards(p, m, m.clock[at.T] + theta * dt, at.SCRATCH, at.SLOPE, at.H, at.RATE)


@kernel_in_loop
def mark_bent(
    p: Problem, m: Memory, dt: float, theta: float, mark: bool, by_rate: bool
) -> int:
    """Count the guards that were straight but are not at `theta`.

    If `mark`, they are marked as bent. The criteria are their rates along the direction
    of `measure` and, unless `by_rate`, their values.
    """
    g, found, resolution = m.guards, 0, INSTANTS * time_resolution(m.clock[at.T], dt)
    state = 0.0  # its rounding exceeds that of time soon after t = 0
    for i in range(m.states.width):
        state = max(state, abs(m.states[at.Y, i]))
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        along, d0, d1 = g[at.RATE_ALONG, k], dt * g[at.RATE0, k], dt * g[at.RATE1, k]
        same = (abs(g[at.RATE, k] - along) <= AFFINE * abs(along)) & (abs(along) > 0.0)
        off = abs(g[at.H, k] - cubic(g[at.H0, k], d0, g[at.H1, k], d1, theta))
        size = abs(g[at.H0, k]) + abs(g[at.H1, k]) + abs(d0) + abs(d1)
        noise = blur(
            max(size, g[at.SIZE, k], 8.0 * state * abs(along)),
            g[at.RATE1, k],
            resolution,
        )
        straight = same & (by_rate | (off <= AFFINE * size + noise))
        new = 0 if straight | (m.flags[at.BENT, k] != 0) else 1
        found += new
        m.flags[at.BENT, k] += new if mark else 0
    return found


@kernel_apart
def bent_on_path(p: Problem, m: Memory, dt: float) -> int:
    """Mark the guards that bend somewhere on a long step.

    It is much longer than its cubic is valid for.
    """
    found, parts = 0, max(1, int(dt / (LONGEST_IF_SURE * (p.t_end - p.t_start))))
    prepare_interpolant(p, m, dt)
    for part in range(parts):
        theta = (part + 0.5) / parts
        interpolate(p, m, theta, at.SCRATCH, 0.0)
        set_way(m)
        eval_guards(
            p, m, m.clock[at.T] + theta * dt, at.SCRATCH, at.SLOPE, at.H, at.RATE
        )
        found += mark_bent(p, m, dt, theta, True, True)
    return found


@kernel_in_loop
def find_bent(p: Problem, m: Memory, dt: float) -> None:
    """Mark the guards that, by this step, are not affine in state and time."""
    found, part, parts = 0, 0, 1
    in_powers = p.methods[m.counts[at.METHOD], at.IN_POWERS] != 0
    if dt > 0.5 * (p.t_end - p.t_start) and not in_powers:  # usually free flight
        parts = int(dt / (LONGEST_IF_SURE * (p.t_end - p.t_start)))
    while part < parts:
        theta = (part + 0.5) / parts
        look_on_cubic(p, m, dt, theta, True)
        new = m.counts[at.MEASURED] == m.counts[at.INSTANTS]
        count = mark_bent(p, m, dt, theta, new, False)
        if count > 0 and not new:
            measure(p, m)  # in a new mode a guard may be another plane: repeat
        else:
            found += count
            part += 1
    if in_powers:
        found += bent_on_path(p, m, dt)
    m.counts[at.N_BENT] += found
    if found > 0:  # window sizes for straight guards do not apply to these
        m.clock[at.WINDOW] = min(m.clock[at.WINDOW], LONGEST * (p.t_end - p.t_start))


@kernel
def by_ends(p: Problem, m: Memory, dt: float) -> int:
    """Judge the step by its ends.

    The result is AFAR if no guard can reach its surface, EVEN if all move evenly.
    Otherwise the result is UNEVEN.
    """
    g, near, fast = m.guards, 0, 0
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        lock = p.mode[k]
        g0, g1 = facing(lock, g[at.H0, k]), facing(lock, g[at.H1, k])
        d0, d1 = g[at.RATE0, k] * dt, g[at.RATE1, k] * dt
        rise, slopes = abs(g1 - g0), abs(d0) + abs(d1)
        uneven = abs(g[at.H1, k] - g[at.H0, k] - 0.5 * (d0 + d1))
        even = (uneven <= ERROR_IF_EVEN * abs(d0)) & (abs(d1 - d0) <= abs(d0))
        afar = (g0 > slopes + rise) & (g1 > slopes + rise) & (uneven <= OWN * slopes)
        near += 0 if afar else 1
        fast += 0 if even | afar else 1
    return AFAR if near == 0 else EVEN if fast == 0 else UNEVEN


@kernel
def leave_out_bent(m: Memory) -> int:
    """Remove the guards already examined in windows from NEAR.

    Returns how many remain.
    """
    count = 0
    for a in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, a]
        m.lists[at.NEAR, count] = k
        count += 1 - m.flags[at.BENT, k]
    m.counts[at.N_NEAR] = count
    return count


@kernel
def lowest(g0: float, d0: float, g1: float, d1: float) -> float:
    """Return the least value of the cubic after its start."""
    _, bottom = turning_points(g0, d0, g1, d1)
    return min(g1, cubic(g0, d0, g1, d1, bottom)) if bottom < 1.0 else g1


@kernel_in_loop
def judge(  # noqa: PLR0913 (three ends of two cubics, in a compiled loop)
    g0: float, d0: float, gc: float, dc: float, g1: float, d1: float,
    leaving: bool, noise: float, slack: float,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Judge a guard in a window by its ends and its middle.

    Margins and slopes (per window) are given. A margin must exceed the error plus
    `slack` times the change. Returns the judgement, the error in the middle, the error
    that is allowed anywhere, and the change.
    """
    error = abs(gc - 0.5 * (g0 + g1) - 0.125 * (d0 - d1))
    error += 0.25 * abs(dc - 1.5 * (g1 - g0) + 0.25 * (d0 + d1))
    change = max(g0, gc, g1) - min(g0, gc, g1)
    own = OWN * change + FLOOR * (abs(g0) + abs(g1)) + noise
    unsure, sixth = SURE * error + slack * change, 1.0 / 6.0
    ends = min(gc, g1) if leaving else min(g0, gc, g1)
    away = leaving and d0 >= 0.0  # leaves its surface, but not like the square of time
    near = ends if away else g0 + sixth * d0
    low = min(ends, near, gc - sixth * dc, gc + sixth * dc, g1 - sixth * d1)
    if (
        low <= unsure and ends >= -unsure
    ):  # not certainly clear: check the turning points, too
        low = min(
            ends, lowest(g0, 0.5 * d0, gc, 0.5 * dc), lowest(gc, 0.5 * dc, g1, 0.5 * d1)
        )
        low = min(low, near) if leaving else low
    if low > unsure:
        return CLEAR, error, min(own, low / SURE), change
    if error <= noise or (error <= RESOLVED * change and low < -unsure):
        return OPEN, error, own, change
    return DIVIDE, error, own, change


@kernel_in_loop
def judge_all(  # noqa: PLR0913 (a window, its ends and its rows, in a compiled loop)
    p: Problem,
    m: Memory,
    dt: float,
    low: float,
    high: float,
    a: int,
    c: int,
    b: int,
    slack: float,
) -> tuple[int, float, bool]:
    """Judge the bending guards in a window, by rows.

    Returns the worst judgement and the least room. Room is the ratio of allowed error
    to error; below 1, rates and values disagree. The last result is whether all guards
    follow their cubics.
    """
    g, span, worst, least, sure = m.guards, dt * (high - low), CLEAR, MOST_ROOM, True
    resolution, longest = (
        time_resolution(m.clock[at.T], dt),
        LONGEST * (p.t_end - p.t_start),
    )
    for i in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, i)
        if m.flags[at.BENT, k] == 0:
            continue
        lock = p.mode[k]
        leaving = low == 0.0 and just_left(p, m, dt, k)
        noise = blur(
            max(g[at.SIZE, k], abs(g[a, k]), abs(g[b, k])), g[c + 1, k], resolution
        )
        kind, error, own, change = judge(
            0.0 if leaving else lock * g[a, k], lock * g[a + 1, k] * span,
            lock * g[c, k], lock * g[c + 1, k] * span,
            lock * g[b, k], lock * g[b + 1, k] * span, leaving, noise, slack,
        )  # fmt: skip
        room = own / error if error > UNDERFLOW else MOST_ROOM
        if (room < min(least, ROOMY) or kind == DIVIDE) and m.counts[
            at.ROUGH
        ] >= MOST_ROUGH - 1:
            m.counts[at.CULPRIT] = k
        moves = error <= MOVES * change
        rough, long = room < 1.0 and span > FINE * longest, span > longest and not moves
        if kind == DIVIDE or rough or long:
            return DIVIDE, room, False
        sure = sure and moves
        worst, least = max(worst, kind), min(least, room)
    return worst, least, sure


@kernel_in_loop
def middle_tells(p: Problem, m: Memory, dt: float) -> bool:
    """Return whether ends and middle suffice.

    They do if the step is short and its cubic is the path. In a longer step they would
    not: a sum of two sines may meet its cubic there by accident.
    """
    longest = FINE * LONGEST * (p.t_end - p.t_start)
    if dt > longest or p.methods[m.counts[at.METHOD], at.IN_POWERS] != 0:
        return False
    look_on_cubic(p, m, dt, 0.5, False)
    kind, room, _ = judge_all(p, m, dt, 0.0, 1.0, at.H0, at.H, at.H1, OF_PATH)
    if kind == DIVIDE or room < 1.0:
        return False
    m.clock[at.WINDOW] = max(m.clock[at.WINDOW], dt)
    return True


@kernel
def any_past(p: Problem, m: Memory, row: int) -> int:
    """Return the first bending guard that is past its surface in a row.

    The result is -1 if there is none.
    """
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        if m.flags[at.BENT, k] != 0 and p.mode[k] * m.guards[row, k] < 0.0:
            return k
    return -1


@kernel
def unused(a: int, b: int) -> int:
    """Return one of three spare rows of the guards that is neither `a` nor `b`."""
    if a != at.H and b != at.H:
        return at.H
    row = at.H0 + 2
    return row if row not in (a, b) else row + 2


@kernel_apart
def look_by_windows(p: Problem, m: Memory, dt: float) -> float:
    """Return the time, s, from the step's start that is free of flips.

    Only bending guards are examined. If one may flip in the very first window, return
    that window: WATCHED then says that its ends suffice.
    """
    prepare_interpolant(p, m, dt)
    run = (p.t_end - p.t_start) / dt
    shortest = max(SHORTEST, INSTANTS * time_resolution(m.clock[at.T], dt) / dt)
    width, low, a = min(m.clock[at.WINDOW] / dt, LONGEST_IF_SURE * run), 0.0, at.H0
    m.counts[at.WATCHED] = BY_WINDOWS
    while low < 1.0 and m.counts[at.ROUGH] <= MOST_ROUGH:
        high, b, divided = low + width, at.H1, False
        if low + 1.25 * width < 1.0:
            b = unused(a, at.H1)
            look(p, m, dt, high, b)
        else:
            high = 1.0
        while True:
            c, middle = unused(a, b), 0.5 * (low + high)
            look(p, m, dt, middle, c)
            kind, room, sure = judge_all(p, m, dt, low, high, a, c, b, 0.0)
            if kind != DIVIDE or high - low <= shortest:
                break
            high, b, divided = middle, c, True
        crawls = not divided and room <= ROOMY and high - low <= shortest
        rough = 2 if room < 1.0 or kind == DIVIDE or crawls else -1
        m.counts[at.ROUGH] = max(0, m.counts[at.ROUGH] + rough)
        if divided or room <= ROOMY:
            width = min(width, high - low)
        else:
            longest = LONGEST_IF_SURE if sure else LONGEST
            if p.branches < 0 or m.counts[at.BARREN] > MOST_BARREN:
                longest = SAMPLED
            width = min(GROW * (high - low), longest * run)
        if kind == OPEN or (
            kind == DIVIDE and (any_past(p, m, c) >= 0 or any_past(p, m, b) >= 0)
        ):
            m.clock[at.WINDOW] = (high - low) * dt
            m.counts[at.WATCHED] = BY_WINDOWS if low > 0.0 else BY_ENDS
            return low * dt if low > 0.0 else high * dt
        low, a = high, b
    m.clock[at.WINDOW] = width * dt
    return low * dt


@kernel_apart
def watch(p: Problem, m: Memory, dt: float) -> float:
    """Shorten the step to where its ends suffice; return its length, or a status.

    WATCHED says whether bending guards may flip in it: not if windows have ruled that
    out.
    """
    if m.counts[at.N_BENT] < m.flags.width:
        find_bent(p, m, dt)
    m.counts[at.MEASURED] = m.counts[at.INSTANTS]
    if m.counts[at.N_BENT] == 0:
        m.clock[at.WINDOW] = max(m.clock[at.WINDOW], LEAP * dt)
        return dt
    if middle_tells(p, m, dt):
        return dt
    part = look_by_windows(p, m, dt)
    if m.counts[at.ROUGH] > MOST_ROUGH:
        return float(at.RATE_DIFFERS)
    if part < dt:
        m.clock[at.NEXT_DT] = min(m.clock[at.NEXT_DT], m.clock[at.WINDOW])
        take_step(p, m, m.clock[at.T], part)
        guards_at_end(p, m, m.clock[at.T] + part)
    return part


@kernel_in_loop
def watched(p: Problem, m: Memory, dt: float) -> float:
    """Do the same as `watch`, if that is necessary.

    Usually the step is no longer than a window and no guard moves fast in it.
    """
    m.counts[at.WATCHED] = BY_ENDS
    if m.flags.width == 0:
        return dt
    new = (
        m.counts[at.MEASURED] != m.counts[at.INSTANTS]
        and m.counts[at.N_BENT] < m.flags.width
    )
    if not new and dt <= m.clock[at.WINDOW]:
        kind = by_ends(p, m, dt)
        if kind == AFAR and p.methods[m.counts[at.METHOD], at.IN_POWERS] == 0:
            m.counts[at.WATCHED] = NONE_NEAR
        if kind != UNEVEN:
            return dt
    return watch(p, m, dt)
