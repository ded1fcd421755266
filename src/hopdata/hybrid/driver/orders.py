"""Whether it matters in which order guards flip that meet their surfaces together.

Guards a and b are due at one instant, their handlers leave the state alone, and each
flip changes the field. With the fields f0 before both flips, fa and fb after one of
them, and fab after both, the flow's derivative across the instant is the identity plus

    [(fa - f0) / ra + (fab - fa) (rb' - rb) / (ra rb')] Dha + [(fab - fa) / rb'] Dhb

if a flips first, where ra and rb are the guards' rates along f0, and rb' is that of b
along fa. If b flips first, a and b change their places. The flow has a derivative there
if both are the same, for every pair of the guards and whichever of the others have
flipped (Aizerman and Gantmakher 1958; Burden et al. 2016). Then all orders agree, as
any order becomes any other by exchanges of neighbours.
"""

from typing import NamedTuple

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import FloatTable
from hopdata.hybrid.driver.problem import (
    Problem,
    copy_row,
    has_flipped,
    on_surface,
)
from hopdata.hybrid.driver.slopes import gradient_of, size_of
from hopdata.hybrid.driver.tangents import single
from hopdata.hybrid.layout import Memory

#: Difference of two orders that counts as none.
#: Unit: 1, of what the flips change. Origin: chosen: far above rounding, far below a
#: dependence that matters.
SAME_ORDER = 1e-6

#: Jump of the field that counts as none.
#: Unit: 1, of the field. Origin: chosen: what the field may change by within the
#: rounding of an instant, of motions as fast as 1e5 per unit of the time.
NO_JUMP = 1e-10

#: Guards at one instant up to which every set of those that have flipped is looked at.
#: Of more, each pair is looked at alone.
#: Unit: 1. Origin: chosen: six have 16 sets with each of their 15 pairs.
MOST_AT_ONCE = 6


class Rows(NamedTuple):
    """Rows of a table in which two guards' flips are compared.

    The fields without a flip, after that of the first guard, of the second, and of
    both; the guards' derivatives by the states; and the sizes of the states.
    """

    none: int
    first: int
    second: int
    both: int
    first_guard: int
    second_guard: int
    sizes: int


@kernel
def rate_by(table: FloatTable, gradient: int, field: int, n: int, rate: float) -> float:
    """Return a guard's rate along a field; `rate` is its derivative by the time."""
    for i in range(n):
        rate += table[gradient, i] * table[field, i]
    return rate


@kernel
def jumps_in_order(
    none: float, one: float, both: float, rate: float, other: float, later: float
) -> tuple[float, float]:
    """Return what one component changes by, per movement of two guards' values.

    The guard with the rate `rate` flips first. The other's rate is `other` before that
    flip and `later` after it. The component's rates are those without a flip, after the
    first, and after both.
    """
    by_second = (both - one) / later
    by_first = (one - none) / rate + by_second * (later - other) / rate
    return by_first, by_second


@kernel
def same_either_way(
    table: FloatTable, rows: Rows, n: int, by_time: float, other_by_time: float
) -> bool:
    """Return whether two guards' flips change the flow of n states alike either way.

    `by_time` and `other_by_time` are the guards' derivatives by the time. Where a flip
    turns the other guard back, they do not.
    """
    rate = rate_by(table, rows.first_guard, rows.none, n, by_time)
    other = rate_by(table, rows.second_guard, rows.none, n, other_by_time)
    later = rate_by(table, rows.first_guard, rows.second, n, by_time)
    other_later = rate_by(table, rows.second_guard, rows.first, n, other_by_time)
    if not (rate * later > 0.0 and other * other_later > 0.0):
        return False
    moved = 0.0
    apart = 0.0
    rounding = 0.0
    for i in range(n):
        none = table[rows.none, i]
        both = table[rows.both, i]
        one = table[rows.first, i]
        a, b = jumps_in_order(none, one, both, rate, other, other_later)
        one = table[rows.second, i]
        b_first, a_second = jumps_in_order(none, one, both, other, rate, later)
        for j in range(n):
            scale = table[rows.sizes, j] / table[rows.sizes, i]
            by_a = table[rows.first_guard, j] * scale
            by_b = table[rows.second_guard, j] * scale
            moved = max(moved, abs(a * by_a + b * by_b))
            apart = max(apart, abs((a - a_second) * by_a + (b - b_first) * by_b))
            whole = max(abs(none), abs(both))
            rounding = max(rounding, whole * (abs(by_a / rate) + abs(by_b / other)))
    return apart <= SAME_ORDER * moved + NO_JUMP * rounding


