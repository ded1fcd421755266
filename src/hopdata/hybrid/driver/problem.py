"""The problem that is integrated, and the evaluation of its field and guards.

Throughout the driver, `p` is the problem, `m` the memory, `out` the output and `log`
the log of events; k is the number of a guard. The names from `layout` are rows of their
tables: ``m.guards[at.H1, k]`` is guard k at the end of the step, and a parameter such
as `y`, `h` or `rate` is the number of a row.
"""

from typing import NamedTuple

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.compiled.memory import (
    FloatTable,
    FloatVector,
    IntTable,
    IntVector,
    row,
)
from hopdata.hybrid.layout import Memory


class Problem(NamedTuple):
    """The caller's request; nothing in it changes except the mode."""

    field: int  # addresses of the callbacks; 0 if absent
    guards: int
    guard: int
    rate_bound: int
    on_event: int
    methods: IntTable
    params: FloatVector
    mode: IntVector  # locks first, then the scene's integers
    rules: IntTable
    rtol: float
    atol: FloatVector
    max_step: float
    t_end: float
    tangent: FloatTable  # the flow's Jacobian, and room for it
    first_order: int  # address of the code that carries it; 0 if not wanted
    here: int  # address of the argument block
    t_start: float
    first_step: float  # 0: to be chosen
    max_steps: int
    max_events: int
    start_state: FloatVector
    # Mode and parameters before and after a call of the handler, the parameters for
    # which guards are left out (see `sleep`), and those for which instants were sought
    # (see `known`).
    kept: FloatVector
    # Address of the guards' code for ranges; 0: no guards, -1: none could be made
    branches: int
    along: IntVector  # machine code and rooms for duals; see `numbers.along`
    # Known instants (see `known`): address of the field's code for ranges (0: none is
    # sought), whether there may be any (and, in `at.STOPS_IN_ALL_MODES`, whether they
    # are the same in all modes), and the number of states that vary.
    switches: int
    has_stops: int
    n_varying: int
    singles: FloatVector
    periods: FloatVector


@kernel
def awake(p: Problem, m: Memory, a: int) -> int:
    """Return guard number `a` in the list AWAKE.

    It is `a` itself if guards never sleep. A loop over all guards then compiles without
    the list, into vector instructions.
    """
    return a if p.rate_bound == 0 else m.lists[at.AWAKE, a]


@kernel
def next_end(p: Problem, m: Memory) -> float:
    """Return when the next step ends at the latest: a known instant, or the end."""
    return min(p.t_end, m.clock[at.STOP])


@kernel
def eval_field(p: Problem, m: Memory, t: float, y: int, dy: int) -> None:
    """Evaluate the field at row `y` of the states into row `dy`.

    Entries that the user's function does not fill remain NaN.
    """
    fill_row(m.states, dy, np.nan)
    m.counts[at.NFEV] += 1
    code.call_field(p.field, t, m.states, y, p.mode, p.params, m.states, dy)


@kernel_apart
def eval_guards(
    p: Problem, m: Memory, t: float, y: int, dy: int, h: int, rate: int
) -> None:
    """Evaluate the guards that are awake at rows `y`, `dy` into rows `h`, `rate`."""
    eval_listed(p, m, at.AWAKE, t, y, dy, h, rate)


@kernel_in_loop
def eval_listed(
    p: Problem, m: Memory, which: int, t: float, y: int, dy: int, h: int, rate: int
) -> None:
    """Evaluate the guards in a list one by one.

    If the system gives all guards at once, all are evaluated.
    """
    s = m.states
    g = m.guards
    if p.guards != 0:
        g[h, 0] = np.nan
        m.counts[at.NGEV] += 1
        code.call_guards(p.guards, t, s, y, s, dy, p.mode, p.params, g, h, g, rate)
        return
    count = m.counts[at.N_AWAKE + which]
    m.counts[at.NGEV] += count
    for a in range(count):
        eval_guard(p, m, t, y, dy, m.lists[which, a], h, rate)


@kernel
def eval_guard(
    p: Problem, m: Memory, t: float, y: int, dy: int, k: int, h: int, rate: int
) -> None:
    """Evaluate one of many guards.

    Entries that the user's function does not fill remain NaN.
    """
    s = m.states
    g = m.guards
    g[h, k] = np.nan
    g[rate, k] = np.nan
    code.call_guard(p.guard, t, s, y, s, dy, p.mode, p.params, k, g, h, g, rate)


