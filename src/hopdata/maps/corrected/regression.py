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

from hopdata.arrays import SD_PER_MAD, FloatArray
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
#: Unit: landings. Origin: chosen.
LANDINGS_PER_TERM = 4.0

#: Contact instants farther from the fit than this are left out of it.
#: Unit: robust standard deviations. Origin: chosen.
OUTLYING = 5.0

#: Columns whose rest is at or below this share of the largest do not vary apart from
#: the curved terms.
#: Unit: 1. Origin: chosen.
FLAT = 1e-10

#: Least slack of a landing (one minus its leverage) by which a residual is divided.
#: Unit: 1. Origin: chosen.
LEAST_SLACK = 1e-3


def mean_terms(
    x: FloatArray, slopes: FloatArray, degree: int, doubt: FloatArray
) -> FloatArray:
    """Return the means of the curved terms over the true inputs, (n, terms).

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
    d = time_differences(instants)
    slopes_of_d = time_differences(slopes)
    variance = np.einsum("pk,pr,rk->k", slopes_of_d, doubt, slopes_of_d)
    sd = np.sqrt(np.maximum(variance, 0.0))
    if degree == 1:
        after_last_foot = instants[:, :-1] - instants[:, -1:]
        squares = monomials(after_last_foot, (2,))
        return np.column_stack([squares, mean_signed_square(d, sd)])
    terms = [monomials(x, (2,)), mean_signed_square(d, sd), mean_cube(d, sd)]
    if degree == 3:
        terms.append(_mean_third_order(x, doubt))
    return np.column_stack(terms)


def mean_signed_square(middle: FloatArray, sd: FloatArray) -> FloatArray:
    """Return the mean of ``d |d|`` for normal d with this mean and sd."""
    share, density = _normal(middle, sd)
    return np.asarray((middle**2 + sd**2) * share + 2 * middle * sd * density)


def mean_cube(middle: FloatArray, sd: FloatArray) -> FloatArray:
    """Return the mean of ``|d|^3`` for normal d with this mean and sd."""
    share, density = _normal(middle, sd)
    far = (middle**3 + 3 * middle * sd**2) * share
    return np.asarray(far + 2 * sd * (middle**2 + 2 * sd**2) * density)


def contact_slopes(
    x: FloatArray, instants: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return contact instants at the mean input, (feet,), and derivatives (p, feet).

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
    for _ in range(2):  # with all landings, then without the outlying ones
        fitted = np.linalg.lstsq(design[good], times[good], rcond=None)[0]
        miss = np.abs(times - design @ fitted).max(axis=1)
        good = miss <= OUTLYING * SD_PER_MAD * np.median(miss[good])
    return fitted[0], fitted[1:]


def simultaneous_point(
    x: FloatArray, middle: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Return the input (p,) nearest to the mean at which all contacts coincide.

    The distance is measured by the covariance of the inputs (Mahalanobis).

    Parameters
    ----------
    x
        (n, p) inputs.
    middle, slopes
        Contact instants at the mean input, and their derivatives: see `contact_slopes`.
    """
    covariance = np.cov(x, rowvar=False)
    of_instants = slopes.T @ covariance @ slopes
    # The instants are relative to their mean, so their covariance is singular.
    multipliers = np.linalg.lstsq(of_instants, -middle, rcond=1e-8)[0]
    return np.asarray(x.mean(axis=0) + covariance @ slopes @ multipliers)


def _mean_third_order(x: FloatArray, doubt: FloatArray) -> FloatArray:
    """Return the means of products of three normal inputs with expected values x."""
    terms = monomials(x, (3,))
    triples = combinations_with_replacement(range(x.shape[1]), 3)
    for column, (i, j, k) in enumerate(triples):
        terms[:, column] += (
            x[:, i] * doubt[j, k] + x[:, j] * doubt[i, k] + x[:, k] * doubt[i, j]
        )
    return terms


