"""Make a step end on the guard that flips first in it.

The step is taken again to the instant that localisation found, and its end corrected by Newton on
h itself, so that time and state of the event have the order of the method, not of the interpolant.
"""

from __future__ import annotations

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.dense import interpolate
from hopdata.hybrid.driver.layout import (
    END,
    ERROR,
    H1,
    INTERPOLANT_ERROR,
    KEND,
    METHOD,
    N_NEAR,
    NEAR,
    RATE1,
    SCRATCH,
    SIZE,
    SLOPE,
    SPAN,
    Memory,
    T,
)
from hopdata.hybrid.driver.linear import has_short_tangent
from hopdata.hybrid.driver.near import gather_reached
from hopdata.hybrid.driver.problem import Problem, eval_field, guards_at_end
from hopdata.hybrid.driver.stepping import take_step
from hopdata.hybrid.driver.surface import blur

MAX_POLISH = 8
SPARED = 5e-2  # of the tolerance: error of the interpolant that is not worth another step
FARTHEST = 0.1  # part of the step by which the interpolant may be wrong: beyond, h is not smooth
HOVER = 1e-8  # part of the step by which rounding of h itself may move its end
RETAKE_ABOVE = 1e-4  # part of the step by which its end may be moved by a midpoint step


@kernel
def nearest_surface(p: Problem, m: Memory, k: int) -> tuple[float, int]:
    """Return how far the end of the step is from guard k, s, or from a rival that is past.

    And which guard that is: the first of those past, if there are any.
    """
    shift, nearest = 0.0, k
    if p.mode[k] * m.guards[RATE1, k] < 0.0:
        shift = -m.guards[H1, k] / m.guards[RATE1, k]
    for a in range(m.counts[N_NEAR]):
        j = m.lists[NEAR, a]
        value, rate = p.mode[j] * m.guards[H1, j], p.mode[j] * m.guards[RATE1, j]
        if rate < 0.0 and value < 0.0 and -value / rate < shift:
            shift, nearest = -value / rate, j
    return shift, nearest


@kernel
def move_end(p: Problem, m: Memory, t: float, shift: float) -> None:
    """Move the end of the step, at time t, by a short midpoint step."""
    s = m.states
    for i in range(s.width):
        s[SCRATCH, i] = s[END, i] + 0.5 * shift * s[KEND, i]
    eval_field(p, m, t + 0.5 * shift, SCRATCH, SLOPE)
    for i in range(s.width):
        s[END, i] += shift * s[SLOPE, i]
    eval_field(p, m, t + shift, END, KEND)


@kernel
def take_part(p: Problem, m: Memory, t: float, span: float, on_interpolant: bool) -> None:
    """Take the first part of the step: anew, or on its interpolant."""
    if on_interpolant:
        interpolate(p, m, span / m.clock[SPAN], END)
        eval_field(p, m, t + span, END, KEND)
    else:
        take_step(p, m, t, span)


@kernel
def look_at_end(p: Problem, m: Memory, t: float, resolution: float) -> None:
    """Evaluate the guards at the end of the step, at time t; those that it has reached are near."""
    guards_at_end(p, m, t)
    gather_reached(p, m, H1, RATE1, resolution)


@kernel_apart
def end_at(
    p: Problem, m: Memory, span: float, on_interpolant: bool, resolution: float, k: int
) -> float:
    """Take the first part of the step, look at the guards there; return the margin of guard k."""
    take_part(p, m, m.clock[T], span, on_interpolant)
    look_at_end(p, m, m.clock[T] + span, resolution)
    return p.mode[k] * m.guards[H1, k]


@kernel_apart
def end_behind_jump(
    p: Problem, m: Memory, k: int, span: float, on_interpolant: bool, resolution: float
) -> float:
    """Make the step end directly behind the jump of guard k, near `span`; return its length.

    Where there is none near, it ends at `span`.
    """
    past = end_at(p, m, span, on_interpolant, resolution, k) <= 0.0
    clear, behind, reach = span, span, resolution
    while clear == behind and reach < FARTHEST * span:
        there = span - reach if past else min(span + reach, p.t_end - m.clock[T])
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


@kernel
def beyond_rounding(m: Memory, k: int, resolution: float) -> bool:
    """Tell whether the step ends farther from guard k than rounding can put it."""
    g = m.guards
    return abs(g[H1, k]) > blur(g[SIZE, k], g[RATE1, k], resolution)


@kernel_apart
def land(p: Problem, m: Memory, k: int, span: float, resolution: float) -> tuple[float, int]:
    """Make the step end on guard k, about `span` from now.

    It is taken again to there, unless the interpolant, which is worst in the middle and as good as
    the step at both its ends, adds next to nothing to the step's error. Where Newton's method makes
    it worse the event function jumps.

    Returns its length and the guard on which it ends: a rival, if one turns out to be earlier.
    """
    t, whole = m.clock[T], m.clock[SPAN]
    last, theta = FARTHEST * span, span / whole
    error = p.methods[m.counts[METHOD], INTERPOLANT_ERROR] * m.clock[ERROR]
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
        if not (abs(shift) < last and abs(m.guards[H1, k]) < left):
            if abs(shift) > HOVER * span and beyond_rounding(m, k, resolution):
                span = end_behind_jump(p, m, k, place, on_interpolant, resolution)
            break
        last, left = abs(shift), abs(m.guards[H1, k])
        if on_interpolant or p.first_order or abs(shift) > RETAKE_ABOVE * span:
            take_part(p, m, t, span + shift, on_interpolant)
        else:
            move_end(p, m, t + span, shift)
        span += shift
        look_at_end(p, m, t + span, resolution)
    return span, k
