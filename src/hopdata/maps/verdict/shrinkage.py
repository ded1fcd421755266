"""How strongly to shrink the terms beyond the third order: restricted maximum likelihood.

Per output the coefficients of the shrunk terms are taken as normal with one common variance. Its
ratio to the variance of the noise is found from what the free terms and the kinks leave over
(Patterson and Thompson 1971). Where the data show no such terms the ratio is zero, and they cost
nothing; where they show them, they count as one more source of uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_RATIOS = np.concatenate([[0.0], np.logspace(-5, 1.5, 80)])

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class VarianceRatios:
    """Variances of q outputs.

    Attributes
    ----------
    ratio
        (q,) variance of a shrunk coefficient over that of the noise.
    noise
        (q,) variance of the noise.
    """

    ratio: Floats
    noise: Floats


def variance_ratios(terms: Floats, outputs: Floats, used: int) -> VarianceRatios:
    """Estimate both variances of each output.

    Parameters
    ----------
    terms
        (n, g) shrunk terms, with all that is fitted freely projected out.
    outputs
        (n, q), likewise.
    used
        Degrees of freedom that the projection took.
    """
    left, values, _ = np.linalg.svd(terms, full_matrices=False)
    loads = left.T @ outputs
    rest = np.sum(outputs**2, axis=0) - np.sum(loads**2, axis=0)
    free = len(terms) - used
    spread = 1.0 + _RATIOS[:, None] * values**2
    power = np.einsum("rg,gq->rq", 1.0 / spread, loads**2) + np.maximum(rest, 0.0)
    with np.errstate(divide="ignore"):  # an output without any noise
        likelihood = -0.5 * (np.log(spread).sum(axis=1)[:, None] + free * np.log(power))
    best = np.argmax(likelihood, axis=0)
    columns = np.arange(outputs.shape[1])
    return VarianceRatios(_RATIOS[best], power[best, columns] / free)
