"""What the smooth terms leave of the outputs, and how to shuffle it without moving its spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import free_terms
from hopdata.maps.verdict.estimate import KinkFit

#: Landings of similar contact spread that may change places, at least.
STRATUM = 40


@dataclass(frozen=True)
class Residuals:
    """Landings of one window after the shared smooth terms, n landings.

    Attributes
    ----------
    basis
        (n, terms) orthonormal basis of the smooth terms.
    values
        (n, q) outputs with the smooth terms projected out, in units of their own rms.
    inputs
        (n, p) inputs, standardised in the window.
    linear
        (p, q) the smooth terms' linear part in the units of `inputs` and `values`.
    strata
        (n,) number of the stratum of contact spread of each landing.
    """

    basis: FloatArray
    values: FloatArray
    inputs: FloatArray
    linear: FloatArray
    strata: NDArray[np.int64]


def smooth_residuals(fit: KinkFit, x: FloatArray, y: FloatArray, instants: FloatArray) -> Residuals:
    """Project the smooth terms of a fit out of its landings.

    Parameters
    ----------
    fit
        Kinks of the chosen window.
    x, y, instants
        As given to `hopdata.maps.verdict.estimate.fit_kinks`.
    """
    inputs = x[fit.rows] - x[fit.rows].mean(axis=0)
    scale = inputs.std(axis=0)
    times = instants[fit.rows] / fit.largest_spread_s
    free = free_terms(inputs / scale, times, fit.degree)
    basis = np.linalg.qr(free)[0]
    values = y[fit.rows] - basis @ (basis.T @ y[fit.rows])
    rms = np.sqrt(np.mean(values**2, axis=0))
    spread = times.std(axis=1)
    number = max(1, len(spread) // STRATUM)
    strata = np.argsort(np.argsort(spread, kind="stable")) * number // len(spread)
    linear = fit.linear * scale[:, None] / rms
    return Residuals(basis, values / rms, inputs / scale, linear, strata)


def shuffled(
    strata: NDArray[np.int64], count: int, generator: np.random.Generator
) -> NDArray[np.int64]:
    """Return `count` random permutations (count, n) of the rows within their strata."""
    keys = generator.random((count, len(strata))) + strata
    home = np.argsort(strata, kind="stable")
    orders = np.argsort(keys, axis=1)
    permutations = np.empty_like(orders)
    permutations[:, home] = orders
    return permutations
