"""How far to step, if a guard is about to flip: not far past it.

A step that spans an event is good only up to there, and the farther past it reaches, the more of
it is lost, and the more guards seem to flip in it. So the step is clipped to a little more than the
time in which the nearest guard will flip: by its value, its rate, and the bend of the last step.
"""

from __future__ import annotations

from math import sqrt

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.layout import AWAKE, BEND, H0, N_AWAKE, RATE0, RATE1, Memory, T
from hopdata.hybrid.driver.problem import Problem
from hopdata.hybrid.driver.surface import time_resolution

OVERSHOOT = 1.2  # past the predicted flip, so that the step finds it if the guess was a bit short
# Multiples of the resolution of time. The step that the field would allow is no measure here: in a
# landing on thousands of springs it is a million times longer than the time between two of them.
CLIP_MOST = 1e3  # leave events that are nearer to localisation
TOO_SHORT = 1e6  # the rates at both ends of such a step tell nothing of the bend


@kernel
def remember_bend(m: Memory, dt: float) -> None:
    """Keep the second derivative of each event function, as a secant over the step just taken."""
    if dt > TOO_SHORT * time_resolution(m.clock[T], dt):
        g = m.guards
        for a in range(m.counts[N_AWAKE]):
            k = m.lists[AWAKE, a]
            g[BEND, k] = (g[RATE1, k] - g[RATE0, k]) / dt


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
    """Return `dt`, or less if a guard is predicted to flip before."""
    g, least = m.guards, CLIP_MOST * time_resolution(m.clock[T], 0.0)
    for a in range(m.counts[N_AWAKE]):
        k = m.lists[AWAKE, a]
        lock = p.mode[k]
        value, rate, bend = lock * g[H0, k], lock * g[RATE0, k], lock * g[BEND, k]
        if value + dt * (min(rate, 0.0) + 0.5 * dt * min(bend, 0.0)) > 0.0:
            continue
        time = OVERSHOOT * flip_time(max(value, 0.0), rate, bend)
        if least < time < dt:
            dt = time
    return dt
