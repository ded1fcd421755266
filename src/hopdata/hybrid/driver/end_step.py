"""Make a step end on the guard that flips first in it.

The step is repeated up to the instant found by localisation. Its end is then corrected
by Newton's method on h itself, so time and state of the event have the order of the
method, not that of the interpolant.
"""

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver import problem, watch
from hopdata.hybrid.driver.branches import AT_BRANCH
from hopdata.hybrid.driver.dense import interpolate
from hopdata.hybrid.driver.jacobian import has_short_tangent
from hopdata.hybrid.driver.localise import CROSSING, DIP, first_cut
from hopdata.hybrid.driver.stepping import take_step
from hopdata.hybrid.driver.windows import BY_WINDOWS, NONE_NEAR, leave_out_bent
from hopdata.hybrid.layout import Memory

MAX_POLISH = 8
SPARED = 5e-2  # tolerances: interpolant error below which the step need not be repeated
FARTHEST = 0.1  # fraction of the step: if the interpolant errs by more, h is not smooth
HOVER = 1e-8  # fraction of the step by which rounding of h may move its end
RETAKE_ABOVE = 1e-4  # fraction of the step: largest move of its end by a midpoint step


@kernel
def nearest_surface(p: problem.Problem, m: Memory, k: int) -> tuple[float, int]:
    """Return the time, s, from the step's end to the surface of guard k or a rival, and the guard.

    A rival is a guard past its surface; the one that was passed first counts.
    """
    shift, nearest = 0.0, k
    if p.mode[k] * m.guards[at.RATE1, k] < 0.0:
        shift = -m.guards[at.H1, k] / m.guards[at.RATE1, k]
    for a in range(m.counts[at.N_NEAR]):
        j = m.lists[at.NEAR, a]
        value, rate = p.mode[j] * m.guards[at.H1, j], p.mode[j] * m.guards[at.RATE1, j]
        if rate < 0.0 and value < 0.0 and -value / rate < shift:
            shift, nearest = -value / rate, j
    return shift, nearest


@kernel
def move_end(p: problem.Problem, m: Memory, t: float, shift: float) -> None:
    """Move the end of the step, which is at time t, by a short midpoint step."""
    s = m.states
    for i in range(s.width):
        s[at.SCRATCH, i] = s[at.END, i] + 0.5 * shift * s[at.KEND, i]
    problem.eval_field(p, m, t + 0.5 * shift, at.SCRATCH, at.SLOPE)
    for i in range(s.width):
        s[at.END, i] += shift * s[at.SLOPE, i]
    problem.eval_field(p, m, t + shift, at.END, at.KEND)


@kernel
def take_part(
    p: problem.Problem, m: Memory, t: float, span: float, on_interpolant: bool
) -> None:
    """Take the first part of the step again, or evaluate its end on the interpolant."""
    if on_interpolant:
        interpolate(p, m, span / m.clock[at.SPAN], at.END, 0.0)
        problem.eval_field(p, m, t + span, at.END, at.KEND)
    else:
        take_step(p, m, t, span)


@kernel
def look_at_end(p: problem.Problem, m: Memory, t: float, resolution: float) -> None:
    """Evaluate the guards at the step's end, at time t, and put those it has reached into NEAR."""
    problem.guards_at_end(p, m, t)
    watch.gather_reached(p, m, at.H1, at.RATE1, resolution)
    for a in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, a]
        left, rate = -p.mode[k] * m.guards[at.H1, k], p.mode[k] * m.guards[at.RATE1, k]
        if problem.is_leaving(m, k, rate, t - m.clock[at.T], resolution):
            problem.count_as_rounding(p, m, k, t, at.END, left, rate, resolution)


@kernel_apart
def end_at(
    p: problem.Problem,
    m: Memory,
    span: float,
    on_interpolant: bool,
    resolution: float,
    k: int,
) -> float:
    """Take the first part of the step and evaluate the guards; return the margin of guard k."""
    take_part(p, m, m.clock[at.T], span, on_interpolant)
    look_at_end(p, m, m.clock[at.T] + span, resolution)
    return p.mode[k] * m.guards[at.H1, k]


