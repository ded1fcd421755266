"""Whether a system is event-selected C1 at a state, by definition and by checklist.

Definition 1.2.1 of the dissertation: every guard is an event function, one that grows
along the field at a rate that stays above a constant. Definition 1.2.2: it does so in
each mode, and the field of each mode extends smoothly beyond the surfaces that bound
it. The first column of its table 1.1 (event-selected systems, ESS) asks for the same in
four lines that a reader can check by eye. Both are computed here, at one state and for
all combinations of the locks of the guards that meet there.

In hopdata the lock of a guard, not the sign of its function, decides which field is
evaluated. So the field of a mode can be evaluated on both sides of its surfaces, and
the extension that definition 1.2.2 asks for is this field. What is left to check is
that it is smooth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.finding import Finding
from hopdata.hybrid.first_order.linearise import Combination, Instant, Linearisation
from hopdata.hybrid.system import System

RATES = "guards report their rates"
EVENT_FUNCTIONS = "guards are event functions (definition 1.2.1)"
EXTENDED = "fields of all modes extend C1 (definition 1.2.2)"
CLAMPED = (
    "a max, min or abs of the state in the field does this, and is needless where the "
    "lock says that the foot is down"
)
CONTINUOUS = "trajectories are continuous"
SURFACES = "guards are smooth surfaces"
ONCE = "each contact is made or broken once"
KEPT = "contact keeps penetration velocity"
#: Normalised rate above which a guard is approached.
#: Unit: 1, of the sum of the sizes of the rate's terms. Origin: chosen.
LIVE = 1e-6
#: Largest change of a coordinate, or step against a lock, that is no change.
#: Unit: 1, of a coordinate's or guard's size. Origin: chosen.
UNCHANGED = 1e-12
#: How much finer the second step is by which kinks of a guard or a field are found.
#: Unit: 1. Origin: chosen.
REFINEMENT = 8.0
#: Share of the coarse step's difference of slopes below which the fine step's shows a
#: smooth function: it is 1/8 for one with a curvature, and 1 for a kink.
#: Unit: 1. Origin: chosen.
SMOOTH_SHARE = 0.5
Views = Mapping[Combination, Linearisation]


def definitions(
    system: System,
    start: Instant,
    active: Sequence[int],
    scale: FloatArray,
    *,
    radius: float,
    seed: int,
    tolerance: float,
) -> tuple[Finding, ...]:
    """Return findings on definitions 1.2.1 and 1.2.2, and on what they rest on.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    start : Instant
        State and mode before the crossings.
    active : sequence of int
        Guards that are crossed.
    scale : (n,) array
        Size of each coordinate.
    radius : float
        Radius of the neighbourhood in which the rate of the event functions is
        bounded, in sizes of the coordinates.
    seed : int
        Seed of the states and directions that are sampled, and of combinations of more
        than eight guards.
    tolerance : float
        Relative difference below which two numbers count as equal.
    """
    views = local.mode_fields(system, start, active, scale, seed)
    off = rates_agree(system, views[()], list(active))
    gaps = field_gaps(system, start, list(views), scale, seed)
    needed = max(SMOOTH_SHARE * gaps.coarse, tolerance)
    detail = (
        "difference of a field's slopes from both sides, in any mode; needed: half of "
        "that at 8 times the step"
    )
    if not gaps.fine <= needed:
        detail += f"; {_rough_modes(system, gaps, needed)}; {CLAMPED}"
    return (
        Finding.at_most(RATES, off, tolerance, "difference of hdot and Dh f + dh/dt"),
        _event_functions(system, start, views, active, scale, radius, seed),
        Finding.at_most(
            EXTENDED,
            gaps.fine,
            needed,
            detail,
        ),
    )


def event_selection(
    system: System,
    start: Instant,
    active: Sequence[int],
    scale: FloatArray,
    seed: int,
    tolerance: float,
) -> tuple[Finding, ...]:
    """Return findings on the four lines of table 1.1's first column.

    All 2^n combinations of locks are checked up to n = 8 active guards, and 256 beyond.
    Rates are normalised by the sums |Dh_i f_i| + |dh/dt|: 1 means that all terms act
    together, and a negative value that a guard runs back. They do not depend on the
    units of state, guard or time.
    """
    guards = list(active)
    views = local.mode_fields(system, start, active, scale, seed)
    size = np.maximum(scale, np.abs(start.y))
    jumps = [np.max(np.abs(view.instant.y - start.y) / size) for view in views.values()]
    coarse, fine = one_sided_gaps(system, views[()], guards, scale)
    return (
        Finding.at_most(
            CONTINUOUS,
            max(map(float, jumps)),
            UNCHANGED,
            "largest jump of a coordinate",
        ),
        Finding.at_most(
            SURFACES,
            fine,
            max(SMOOTH_SHARE * coarse, tolerance),
            "difference of slopes from both sides; needed: half of that at 8 times the "
            "step",
        ),
        _once(system, views, guards, scale),
        _keeps_velocity(system, views, guards, scale),
    )


def _ways(views: Views, guards: list[int]) -> IntArray:
    """Return the directions in which the guards are crossed, +1 or -1."""
    return -views[()].instant.mode[guards]


def _share(part: FloatArray, whole: FloatArray) -> FloatArray:
    """Return parts divided by wholes, with 0 / 0 = 0."""
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)


def _normalised_rates(views: Views, guards: list[int]) -> dict[Combination, FloatArray]:
    """Return the guards' rates in their directions over the sums of their terms."""
    ways = _ways(views, guards)
    return {
        crossed: _share(ways * view.guard_rates[guards], view.guard_scales[guards])
        for crossed, view in views.items()
    }


