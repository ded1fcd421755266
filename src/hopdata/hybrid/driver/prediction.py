"""How far to step, if a guard is about to flip: not far past it.

A step that spans an event is good only up to there, and the farther past it reaches, the more of
it is lost, and the more guards seem to flip in it. So the step is clipped to a little more than the
time in which the nearest guard will flip: by its value, its rate, and the bend of the last step.
"""

from __future__ import annotations

from math import sqrt

from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.layout import (
    BEND,
    BENT,
    GAP,
    H0,
    H1,
    N_AWAKE,
    N_BENT,
    NEAR,
    RATE0,
    RATE1,
    Memory,
    T,
)
from hopdata.hybrid.driver.near import after, gather_coming
from hopdata.hybrid.driver.problem import Problem, awake
from hopdata.hybrid.driver.sleep import wake_for
from hopdata.hybrid.driver.surface import time_resolution

SOON = 4.0  # times the last two events' distance: the next flip is first looked for within this
OVERSHOOT = 1.2  # past the predicted flip, so that the step finds it if the guess was a bit short
# Multiples of the resolution of time. The step that the field would allow is no measure here: in a
# landing on thousands of springs it is a million times longer than the time between two of them.
CLIP_MOST = 1e3  # leave events that are nearer to localisation
TOO_SHORT = 1e6  # the rates at both ends of such a step tell nothing of the bend


@kernel_apart
def carry_guards(p: Problem, m: Memory, dt: float) -> None:
    """Make the guards at the end of the step those at its start; keep their second derivatives.

    These are secants over the step. Of a guard that bends those of longer steps tell nothing.
    """
    g, tells, per_s = m.guards, dt > TOO_SHORT * time_resolution(m.clock[T], dt), 1.0 / dt
    for a in range(m.counts[N_AWAKE]):
        k = awake(p, m, a)
        g[BEND, k] = (g[RATE1, k] - g[RATE0, k]) * per_s if tells else g[BEND, k]
        g[H0, k], g[RATE0, k] = g[H1, k], g[RATE1, k]
    if not tells and m.counts[N_BENT] > 0:
        for k in range(m.flags.width):
            g[BEND, k] = g[BEND, k] if m.flags[BENT, k] == 0 else 0.0


@kernel
def flip_time(g: float, d: float, c: float) -> float:
    """Return when g + d t + c t^2 / 2 falls through zero; 0 if it does not."""
    room = d * d - 2.0 * g * c
    if room <= 0.0:
        return 0.0
    root = sqrt(room)
    if d < 0.0:
        return 2.0 * g / (root - d)
    return -(d + root) / c if c < 0.0 else 0.0


@kernel
def clipped(p: Problem, m: Memory, dt: float) -> float:
    """Return `dt`, or less if a guard is predicted to flip before.

    Of the guards asleep those that might flip by then wake, the nearest first.
    """
    dt = clipped_by_awake(p, m, dt)
    k = wake_for(p, m, dt)
    while k >= 0:
        dt = clipped_by(p, m, k, dt)
        k = wake_for(p, m, dt)
    return dt


@kernel
def clipped_by_awake(p: Problem, m: Memory, dt: float) -> float:
    """Return `dt`, or a little more than the time to the first flip that is predicted before."""
    soon = SOON * m.clock[GAP]
    if soon < dt:
        first = clipped_by_coming(p, m, soon)
        if first < soon:
            return first
    return clipped_by_coming(p, m, dt)


@kernel
def clipped_by_coming(p: Problem, m: Memory, dt: float) -> float:
    """Return `dt`, or a little more than the time to the first flip before it."""
    for a in range(gather_coming(p, m, dt)):
        dt = clipped_by(p, m, m.lists[NEAR, a], dt)
    return dt


@kernel
def clipped_by(p: Problem, m: Memory, k: int, dt: float) -> float:
    """Return `dt`, or a little more than the time to the flip of guard k if that is before."""
    g, lock = m.guards, p.mode[k]
    value, rate, bend = lock * g[H0, k], lock * g[RATE0, k], lock * g[BEND, k]
    if after(value, rate, bend, dt) > 0.0:
        return dt
    time = OVERSHOOT * flip_time(max(value, 0.0), rate, bend)
    least = CLIP_MOST * time_resolution(m.clock[T], 0.0)
    return time if least < time < dt else dt
