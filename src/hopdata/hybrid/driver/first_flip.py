"""End a step at the first flip in it: judge, search, land, and mark the guards that flip there."""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver.knots import set_knots
from hopdata.hybrid.driver.landing import land, look_at_end
from hopdata.hybrid.driver.layout import (
    H0,
    H1,
    N_AWAKE,
    N_NEAR,
    NEAR,
    PIECES,
    RATE0,
    RATE1,
    SIZE,
    WATCHED,
    Memory,
    T,
)
from hopdata.hybrid.driver.localisation import first_cut
from hopdata.hybrid.driver.near import gather_near, gather_near_by_pieces
from hopdata.hybrid.driver.problem import Problem, guards_at_end
from hopdata.hybrid.driver.stepping import take_step
from hopdata.hybrid.driver.surface import (
    blur,
    mark_due,
    mark_one,
    remember_residuals,
    time_resolution,
)
from hopdata.hybrid.driver.suspicion import CROSSING, DIP
from hopdata.hybrid.driver.watch import BY_WINDOWS, NONE_NEAR, leave_out_bent


@kernel_in_loop
def gather(p: Problem, m: Memory, dt: float) -> int:
    """Put the guards that may flip within the step into NEAR; return how many they are."""
    set_knots(p, m, dt)
    count = gather_near_by_pieces(p, m, dt) if m.counts[PIECES] > 1 else gather_near(p, m, dt)
    return leave_out_bent(m) if count > 0 and m.counts[WATCHED] == BY_WINDOWS else count


@kernel_apart
def end_at_dips(
    p: Problem, m: Memory, dt: float, kind: int, k: int, theta: float
) -> tuple[float, int, int, float]:
    """End the step at a dip, if its first cut is one: the sign of h there decides. And so on.

    Returns the step's length, and kind, guard and place of the cut that remains.
    """
    for _ in range(2 * m.counts[N_AWAKE] + 4):
        if kind != DIP or theta * dt <= time_resolution(m.clock[T], dt):
            break
        dt *= theta
        take_step(p, m, m.clock[T], dt)
        guards_at_end(p, m, m.clock[T] + dt)
        gather(p, m, dt)
        kind, k, theta = first_cut(p, m, dt)
    return dt, kind, k, theta


@kernel
def end_at_first_flip(p: Problem, m: Memory, dt: float) -> tuple[float, int]:
    """Shorten the step to the first flip in it, if any.

    Marks in DUE the guards that flip at its end; returns its length (0 if they flip at its very
    start) and how many they are.
    """
    if (
        m.counts[WATCHED] == NONE_NEAR or gather(p, m, dt) == 0
    ):  # mostly: what the search needs is not even prepared
        return dt, 0
    kind, k, theta = first_cut(p, m, dt)
    if kind == DIP:
        dt, kind, k, theta = end_at_dips(p, m, dt, kind, k, theta)
    if kind != CROSSING:
        return dt, 0
    for a in range(m.counts[N_NEAR]):
        j = m.lists[NEAR, a]
        size = max(abs(m.guards[H0, j]), abs(m.guards[H1, j]))
        still_leaving = p.mode[j] * m.guards[H0, j] <= 0.0  # what it took for rounding stays so
        m.guards[SIZE, j] = max(size, m.guards[SIZE, j]) if still_leaving else size
    resolution = time_resolution(m.clock[T], dt)
    if theta * dt <= resolution:
        at_once = p.mode[k] * m.guards[H0, k] <= blur(
            m.guards[H0, k], m.guards[RATE0, k], resolution
        )
        if at_once:
            mark_one(m, k)
            remember_residuals(p, m, H0)
            return 0.0, 1
        dt = min(resolution, dt)  # an event function that jumps: just past it
        take_step(p, m, m.clock[T], dt)
        look_at_end(p, m, m.clock[T] + dt, resolution)
    else:
        dt, k = land(p, m, k, theta * dt, resolution)
    total = mark_due(p, m, H1, RATE1, resolution)
    if total == 0 and p.mode[k] * m.guards[RATE1, k] < 0.0:
        total = mark_one(m, k)
    remember_residuals(p, m, H1)
    return dt, total
