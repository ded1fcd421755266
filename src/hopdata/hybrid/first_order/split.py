"""Positions and velocities of a second-order mechanical system."""

from __future__ import annotations

from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.first_order.local import FloatArray

Indices = tuple[int, ...]
FULL_RANK = 1e-9
MOST_SPLITS = 20_000


def velocity_rank(jacobian: FloatArray, positions: Indices, velocities: Indices) -> float:
    """Return the smallest over the largest singular value of d(rate of positions)/d(velocities).

    It is 0 unless the state is divided evenly: then each velocity moves positions in its own way.
    """
    if len(positions) != len(velocities) or not positions:
        return 0.0
    values = np.linalg.svd(jacobian[np.ix_(positions, velocities)], compute_uv=False)
    return float(values[-1] / values[0]) if values[0] > 0 else 0.0


def infer_split(
    jacobian: FloatArray, jumps: NDArray[np.bool_], gradients: FloatArray
) -> tuple[Indices, Indices] | None:
    """Return positions and velocities, as the field tells them apart, or None.

    Velocities are among the coordinates whose rates change at a guard. Among the others, the
    positions are half of the state whose rates the velocities determine, those first on which the
    guards depend.

    Parameters
    ----------
    jacobian : (n, n) array
        Derivative of the field, in units of the coordinates' sizes.
    jumps : (n,) array of bool
        Coordinates whose rate changes at a guard.
    gradients : (k, n) array
        Slopes of the guards.
    """
    n = len(jacobian)
    steady = [i for i in range(n) if not jumps[i]]
    if n % 2 or len(steady) < n // 2:
        return None
    on_guards = np.any(gradients != 0, axis=0)
    steady.sort(key=lambda i: not on_guards[i])
    for chosen in islice(combinations(steady, n // 2), MOST_SPLITS):
        positions = tuple(sorted(chosen))
        velocities = tuple(i for i in range(n) if i not in chosen)
        if velocity_rank(jacobian, positions, velocities) > FULL_RANK:
            return positions, velocities
    return None
