"""The orders in which guards that meet at one state are crossed, each with its matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from math import factorial

import numpy as np

from hopdata.hybrid.first_order.local import (
    FloatArray,
    Instant,
    Linearisation,
    linearise,
)
from hopdata.hybrid.first_order.saltation import NotTransversalError, crossing
from hopdata.hybrid.system import System

NARROW = 1e-9  # a cone of deviations that is thinner than this is taken for a plane
MOST_ORDERS = 720


@dataclass(frozen=True)
class Node:
    """Where a trajectory stands after some of the crossings.

    `product` (n, n) takes a deviation before the first crossing to one from the nominal
    trajectory of the mode that has been reached.
    """

    here: Linearisation
    product: FloatArray

    @property
    def delays(self) -> FloatArray:
        """Functionals whose values on a deviation are the instants of crossing, (n_guards, n)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return -(self.here.gradients @ self.product) / self.here.guard_rates[:, None]


class CrossingTree:
    """The crossings of some guards in any order from one state; each is computed when asked for."""

    def __init__(
        self, system: System, start: Instant, guards: Sequence[int], scale: FloatArray
    ) -> None:
        self.system, self.guards, self.scale = system, tuple(guards), scale
        here = linearise(system, start, scale)
        self._nodes: dict[tuple[int, ...], Node] = {(): Node(here, np.eye(system.n_states))}

    def node(self, order: tuple[int, ...]) -> Node:
        """Return the node after the crossings in this order; raise if one is not transversal."""
        if order not in self._nodes:
            before = self.node(order[:-1])
            self._require_approach(before.here, order[-1])
            matrix, here = crossing(self.system, before.here, order[-1], self.scale)
            self._nodes[order] = Node(here, matrix @ before.product)
        return self._nodes[order]

    def order(self, deviation: FloatArray) -> tuple[int, ...]:
        """Return the order in which the neighbour at a deviation (n,) crosses the guards.

        It is exact to first order: the neighbour follows one constant field after the other. Of
        guards crossed together the first named comes first.
        """
        order: tuple[int, ...] = ()
        while len(order) < len(self.guards):
            delays = self.node(order).delays @ deviation
            waiting = [guard for guard in self.guards if guard not in order]
            order = (*order, min(waiting, key=lambda guard: delays[guard]))
        return order

    def _require_approach(self, here: Linearisation, guard: int) -> None:
        """Raise unless the guard is approached from the side on which its lock is."""
        rate = here.guard_rates[guard]
        if not -here.instant.mode[guard] * rate > 0:
            name = self.system.guard_names[guard]
            raise NotTransversalError(
                f"guard {name}: expected to be approached, found a rate of {rate:.3g} on the side "
                f"{here.instant.mode[guard]:+d} in mode {here.instant.mode.tolist()}"
            )


@dataclass(frozen=True)
class CrossingOrder:
    """One order of the guards.

    Parameters
    ----------
    guards : tuple of int
        Numbers of the guards, the first crossed first.
    matrix : (n, n) array
        Product of the saltation matrices.
    direction : (n,) array or None
        A deviation of unit length whose trajectory crosses in this order, and that keeps well clear
        of other orders; None if there is none but in the borders of other orders.
    state : (n,) array
        State after the crossings: it depends on the order only where handlers change the state.
    """

    guards: tuple[int, ...]
    matrix: FloatArray
    direction: FloatArray | None
    state: FloatArray


def crossing_orders(tree: CrossingTree, *, seed: int = 0) -> tuple[CrossingOrder, ...]:
    """Return the orders that occur among the deviations, with their matrices.

    An order occurs if a set of deviations with an interior crosses in it. With up to six guards
    all orders are tried; with more, those are returned in which 720 random deviations cross.
    """
    if factorial(len(tree.guards)) <= MOST_ORDERS:
        every = (_order(tree, guards) for guards in permutations(tree.guards))
        return tuple(order for order in every if order.direction is not None)
    draws = np.random.default_rng(seed).normal(size=(MOST_ORDERS, tree.system.n_states))
    found = {tree.order(v): v / np.linalg.norm(v) for v in draws * tree.scale}
    return tuple(_crossing_order(tree, guards, v) for guards, v in found.items())


def _crossing_order(
    tree: CrossingTree, guards: tuple[int, ...], direction: FloatArray | None
) -> CrossingOrder:
    last = tree.node(guards)
    return CrossingOrder(guards, last.product, direction, last.here.instant.y)


def _order(tree: CrossingTree, guards: tuple[int, ...]) -> CrossingOrder:
    delays = [tree.node(guards[:i]).delays[guard] for i, guard in enumerate(guards)]
    scaled = np.array(delays) * tree.scale
    direction = _inside_cone(np.diff(scaled, axis=0), float(np.abs(scaled).max()))
    if direction is not None:
        direction = direction * tree.scale
        direction = direction / np.linalg.norm(direction)
    return _crossing_order(tree, guards, direction)


def _inside_cone(rows: FloatArray, size: float) -> FloatArray | None:
    """Return v with rows @ v > 0, or None: then rows sum to zero with weights >= 0 (Gordan 1873).

    The smallest |rows.T w|^2 + (1 - sum w)^2 over w >= 0 is positive in the first case, and its
    minimiser gives v = rows.T w. Rows that vanish beside `size` are of guards with one surface,
    which are crossed together by all: they ask for nothing.
    """
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    asking = lengths[:, 0] > NARROW * size
    if not asking.any():
        return np.ones(rows.shape[1])
    from scipy.optimize import nnls

    unit = rows[asking] / lengths[asking]
    sums = np.vstack([unit.T, np.ones(len(unit))])
    weights, _ = nnls(sums, np.append(np.zeros(rows.shape[1]), 1.0))
    inside = unit.T @ weights
    return inside if np.linalg.norm(inside) > NARROW else None
