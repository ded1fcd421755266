"""The conditions that make crossings commute, computed at one state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.hybrid.first_order import additivity
from hopdata.hybrid.first_order.findings import Finding, above, at_most, not_computed
from hopdata.hybrid.first_order.local import (
    FloatArray,
    Instant,
    Linearisation,
    differentiate,
    field_at,
    linearise,
)
from hopdata.hybrid.first_order.modes import mode_fields
from hopdata.hybrid.first_order.orders import CrossingTree, crossing_orders
from hopdata.hybrid.first_order.saltation import NotTransversalError
from hopdata.hybrid.first_order.split import FULL_RANK, Indices, infer_split, velocity_rank
from hopdata.hybrid.system import System

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
            crossed: linearise(system, view.instant.moved(start.y, start.t), scale)
            for crossed, view in mode_fields(system, start, active, scale, seed).items()
        }

    @property
    def here(self) -> Linearisation:
        """The system before any crossing."""
        return self.modes[()]

    def smooth_guards(self) -> tuple[Finding, ...]:
        """Guards have one slope from both sides, and report rates that agree with it."""
        coarse, fine = additivity.one_sided_gaps(self.system, self.here, self.active, self.scale)
        smooth = fine <= max(0.5 * coarse, self.tolerance)
        needed = f"<= {max(0.5 * coarse, self.tolerance):.2g}"
        agree = additivity.rates_agree(self.system, self.here, self.active)
        return (
            Finding(
                "guards are smooth surfaces", bool(smooth), fine, needed,
                "difference of slopes from both sides; needed: half of that at 8 times the step",
            ),
            at_most(
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
            return infer_split(
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
        derivative, _ = differentiate(lambda p: field_at(self.system, p), self.start, self.scale)
        return derivative * self.scale / self.scale[:, None]

    def _jumps(self) -> FloatArray:
        """Return how much each rate changes at a guard, over its size, (n,)."""
        single, size = additivity.increments(self.modes)
        change = np.max(np.abs(single), axis=0)
        return np.divide(change, size, out=np.zeros_like(size), where=size > 0)

    def additivity(
        self, selected: bool, split: tuple[Indices, Indices] | None
    ) -> tuple[Finding, ...]:
        """Return the findings of the second column of table 1.1."""
        residual = additivity.additive_residual(self.modes)
        return (
            Finding("is event-selected", selected, float("nan"), "", "the conditions above"),
            *self._split_findings(split),
            at_most(
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
            return tuple(not_computed(name, "a split", why) for name in names)
        positions, velocities = map(list, split)
        slopes = np.abs(self.here.gradients[list(self.active)]) * self.scale
        by_velocity = slopes[:, velocities].sum(axis=1) / slopes.sum(axis=1)
        return (
            above(
                names[0], velocity_rank(self._jacobian(), *split), FULL_RANK,
                "smallest over largest singular value of d(dq/dt)/dv",
            ),
            at_most(
                names[1], float(by_velocity.max()), self.tolerance,
                "share of the velocities in |Dh|",
            ),
            at_most(
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
            return not_computed(ONE_PRODUCT, f"<= {self.tolerance:g}", str(error))
        matrices = [order.matrix * self.scale / self.scale[:, None] for order in orders]
        return at_most(
            ONE_PRODUCT, additivity.spread(matrices), self.tolerance,
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
