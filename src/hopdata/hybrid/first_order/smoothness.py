"""Is the flow through a state C1? Table 1.1 of the dissertation, computed.

The first column of the table is event-selection. The second (force-position additive: positions
and velocities, guards of position, additive accelerations) suffices for the crossings to commute.
Whether they do is computed as well, and decides: the flow has a Jacobian at the state if all orders
that occur around it have one matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.linearise import Combination, Indices, Instant, Linearisation
from hopdata.hybrid.first_order.saltation import CrossingTree, NotTransversalError, crossing_orders
from hopdata.hybrid.first_order.selection import EventSelection, Finding, check_event_selected
from hopdata.hybrid.system import System

# Measures of what makes crossings commute: smooth guards, additive forces, one product.

REFINEMENT = 8.0

Modes = dict[Combination, Linearisation]


def one_sided_gaps(
    system: System, here: Linearisation, guards: Sequence[int], scale: FloatArray
) -> tuple[float, float]:
    """Return how much the guards' slopes from both sides differ, for a step and an eighth of it.

    Relative to the slope. A smooth guard's difference shrinks with the step, that of a kink stays.
    """
    chosen = list(guards)
    coarse, fine = (_gap(system, here, chosen, scale, local.STEP / r) for r in (1.0, REFINEMENT))
    size = np.abs(here.gradients[chosen]) @ scale
    return tuple(float(np.max(gap / size)) if size.all() else np.inf for gap in (coarse, fine))  # type: ignore[return-value]


def _gap(
    system: System, here: Linearisation, guards: list[int], scale: FloatArray, step: float
) -> FloatArray:
    at = here.instant

    def surfaces(y: FloatArray) -> FloatArray:
        return local.guards_at(system, at.moved(y, at.t), here.rate)[0][guards]

    bends = [
        surfaces(at.y + shift) - 2 * surfaces(at.y) + surfaces(at.y - shift)
        for shift in np.diag(step * scale)
    ]
    return np.sum(np.abs(bends), axis=0) / step


def rates_agree(system: System, here: Linearisation, guards: Sequence[int]) -> float:
    """Return how far rates that the guards report are from Dh f + dh/dt, relative to their size."""
    chosen = list(guards)
    reported = local.guards_at(system, here.instant, here.rate)[1][chosen]
    off, size = np.abs(reported - here.guard_rates[chosen]), here.guard_scales[chosen]
    return float(np.max(np.divide(off, size, out=np.zeros_like(off), where=size > 0)))


def increments(modes: Modes) -> tuple[FloatArray, FloatArray]:
    """Return the changes of the field by single guards, (n_guards, n), and the rates' sizes (n,).

    The size of a rate is its largest value in any mode.
    """
    free = modes[()].rate
    single = np.array([modes[c].rate - free for c in modes if len(c) == 1])
    size = np.max([np.abs(view.rate) for view in modes.values()], axis=0)
    return single, size


def additive_residual(modes: Modes) -> float:
    """Return the largest |f_b - f_0 - sum of single changes| over modes b, over rates' sizes."""
    single, size = increments(modes)
    of = {c[0]: change for c, change in zip((c for c in modes if len(c) == 1), single, strict=True)}
    nothing = np.zeros_like(size)
    residuals = [
        np.abs(view.rate - modes[()].rate - sum((of[k] for k in crossed), nothing))
        for crossed, view in modes.items()
    ]
    return largest_relative(np.max(residuals, axis=0), size)


def largest_relative(values: FloatArray, sizes: FloatArray) -> float:
    """Return the largest ratio of values to sizes; 0 where both vanish."""
    ratios = np.divide(values, sizes, out=np.zeros_like(values), where=sizes > 0)
    return float(np.max(ratios, initial=0.0))


def spread(products: Sequence[FloatArray]) -> float:
    """Return the largest distance of two saltation products over the largest effect of one.

    The distance is Frobenius' norm, in units of the coordinates' sizes; the effect that to 1.
    """
    stack = np.array(products)
    effect = np.linalg.norm(stack - np.eye(stack.shape[-1]), axis=(1, 2)).max()
    apart = max(float(np.linalg.norm(stack - one, axis=(1, 2)).max()) for one in stack)
    return apart / float(effect) if effect > 0 else 0.0


# The conditions that make crossings commute, computed at one state.

ONE_PRODUCT = "all orders have one saltation product"