# Definition 1.2.1.


def _event_functions(
    system: System,
    start: Instant,
    views: Views,
    active: Sequence[int],
    scale: FloatArray,
    radius: float,
    seed: int,
) -> Finding:
    """Return the finding on whether the guards are event functions in every mode.

    The state decides: where a rate is positive, so it is in some neighbourhood, because
    field and gradients are continuous. The number of the definition, the constant below
    which no rate falls, belongs to one neighbourhood; it is reported for the one of the
    given radius.
    """
    guards = list(active)
    shares = _normalised_rates(views, guards)
    slowest = min(float(np.min(share)) for share in shares.values())
    constant, share, guard = _liveness(
        system, start, views, guards, scale, radius, seed
    )
    name = system.guard_names[guard]
    detail = (
        "smallest rate of a guard in any mode, over the sum of its terms; within "
        f"{radius:g} of the state it is {share:.3g}, and the constant is "
        f"{constant:.3g} ({name})"
    )
    return Finding.above(EVENT_FUNCTIONS, slowest, LIVE, detail)


def _liveness(
    system: System,
    start: Instant,
    views: Views,
    guards: list[int],
    scale: FloatArray,
    radius: float,
    seed: int,
) -> tuple[float, float, int]:
    """Return the smallest rate near a state, the smallest normalised one, and a guard.

    Rates are those that the guards report. The guard is the one of the smallest rate.
    """
    ways = _ways(views, guards)
    smallest = np.inf
    smallest_share = np.inf
    slow_guard = guards[0]
    for place in local.neighbours(start, scale, radius, seed):
        for crossed, view in views.items():
            at = local.in_mode(system, place, crossed)
            rates = local.guards_at(system, at, local.field_at(system, at))[1][guards]
            own = ways * rates
            slow = int(np.argmin(own))
            if own[slow] < smallest:
                smallest = float(own[slow])
                slow_guard = guards[slow]
            share = _share(own, view.guard_scales[guards])
            smallest_share = min(smallest_share, float(np.min(share)))
    return smallest, smallest_share, slow_guard


def liveness_constant(
    system: System,
    start: Instant,
    active: Sequence[int],
    scale: FloatArray,
    radius: float,
    seed: int = 0,
) -> float:
    """Return the smallest rate of a guard in any mode near a state.

    This is the constant f of definition 1.2.1 for the neighbourhood of the given
    radius (in sizes of the coordinates), in the unit of the guards over time. If it is
    not positive, a guard is no event function there.
    """
    views = local.mode_fields(system, start, active, scale, seed)
    return _liveness(system, start, views, list(active), scale, radius, seed)[0]


def rates_agree(system: System, here: Linearisation, guards: list[int]) -> float:
    """Return the difference of the reported rates from Dh f + dh/dt.

    It is relative to their size.
    """
    reported = local.guards_at(system, here.instant, here.rate)[1][guards]
    off = np.abs(reported - here.guard_rates[guards])
    return float(np.max(_share(off, here.guard_scales[guards])))


# Definition 1.2.2.

#: Number of directions besides the axes along which a field's slopes are compared; more
#: would find rarer kinks.
#: Unit: 1. Origin: chosen.
DIRECTIONS = 8