def _normal(middle: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return P(d > 0) - P(d < 0), and the sd times the normal density at zero."""
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
    expected_inputs = centred @ known.slopes
    drift = centred @ known.drift
    corrections = (centred - expected_inputs, drift)
    slopes, standard_errors = _regress(
        expected_inputs, y - drift, corrections=corrections
    )
    return LinearMap(slopes, standard_errors, removed=known.removed)


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
    if errors is None:
        errors = InputErrors.none(x.shape[1], y.shape[1])
    if units is None:
        units = y.std(axis=0)

    # Inputs expected given the measured ones, in units of their standard deviations.
    known = calibration(x, errors)
    centred = x - x.mean(axis=0)
    scale = x.std(axis=0)
    inputs = centred @ known.slopes / scale
    drift = centred @ known.drift
    doubt = known.doubt / scale[:, None] / scale
    corrections = (centred / scale - inputs, drift)

    # Curved terms are about the simultaneous contact.
    middle, delays = contact_slopes(inputs, instants)
    time_unit = float((inputs @ delays).std(axis=1).max())
    deviations = inputs - simultaneous_point(inputs, middle, delays)

    highest = affordable_degree(
        len(x), x.shape[1], instants.shape[1], LANDINGS_PER_TERM
    )
    fits = []
    for degree in range(highest + 1):
        curved = mean_terms(deviations, delays / time_unit, degree, doubt)
        slopes, standard_errors = _regress(
            deviations, y - drift, curved=curved, corrections=corrections
        )
        fits.append(LinearMap(slopes, standard_errors, degree, known.removed))
    best = _least_error(fits, units)
    return replace(
        best,
        coefficients=best.coefficients / scale[:, None],
        standard_errors=best.standard_errors / scale[:, None],
    )


def _least_error(fits: list[LinearMap], units: FloatArray) -> LinearMap:
    """Return the fit with the least expected squared error, bias and scatter together.

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
    weighed = np.where(
        units > 0, units, np.inf
    )  # outputs that do not vary do not count
    unbiased = fits[-1]
    unbiased_scatter = float(np.sum((unbiased.standard_errors / weighed) ** 2))
    errors = []
    for fit in fits:
        scatter = float(np.sum((fit.standard_errors / weighed) ** 2))
        distance = (fit.coefficients - unbiased.coefficients) / weighed
        squared_distance = float(np.sum(distance**2))
        squared_bias = max(squared_distance - (unbiased_scatter - scatter), 0.0)
        errors.append(scatter + squared_bias)
    return fits[int(np.argmin(errors))]


def _regress(
    linear: FloatArray,
    y: FloatArray,
    *,
    curved: FloatArray | None = None,
    corrections: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of the linear terms, (p, q), and their standard errors.

    The `curved` terms (n, terms) are fitted beside them. If inputs and outputs are the
    values expected given the measured ones, `corrections` has what was subtracted from
    both, (n, p) and (n, q). The standard errors then use the measured values, so they
    include the uncertainty of the moments behind the corrections (Fuller 1987, sec.
    2.2).
    """
    others = [np.ones(len(linear))]
    if curved is not None:
        others.append(curved)
    basis, _ = np.linalg.qr(np.column_stack(others))
    inputs = linear - basis @ (basis.T @ linear)
    outputs = y - basis @ (basis.T @ y)
    own, triangle = np.linalg.qr(inputs)
    rests = np.abs(np.diag(triangle))
    if rests.min() <= FLAT * rests.max():
        raise AnalysisError(
            "map: expected inputs that vary apart from the curved terms"
        )
    slopes = np.linalg.solve(triangle, own.T @ outputs)
    influence = np.linalg.solve(triangle, own.T)
    slack = 1.0 - np.sum(basis**2, axis=1) - np.sum(own**2, axis=1)
    scaling = np.sqrt(np.maximum(slack, LEAST_SLACK))
    residuals = (outputs - inputs @ slopes) / scaling[:, None]
    if corrections is None:
        return slopes, np.sqrt(influence**2 @ residuals**2)

    of_inputs, of_outputs = corrections
    lost = of_outputs - of_inputs @ slopes
    measured = residuals + lost
    mean = influence @ lost / len(lost)
    # The corrections' mean contribution is not scatter, so squares are taken about it.
    # Except for rounding they are never negative.
    about_mean = mean * (len(lost) * mean - 2 * influence @ measured)
    square = influence**2 @ measured**2 + about_mean
    return slopes, np.sqrt(np.maximum(square, 0.0))


def _enough(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both as arrays, if there are landings enough for an affine map."""
    x, y = checked(x, y)
    if len(x) < x.shape[1] + 2:
        raise AnalysisError(
            f"map: {len(x)} landings do not suffice for {x.shape[1]} inputs"
        )
    return x, y