@kernel_apart
def end_behind_jump(
    p: problem.Problem,
    m: Memory,
    k: int,
    span: float,
    on_interpolant: bool,
    resolution: float,
) -> float:
    """Make the step end just past the jump of guard k near `span`, and return its length.

    If there is no jump nearby, the step ends at `span`.
    """
    past = end_at(p, m, span, on_interpolant, resolution, k) <= 0.0
    clear, behind, reach = span, span, resolution
    while clear == behind and reach < FARTHEST * span:
        there = span - reach if past else min(span + reach, p.t_end - m.clock[at.T])
        if (end_at(p, m, there, on_interpolant, resolution, k) <= 0.0) != past:
            clear, behind = (there, span) if past else (span, there)
        reach *= 2.0
    while behind - clear > resolution:
        middle = 0.5 * (clear + behind)
        if end_at(p, m, middle, on_interpolant, resolution, k) <= 0.0:
            behind = middle
        else:
            clear = middle
    end_at(p, m, behind, on_interpolant, resolution, k)
    return behind


@kernel_apart
def land(
    p: problem.Problem, m: Memory, k: int, span: float, resolution: float
) -> tuple[float, int]:
    """Make the step end on guard k, about `span` from its start.

    The step is repeated up to there unless the interpolant adds almost nothing to the
    step's error. The interpolant is worst in the middle and as good as the step at both
    ends. Where Newton's method increases the distance, the event function jumps.

    Returns the step's length and the guard on which it ends: a rival if one flips
    earlier.
    """
    t, whole = m.clock[at.T], m.clock[at.SPAN]
    last, theta = FARTHEST * span, span / whole
    error = p.methods[m.counts[at.METHOD], at.INTERPOLANT_ERROR] * m.clock[at.ERROR]
    on_interpolant = error * (4.0 * theta * (1.0 - theta)) ** 2 <= SPARED and (
        not p.first_order or has_short_tangent(p, m, span)
    )
    end_at(p, m, span, on_interpolant, resolution, k)
    place, aim, left = span, k, np.inf
    for _ in range(MAX_POLISH):
        shift, k = nearest_surface(p, m, k)
        if k != aim:
            place, aim, left = span, k, np.inf
        if not abs(shift) > resolution:
            break
        if not (abs(shift) < last and abs(m.guards[at.H1, k]) < left):
            noise = problem.blur(
                m.guards[at.SIZE, k], m.guards[at.RATE1, k], resolution
            )
            if abs(shift) > HOVER * span and abs(m.guards[at.H1, k]) > noise:
                span = end_behind_jump(p, m, k, place, on_interpolant, resolution)
            break
        last, left = abs(shift), abs(m.guards[at.H1, k])
        if on_interpolant or p.first_order or abs(shift) > RETAKE_ABOVE * span:
            take_part(p, m, t, span + shift, on_interpolant)
        else:
            move_end(p, m, t + span, shift)
        span += shift
        look_at_end(p, m, t + span, resolution)
    return span, k


# End a step at its first flip: judge, search, land, and mark the guards that flip
# there.


@kernel_in_loop
def gather(p: problem.Problem, m: Memory, dt: float) -> int:
    """Put the guards that may flip within the step into NEAR, and return their number."""
    watch.set_knots(p, m, dt)
    count = (
        watch.gather_near_by_pieces(p, m, dt)
        if m.counts[at.PIECES] > 1
        else watch.gather_near(p, m, dt)
    )
    return (
        leave_out_bent(m) if count > 0 and m.counts[at.WATCHED] == BY_WINDOWS else count
    )


@kernel_apart
def end_at_dips(
    p: problem.Problem, m: Memory, dt: float, kind: int, k: int, theta: float
) -> tuple[float, int, int, float]:
    """End the step at its first cut as long as this is a dip, where the sign of h decides.

    Returns the step's length, and kind, guard and place of the remaining cut.
    """
    for _ in range(2 * m.counts[at.N_AWAKE] + 4):
        if kind != DIP or theta * dt <= problem.time_resolution(m.clock[at.T], dt):
            break
        dt *= theta
        take_step(p, m, m.clock[at.T], dt)
        problem.guards_at_end(p, m, m.clock[at.T] + dt)
        gather(p, m, dt)
        kind, k, theta = first_cut(p, m, dt)
    return dt, kind, k, theta


