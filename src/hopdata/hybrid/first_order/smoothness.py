"""Test whether the flow through a state is C1, and go through table 1.1 line by line.

Two columns of the dissertation's table 1.1 say what to look at. The first is
event-selection (see `event_selected`, which also has definitions 1.2.1 and 1.2.2):
every active guard is approached, whichever of the others have been crossed, and the
state does not jump. Every nearby trajectory then crosses each guard exactly once,
because rates that are positive here are positive in a neighbourhood. Whether the
crossings commute is computed: the flow has a Jacobian at the state if all orders that
occur around it have the same matrix. The second column, force-position additive systems
(see `second_order`), is sufficient for that but not necessary: it explains why a flow
is C1, and does not decide it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.hybrid.arguments import expect
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.crossings import NoDerivativeError
from hopdata.hybrid.first_order.event_selected import (
    CONTINUOUS,
    definitions,
    event_selection,
)
from hopdata.hybrid.first_order.finding import Finding
from hopdata.hybrid.first_order.saltation import (
    SAME_END,
    BouligandDerivative,
    CrossingOrder,
    NotTransversalError,
)
from hopdata.hybrid.first_order.second_order import GROUPED, second_order_form
from hopdata.hybrid.system import System


def spread(products: Sequence[FloatArray], unknown: float = 0.0) -> float:
    """Return the largest distance of two products over the largest effect of one.

    The distance is the Frobenius norm in units of the coordinates' sizes; the effect of
    a product is its distance from 1. Of a distance, `unknown` does not count.
    """
    stack = np.array(products)
    effect = np.linalg.norm(stack - np.eye(stack.shape[-1]), axis=(1, 2)).max()
    apart = max(float(np.linalg.norm(stack - one, axis=(1, 2)).max()) for one in stack)
    if effect > 0 and apart > unknown:
        return (apart - unknown) / float(effect)
    return 0.0


#: Rounding of a field and of a state, of which products are made of several.
#: Unit: 1, of their sizes. Origin: chosen: 16 roundings.
ROUNDING = 16 * float(np.finfo(float).eps)


def distance_from_surfaces(flow: BouligandDerivative) -> FloatArray:
    """Return the displacement (n,) that puts the state on all of its guards' surfaces.

    It is zero for a state that lies elsewhere, on whose guards the caller insists.
    """
    here = flow.node(()).here
    guards = list(flow.guards)
    h = local.guards_at(flow.system, here.instant, here.rate)[0][guards]
    gradients = here.gradients[guards] * flow.scale
    if (np.abs(h) > local.ON_GUARD * np.abs(gradients).sum(axis=1)).any():
        return np.zeros(len(flow.scale))
    return np.asarray(flow.scale * (np.linalg.pinv(gradients) @ h))


def unknown_of_products(
    flow: BouligandDerivative, orders: Sequence[CrossingOrder]
) -> float:
    """Return up to which distance two products may differ for no reason.

    These are rounding, and what the fields change between the state and the surfaces.
    """
    off = np.abs(distance_from_surfaces(flow))

    def of_field(here: local.Linearisation) -> FloatArray:
        at = here.instant
        slopes = np.abs(local.derivative_of_field(flow.system, at, flow.scale))
        moved = off + ROUNDING * np.maximum(flow.scale, np.abs(at.y))
        return np.asarray(ROUNDING * np.abs(here.rate) + slopes @ moved)

    of_order = []
    for order in orders:
        total = 0.0
        for i, guard in enumerate(order.guards):
            here = flow.node(order.guards[:i]).here
            there = flow.node(order.guards[: i + 1]).here
            fields = (of_field(here) + of_field(there)) / flow.scale
            timing = here.gradients[guard] * flow.scale / here.guard_rates[guard]
            total += float(np.linalg.norm(fields) * np.linalg.norm(timing))
        of_order.append(total)
    return max(of_order)


#: Relative difference below which two numbers count as equal: slopes, rates, products.
#: Unit: 1. Origin: chosen.
EQUAL = 1e-8
ONE_PRODUCT = "all orders have one saltation product"
NOT_SELECTED = "not event-selected"
SELECTED = "event-selected, not C1"
C1 = "C1"
LANDING = (
    "the landing, as a map from before to after all contacts, has one derivative at "
    "this state: all orders have one product and end at one state; of states nearby "
    "this says nothing"
)


def _orders(flow: BouligandDerivative, seed: int) -> tuple[CrossingOrder, ...] | str:
    """Return the orders that occur, or why they cannot be followed."""
    try:
        return flow.pieces(seed=seed)
    except (NotTransversalError, NoDerivativeError) as error:
        return str(error)


def end_as_one(flow: BouligandDerivative, orders: Sequence[CrossingOrder]) -> bool:
    """Return whether all orders end at one state, in one mode, with one memory.

    Otherwise the flow jumps between them, whatever their matrices are.
    """
    ends = [flow.node(order.guards).here.instant for order in orders]
    first = ends[0]
    for end in ends:
        off = np.abs(end.y - first.y) / np.maximum(flow.scale, np.abs(first.y))
        alike = (end.mode == first.mode).all() and (end.params == first.params).all()
        if not alike or (off > SAME_END).any():
            return False
    return True


def one_product(
    flow: BouligandDerivative,
    orders: tuple[CrossingOrder, ...] | str,
    tolerance: float,
) -> Finding:
    """Return the finding on whether all orders that occur have one product.

    `orders` may be the reason why they cannot be followed.
    """
    scale = flow.scale
    if isinstance(orders, str):
        return Finding(ONE_PRODUCT, False, np.nan, f"<= {tolerance:g}", orders)
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
    if spread(matrices) > tolerance:
        # The rest is of rounding, or of a state that is beside the surfaces.
        unknown = unknown_of_products(flow, orders)
        off = float(np.linalg.norm(distance_from_surfaces(flow) / scale))
        if spread(matrices, unknown) <= tolerance:
            detail += (
                f"; the distance itself, up to {unknown:.1g}, is of rounding and of a "
                f"state that is {off:.1g} off the surfaces: it does not count"
            )
        return Finding.at_most(
            ONE_PRODUCT, spread(matrices, unknown), tolerance, detail
        )
    return Finding.at_most(ONE_PRODUCT, spread(matrices), tolerance, detail)


@dataclass(frozen=True)
class SmoothnessReport:
    """Result of `check_c1`.

    Parameters
    ----------
    guards : tuple of str
        The active guards.
    definitions : tuple of Finding
        Definitions 1.2.1 (event functions) and 1.2.2 (event-selected C1), after the
        finding on which their numbers rest, that guards report their rates.
    ess : tuple of Finding
        The four lines of table 1.1's first column: event-selected systems.
    fopas : tuple of Finding
        The four lines of its second column: force-position additive systems, in which
        contacts add accelerations. They imply one product.
    products : Finding
        Whether all orders of crossing that occur have one saltation product; the value
        is the largest distance between two of them over the largest distance of one
        from 1.
    ends_as_one : bool
        Whether all these orders end at one state, in one mode.
    """

    guards: tuple[str, ...]
    definitions: tuple[Finding, ...]
    ess: tuple[Finding, ...]
    fopas: tuple[Finding, ...]
    products: Finding
    ends_as_one: bool

    @property
    def selection(self) -> tuple[Finding, ...]:
        """All conditions of an event-selected system: definitions and column."""
        return (*self.definitions, *self.ess)

    @property
    def is_fopas(self) -> bool:
        """Whether it is force-position additive, which implies that the flow is C1."""
        return all(finding.passed for finding in self.fopas)

    @property
    def verdict(self) -> str:
        """One of "C1", "event-selected, not C1", "not event-selected"."""
        if not all(finding.passed for finding in self.selection):
            return NOT_SELECTED
        return C1 if self.products.passed else SELECTED

    @property
    def landing_has_one_derivative(self) -> bool:
        """Whether the map from before to after all contacts has one, at this state.

        It is the product, if every line but that on jumps of the state holds, and all
        orders end at one state. At an instant between the contacts the flow jumps all
        the same. It says nothing of states nearby: where orders end apart at these, the
        map jumps there, by little.
        """
        failed = [one.condition for one in self.selection if not one.passed]
        return set(failed) <= {CONTINUOUS} and self.products.passed and self.ends_as_one

    @property
    def reasons(self) -> tuple[str, ...]:
        """Conditions that do not hold, without those of the second column."""
        findings = (*self.selection, self.products)
        return tuple(one.condition for one in findings if not one.passed)

    @property
    def of_second_column(self) -> str:
        """What the second column says about the answer, in words."""
        if self.is_fopas:
            return "FoPAS: every line holds, and so the flow is C1"
        failed = [one.condition for one in self.fopas if not one.passed]
        rests = "the answer is that of the lines above FoPAS"
        if GROUPED in failed:
            return f"FoPAS: not asked without positions and velocities; {rests}"
        return f"FoPAS: a line fails, which decides nothing; {rests}"

    def __str__(self) -> str:
        title = self.verdict
        if self.reasons:
            title += f" (does not hold: {'; '.join(self.reasons)})"
        required = {
            "event-selected C1, by definition, if": self.definitions,
            "table 1.1, event-selected system (ESS), if": self.ess,
            "C1 if moreover": (self.products,),
        }
        findings = [one for group in required.values() for one in group]
        head, *rows = Finding.table([*findings, *self.fopas]).split("\n")
        lines = [title, f"guards {', '.join(self.guards)}", head]
        for what, group in required.items():
            lines += [what, *rows[: len(group)]]
            rows = rows[len(group) :]
        lines.append(
            "table 1.1, force-position additive system (FoPAS), sufficient for C1 and "
            "not necessary, if"
        )
        lines += [_not_required(row) for row in rows]
        lines.append(self.of_second_column)
        if self.verdict == NOT_SELECTED and self.landing_has_one_derivative:
            lines.append(LANDING)
        return "\n".join(lines)


def _not_required(row: str) -> str:
    """Return a row of the table whose condition may fail in a flow that is C1."""
    if row.startswith("NO"):
        return "no" + row.removeprefix("NO")
    return row


#: Radius of the neighbourhood in which `check_c1` bounds the rates of event functions.
#: Unit: 1, of a coordinate's size. Origin: derived: the step of the differences, so
#: that definition and derivatives look at the same states.
RADIUS = local.STEP
IS_SELECTED = "is event-selected"


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
    radius: float = RADIUS,
    seed: int = 0,
    tolerance: float = EQUAL,
) -> SmoothnessReport:
    """Check whether the flow through a state on the surfaces of guards is C1.

    The answer goes through definitions 1.2.1 and 1.2.2 and both columns of table 1.1 of
    the dissertation, a line each, with a number and what it means.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    state : (n,) array_like
        State at which the guards meet.
    params, mode, t
        As for `solve`; `mode` is the mode before the crossings, with all locks set.
    guards : sequence of int or str, optional
        Guards that are crossed; by default those on whose surface the state lies. Those
        that are named count as crossed at this state, also if it lies elsewhere.
    scale : (n,) array_like, optional
        Size of each coordinate: unit of differences and norms. By default 1.
    positions : sequence of int, optional
        Coordinates that are positions, for the second column; the others are
        velocities. By default those whose rate is another coordinate or, if these are
        not half of all, the first half.
    radius : float
        Radius of the neighbourhood in which the rates of the event functions are
        bounded (definition 1.2.1), in sizes of the coordinates.
    seed : int
        Seed for sampling combinations of more than eight guards, orders of more than
        six, and states and directions beside this one.
    tolerance : float
        Relative difference below which two numbers count as equal.

    Returns
    -------
    SmoothnessReport
        Printing it shows the table.

    Raises
    ------
    ValueError
        If no guard is crossed, or the radius is not above 0.
    """
    expect(radius > 0, "radius", "a number > 0", radius)
    sizes = local.state_scale(system, scale)
    start = local.instant(system, state, params=params, mode=mode, t=t)
    here = local.linearise(system, start, sizes)
    active = local.active_guards(system, here, guards, sizes)
    expect(active, "guards", "at least one, as the state lies on no surface", active)
    defined = definitions(
        system,
        start,
        active,
        sizes,
        radius=radius,
        seed=seed,
        tolerance=tolerance,
    )
    ess = event_selection(system, start, active, sizes, seed, tolerance)
    form = second_order_form(system, start, active, sizes, seed, tolerance, positions)
    flow = BouligandDerivative(system, start, active, sizes)
    orders = _orders(flow, seed)
    n_missing = sum(not finding.passed for finding in (*defined, *ess))
    selected = Finding.at_most(
        IS_SELECTED, n_missing, 0.0, "conditions above that do not hold"
    )
    return SmoothnessReport(
        guards=tuple(system.guard_names[k] for k in active),
        definitions=defined,
        ess=ess,
        fopas=(selected, *form),
        products=one_product(flow, orders, tolerance),
        ends_as_one=not isinstance(orders, str) and end_as_one(flow, orders),
    )
