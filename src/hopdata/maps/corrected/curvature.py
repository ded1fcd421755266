"""Curvature of a landing map that all schedules share, as terms beside the linear ones.

Where inputs carry noise, a term is replaced by what it is on average given the measured inputs
(regression calibration; Carroll, Ruppert, Stefanski and Crainiceanu 2006, ch. 4). With one linear
term this is the moment correction of Fuller (1987). Inputs and their errors are taken as normal.

The largest second-order terms of a landing are not products of inputs but ``d |d|``, the squares of
the times between two contacts with the sign of their order: a map that is C1 may have them.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.verdict.kinks import time_differences
from hopdata.maps.verdict.smooth import monomials, number_of_free_terms

#: Landings wanted for each term. Cubic terms of p inputs multiply the variance of a derivative by
#: 1 + (p + 2) / 2: they are worth it only where landings are many.
LANDINGS_PER_TERM = 4.0
_OUTLYING = 5.0

Floats = NDArray[np.float64]


def affordable_degree(landings: int, n_inputs: int, n_feet: int) -> int:
    """Return the order of the terms that so many landings can bear: 3, 2, 1 or 0.

    Three and two are those of all inputs. One has second-order terms of the contact instants only,
    zero has none but the linear ones.
    """
    for degree in (3, 2):
        if landings >= LANDINGS_PER_TERM * number_of_free_terms(n_inputs, n_feet, degree):
            return degree
    few = 1 + n_inputs + n_feet * (n_feet - 1)
    return 1 if landings >= LANDINGS_PER_TERM * few else 0


def mean_terms(x: Floats, slopes: Floats, degree: int, doubt: Floats) -> Floats:
    """Return the curved terms on average over what the inputs may be, (n, terms).

    Parameters
    ----------
    x
        (n, p) inputs to be expected given the measured ones, from the point of expansion.
    slopes
        (p, feet) derivatives of the contact instants, in a unit in which they are about one.
    degree
        See `affordable_degree`.
    doubt
        (p, p) covariance of the inputs given the measured ones.
    """
    if degree == 0:
        return np.empty((len(x), 0))
    instants = x @ slopes
    d, steps = time_differences(instants), time_differences(slopes)
    sd = np.sqrt(np.maximum(np.einsum("pk,pr,rk->k", steps, doubt, steps), 0.0))
    if degree == 1:
        u = instants[:, :-1] - instants[:, -1:]
        return np.column_stack([monomials(u, (2,)), mean_signed_square(d, sd)])
    blocks = [monomials(x, (2,)), mean_signed_square(d, sd), mean_cube(d, sd)]
    if degree == 3:
        blocks.append(_mean_third_order(x, doubt))
    return np.column_stack(blocks)


def mean_signed_square(middle: Floats, sd: Floats) -> Floats:
    """Return the mean of ``d |d|`` of normal d of this mean and standard deviation."""
    share, density = _normal(middle, sd)
    values: Floats = (middle**2 + sd**2) * share + 2 * middle * sd * density
    return values


def mean_cube(middle: Floats, sd: Floats) -> Floats:
    """Return the mean of ``|d|^3`` of normal d of this mean and standard deviation."""
    share, density = _normal(middle, sd)
    values: Floats = (middle**3 + 3 * middle * sd**2) * share
    return values + 2 * sd * (middle**2 + 2 * sd**2) * density


def contact_slopes(x: Floats, instants: Floats) -> tuple[Floats, Floats]:
    """Return the contact instants at the mean input, (feet,), and their derivatives (p, feet).

    Relative to the mean of all feet. Linear in the inputs: what they are beyond that changes the
    second-order terms of the map only in third order. Landings whose instants lie far off are left
    out of the fit.

    Parameters
    ----------
    x
        (n, p) inputs.
    instants
        (n, feet) measured contact instants.
    """
    times = instants - instants.mean(axis=1, keepdims=True)
    design = np.column_stack([np.ones(len(x)), x - x.mean(axis=0)])
    good = np.ones(len(x), dtype=bool)
    for _ in range(2):
        fitted = np.linalg.lstsq(design[good], times[good], rcond=None)[0]
        miss = np.abs(times - design @ fitted).max(axis=1)
        good = miss <= _OUTLYING * 1.4826 * np.median(miss[good])
    return fitted[0], fitted[1:]


def simultaneous_point(x: Floats, middle: Floats, slopes: Floats) -> Floats:
    """Return the input (p,) nearest to the mean at which all contacts are expected at once.

    Nearest by the covariance of the inputs.

    Parameters
    ----------
    x
        (n, p) inputs.
    middle, slopes
        Contact instants at their mean, and their derivatives: see `contact_slopes`.
    """
    spread = np.cov(x, rowvar=False)
    weights = np.linalg.lstsq(slopes.T @ spread @ slopes, -middle, rcond=1e-8)[0]
    point: Floats = x.mean(axis=0) + spread @ slopes @ weights
    return point


def _mean_third_order(x: Floats, doubt: Floats) -> Floats:
    terms = monomials(x, (3,))
    for column, (i, j, k) in enumerate(combinations_with_replacement(range(x.shape[1]), 3)):
        terms[:, column] += x[:, i] * doubt[j, k] + x[:, j] * doubt[i, k] + x[:, k] * doubt[i, j]
    return terms


def _normal(middle: Floats, sd: Floats) -> tuple[Floats, Floats]:
    """Return P(d > 0) - P(d < 0) and the normal density at zero, times the standard deviation."""
    from scipy.special import erf

    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sd > 0, middle / sd, np.inf * np.sign(middle))
    ratio = np.nan_to_num(ratio, nan=0.0, posinf=1e3, neginf=-1e3)
    return erf(ratio / np.sqrt(2.0)), np.exp(-0.5 * ratio**2) / np.sqrt(2.0 * np.pi)
