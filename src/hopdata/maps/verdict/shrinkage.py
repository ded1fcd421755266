"""How strongly to shrink the terms beyond the third order: restricted maximum likelihood.

Per output the coefficients of each of two groups of shrunk terms are taken as normal with one
variance for the group. Their ratios to the variance of the noise are found from what the free terms
and the kinks leave over (Patterson and Thompson 1971). Where the data show no such terms the ratio
is zero, and they cost nothing; where they show them, they count as one more source of uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_RATIOS = np.concatenate([[0.0], np.logspace(-5, 1.5, 80)])
#: Shares of the second group in the sum of the two ratios.
_SHARES = (0.0, 1e-3, 1e-2, 0.1, 0.5, 1.0)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class VarianceRatios:
    """Variances of q outputs.

    Attributes
    ----------
    ratios
        (q, 2) variance of a shrunk coefficient of each group over that of the noise.
    noise
        (q,) variance of the noise.
    """

    ratios: Floats
    noise: Floats


def variance_ratios(groups: Sequence[Floats], outputs: Floats, used: int) -> VarianceRatios:
    """Estimate the variances of each output.

    Parameters
    ----------
    groups
        (n, g) shrunk terms of each group, with all that is fitted freely projected out.
    outputs
        (n, q), likewise.
    used
        Degrees of freedom that the projection took.
    """
    sizes = [group.shape[1] for group in groups]
    terms = sum(sizes)
    triangle = np.asarray(np.linalg.qr(np.hstack([*groups, outputs]), mode="r"), np.float64)
    root, loads = triangle[:terms, :terms], triangle[:terms, terms:]
    rest = np.sum(triangle[terms:, terms:] ** 2, axis=0)
    free = len(outputs) - used
    likelihood, power = np.stack(
        [
            _profile(root * np.sqrt(np.repeat([1.0 - share, share], sizes)), loads, rest, free)
            for share in _SHARES
        ],
        axis=1,
    )
    columns = np.arange(outputs.shape[1])
    best = np.argmax(likelihood.reshape(-1, len(columns)), axis=0)
    share, ratio = np.unravel_index(best, likelihood.shape[:2])
    of_second = np.asarray(_SHARES)[share]
    ratios = _RATIOS[ratio, None] * np.column_stack([1.0 - of_second, of_second])
    return VarianceRatios(ratios, power[share, ratio, columns] / free)


def _profile(terms: Floats, loads: Floats, rest: Floats, free: int) -> tuple[Floats, Floats]:
    """Return log likelihoods and sums of squares (ratios, q), for terms of one common variance."""
    values, vectors = np.linalg.eigh(terms @ terms.T)
    own = (vectors.T @ loads) ** 2
    spread = 1.0 + _RATIOS[:, None] * np.maximum(values, 0.0)
    power = np.einsum("rg,gq->rq", 1.0 / spread, own) + rest
    with np.errstate(divide="ignore"):  # an output without any noise
        likelihood = -0.5 * (np.log(spread).sum(axis=1)[:, None] + free * np.log(power))
    return likelihood, power