@kernel
def guards_at_start(p: Problem, m: Memory, t: float) -> bool:
    """Evaluate the guards at the start of the step.

    Returns whether all are filled and finite.
    """
    if p.guards != 0:
        fill_row(m.guards, at.H0, np.nan)
        fill_row(m.guards, at.RATE0, np.nan)
    eval_guards(p, m, t, at.Y, at.K1, at.H0, at.RATE0)
    return guards_are_finite(p, m, at.H0, at.RATE0)


@kernel
def guards_at_end(p: Problem, m: Memory, t: float) -> bool:
    """Evaluate the guards at the end of the step; return whether all are finite."""
    eval_guards(p, m, t, at.END, at.KEND, at.H1, at.RATE1)
    return guards_are_finite(p, m, at.H1, at.RATE1)


@kernel_apart
def guards_are_finite(p: Problem, m: Memory, h: int, rate: int) -> bool:
    """Return whether the values in rows `h` and `rate` are finite.

    If not, the first guard that is not finite is reported. The usual loop, over finite
    guards, counts without a branch so that it vectorises.
    """
    g = m.guards
    wrong = 0
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        finite = (abs(g[h, k]) < np.inf) & (abs(g[rate, k]) < np.inf)
        wrong += 0 if finite else 1
    if wrong == 0:
        return True
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        if not (np.isfinite(g[h, k]) and np.isfinite(g[rate, k])):
            m.counts[at.CULPRIT] = k
            break
    return False


@kernel
def first_not_finite(table: FloatTable, row: int) -> int:
    """Return the index of the first value in a row that is NaN or infinite, or -1."""
    for i in range(table.width):
        if not np.isfinite(table[row, i]):
            return i
    return -1


@kernel
def copy_row(
    source: FloatTable, which: int, into: FloatTable, target: int, first: int = 0
) -> None:
    """Copy row `which` of a table to row `target` of another, from column `first`."""
    for i in range(source.width):
        into[target, first + i] = source[which, i]


@kernel
def fill_row(table: FloatTable, target: int, value: float) -> None:
    """Set a whole row of a table to one value."""
    row(table, target)[:] = value


# Conditions for a flip: signs, locks and rounding.
#
# The margin of a guard is g = b h, where b = -1 or +1 is its lock. It is positive on
# the side that the lock names, and falls through zero when the guard flips. A guard
# that has just flipped is on its new side by definition, whatever rounding does to h.

EPS = 2.0**-52

#: Rounding error of h, as a fraction of its largest value over the step.
#: Unit: 1. Origin: rounding: four units in the last place of a double.
ROUNDING = 4 * EPS

#: Rounding error of an event's time, as a fraction of the time.
#: Unit: 1. Origin: rounding: four units in the last place of a double.
TIME_ROUNDING = 4 * EPS

#: Share of a term of h that is taken to show in a rate along `way`, from which the size
#: of the terms is estimated.
#: Unit: 1. Origin: derived: the mean size of a component of `way`, whose values spread
#: evenly from -0.43 to 0.57.
SHARE = 0.25

# The golden section of 2^16, whose multiples spread evenly over the 16-bit numbers.
GOLDEN = 40503
MASK = 0xFFFF
PER_MASK = 2.0**-16

#: Instants closer to each other than this are a crowd: rounding may hide what a guard
#: does between them.
#: Unit: time resolutions. Origin: chosen.
CROWDED = 1000

#: Most roundings of the terms of h, and most time resolutions, that count as rounding
#: where h should be zero. The sine of a large angle, or a sum of many terms, leaves
#: some tens of them; a jump by the size of the terms has 1e15. If 1.5 times larger, a
#: jump by 1.3e-12 of the terms passes for rounding, instead of one by 0.9e-12.
#: Unit: roundings. Origin: chosen.
MOST_ROUNDINGS = 1000.0


@kernel
def margin_of(p: Problem, m: Memory, k: int, row: int) -> float:
    """Return the margin of guard k, or its rate, from a row of the guards."""
    return p.mode[k] * m.guards[row, k]


@kernel_in_loop
def way(i: int) -> float:
    """Return component i of a fixed direction that shows in nearly all guards.

    It is the fractional part of a multiple of the golden section, shifted so that both
    signs occur and none is zero.
    """
    return ((i + 1) * GOLDEN & MASK) * PER_MASK - 0.43


