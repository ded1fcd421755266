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

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
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

# Rows of the tangent's table that are free while a guard is passed: the fields before
# both flips, after one of them, and after both; the derivatives of both guards.
NONE, FIRST, SECOND, BOTH = at.PHI_SLOPE, at.PHI_SHIFTED, at.COLUMN, at.F_AFTER
FIRST_GUARD, SECOND_GUARD = at.ALONG, at.GRADIENT


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
def rate_by(p: Problem, m: Memory, gradient: int, rate: float, field: int) -> float:
    """Return a guard's rate along the field in row `field`; it is `rate` along f-."""
    phi = p.tangent
    before = single(m, at.F_BEFORE)
    for i in range(m.states.width):
        rate += phi[gradient, i] * (phi[field, i] - phi[before, i])
    return rate


@kernel
def field_here(p: Problem, m: Memory, row: int) -> None:
    """Write the field of the present locks into a single row."""
    m.counts[at.NFEV] += 1
    into = single(m, row)
    code.call_field(
        p.field, m.clock[at.T], m.states, at.Y, p.mode, p.params, p.tangent, into
    )


@kernel
def same_either_way(
    p: Problem, m: Memory, rate: float, other: float, later: float, other_later: float
) -> bool:
    """Return whether two guards' flips change the flow alike in either order.

    `rate` and `other` are the guards' rates before both flips, `later` and
    `other_later` those after the flip of the other one.
    """
    phi = p.tangent
    n = m.states.width
    moved = 0.0
    apart = 0.0
    rounding = 0.0
    for i in range(n):
        none = phi[single(m, NONE), i]
        both = phi[single(m, BOTH), i]
        one = phi[single(m, FIRST), i]
        a, b = jumps_in_order(none, one, both, rate, other, other_later)
        one = phi[single(m, SECOND), i]
        b_first, a_second = jumps_in_order(none, one, both, other, rate, later)
        size = size_of(p, m, i, m.states[at.Y, i])
        for j in range(n):
            scale = size_of(p, m, j, m.states[at.Y, j]) / size
            by_a = phi[single(m, FIRST_GUARD), j] * scale
            by_b = phi[single(m, SECOND_GUARD), j] * scale
            moved = max(moved, abs(a * by_a + b * by_b))
            apart = max(apart, abs((a - a_second) * by_a + (b - b_first) * by_b))
            whole = max(abs(none), abs(both))
            rounding = max(rounding, whole * (abs(by_a / rate) + abs(by_b / other)))
    return apart <= SAME_ORDER * moved + NO_JUMP * rounding


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
    rate_a = gradient_of(p, m, a)
    copy_row(phi, single(m, at.GRADIENT), phi, single(m, FIRST_GUARD))
    rate_b = gradient_of(p, m, b)
    flip_set(p, m, flipped)
    field_here(p, m, NONE)
    flip_lock(p, a)
    field_here(p, m, FIRST)
    flip_lock(p, b)
    field_here(p, m, BOTH)
    flip_lock(p, a)
    field_here(p, m, SECOND)
    flip_lock(p, b)
    flip_set(p, m, flipped)
    gradient_a = single(m, FIRST_GUARD)
    gradient_b = single(m, SECOND_GUARD)
    before_a = rate_by(p, m, gradient_a, rate_a, single(m, NONE))
    before_b = rate_by(p, m, gradient_b, rate_b, single(m, NONE))
    later_a = rate_by(p, m, gradient_a, rate_a, single(m, SECOND))
    later_b = rate_by(p, m, gradient_b, rate_b, single(m, FIRST))
    crosses = before_a * later_a > 0.0 and before_b * later_b > 0.0
    return crosses and same_either_way(p, m, before_a, before_b, later_a, later_b)


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
