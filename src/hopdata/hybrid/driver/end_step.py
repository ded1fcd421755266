"""Make a step end on the guard that flips first in it.

The step is repeated up to the instant found by localisation. Its end is then corrected
by Newton's method on h itself, so time and state of the event have the order of the
method, not that of the interpolant.
"""

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver import problem, watch
from hopdata.hybrid.driver.dense import interpolate
from hopdata.hybrid.driver.localise import NONE
from hopdata.hybrid.driver.proof import first_flip
from hopdata.hybrid.driver.stepping import take_step
from hopdata.hybrid.driver.tangents import has_short_tangent
from hopdata.hybrid.layout import Memory

#: Most corrections of a step's end by Newton's method.
#: Unit: 1. Origin: chosen.
MAX_POLISH = 8

#: Error of the interpolant below which the step need not be repeated.
#: Unit: tolerances. Origin: chosen.
SPARED = 5e-2

#: Fraction of the step by which the interpolant may err: if it errs by more, h is not
#: smooth.
#: Unit: 1. Origin: chosen.
FARTHEST = 0.1

#: How often a step is taken again up to a flip that its rate does not lead to.
#: Unit: 1. Origin: chosen.
MOST_RETAKES = 8

#: Factor by which the search for a jump reaches farther in each turn.
#: Unit: 1. Origin: chosen.
WIDER = 4.0

#: Fraction of the step by which rounding of h may move its end.
#: Unit: 1. Origin: chosen.
HOVER = 1e-8

#: Largest move of the step's end by a midpoint step, as a fraction of the step: for
#: larger ones the step is taken again.
#: Unit: 1. Origin: chosen.
RETAKE_ABOVE = 1e-4


# The end of a step, at a given length.


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
    """Evaluate the guards at the step's end, at time t.

    Those that have reached their surface are put into NEAR.
    """
    problem.guards_at_end(p, m, t)
    watch.gather_reached(p, m, at.H1, at.RATE1, resolution)
    for a in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, a]
        residual = -problem.margin_of(p, m, k, at.H1)
        rate = problem.margin_of(p, m, k, at.RATE1)
        if problem.is_leaving(m, k, rate, t - m.clock[at.T], resolution):
            problem.count_as_rounding(p, m, k, t, at.END, residual, rate, resolution)


@kernel_apart
def end_at(
    p: problem.Problem,
    m: Memory,
    span: float,
    on_interpolant: bool,
    resolution: float,
    k: int,
) -> float:
    """Take the first part of the step; return the margin of guard k at its end."""
    take_part(p, m, m.clock[at.T], span, on_interpolant)
    look_at_end(p, m, m.clock[at.T] + span, resolution)
    return problem.margin_of(p, m, k, at.H1)


# Landing: the length of the step at which it ends on a surface.


@kernel
def nearest_surface(p: problem.Problem, m: Memory, k: int) -> tuple[float, int]:
    """Return the time, s, from the step's end to the first surface, and its guard.

    It is the surface of guard k or of a rival. A rival is a guard past its surface; the
    one that was passed first counts.
    """
    shift = 0.0
    nearest = k
    if problem.margin_of(p, m, k, at.RATE1) < 0.0:
        shift = -m.guards[at.H1, k] / m.guards[at.RATE1, k]
    for a in range(m.counts[at.N_NEAR]):
        j = m.lists[at.NEAR, a]
        value = problem.margin_of(p, m, j, at.H1)
        rate = problem.margin_of(p, m, j, at.RATE1)
        if rate < 0.0 and value < 0.0 and -value / rate < shift:
            shift = -value / rate
            nearest = j
    return shift, nearest