@kernel
def time_resolution(t: float, dt: float) -> float:
    """Return the interval, s, below which two instants coincide.

    It is the rounding of time, not a tolerance.
    """
    return TIME_ROUNDING * max(abs(t), abs(t + dt), dt)


@kernel
def blur(size: float, rate: float, resolution: float) -> float:
    """Return the change of a margin that rounding, of h and of time, may cause."""
    return ROUNDING * size + resolution * abs(rate)


@kernel
def is_due(g: float, rate: float, size: float, resolution: float) -> bool:
    """Return whether a guard flips now.

    Parameters
    ----------
    g, rate : float
        Distance to the surface, positive on the lock's side, and its rate.
    size : float
        Largest recent |h|: the scale of the rounding error in g.
    resolution : float
        Time below which two instants coincide, s.
    """
    noise = blur(size, rate, resolution)
    return g < -noise or (g <= noise and rate < 0.0)


@kernel
def flips_now(
    p: Problem, m: Memory, k: int, h: int, rate: int, resolution: float
) -> bool:
    """Return whether guard k flips now, by its value and its rate in two rows.

    Behind a pole the sign decides: h is large, but its rate is so much larger that it
    seems to be at its surface.
    """
    margin = margin_of(p, m, k, h)
    if m.flags[at.AT_POLE, k] != 0:
        return margin < 0.0
    return is_due(margin, margin_of(p, m, k, rate), m.guards[at.SIZE, k], resolution)


@kernel_apart
def mark_due(p: Problem, m: Memory, h: int, rate: int, resolution: float) -> int:
    """Put the guards in NEAR that flip now into DUE; return how many.

    Their values and rates are in rows `h` and `rate`.
    """
    total = 0
    for a in range(m.counts[at.N_NEAR]):
        k = m.lists[at.NEAR, a]
        if flips_now(p, m, k, h, rate, resolution):
            m.lists[at.DUE, total] = k
            total += 1
    m.counts[at.N_DUE] = total
    return total


@kernel
def mark_one(m: Memory, k: int) -> int:
    """Put guard k alone into DUE; return 1."""
    m.lists[at.DUE, 0] = k
    m.counts[at.N_DUE] = 1
    return 1


@kernel_in_loop
def size_of_terms(moving: float, still: float, t: float) -> float:
    """Return the size of the terms whose sum is h, from two of its rates.

    They are the rates for a moving and for a resting state. On a moving surface, or far
    from the origin, the terms cancel and leave their rounding: that of the state by its
    share in h, along one direction, and that of time by the surface's speed.
    """
    return abs(moving - still) / SHARE + abs(still * t)


@kernel_apart
def terms_at(p: Problem, m: Memory, k: int, t: float, y: int) -> float:
    """Return the size of the terms of guard k at time t and row `y` of the states.

    Overwrites SLOPE, H and RATE.
    """
    s = m.states
    still = 0.0
    moving = 0.0
    for turn in range(2):  # the state at rest, then in motion
        for i in range(s.width):
            s[at.SLOPE, i] = turn * way(i) * s[y, i]
        if p.guards != 0:
            eval_listed(p, m, at.AWAKE, t, y, at.SLOPE, at.H, at.RATE)
        else:
            m.counts[at.NGEV] += 1
            eval_guard(p, m, t, y, at.SLOPE, k, at.H, at.RATE)
        still = moving
        moving = m.guards[at.RATE, k]
    return size_of_terms(moving, still, t)


@kernel_apart
def most_rounding(
    p: Problem, m: Memory, k: int, t: float, y: int, rate: float, resolution: float
) -> float:
    """Return the largest value of guard k, where it should be zero, that is rounding.

    It is bounded by the terms of h at time t and row `y` of the states, whatever h
    itself is. A larger value is a jump of h: if it counted as rounding, the guard would
    not be seen again.
    """
    terms = max(terms_at(p, m, k, t, y), m.guards[at.PARTS, k])
    return MOST_ROUNDINGS * blur(terms, rate, resolution)


@kernel
def raise_scale(m: Memory, k: int, residual: float) -> None:
    """Raise the scale of guard k so that this residual of h counts as rounding.

    The caller bounds the residual.
    """
    m.guards[at.SIZE, k] = max(m.guards[at.SIZE, k], 2.0 * residual / ROUNDING)


@kernel
def scale_of_residual(residual: float, most: float) -> float:
    """Return the rounding scale at which a residual of h counts as rounding.

    It does so only up to `most`.
    """
    return min(2.0 * residual, most) / ROUNDING


