"""The flow's derivative by fourth-order central differences of `solve`."""

from __future__ import annotations

import numpy as np

from hopdata.hybrid import solve
from hopdata.hybrid.first_order.linearise import instant, linearise
from hopdata.hybrid.first_order.saltation import crossing

TIGHT = {"rtol": 1e-13, "atol": 1e-14}


def differences(system, t_span, y0, *, step=1e-4, **options):
    """Return the derivative of the final by the initial state, from four integrations a column."""
    y0, columns = np.asarray(y0, dtype=float), []
    for e in step * np.eye(len(y0)):
        ends = [
            solve(system, t_span, y0 + part * e, **{**TIGHT, **options}).y_end
            for part in (-2, -1, 1, 2)
        ]
        columns.append(np.array([1, -8, 8, -1]) @ ends / (12 * step))
    return np.array(columns).T


def carried(system, t_span, y0, **options):
    """Return a solution with its Jacobian at a tight tolerance, by one method with its own code."""
    return solve(
        system, t_span, y0, jacobian=True, **{"method": "dop853", **TIGHT, **options}
    )


def gap(one, other):
    """Return the largest difference of two matrices, relative to the largest entry."""
    return np.abs(one - other).max() / np.abs(other).max()


def saltation_product(system, state, order, *, params=(), mode, t=0.0):
    """Return the product of the matrices of guards crossed at one instant, in the given order."""
    scale, product = np.ones(system.n_states), np.eye(system.n_states)
    here = linearise(
        system, instant(system, state, params=params, mode=mode, t=t), scale
    )
    for guard in order:
        matrix, here = crossing(system, here, guard, scale)
        product = matrix @ product
    return product