@kernel_apart
def end_behind_jump(
    p: problem.Problem,
    m: Memory,
    k: int,
    span: float,
    on_interpolant: bool,
    resolution: float,
) -> float:
    """Make the step end just past the jump of guard k near `span`; return its length.

    If there is no jump nearby, the step ends at `span`.
    """
    past = end_at(p, m, span, on_interpolant, resolution, k) <= 0.0
    clear = span
    behind = span
    reach = resolution
    while clear == behind and reach < FARTHEST * span:
        if past:
            there = span - reach
        else:
            there = min(span + reach, problem.next_end(p, m) - m.clock[at.T])
        if (end_at(p, m, there, on_interpolant, resolution, k) <= 0.0) != past:
            if past:
                clear = there
            else:
                behind = there
        reach *= WIDER
    while behind - clear > resolution:
        middle = 0.5 * (clear + behind)
        if end_at(p, m, middle, on_interpolant, resolution, k) <= 0.0:
            behind = middle
        else:
            clear = middle
    end_at(p, m, behind, on_interpolant, resolution, k)
    if not problem.guards_are_finite(p, m, at.H1, at.RATE1):  # on a pole, not behind
        behind = min(behind + resolution, problem.next_end(p, m) - m.clock[at.T])
        end_at(p, m, behind, on_interpolant, resolution, k)
    return behind


@kernel
def interpolant_suffices(p: problem.Problem, m: Memory, span: float) -> bool:
    """Return whether the interpolant adds almost nothing to the step's error at `span`.

    It is worst in the middle of a step and as good as the step at both ends.
    """
    theta = span / m.clock[at.SPAN]
    error = p.methods[m.counts[at.METHOD], at.INTERPOLANT_ERROR] * m.clock[at.ERROR]
    if not error * (4.0 * theta * (1.0 - theta)) ** 2 <= SPARED:
        return False
    return not p.first_order or has_short_tangent(p, m, span)


@kernel_apart
def land(
    p: problem.Problem, m: Memory, k: int, span: float, resolution: float
) -> tuple[float, int]:
    """Make the step end on guard k, about `span` from its start, by Newton's method.

    The step is repeated up to there unless the interpolant is accurate enough. Where
    Newton's method increases the distance, the event function jumps.

    Returns the step's length and the guard on which it ends: a rival if one flips
    earlier.
    """
    t = m.clock[at.T]
    largest_shift = FARTHEST * span
    on_interpolant = interpolant_suffices(p, m, span)
    end_at(p, m, span, on_interpolant, resolution, k)
    located = span  # where the search for this guard began
    aim = k
    least_value = np.inf
    for _ in range(MAX_POLISH):
        shift, k = nearest_surface(p, m, k)
        if k != aim:
            located = span
            aim = k
            least_value = np.inf
        if not abs(shift) > resolution:
            break
        value = abs(m.guards[at.H1, k])
        if not (abs(shift) < largest_shift and value < least_value):
            rate = m.guards[at.RATE1, k]
            noise = problem.blur(m.guards[at.SIZE, k], rate, resolution)
            if abs(shift) > HOVER * span and value > noise:
                span = end_behind_jump(p, m, k, located, on_interpolant, resolution)
            break
        largest_shift = abs(shift)
        least_value = value
        if on_interpolant or p.first_order or abs(shift) > RETAKE_ABOVE * span:
            take_part(p, m, t, span + shift, on_interpolant)
        else:
            move_end(p, m, t + span, shift)
        span += shift
        look_at_end(p, m, t + span, resolution)
    return span, k


@kernel_apart
def land_behind_jump(
    p: problem.Problem, m: Memory, k: int, span: float, resolution: float
) -> float:
    """Make the step end just past the jump of guard k, about `span` from its start.

    Returns the step's length.
    """
    on_interpolant = interpolant_suffices(p, m, span)
    return end_behind_jump(p, m, k, span, on_interpolant, resolution)


# End a step at its first flip: search, land, and mark the guards that flip there.


@kernel
def flips_by_rounding(
    p: problem.Problem, m: Memory, k: int, t: float, resolution: float
) -> bool:
    """Return whether guard k, on which the step ends, flips although h is not 0.

    The step ends at time t. Its residual must be explained by rounding. If it is not, h
    jumps there, and the step has ended before the jump: the next step begins before it,
    and finds it.
    """
    margin = problem.margin_of(p, m, k, at.H1)
    rate = problem.margin_of(p, m, k, at.RATE1)
    if not rate < 0.0:
        return False
    return margin <= problem.most_rounding(p, m, k, t, at.END, rate, resolution)