@kernel_apart
def count_as_rounding(
    p: Problem,
    m: Memory,
    k: int,
    t: float,
    y: int,
    residual: float,
    rate: float,
    resolution: float,
) -> None:
    """Raise the scale of guard k so that a residual of h counts as rounding.

    A negative residual changes nothing. It is raised no further than the terms of h
    allow; see `most_rounding`.
    """
    if 2.0 * residual > ROUNDING * m.guards[at.SIZE, k]:
        most = most_rounding(p, m, k, t, y, rate, resolution)
        scale = scale_of_residual(residual, most)
        m.guards[at.SIZE, k] = max(m.guards[at.SIZE, k], scale)


@kernel
def evaluate_due_along(p: Problem, m: Memory, factor: float) -> None:
    """Write the rates of the guards in DUE for a motion of the state into RATE.

    The motion is `factor` times the state, component by component times `way`.
    """
    s = m.states
    for i in range(s.width):
        s[at.SLOPE, i] = factor * way(i) * s[at.Y, i]
    eval_listed(p, m, at.DUE, m.clock[at.T], at.Y, at.SLOPE, at.H, at.RATE)


@kernel_apart
def remember_parts(p: Problem, m: Memory) -> None:
    """Measure the size of the terms whose sum is h, for the guards that flip now."""
    g = m.guards
    evaluate_due_along(p, m, 0.0)
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        g[at.PARTS, k] = g[at.RATE, k]  # kept until the terms are known
    evaluate_due_along(p, m, 1.0)
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        still = g[at.PARTS, k]
        g[at.PARTS, k] = size_of_terms(g[at.RATE, k], still, m.clock[at.T])
        if m.flags[at.AT_POLE, k] != 0:
            g[at.PARTS, k] = 0.0  # large ones say nothing of what follows
        g[at.SIZE, k] = max(g[at.SIZE, k], g[at.PARTS, k])


@kernel
def remember_residuals(
    p: Problem, m: Memory, t: float, y: int, h: int, rate: int, resolution: float
) -> None:
    """Treat the residual of h as rounding where a guard flips from its old side.

    Time t and row `y` of the states belong to rows `h` and `rate` of the guards.
    """
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        if m.flags[at.AT_POLE, k] == 0:
            residual = margin_of(p, m, k, h)
            count_as_rounding(p, m, k, t, y, residual, m.guards[rate, k], resolution)


@kernel
def is_leaving(m: Memory, k: int, rate: float, ahead: float, resolution: float) -> bool:
    """Return whether guard k leaves the surface of its last flip.

    Its rate is given at the time `ahead` from now.

    This close to that instant, in the same crowd, rounding of state and h exceeds their
    motion.
    """
    since = m.counts[at.INSTANTS] - m.flags[at.LAST_FLIP, k]
    in_crowd = m.flags[at.LAST_FLIP, k] > 0 and since <= m.counts[at.CROWD]
    near = m.clock[at.T] + ahead - m.clock[at.INSTANT] <= CROWDED * resolution
    return in_crowd and near and rate > 0.0


@kernel
def has_flipped(m: Memory, k: int) -> bool:
    """Return whether guard k has flipped at this instant."""
    return (
        m.flags[at.LAST_FLIP, k] == m.counts[at.INSTANTS] and m.flags[at.FLIPS, k] > 0
    )


@kernel
def on_surface(m: Memory, k: int, resolution: float) -> bool:
    """Return whether guard k is on its surface to within rounding."""
    noise = blur(m.guards[at.SIZE, k], m.guards[at.RATE0, k], resolution)
    return abs(m.guards[at.H0, k]) <= noise


@kernel
def is_marked(m: Memory, k: int) -> bool:
    """Return whether guard k is in DUE."""
    found = 0
    for a in range(m.counts[at.N_DUE]):
        found += 1 if m.lists[at.DUE, a] == k else 0
    return found > 0


@kernel
def next_due(p: Problem, m: Memory, last: int) -> int:
    """Return the first guard by number after `last` that flips now, or -1.

    DUE is not sorted. Where time runs backward, so does the order: what was done last
    is undone first.
    """
    found = -1
    for a in range(m.counts[at.N_DUE]):
        k = m.lists[at.DUE, a]
        sense = p.rules[at.WAY, k]  # of time
        after_last = last < 0 or sense * k > sense * last
        if after_last and (found < 0 or sense * k < sense * found):
            found = k
    return found
