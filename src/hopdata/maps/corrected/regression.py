"""Four estimates of the derivative of a landing map at a simultaneous contact.

Ordinary least squares has two errors. Noise in the inputs pulls its coefficients
towards zero (errors in variables; Fuller 1987). And because the landings have a finite
spread, it estimates a secant of a curved map, not the derivative. Either error can be
corrected, or both.

All estimates use the coordinates of a rigid body on a section, 8 inputs and 11 outputs
(`hopdata.maps.coordinates`).
"""

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from math import erf

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.maps.affine import checked
from hopdata.maps.coordinates import affordable_degree, monomials, time_differences
from hopdata.maps.corrected.marker_noise import InputErrors, calibration

# Curved terms: the curvature of a landing map that all schedules share.
#
# If the inputs are noisy, a term is replaced by its mean given the measured inputs
# (regression calibration; Carroll, Ruppert, Stefanski and Crainiceanu 2006, ch. 4). For
# a single linear term this is the moment correction of Fuller (1987). Inputs and their
# errors are assumed to be normal.
#
# The largest second-order terms of a landing are not products of inputs but ``d |d|``,
# the squared times between two contacts with the sign of their order. A C1 map may have
# them.

#: Number of landings required for each term. Cubic terms of p inputs multiply the
#: variance of a derivative by 1 + (p + 2) / 2, so they pay off only with many landings.
LANDINGS_PER_TERM = 4.0
_OUTLYING = 5.0  # robust standard deviations beyond which contact instants are left out


def mean_terms(
    x: FloatArray, slopes: FloatArray, degree: int, doubt: FloatArray
) -> FloatArray:
    """Return the means of the curved terms over the distribution of the true inputs, (n, terms).

    Parameters
    ----------
    x
        (n, p) expected inputs given the measured ones, relative to the point of
        expansion.
    slopes
        (p, feet) derivatives of the contact instants, in a unit in which they are about
        one.
    degree
        Order of the terms. Two and three include those of all inputs; one has only
        second-order terms of the contact instants; zero has no curved terms.
    doubt
        (p, p) covariance of the true inputs given the measured ones.
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


def mean_signed_square(middle: FloatArray, sd: FloatArray) -> FloatArray:
    """Return the mean of ``d |d|`` for normal d with this mean and standard deviation."""
    share, density = _normal(middle, sd)
    return np.asarray((middle**2 + sd**2) * share + 2 * middle * sd * density)


def mean_cube(middle: FloatArray, sd: FloatArray) -> FloatArray:
    """Return the mean of ``|d|^3`` for normal d with this mean and standard deviation."""
    share, density = _normal(middle, sd)
    far = (middle**3 + 3 * middle * sd**2) * share
    return np.asarray(far + 2 * sd * (middle**2 + 2 * sd**2) * density)


def contact_slopes(
    x: FloatArray, instants: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the contact instants at the mean input, (feet,), and their derivatives (p, feet).

    Instants are relative to the mean over all feet and fitted as linear functions of
    the inputs; their higher orders change the second-order terms of the map only in
    third order. Landings with outlying instants are left out of the fit.

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


def simultaneous_point(
    x: FloatArray, middle: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Return the input (p,) nearest to the mean at which all contacts are expected at once.

    The distance is measured by the covariance of the inputs (Mahalanobis).

    Parameters
    ----------
    x
        (n, p) inputs.
    middle, slopes
        Contact instants at the mean input, and their derivatives: see `contact_slopes`.
    """
    spread = np.cov(x, rowvar=False)
    weights = np.linalg.lstsq(slopes.T @ spread @ slopes, -middle, rcond=1e-8)[0]
    return np.asarray(x.mean(axis=0) + spread @ slopes @ weights)


def _mean_third_order(x: FloatArray, doubt: FloatArray) -> FloatArray:
    terms = monomials(x, (3,))
    for column, (i, j, k) in enumerate(
        combinations_with_replacement(range(x.shape[1]), 3)
    ):
        terms[:, column] += (
            x[:, i] * doubt[j, k] + x[:, j] * doubt[i, k] + x[:, k] * doubt[i, j]
        )
    return terms


def _normal(middle: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return P(d > 0) - P(d < 0), and the standard deviation times the normal density at zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sd > 0, middle / sd, np.inf * np.sign(middle))
    ratio = np.nan_to_num(ratio, nan=0.0, posinf=1e3, neginf=-1e3)
    # Loading `scipy.special` takes a hundred times as long as this.
    share = np.vectorize(erf, otypes=[float])(ratio / np.sqrt(2.0))
    return share, np.exp(-0.5 * ratio**2) / np.sqrt(2.0 * np.pi)


@dataclass(frozen=True)
class LinearMap:
    """An estimate of the derivative of q outputs with respect to p inputs.

    Attributes
    ----------
    coefficients
        (p, q) derivatives.
    standard_errors
        (p, q) by the sandwich formula with a correction for leverage (MacKinnon and
        White 1985, HC2). The noise of the markers is treated as known.
    degree
        Order of the curved terms in the fit, see `mean_terms`; 0 if there are none.
    removed
        Share of the noise covariance that was subtracted: less than 1 if the inputs
        hardly vary more than their noise.
    """

    coefficients: FloatArray
    standard_errors: FloatArray
    degree: int = 0
    removed: float = 0.0


def ols_map(x: FloatArray, y: FloatArray) -> LinearMap:
    """Fit an affine map by ordinary least squares.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs.
    """
    x, y = _enough(x, y)
    return LinearMap(*_regress(x - x.mean(axis=0), y))


