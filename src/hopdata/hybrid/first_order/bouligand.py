"""The Bouligand derivative of a flow through a state at which several guards meet.

It is linear on each cone of deviations whose trajectories cross the guards in one order, and
continuous from cone to cone (Burden, Sastry, Koditschek and Revzen 2016; dissertation,
section 1.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.first_order.local import (
    FloatArray,
    active_guards,
    instant,
    linearise,
    state_scale,
)
from hopdata.hybrid.first_order.orders import CrossingOrder, CrossingTree, crossing_orders
from hopdata.hybrid.system import System


@dataclass(frozen=True)
class BouligandDerivative:
    """A piecewise linear map of deviations from the state at which guards meet.

    Call it with deviations v, (n,) or (n, m), at the instant at which the nominal trajectory meets
    the guards. It returns D_v, of the same shape: where the neighbour is relative to the nominal
    trajectory once both have crossed all guards, carried back to that instant by the last field.
    """

    tree: CrossingTree

    def __call__(self, deviations: ArrayLike) -> FloatArray:
        """Return the directional derivatives D_v."""
        v = np.asarray(deviations, dtype=np.float64)
        if v.ndim not in (1, 2) or len(v) != self.tree.system.n_states:
            raise ValueError(
                f"deviations: expected ({self.tree.system.n_states},) or "
                f"({self.tree.system.n_states}, m), found {v.shape}"
            )
        if v.ndim == 1:
            return self.tree.node(self.order(v)).product @ v
        images = [self(column) for column in v.T]
        return np.array(images).reshape(v.T.shape).T

    def order(self, deviation: ArrayLike) -> tuple[int, ...]:
        """Return the order in which the neighbour at a deviation (n,) crosses the guards.

        It is exact to first order: the neighbour follows one constant field after the other. Of
        guards crossed together the first named comes first.
        """
        return self.tree.order(np.asarray(deviation, dtype=np.float64))

    def pieces(self) -> tuple[CrossingOrder, ...]:
        """Return the orders that occur, with their matrices."""
        return crossing_orders(self.tree)


def bouligand_derivative(
    system: System,
    state: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    guards: Sequence[int | str] | None = None,
    scale: ArrayLike | None = None,
) -> BouligandDerivative:
    """Return the Bouligand derivative of the flow at a state on the surfaces of several guards.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    state : (n,) array_like
        State at which the guards meet.
    params, mode, t
        As for `solve`; `mode` is that before the crossings, with all locks set.
    guards : sequence of int or str, optional
        Guards that are crossed. By default those on whose surface the state lies.
    scale : (n,) array_like, optional
        Size of each coordinate, for the steps of differences. By default 1.

    Returns
    -------
    BouligandDerivative
        Raises `NotTransversalError` when it meets an order in which a guard is not approached.
    """
    sizes = state_scale(system, scale)
    start = instant(system, state, params=params, mode=mode, t=t)
    chosen = active_guards(system, linearise(system, start, sizes), guards, sizes)
    return BouligandDerivative(CrossingTree(system, start, chosen, sizes))