@kernel
def flips_at_start(p: problem.Problem, m: Memory, k: int, resolution: float) -> bool:
    """Mark guard k and return True if it is at its surface at the start of the step.

    Where it is not, its event function jumps there.
    """
    h = m.guards[at.H0, k]
    noise = problem.blur(h, m.guards[at.RATE0, k], resolution)
    if not p.mode[k] * h <= noise:
        return False
    problem.mark_one(m, k)
    problem.remember_residuals(p, m, m.clock[at.T], at.Y, at.H0, at.RATE0, resolution)
    return True


@kernel_apart
def is_off_surface(
    p: problem.Problem, m: Memory, k: int, dt: float, resolution: float
) -> bool:
    """Return whether guard k is not on its surface at the end of the step, taken again.

    The new step has an interpolant of its own, so it must be searched, too. Behind the
    surface, the guard has flipped earlier than expected, where the errors of the steps
    alone move it. Before it, the step may have passed both the flip and a return soon
    after it, as at a pole.
    """
    if m.clock[at.SPAN] > dt:
        return False  # the step ends on the interpolant of the longer one
    rate = m.guards[at.RATE1, k]
    noise = problem.blur(m.guards[at.SIZE, k], rate, resolution)
    distance = abs(problem.margin_of(p, m, k, at.H1))
    return distance > problem.MOST_ROUNDINGS * noise


@kernel
def passes_pole(p: problem.Problem, m: Memory, k: int, resolution: float) -> bool:
    """Return whether guard k passes a pole where the step ends.

    Behind a pole, h has the other sign, is no rounding, and comes back from infinity.
    Near a pole, h is about c / (t - t_pole), so h over its rate is the time since the
    pole: it is one if this is within some time resolutions. Taken along its tangent, h
    would be on its surface there.
    """
    past = -problem.margin_of(p, m, k, at.H1)
    rate = problem.margin_of(p, m, k, at.RATE1)
    # A step may begin behind another pole, where h is as large: it is a scale only.
    scale = max(abs(m.guards[at.H0, k]), m.guards[at.PARTS, k])
    rounding = problem.MOST_ROUNDINGS * problem.blur(scale, 0.0, 0.0)
    if not (rate > 0.0 and past > rounding):
        return False
    return past <= problem.MOST_ROUNDINGS * resolution * rate


@kernel_apart
def forget_poles(m: Memory) -> None:
    """Forget which guards have passed a pole where the last step ended."""
    for k in range(m.flags.width):
        m.flags[at.AT_POLE, k] = 0
    m.counts[at.N_POLES] = 0


@kernel
def note_poles(p: problem.Problem, m: Memory, resolution: float) -> None:
    """Note which guards in NEAR pass a pole where the step ends.

    Their values there are no measure of the rounding of later ones.
    """
    for a in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, a]
        if passes_pole(p, m, k, resolution):
            m.flags[at.AT_POLE, k] = 1
            m.guards[at.SIZE, k] = 0.0
            m.counts[at.N_POLES] += 1


@kernel
def end_at_first_flip(p: problem.Problem, m: Memory, dt: float) -> tuple[float, int]:
    """Shorten the step to the first flip in it, if any.

    The guards that flip at its end are marked in DUE. Returns the step's length (0 if
    they flip at its very start) and their number.
    """
    resolution = problem.time_resolution(m.clock[at.T], dt)
    if m.counts[at.N_POLES] > 0:
        forget_poles(m)
    for _ in range(MOST_RETAKES):
        k, theta, jumps = first_flip(p, m, dt)
        if k == NONE:
            return dt, 0
        if theta * dt <= resolution:
            if flips_at_start(p, m, k, resolution):
                return 0.0, 1
            dt = min(resolution, dt)  # just past the jump
            take_step(p, m, m.clock[at.T], dt)
            look_at_end(p, m, m.clock[at.T] + dt, resolution)
            break
        if jumps:
            dt = land_behind_jump(p, m, k, theta * dt, resolution)
            break
        dt, k = land(p, m, k, theta * dt, resolution)
        if not is_off_surface(p, m, k, dt, resolution):
            break
    t = m.clock[at.T] + dt
    note_poles(p, m, resolution)
    total = problem.mark_due(p, m, at.H1, at.RATE1, resolution)
    if total == 0 and flips_by_rounding(p, m, k, t, resolution):
        total = problem.mark_one(m, k)
    problem.remember_residuals(p, m, t, at.END, at.H1, at.RATE1, resolution)
    return dt, total