def corrected_map(x: FloatArray, y: FloatArray, errors: InputErrors) -> LinearMap:
    """Fit an affine map whose inputs have noise of known covariance.

    The coefficients are ``(Sxx - N)^-1 (Sxy - M)``, where S are covariances of the
    data, N is the covariance of the inputs' errors and M that between the errors of
    inputs and outputs.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs.
    errors
        Covariances of their errors.
    """
    x, y = _enough(x, y)
    known = calibration(x, errors)
    centred = x - x.mean(axis=0)
    inputs, drift = centred @ known.slopes, centred @ known.drift
    slopes, se = _regress(inputs, y - drift, astray=(centred - inputs, drift))
    return LinearMap(slopes, se, removed=known.removed)


def curved_map(
    x: FloatArray,
    y: FloatArray,
    instants: FloatArray,
    errors: InputErrors | None = None,
    *,
    units: FloatArray | None = None,
) -> LinearMap:
    """Fit the derivative at the simultaneous contact, together with curved terms.

    The order of the curved terms is the highest that the landings allow, or a lower one
    with a smaller expected error.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs.
    instants
        (n, feet) measured contact instants, s.
    errors
        Covariances of the errors of inputs and outputs; by default zero.
    units
        (q,) units in which errors of the outputs have equal weight when the order of
        the terms is chosen; by default the standard deviations of the outputs.
    """
    x, y = _enough(x, y)
    if not np.ptp(instants - instants.mean(axis=1, keepdims=True), axis=0).any():
        raise AnalysisError("curved map: expected contact instants that differ")
    errors = errors or InputErrors.none(x.shape[1], y.shape[1])
    known, centred = calibration(x, errors), x - x.mean(axis=0)
    scale = x.std(axis=0)
    inputs, drift = centred @ known.slopes / scale, centred @ known.drift
    middle, delays = contact_slopes(inputs, instants)
    unit = float((inputs @ delays).std(axis=1).max())
    moved = inputs - simultaneous_point(inputs, middle, delays)
    doubt = known.doubt / scale[:, None] / scale
    astray = (centred / scale - inputs, drift)
    fits = []
    highest = affordable_degree(
        len(x), x.shape[1], instants.shape[1], LANDINGS_PER_TERM
    )
    for degree in range(highest + 1):
        curved = mean_terms(moved, delays / unit, degree, doubt)
        slopes, se = _regress(moved, y - drift, (curved,), astray)
        fits.append(LinearMap(slopes, se, degree, known.removed))
    best = _least_error(fits, y.std(axis=0) if units is None else units)
    found, se = (
        one / scale[:, None] for one in (best.coefficients, best.standard_errors)
    )
    return replace(best, coefficients=found, standard_errors=se)


def _least_error(fits: list[LinearMap], units: FloatArray) -> LinearMap:
    """Return the fit with the least expected squared error, the sum of bias and scatter.

    The last fit has all terms and counts as unbiased. The squared bias of another fit
    is its squared distance from the last one, less the part that the scatter of the
    last one explains (the focused criterion of Claeskens and Hjort 2003).

    Parameters
    ----------
    fits
        Maps of standardised inputs, in order of increasing numbers of terms.
    units
        (q,) units of the outputs.
    """
    units = np.where(units > 0, units, np.inf)
    scatter = [float(np.sum((fit.standard_errors / units) ** 2)) for fit in fits]
    errors = []
    for fit, own in zip(fits, scatter, strict=True):
        apart = float(np.sum(((fit.coefficients - fits[-1].coefficients) / units) ** 2))
        errors.append(own + max(apart - (scatter[-1] - own), 0.0))
    return fits[int(np.argmin(errors))]


def _regress(
    linear: FloatArray,
    y: FloatArray,
    others: tuple[FloatArray, ...] = (),
    astray: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of the linear terms, (p, q), and their standard errors.

    If inputs and outputs are the values expected given the measured ones, `astray` has
    the corrections that were subtracted from both, (n, p) and (n, q). The standard
    errors then use the measured values, so they include the uncertainty of the moments
    behind the corrections (Fuller 1987, sec. 2.2).
    """
    basis = np.linalg.qr(np.column_stack([np.ones(len(linear)), *others]))[0]
    linear, y = (part - basis @ (basis.T @ part) for part in (linear, y))
    own, triangle = np.linalg.qr(linear)
    if np.abs(np.diag(triangle)).min() <= 1e-10 * np.abs(np.diag(triangle)).max():
        raise AnalysisError(
            "map: expected inputs that vary apart from the curved terms"
        )
    slopes = np.linalg.solve(triangle, own.T @ y)
    influence = np.linalg.solve(triangle, own.T)
    slack = 1.0 - np.sum(basis**2, axis=1) - np.sum(own**2, axis=1)
    residuals = (y - linear @ slopes) / np.sqrt(np.maximum(slack, 1e-3))[:, None]
    if astray is None:
        return slopes, np.sqrt(influence**2 @ residuals**2)
    lost = astray[1] - astray[0] @ slopes
    residuals, mean = residuals + lost, influence @ lost / len(lost)
    # The corrections' mean contribution is not scatter, so squares are taken about it.
    # Except for rounding they are never negative.
    square = influence**2 @ residuals**2 + mean * (
        len(lost) * mean - 2 * influence @ residuals
    )
    return slopes, np.sqrt(np.maximum(square, 0.0))


def _enough(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    x, y = checked(x, y)
    if len(x) < x.shape[1] + 2:
        raise AnalysisError(
            f"map: {len(x)} landings do not suffice for {x.shape[1]} inputs"
        )
    return x, y
