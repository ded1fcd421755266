"""Test whether the flow through a state is C1, by the two columns of table 1.1.

The table's first column is event-selection (definitions 1.2.1 and 1.2.2 of the
dissertation): every active guard is approached, whichever of the others have been
crossed, and the state does not jump. Every nearby trajectory then crosses each guard
exactly once, because rates that are positive here are positive in a neighbourhood.
Whether the crossings commute is computed: the flow has a Jacobian at the state if all
orders that occur around it have the same matrix. The second column (see
`second_order`), additive forces and guards that depend on position alone, is sufficient
for that but not necessary: it explains why a flow is C1, and does not decide it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.finding import Finding
from hopdata.hybrid.first_order.linearise import Combination, Instant, Linearisation
from hopdata.hybrid.first_order.saltation import (
    BouligandDerivative,
    NotTransversalError,
)
from hopdata.hybrid.first_order.second_order import second_order_form
from hopdata.hybrid.system import System

# Event-selection: how the active guards are crossed, for all combinations of their
# locks.

CONTINUOUS = "trajectories are continuous"
CROSSED = "each guard is crossed"
ONCE = "each guard is crossed only once"
KEPT = "contact keeps penetration velocity"
#: Normalised rate above which a guard is approached.
#: Unit: 1, of the sum of the sizes of the rate's terms. Origin: chosen.
LIVE = 1e-6
#: Largest change of a coordinate, or step against a lock, that is no change.
#: Unit: 1, of a coordinate's or guard's size. Origin: chosen.
UNCHANGED = 1e-12


def event_selection(
    system: System, start: Instant, active: Sequence[int], scale: FloatArray, seed: int
) -> tuple[Finding, ...]:
    """Return findings on jumps of the state, and on guards being crossed, and once.

    All 2^n combinations of locks are checked up to n = 8 active guards, and 256 beyond.
    Rates are normalised by the sums |Dh_i f_i| + |dh/dt|: 1 means that all terms act
    together, and a negative value that a guard runs back. They do not depend on the
    units of state, guard or time.
    """
    guards = list(active)
    views = local.mode_fields(system, start, active, scale, seed)
    ways = -start.mode[guards]  # directions of crossing
    size = np.maximum(scale, np.abs(start.y))
    rates = {}
    shares = []
    jumps = []
    for crossed, view in views.items():
        rates[crossed] = ways * view.guard_rates[guards]
        shares.append(_share(rates[crossed], view.guard_scales[guards]))
        jumps.append(float(np.max(np.abs(view.instant.y - start.y) / size)))
    slowest = float(np.min(shares))
    back = _pushed_back(system, views, guards, ways, scale)
    ratio = _kept(rates, guards)
    of_rates = "smallest normalised rate of a guard in any mode"
    of_steps = "largest step of a handler against a lock"
    of_ratios = "smallest ratio of a guard's rate after its crossing to that before"
    return (
        Finding.at_most(
            CONTINUOUS, max(jumps), UNCHANGED, "largest jump of a coordinate"
        ),
        Finding.above(CROSSED, slowest, LIVE, of_rates),
        Finding.at_most(ONCE, back, UNCHANGED, of_steps),
        Finding.above(KEPT, ratio, LIVE, of_ratios),
    )


def _share(part: FloatArray, whole: FloatArray) -> FloatArray:
    """Return parts divided by wholes, with 0 / 0 = 0."""
    return np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)


def _kept(rates: Mapping[Combination, FloatArray], guards: Sequence[int]) -> float:
    """Return the smallest ratio of a guard's rate after its crossing to that before.

    0 if there is none.
    """
    ratios = []
    for before, rate in rates.items():
        for i, guard in enumerate(guards):
            after = rates.get(tuple(sorted({*before, guard})))
            if guard not in before and after is not None and rate[i] != 0:
                ratios.append(float(after[i] / rate[i]))
    return min(ratios, default=0.0)


def _pushed_back(
    system: System,
    views: Mapping[Combination, Linearisation],
    guards: list[int],
    ways: IntArray,
    scale: FloatArray,
) -> float:
    """Return the largest step of a handler against a lock, in units of its scale."""
    surfaces = {}
    for crossed, view in views.items():
        h, _ = local.guards_at(system, view.instant, view.rate)
        surfaces[crossed] = h[guards]
    worst = 0.0
    for crossed, view in views.items():
        is_over = np.isin(guards, crossed)
        locks = np.where(is_over, ways, -ways)
        if not np.array_equal(view.instant.mode[guards], locks):
            return np.inf  # a handler has set a lock itself
        size = np.maximum(np.abs(view.gradients[guards]) @ scale, np.finfo(float).tiny)
        against = np.where(is_over, -ways, ways)
        moved = against * (surfaces[crossed] - surfaces[()]) / size
        worst = max(worst, float(moved.max()))
    return worst


# Tests of smooth guards, and of crossings that commute.

#: How much finer the second step is by which kinks of a guard are found.
#: Unit: 1. Origin: chosen.
REFINEMENT = 8.0


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


def rates_agree(system: System, here: Linearisation, guards: list[int]) -> float:
    """Return the difference of the reported rates from Dh f + dh/dt.

    It is relative to their size.
    """
    reported = local.guards_at(system, here.instant, here.rate)[1][guards]
    off = np.abs(reported - here.guard_rates[guards])
    return float(np.max(_share(off, here.guard_scales[guards])))


def spread(products: Sequence[FloatArray]) -> float:
    """Return the largest distance of two products over the largest effect of one.

    The distance is the Frobenius norm in units of the coordinates' sizes; the effect of
    a product is its distance from 1.
    """
    stack = np.array(products)
    effect = np.linalg.norm(stack - np.eye(stack.shape[-1]), axis=(1, 2)).max()
    apart = max(float(np.linalg.norm(stack - one, axis=(1, 2)).max()) for one in stack)
    if effect > 0:
        return apart / float(effect)
    return 0.0


#: Relative difference below which two numbers count as equal: slopes, rates, products.
#: Unit: 1. Origin: chosen.
EQUAL = 1e-8
ONE_PRODUCT = "all orders have one saltation product"
NOT_SELECTED = "not event-selected"
SELECTED = "event-selected, not C1"
C1 = "C1"


def smooth_guards(
    system: System,
    here: Linearisation,
    active: list[int],
    scale: FloatArray,
    tolerance: float,
) -> tuple[Finding, ...]:
    """Return findings on equal one-sided gradients, and on the reported rates."""
    coarse, fine = one_sided_gaps(system, here, active, scale)
    needed = max(0.5 * coarse, tolerance)
    off = rates_agree(system, here, active)
    of_slopes = (
        "difference of slopes from both sides; needed: half of that at 8 times the step"
    )
    of_rates = "difference of hdot and Dh f + dh/dt"
    return (
        Finding.at_most("guards are smooth surfaces", fine, needed, of_slopes),
        Finding.at_most("guards report their rates", off, tolerance, of_rates),
    )


def one_product(flow: BouligandDerivative, seed: int, tolerance: float) -> Finding:
    """Return the finding on whether all orders that occur have one product."""
    scale = flow.scale
    try:
        orders = flow.pieces(seed=seed)
    except NotTransversalError as error:
        return Finding(ONE_PRODUCT, False, np.nan, f"<= {tolerance:g}", str(error))
    matrices = [order.matrix * scale / scale[:, None] for order in orders]
    detail = (
        f"largest distance of two of {len(orders)} products, over that of one from 1"
    )
    ends = np.array([order.state for order in orders])
    start = flow.node(()).here.instant.y
    if (ends != start).any():
        distances = [np.linalg.norm((ends - end) / scale, axis=1).max() for end in ends]
        apart = max(map(float, distances))
        detail += f"; the states after them differ by {apart:.3g}"
    return Finding.at_most(ONE_PRODUCT, spread(matrices), tolerance, detail)


@dataclass(frozen=True)
class SmoothnessReport:
    """Result of `check_c1`.

    Parameters
    ----------
    guards : tuple of str
        The active guards.
    selection : tuple of Finding
        First column of table 1.1: the conditions for an event-selected system.
    products : Finding
        Whether all orders of crossing that occur have one saltation product; the value
        is the largest distance between two of them over the largest distance of one
        from 1.
    second_order : tuple of Finding
        Second column of table 1.1 without its first line, event-selection: the
        conditions for a system of second order whose contacts add accelerations. They
        imply one product.
    """

    guards: tuple[str, ...]
    selection: tuple[Finding, ...]
    products: Finding
    second_order: tuple[Finding, ...]

    @property
    def has_second_order_form(self) -> bool:
        """Whether both columns of table 1.1 hold, which implies that the flow is C1."""
        return all(finding.passed for finding in (*self.selection, *self.second_order))

    @property
    def verdict(self) -> str:
        """One of "C1", "event-selected, not C1", "not event-selected"."""
        if not all(finding.passed for finding in self.selection):
            return NOT_SELECTED
        return C1 if self.products.passed else SELECTED

    @property
    def reasons(self) -> tuple[str, ...]:
        """Conditions that do not hold, without those of the second-order form."""
        findings = (*self.selection, self.products)
        return tuple(one.condition for one in findings if not one.passed)

    def __str__(self) -> str:
        title = self.verdict
        if self.reasons:
            title += f" (does not hold: {'; '.join(self.reasons)})"
        findings = (*self.selection, self.products, *self.second_order)
        head, *rows = Finding.table(findings).split("\n")
        n_first = len(self.selection)
        form = "holds" if self.has_second_order_form else "does not hold"
        lines = [
            title,
            f"guards {', '.join(self.guards)}",
            head,
            "event-selected if",
            *rows[:n_first],
            "C1 if moreover",
            rows[n_first],
            "second-order form (additive accelerations; sufficient for C1, and "
            f"{form}) if it is event-selected and",
            *rows[n_first + 1 :],
        ]
        return "\n".join(lines)


def check_c1(  # noqa: PLR0913 (each parameter is an option of the user's)
    system: System,
    state: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    guards: Sequence[int | str] | None = None,
    scale: ArrayLike | None = None,
    positions: Sequence[int] | None = None,
    seed: int = 0,
    tolerance: float = EQUAL,
) -> SmoothnessReport:
    """Check whether the flow through a state on the surfaces of guards is C1.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    state : (n,) array_like
        State at which the guards meet.
    params, mode, t
        As for `solve`; `mode` is the mode before the crossings, with all locks set.
    guards : sequence of int or str, optional
        Guards that are crossed; by default those on whose surface the state lies.
    scale : (n,) array_like, optional
        Size of each coordinate: unit of differences and norms. By default 1.
    positions : sequence of int, optional
        Coordinates that are positions, for the second-order form; the others are
        velocities. By default those whose rate is another coordinate or, if these are
        not half of all, the first half.
    seed : int
        Seed for sampling combinations of more than eight guards, orders of more than
        six, and states beside this one.
    tolerance : float
        Relative difference below which two numbers count as equal.

    Returns
    -------
    SmoothnessReport
        Printing it shows the table.

    Raises
    ------
    ValueError
        If no guard is crossed.
    """
    sizes = local.state_scale(system, scale)
    start = local.instant(system, state, params=params, mode=mode, t=t)
    here = local.linearise(system, start, sizes)
    active = local.active_guards(system, here, guards, sizes)
    expect(active, "guards", "at least one, as the state lies on no surface", active)
    continuous, *others = event_selection(system, start, active, sizes, seed)
    smooth = smooth_guards(system, here, list(active), sizes, tolerance)
    flow = BouligandDerivative(system, start, active, sizes)
    products = one_product(flow, seed, tolerance)
    form = second_order_form(system, start, active, sizes, seed, tolerance, positions)
    names = tuple(system.guard_names[k] for k in active)
    return SmoothnessReport(names, (continuous, *smooth, *others), products, form)