# What follows compares the guards in DUE, in rows of the tangent's table that are free
# while a guard is passed.


@kernel
def rows_of(m: Memory) -> Rows:
    """Return the rows in which guards are compared."""
    return Rows(
        none=single(m, at.PHI_SLOPE),
        first=single(m, at.PHI_SHIFTED),
        second=single(m, at.COLUMN),
        both=single(m, at.F_AFTER),
        first_guard=single(m, at.ALONG),
        second_guard=single(m, at.GRADIENT),
        sizes=single(m, at.PHI_VALUES),
    )


@kernel
def field_here(p: Problem, m: Memory, row: int) -> None:
    """Write the field of the present locks into a row."""
    m.counts[at.NFEV] += 1
    t = m.clock[at.T]
    code.call_field(p.field, t, m.states, at.Y, p.mode, p.params, p.tangent, row)


@kernel
def by_time_of(p: Problem, m: Memory, k: int) -> float:
    """Write guard k's derivative by the states into GRADIENT; return that by time."""
    phi = p.tangent
    before = single(m, at.F_BEFORE)
    gradient = single(m, at.GRADIENT)
    by_time = gradient_of(p, m, k)
    for i in range(m.states.width):
        by_time -= phi[gradient, i] * phi[before, i]
    return by_time


@kernel
def flip_lock(p: Problem, k: int) -> None:
    """Flip the lock of guard k, for a trial."""
    p.mode[k] = -p.mode[k]


@kernel_apart
def commute(p: Problem, m: Memory, a: int, b: int, flipped: int) -> bool:
    """Return whether guards a and b may flip in either order.

    Both stand in DUE. Those guards there whose bits are set in `flipped` have flipped.
    """
    phi = p.tangent
    n = m.states.width
    rows = rows_of(m)
    by_time_a = by_time_of(p, m, a)
    copy_row(phi, rows.second_guard, phi, rows.first_guard)
    by_time_b = by_time_of(p, m, b)
    flip_set(p, m, flipped)
    field_here(p, m, rows.none)
    flip_lock(p, a)
    field_here(p, m, rows.first)
    flip_lock(p, b)
    field_here(p, m, rows.both)
    flip_lock(p, a)
    field_here(p, m, rows.second)
    flip_lock(p, b)
    flip_set(p, m, flipped)
    for i in range(n):
        phi[rows.sizes, i] = size_of(p, m, i, m.states[at.Y, i])
    return bool(same_either_way(phi, rows, n, by_time_a, by_time_b))


@kernel
def flip_set(p: Problem, m: Memory, chosen: int) -> None:
    """Flip the locks of the guards in DUE whose bits are set, for a trial."""
    for place in range(m.counts[at.N_DUE]):
        if chosen >> place & 1:
            flip_lock(p, m.lists[at.DUE, place])


@kernel
def meets(m: Memory, place: int, resolution: float) -> bool:
    """Return whether the guard at this place of DUE is yet to cross here."""
    k = m.lists[at.DUE, place]
    return not has_flipped(m, k) and on_surface(m, k, resolution)


@kernel
def all_meet(m: Memory, chosen: int, resolution: float) -> bool:
    """Return whether all guards in DUE whose bits are set are yet to cross here."""
    for place in range(m.counts[at.N_DUE]):
        if chosen >> place & 1 and not meets(m, place, resolution):
            return False
    return True


@kernel
def holds(chosen: int, one: int, other: int) -> bool:
    """Return whether one of two bits is set."""
    return (chosen >> one & 1) + (chosen >> other & 1) > 0


@kernel_apart
def pairs_commute(p: Problem, m: Memory, flipped: int, resolution: float) -> bool:
    """Return whether all pairs of guards commute once those of the set flipped."""
    for one in range(m.counts[at.N_DUE]):
        for other in range(one):
            if holds(flipped, one, other):
                continue
            if not (meets(m, one, resolution) and meets(m, other, resolution)):
                continue
            a = m.lists[at.DUE, other]
            b = m.lists[at.DUE, one]
            if not commute(p, m, a, b, flipped):
                return False
    return True


@kernel_apart
def order_matters(p: Problem, m: Memory, resolution: float) -> bool:
    """Return whether the flow has no derivative where the guards in DUE meet.

    The field before the first flip is in F_BEFORE.
    """
    sets = 1
    if m.counts[at.N_DUE] <= MOST_AT_ONCE:
        sets = 1 << m.counts[at.N_DUE]
    for flipped in range(sets):
        if not all_meet(m, flipped, resolution):
            continue
        if not pairs_commute(p, m, flipped, resolution):
            return True
    return False