class FieldGaps(NamedTuple):
    """How far the fields of modes are from having one slope along a line.

    Parameters
    ----------
    modes : tuple of Combination
        The modes, each by the guards that have been crossed in it.
    of_mode : (M, n) array
        Gap of each coordinate's rate in each mode, for the fine step.
    coarse, fine : float
        Largest gaps for the two steps.
    """

    modes: tuple[Combination, ...]
    of_mode: FloatArray
    coarse: float
    fine: float


def field_gaps(
    system: System,
    start: Instant,
    combinations: Sequence[Combination],
    scale: FloatArray,
    seed: int,
) -> FieldGaps:
    """Return how far the modes' fields are from having one slope, for two steps.

    The second step is an eighth of the first. Along a line through the state, the
    difference of the slopes from both sides and the change of the slope with the step
    are summed. Both shrink with the step if the field is C1; a kink leaves the first
    and a jump lets the second grow. They are relative to the largest rate or slope of
    each coordinate in any mode.
    """
    n = len(scale)
    rng = np.random.default_rng(seed)
    lines = np.vstack([np.eye(n), rng.uniform(-1.0, 1.0, (DIRECTIONS, n))])
    shifts = local.STEP * np.maximum(scale, np.abs(start.y)) * lines
    size = np.zeros(n)
    coarse = np.zeros(n)
    fine = np.zeros((len(combinations), n))
    for own, crossed in zip(fine, combinations, strict=True):
        at = local.in_mode(system, start, crossed)
        size = np.maximum(size, np.abs(local.field_at(system, at)))
        for shift in shifts:
            wide, wide_slope = _line_gap(system, at, shift, 1.0)
            narrow, narrow_slope = _line_gap(system, at, shift, 1.0 / REFINEMENT)
            coarse = np.maximum(coarse, wide)
            np.maximum(own, narrow, out=own)
            size = np.maximum(size, np.maximum(wide_slope, narrow_slope))
    of_mode = _share(fine, np.broadcast_to(size, fine.shape))
    return FieldGaps(
        modes=tuple(combinations),
        of_mode=of_mode,
        coarse=float(np.max(_share(coarse, size))),
        fine=float(np.max(of_mode)),
    )


def _rough_modes(system: System, gaps: FieldGaps, needed: float) -> str:
    """Name mode and coordinate of the first gap that is too large, and of the worst."""

    def place(mode: int, coordinate: int) -> str:
        crossed = _crossed_names(system, gaps.modes[mode])
        return f"dy[{coordinate}] with {crossed} crossed"

    too_large = np.argwhere(~(gaps.of_mode <= needed))
    first = place(*map(int, too_large[0]))
    worst = place(*divmod(int(np.argmax(gaps.of_mode)), gaps.of_mode.shape[1]))
    if first == worst:
        return f"first and worst: {first}"
    return f"first: {first}, worst: {worst}"


def _crossed_names(system: System, crossed: Combination) -> str:
    """Return the names of the guards that have been crossed, or ``none``."""
    return " and ".join(system.guard_names[k] for k in crossed) or "none"


def _line_gap(
    system: System, at: Instant, shift: FloatArray, share: float
) -> tuple[FloatArray, FloatArray]:
    """Return the gap of a field's slopes along a shift, and the size of the slope.

    Slopes are per coordinate's size; `share` of the shift is the step.
    """
    step = local.STEP * share

    def rate(part: float) -> FloatArray:
        return local.field_at(system, at.moved(at.y + part * share * shift, at.t))

    centre = rate(0.0)
    ahead = rate(1.0)
    behind = rate(-1.0)
    bend = np.abs(ahead - 2 * centre + behind) / step
    slope = (ahead - behind) / (2 * step)
    slope_of_half = (rate(0.5) - rate(-0.5)) / step
    return bend + np.abs(slope - slope_of_half), np.abs(slope)


# Table 1.1, first column.


def one_sided_gaps(
    system: System, here: Linearisation, guards: list[int], scale: FloatArray
) -> tuple[float, float]:
    """Return the difference of the guards' one-sided gradients, for two steps.

    The second step is an eighth of the first. The difference is relative to the
    gradient. It shrinks with the step for a smooth guard, and remains for a kink.
    """
    size = np.abs(here.gradients[guards]) @ scale
    if not size.all():
        return np.inf, np.inf
    coarse = _gap(system, here, guards, scale, local.STEP)
    fine = _gap(system, here, guards, scale, local.STEP / REFINEMENT)
    return float(np.max(coarse / size)), float(np.max(fine / size))