@kernel
def flips_by_rounding(
    p: problem.Problem, m: Memory, k: int, t: float, resolution: float
) -> bool:
    """Return whether guard k, on which the step ends at time t, flips although h has a rest.

    Its rest must be explained by rounding. If it is not, h jumps there, and the step
    has ended before the jump: the next step begins before it, and finds it.
    """
    margin, rate = p.mode[k] * m.guards[at.H1, k], p.mode[k] * m.guards[at.RATE1, k]
    if not rate < 0.0:
        return False
    return margin <= problem.most_rounding(p, m, k, t, at.END, rate, resolution)


@kernel
def set_sizes(p: problem.Problem, m: Memory, which: int) -> None:
    """Set the rounding scale of the guards in a list by their values at the ends of the step."""
    for a in range(m.counts[at.N_AWAKE + which]):
        k = m.lists[which, a]
        # What counts as rounding remains so until the guard has left its surface.
        left = p.mode[k] * m.guards[at.H0, k] > 0.0
        size = max(abs(m.guards[at.H0, k]), abs(m.guards[at.H1, k]))
        m.guards[at.SIZE, k] = max(size, m.guards[at.PARTS if left else at.SIZE, k])


@kernel_apart
def flips_by_sign(p: problem.Problem, m: Memory, dt: float) -> int:
    """Mark the guards that flip in a step across a branch; return their number.

    The step is too short to be divided, so only the signs at its ends tell.
    """
    set_sizes(p, m, at.AWAKE)
    resolution = problem.time_resolution(m.clock[at.T], dt)
    look_at_end(p, m, m.clock[at.T] + dt, resolution)
    total = problem.mark_due(p, m, at.H1, at.RATE1, resolution)
    t = m.clock[at.T] + dt
    problem.remember_residuals(p, m, t, at.END, at.H1, at.RATE1, resolution)
    return total


@kernel
def end_at_first_flip(p: problem.Problem, m: Memory, dt: float) -> tuple[float, int]:
    """Shorten the step to the first flip in it, if any.

    The guards that flip at its end are marked in DUE. Returns the step's length (0 if
    they flip at its very start) and their number.
    """
    if m.counts[at.WATCHED] == AT_BRANCH:
        return dt, flips_by_sign(p, m, dt)
    # Usually no guard is near, so the search is not even prepared.
    if m.counts[at.WATCHED] == NONE_NEAR or gather(p, m, dt) == 0:
        return dt, 0
    kind, k, theta = first_cut(p, m, dt)
    if kind == DIP:
        dt, kind, k, theta = end_at_dips(p, m, dt, kind, k, theta)
    if kind != CROSSING:
        return dt, 0
    set_sizes(p, m, at.NEAR)
    resolution = problem.time_resolution(m.clock[at.T], dt)
    if theta * dt <= resolution:
        h, rate = m.guards[at.H0, k], m.guards[at.RATE0, k]
        if p.mode[k] * h <= problem.blur(h, rate, resolution):
            problem.mark_one(m, k)
            problem.remember_residuals(
                p, m, m.clock[at.T], at.Y, at.H0, at.RATE0, resolution
            )
            return 0.0, 1
        dt = min(resolution, dt)  # an event function that jumps: end just past the jump
        take_step(p, m, m.clock[at.T], dt)
        look_at_end(p, m, m.clock[at.T] + dt, resolution)
    else:
        dt, k = land(p, m, k, theta * dt, resolution)
    t = m.clock[at.T] + dt
    total = problem.mark_due(p, m, at.H1, at.RATE1, resolution)
    if total == 0 and flips_by_rounding(p, m, k, t, resolution):
        total = problem.mark_one(m, k)
    problem.remember_residuals(p, m, t, at.END, at.H1, at.RATE1, resolution)
    return dt, total