class Conditions:
    """The conditions of table 1.1 at one state, in all modes of its active guards."""

    def __init__(
        self,
        system: System,
        start: Instant,
        active: tuple[int, ...],
        scale: FloatArray,
        seed: int,
        tolerance: float,
    ) -> None:
        self.system, self.start, self.active = system, start, active
        self.scale, self.seed, self.tolerance = scale, seed, tolerance
        # All at one state: handlers that change it are a matter of continuity.
        self.modes = {
            crossed: local.linearise(system, view.instant.moved(start.y, start.t), scale)
            for crossed, view in local.mode_fields(system, start, active, scale, seed).items()
        }

    @property
    def here(self) -> Linearisation:
        """The system before any crossing."""
        return self.modes[()]

    def smooth_guards(self) -> tuple[Finding, ...]:
        """Guards have one slope from both sides, and report rates that agree with it."""
        coarse, fine = one_sided_gaps(self.system, self.here, self.active, self.scale)
        smooth = fine <= max(0.5 * coarse, self.tolerance)
        needed = f"<= {max(0.5 * coarse, self.tolerance):.2g}"
        agree = rates_agree(self.system, self.here, self.active)
        return (
            Finding(
                "guards are smooth surfaces", bool(smooth), fine, needed,
                "difference of slopes from both sides; needed: half of that at 8 times the step",
            ),
            Finding.at_most(
                "guards report their rates", agree, self.tolerance,
                "difference of hdot and Dh f + dh/dt",
            ),
        )  # fmt: skip

    def split(
        self, positions: Sequence[int] | None, velocities: Sequence[int] | None
    ) -> tuple[Indices, Indices] | None:
        """Return positions and velocities, given or inferred."""
        n = self.system.n_states
        if positions is None and velocities is None:
            return local.infer_split(
                self._jacobian(),
                self._jumps() > self.tolerance,
                self.here.gradients[list(self.active)],
            )
        first = _rest(n, velocities or ()) if positions is None else tuple(map(int, positions))
        second = _rest(n, first) if velocities is None else tuple(map(int, velocities))
        if sorted((*first, *second)) != list(range(n)):
            raise ValueError(
                f"positions, velocities: expected each of 0 to {n - 1} once, "
                f"found {first}, {second}"
            )
        return first, second

    def _jacobian(self) -> FloatArray:
        derivative, _ = local.differentiate(
            lambda p: local.field_at(self.system, p), self.start, self.scale
        )
        return derivative * self.scale / self.scale[:, None]

    def _jumps(self) -> FloatArray:
        """Return how much each rate changes at a guard, over its size, (n,)."""
        single, size = increments(self.modes)
        change = np.max(np.abs(single), axis=0)
        return np.divide(change, size, out=np.zeros_like(size), where=size > 0)

    def additivity(
        self, selected: bool, split: tuple[Indices, Indices] | None
    ) -> tuple[Finding, ...]:
        """Return the findings of the second column of table 1.1."""
        residual = additive_residual(self.modes)
        return (
            Finding("is event-selected", selected, float("nan"), "", "the conditions above"),
            *self._split_findings(split),
            Finding.at_most(
                "accelerations are additive", residual, self.tolerance,
                "|f_b - f_0 - sum of single changes| in any mode, over the rate's size",
            ),
        )  # fmt: skip

    def _split_findings(self, split: tuple[Indices, Indices] | None) -> tuple[Finding, ...]:
        names = (
            "state is positions and velocities",
            "guards depend on positions only",
            "contact changes accelerations only",
        )
        if split is None:
            why = "no even split of the state found"
            return tuple(Finding.not_computed(name, "a split", why) for name in names)
        positions, velocities = map(list, split)
        slopes = np.abs(self.here.gradients[list(self.active)]) * self.scale
        by_velocity = slopes[:, velocities].sum(axis=1) / slopes.sum(axis=1)
        return (
            Finding.above(
                names[0], local.velocity_rank(self._jacobian(), *split), local.FULL_RANK,
                "smallest over largest singular value of d(dq/dt)/dv",
            ),
            Finding.at_most(
                names[1], float(by_velocity.max()), self.tolerance,
                "share of the velocities in |Dh|",
            ),
            Finding.at_most(
                names[2], float(self._jumps()[positions].max()), self.tolerance,
                "change of a position's rate at a guard",
            ),
        )  # fmt: skip

    def products(self) -> Finding:
        """Return whether the orders that occur agree in their saltation product."""
        tree = CrossingTree(self.system, self.start, self.active, self.scale)
        try:
            orders = crossing_orders(tree, seed=self.seed)
        except NotTransversalError as error:
            return Finding.not_computed(ONE_PRODUCT, f"<= {self.tolerance:g}", str(error))
        matrices = [order.matrix * self.scale / self.scale[:, None] for order in orders]
        return Finding.at_most(
            ONE_PRODUCT, spread(matrices), self.tolerance,
            f"largest distance of two of {len(orders)} products, over that of one from 1"
            + self._ends([order.state for order in orders]),
        )  # fmt: skip

    def _ends(self, states: list[FloatArray]) -> str:
        """Return in words how far apart the orders end, if handlers change the state."""
        ends = np.array(states) / self.scale
        if np.array_equal(ends, np.broadcast_to(self.start.y / self.scale, ends.shape)):
            return ""
        apart = max(float(np.linalg.norm(ends - end, axis=1).max()) for end in ends)
        return f"; the states after them differ by {apart:.3g}"