def _gap(
    system: System,
    here: Linearisation,
    guards: list[int],
    scale: FloatArray,
    step: float,
) -> FloatArray:
    at = here.instant

    def surfaces(y: FloatArray) -> FloatArray:
        return local.guards_at(system, at.moved(y, at.t), here.rate)[0][guards]

    bends = [
        surfaces(at.y + shift) - 2 * surfaces(at.y) + surfaces(at.y - shift)
        for shift in np.diag(step * scale)
    ]
    return np.sum(np.abs(bends), axis=0) / step


def _once(
    system: System, views: Views, guards: list[int], scale: FloatArray
) -> Finding:
    """Return the finding on whether every contact is made or broken exactly once.

    A guard and a mode count if the guard is not approached though it is still to be
    crossed, if it runs back though it has been crossed, or if a handler pushes it
    against its lock or sets the lock itself.
    """
    pushed = _pushed_back(system, views, guards, scale)
    wrong = []
    for crossed, share in _normalised_rates(views, guards).items():
        is_over = np.isin(guards, crossed)
        is_wrong = np.where(is_over, share < -LIVE, share <= LIVE)
        is_wrong |= pushed[crossed] > UNCHANGED
        wrong += [(guards[k], crossed) for k in np.flatnonzero(is_wrong)]
    total = len(guards) * len(views)
    detail = f"pairs of guard and mode, of {total}, in which it stops or is turned back"
    if wrong:
        guard, crossed = wrong[0]
        beyond = _crossed_names(system, crossed)
        detail += f"; first: {system.guard_names[guard]} with {beyond} crossed"
    worst = max(float(np.max(steps)) for steps in pushed.values())
    if worst > UNCHANGED:
        detail += f"; largest step of a handler against a lock {worst:.3g}"
    return Finding.at_most(ONCE, float(len(wrong)), 0.0, detail)


def _pushed_back(
    system: System, views: Views, guards: list[int], scale: FloatArray
) -> dict[Combination, FloatArray]:
    """Return the steps of handlers against the locks, in units of the guards' scales.

    A step is infinite if a handler has set a lock itself.
    """
    ways = _ways(views, guards)
    surfaces = {}
    for crossed, view in views.items():
        h, _ = local.guards_at(system, view.instant, view.rate)
        surfaces[crossed] = h[guards]
    pushed = {}
    for crossed, view in views.items():
        is_over = np.isin(guards, crossed)
        locks = np.where(is_over, ways, -ways)
        size = np.maximum(np.abs(view.gradients[guards]) @ scale, np.finfo(float).tiny)
        against = np.where(is_over, -ways, ways)
        moved = against * (surfaces[crossed] - surfaces[()]) / size
        is_set = view.instant.mode[guards] != locks
        pushed[crossed] = np.where(is_set, np.inf, np.maximum(moved, 0.0))
    return pushed


def _crossed_last(
    system: System, views: Views, before: Combination, guard: int, scale: FloatArray
) -> Linearisation | None:
    """Return the view after a guard is crossed that follows others; None if unknown.

    That of the same guards in the order of their numbers has another history, and
    differs where handlers move the state.
    """
    known = views.get(tuple(sorted({*before, guard})))
    if known is None:
        return None
    after = local.cross(system, views[before].instant, guard)
    parts = ("y", "mode", "params")
    if all(
        np.array_equal(getattr(after, part), getattr(known.instant, part))
        for part in parts
    ):
        return known
    return local.linearise(system, after, scale)


def _keeps_velocity(
    system: System, views: Views, guards: list[int], scale: FloatArray
) -> Finding:
    """Return the finding on what a contact leaves of its guard's rate.

    The line is empty, and holds, if no guard has a rate before its crossing; then
    another line fails.
    """
    ratios = []
    for before, view in views.items():
        for guard in guards:
            rate = view.guard_rates[guard]
            if guard in before or rate == 0:
                continue
            after = _crossed_last(system, views, before, guard, scale)
            if after is not None:
                ratios.append(float(after.guard_rates[guard] / rate))
    detail = "smallest ratio of a guard's rate after its crossing to that before"
    if not ratios:
        return Finding(KEPT, True, np.nan, f"> {LIVE:g}", f"{detail}; there is none")
    return Finding.above(KEPT, min(ratios), LIVE, detail)
