"""Ranges of the guards over several steps at once.

The guards' code for ranges tells of all paths in a box of time, states and slopes,
whatever they are. So one run of it over a box that reaches ahead of a step serves each
later step whose own ranges lie in the box, as long as mode and parameters are the same:
the ranges are wider than those of the step would be, but where they decide, they decide
the same. Such a step costs the enclosure of its states, and no run of the guards.

The box ends where guards are expected to come near or to turn, by their values, rates
and bends. Whatever may have changed mode or parameters must call `forget_box`.
"""

from math import inf, sqrt

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver.enclosure import enclose
from hopdata.hybrid.driver.paths import answer_next, run_on
from hopdata.hybrid.driver.problem import Problem, awake, copy_row
from hopdata.hybrid.driver.watch import facing
from hopdata.hybrid.layout import Memory
from hopdata.hybrid.numbers import answers

#: Steps like the last one for which a box reaches ahead, at most.
#: Unit: 1. Origin: chosen.
MOST_AHEAD = 8.0

#: Steps for which a box reaches ahead, at least: otherwise there is none.
#: Unit: 1. Origin: chosen.
LEAST_AHEAD = 2.0

#: Range of a guard or of its rate in a box, over what is expected of it.
#: Unit: 1. Origin: chosen.
LOOSE = 2.0

#: Part of a state's range in a step by which a box is wider.
#: Unit: 1. Origin: chosen.
SLACK = 1.0 / 16.0

#: Factor of the reach of boxes after one that did not tell of a guard.
#: Unit: 1. Origin: chosen.
SHRINK = 0.5

#: Factor of their reach after each other step, up to what is expected.
#: Unit: 1. Origin: chosen.
GROW = 1.25


@kernel
def forget_box(m: Memory) -> None:
    """Let nothing be known of the steps ahead: mode or parameters may have changed."""
    m.clock[at.BOX_TO] = -inf


@kernel
def reach_less(m: Memory) -> None:
    """Forget a box that has not told of a guard, and make smaller ones."""
    forget_box(m)
    m.clock[at.REACH] *= SHRINK


@kernel_in_loop
def is_in_box(m: Memory, dt: float) -> bool:
    """Return whether the step, whose ranges are known, lies in the box."""
    t = m.clock[at.T]
    if not (m.clock[at.BOX_FROM] <= t and t + dt <= m.clock[at.BOX_TO]):
        return False
    s = m.states
    outside = 0
    for i in range(s.width):
        is_inside = s[at.LEAST, i] >= s[at.BOX_LEAST, i]
        is_inside &= s[at.MOST, i] <= s[at.BOX_MOST, i]
        is_inside &= s[at.LEAST_SLOPE, i] >= s[at.BOX_LEAST_SLOPE, i]
        is_inside &= s[at.MOST_SLOPE, i] <= s[at.BOX_MOST_SLOPE, i]
        outside += 0 if is_inside else 1
    return outside == 0


@kernel_apart
def steps_ahead(p: Problem, m: Memory, dt: float) -> float:
    """Return for how many steps like this one a box is expected to tell of all guards.

    It does while a guard is far from its surface or does not turn.
    """
    g = m.guards
    fewest = MOST_AHEAD
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        lock = p.mode[k]
        start = facing(lock, g[at.H0, k])
        end = facing(lock, g[at.H1, k])
        before = g[at.RATE0, k]
        after = g[at.RATE1, k]
        bend = abs(after - before)
        until_turn = abs(after) / (LOOSE * bend)
        until_turn = until_turn if before * after > 0.0 else 0.0
        # In n steps it goes n |rate| dt + n^2 bend dt / 2.
        rest = (min(start, end) / LOOSE - abs(end - start)) / (2.0 * dt)
        root = sqrt(after * after + 2.0 * bend * max(rest, 0.0))
        until_near = 2.0 * rest / (abs(after) + root)
        fewest = min(fewest, max(until_turn, until_near))
    return fewest


@kernel_apart
def make_box(m: Memory, dt: float, ahead: float) -> None:
    """Make a box of this step, and of the way in some steps after it."""
    s = m.states
    span = ahead * dt
    for i in range(s.width):
        slack = SLACK * (s[at.MOST, i] - s[at.LEAST, i])
        drift = s[at.MOST_SLOPE, i] - s[at.LEAST_SLOPE, i]
        least = s[at.END, i] + span * (s[at.KEND, i] - 0.5 * ahead * drift)
        most = s[at.END, i] + span * (s[at.KEND, i] + 0.5 * ahead * drift)
        s[at.BOX_LEAST, i] = min(s[at.LEAST, i], least) - slack
        s[at.BOX_MOST, i] = max(s[at.MOST, i], most) + slack
        drift *= ahead + SLACK
        s[at.BOX_LEAST_SLOPE, i] = s[at.LEAST_SLOPE, i] - drift
        s[at.BOX_MOST_SLOPE, i] = s[at.MOST_SLOPE, i] + drift


@kernel_apart
def look_ahead(p: Problem, m: Memory, dt: float, ahead: float) -> bool:
    """Make a box and the guards' ranges in it; return whether they can be used.

    They cannot if the code has several paths in the box, or cannot be followed.
    """
    make_box(m, dt, ahead)
    start = m.clock[at.T]
    end = start + (1.0 + ahead) * dt
    answer_next(m, 0)
    run_on(p, m, at.BOX_LEAST, start, end, 1.0)
    c = m.counts
    c[at.LOOKS] += 1
    if c[at.ANSWERS + answers.OPENED] + c[at.ANSWERS + answers.LOST] != 0:
        forget_box(m)
        return False
    for row in range(4):
        copy_row(m.guards, at.RANGES + row, m.guards, at.BOX_RANGES + row)
    m.clock[at.BOX_FROM] = start
    m.clock[at.BOX_TO] = end
    return True


@kernel
def knows_box(p: Problem, m: Memory, dt: float) -> bool:
    """Return whether there are ranges of the guards in a box around the step.

    A box that does not hold the step is replaced by a new one, if that is expected to
    serve. The ranges are in the rows from BOX_RANGES on.
    """
    enclose(m, dt, 0.0, 1.0)
    if is_in_box(m, dt):
        return True
    m.clock[at.REACH] = min(GROW * m.clock[at.REACH], 1.0)
    ahead = m.clock[at.REACH] * steps_ahead(p, m, dt)
    if not ahead >= LEAST_AHEAD:
        return False
    return look_ahead(p, m, dt, ahead)
