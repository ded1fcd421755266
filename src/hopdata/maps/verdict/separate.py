"""The plain comparison: a linear map for each schedule, and how much they differ.

At a finite spread of contacts the maps of the schedules differ even if the map through the landing
is C1, since each schedule sees its own side of the curvature. The difference then goes to zero with
the spread; if it is a jump of the derivative it does not. Maps from disjoint halves are multiplied,
so that noise adds nothing on average.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.affine import fit_affine
from hopdata.maps.verdict.inputs import large_classes

HALVINGS = 10


def separate_difference(
    x: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    covariance: FloatArray,
    *,
    generator: np.random.Generator,
) -> float:
    """Return the rms difference of the schedules' maps relative to the map of all.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs of a window.
    weights
        (n, schedules) membership of each landing; each counts where it weighs most.
    covariance
        (p, p) of the inputs of the study: in all windows a change of the outcome counts by what it
        is over these inputs, as in `hopdata.maps.verdict.effect.outcome_variance`.
    generator
        Source of the halvings.

    Returns
    -------
    float
        NaN if fewer than two schedules have enough landings; 0 where noise exceeds the difference.
    """
    classes = large_classes(weights, x.shape[1])
    if len(classes) < 2:
        return float("nan")
    squares = []
    for _ in range(HALVINGS):
        mixed = [generator.permutation(rows) for rows in classes]
        first, second = (
            [fit_affine(x[rows[k::2]], y[rows[k::2]]).coefficients for rows in mixed]
            for k in (0, 1)
        )
        for a, b in combinations(range(len(classes)), 2):
            squares.append(np.sum((first[a] - first[b]) * (covariance @ (second[a] - second[b]))))
    map_of_all = fit_affine(x, y).coefficients
    whole = np.sum(map_of_all * (covariance @ map_of_all))
    return float(np.sqrt(max(0.0, float(np.mean(squares))) / whole))