def _rest(n: int, indices: Sequence[int]) -> Indices:
    return tuple(i for i in range(n) if i not in indices)


EQUAL = 1e-8
NOT_SELECTED, SELECTED, C1 = "not event-selected", "event-selected, not C1", "C1"


@dataclass(frozen=True)
class SmoothnessReport:
    """What `check_c1` found.

    Parameters
    ----------
    guards : tuple of str
        The active guards.
    selection : tuple of Finding
        First column of table 1.1: what makes the system event-selected.
    additivity : tuple of Finding
        Second column: what makes it force-position additive, and so C1.
    products : Finding
        Whether all orders of crossing that occur have one saltation product; the value is the
        largest distance of two of them over the largest distance of one from 1.
    positions, velocities : tuple of int or None
        The split of the state, given or inferred; None if there is none.
    """

    guards: tuple[str, ...]
    selection: tuple[Finding, ...]
    additivity: tuple[Finding, ...]
    products: Finding
    positions: Indices | None
    velocities: Indices | None

    @property
    def verdict(self) -> str:
        """One of "C1", "event-selected, not C1", "not event-selected"."""
        if not all(finding.passed for finding in self.selection):
            return NOT_SELECTED
        return C1 if self.products.passed else SELECTED

    @property
    def reasons(self) -> tuple[str, ...]:
        """The conditions that do not hold."""
        every = (*self.selection, *self.additivity, self.products)
        return tuple(finding.condition for finding in every if not finding.passed)

    def __str__(self) -> str:
        why = f" (does not hold: {'; '.join(self.reasons)})" if self.reasons else ""
        table = Finding.table((*self.selection, *self.additivity, self.products)).split("\n")
        middle = 1 + len(self.selection)
        lines = [
            f"{self.verdict}{why}",
            f"guards {', '.join(self.guards)}; positions {_listed(self.positions)}, "
            f"velocities {_listed(self.velocities)}",
            table[0],
            "event-selected if",
            *table[1:middle],
            "force-position additive, so C1, if moreover",
            *table[middle:],
        ]
        return "\n".join(lines)


def _listed(indices: Indices | None) -> str:
    return "none" if indices is None else " ".join(map(str, indices))


def check_c1(
    system: System,
    state: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    guards: Sequence[int | str] | None = None,
    positions: Sequence[int] | None = None,
    velocities: Sequence[int] | None = None,
    scale: ArrayLike | None = None,
    radius: float = 1e-3,
    n_samples: int = 16,
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
        As for `solve`; `mode` is that before the crossings, with all locks set.
    guards : sequence of int or str, optional
        The guards that are crossed. By default those on whose surface the state lies.
    positions, velocities : sequence of int, optional
        Split of the state. By default inferred; if one is given the other is the rest.
    scale : (n,) array_like, optional
        Size of each coordinate: unit of differences, samples and norms. By default 1.
    radius, n_samples, seed
        Liveness is looked at on so many states more, in a ball of this radius in units of `scale`.
    tolerance : float
        Up to which two numbers are taken as equal, relative to their size.

    Returns
    -------
    SmoothnessReport
        Print it for the table.
    """
    sizes = local.state_scale(system, scale)
    start = local.instant(system, state, params=params, mode=mode, t=t)
    active = local.active_guards(system, local.linearise(system, start, sizes), guards, sizes)
    selection = check_event_selected(
        system, start.y, params=params, mode=mode, t=t, guards=active,
        radius=radius, n_samples=n_samples, seed=seed, scale=sizes,
    )  # fmt: skip
    conditions = Conditions(system, start, active, sizes, seed, tolerance)
    split = conditions.split(positions, velocities)
    return SmoothnessReport(
        selection.guards,
        _selection_findings(selection, conditions),
        conditions.additivity(selection.passed, split),
        conditions.products(),
        *(split or (None, None)),
    )


def _selection_findings(selection: EventSelection, conditions: Conditions) -> tuple[Finding, ...]:
    continuous, *others = selection.findings
    return (continuous, *conditions.smooth_guards(), *others)
