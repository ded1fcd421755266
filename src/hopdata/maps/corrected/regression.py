"""The derivative of a landing map at a simultaneous contact: four estimates of it.

Ordinary least squares errs twice. Noise of the inputs pulls its coefficients towards zero (errors
in variables; Fuller 1987), and at a finite spread of the landings it is a secant of a curved map,
not its derivative. Each can be corrected, and both.

All is in the coordinates of a rigid body on a section: 8 inputs, 11 outputs
(`hopdata.maps.coordinates`).
"""

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.maps.affine import checked
from hopdata.maps.coordinates import affordable_degree, monomials, time_differences
from hopdata.maps.corrected.marker_noise import InputErrors, calibration

# Curvature of a landing map that all schedules share, as terms beside the linear ones.
#
# Where inputs carry noise, a term is replaced by what it is on average given the measured inputs
# (regression calibration; Carroll, Ruppert, Stefanski and Crainiceanu 2006, ch. 4). With one linear
# term this is the moment correction of Fuller (1987). Inputs and their errors are taken as normal.
#
# The largest second-order terms of a landing are not products of inputs but ``d |d|``, the squares
# of the times between two contacts with the sign of their order: a map that is C1 may have them.

#: Landings wanted for each term. Cubic terms of p inputs multiply the variance of a derivative by
#: 1 + (p + 2) / 2: they are worth it only where landings are many.
LANDINGS_PER_TERM = 4.0
_OUTLYING = 5.0


def mean_terms(x: FloatArray, slopes: FloatArray, degree: int, doubt: FloatArray) -> FloatArray:
    """Return the curved terms on average over what the inputs may be, (n, terms).

    Parameters
    ----------
    x
        (n, p) inputs to be expected given the measured ones, from the point of expansion.
    slopes
        (p, feet) derivatives of the contact instants, in a unit in which they are about one.
    degree
        Three and two are those of all inputs. One has second-order terms of the contact instants
        only, zero has none but the linear ones.
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


def mean_signed_square(middle: FloatArray, sd: FloatArray) -> FloatArray:
    """Return the mean of ``d |d|`` of normal d of this mean and standard deviation."""
    share, density = _normal(middle, sd)
    return np.asarray((middle**2 + sd**2) * share + 2 * middle * sd * density)


def mean_cube(middle: FloatArray, sd: FloatArray) -> FloatArray:
    """Return the mean of ``|d|^3`` of normal d of this mean and standard deviation."""
    share, density = _normal(middle, sd)
    far = (middle**3 + 3 * middle * sd**2) * share
    return np.asarray(far + 2 * sd * (middle**2 + 2 * sd**2) * density)


def contact_slopes(x: FloatArray, instants: FloatArray) -> tuple[FloatArray, FloatArray]:
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


def simultaneous_point(x: FloatArray, middle: FloatArray, slopes: FloatArray) -> FloatArray:
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
    return np.asarray(x.mean(axis=0) + spread @ slopes @ weights)


def _mean_third_order(x: FloatArray, doubt: FloatArray) -> FloatArray:
    terms = monomials(x, (3,))
    for column, (i, j, k) in enumerate(combinations_with_replacement(range(x.shape[1]), 3)):
        terms[:, column] += x[:, i] * doubt[j, k] + x[:, j] * doubt[i, k] + x[:, k] * doubt[i, j]
    return terms


def _normal(middle: FloatArray, sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return P(d > 0) - P(d < 0) and the normal density at zero, times the standard deviation."""
    from scipy.special import erf

    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sd > 0, middle / sd, np.inf * np.sign(middle))
    ratio = np.nan_to_num(ratio, nan=0.0, posinf=1e3, neginf=-1e3)
    return erf(ratio / np.sqrt(2.0)), np.exp(-0.5 * ratio**2) / np.sqrt(2.0 * np.pi)


@dataclass(frozen=True)
class LinearMap:
    """An estimate of the derivative of q outputs by p inputs.

    Attributes
    ----------
    coefficients
        (p, q).
    standard_errors
        (p, q) by the sandwich formula, leverages allowed for (MacKinnon and White 1985, HC2). The
        noise of the markers counts as known.
    degree
        Order of the curved terms beside the linear ones; 0 for none.
    removed
        Share of the noise covariance that was taken off: less than 1 where the inputs hardly vary
        more than their noise.
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
    """Fit an affine map whose inputs carry noise of known covariance.

    The coefficients are ``(Sxx - N)^-1 (Sxy - M)`` with the moments S of the data and those of the
    errors, N of the inputs and M shared with the outputs.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs.
    errors
        Their errors.
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
    """Fit the derivative where all feet are expected at once, with curvature beside it.

    The order of the curved terms is what the landings bear, or less where that is expected to err
    less.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs.
    instants
        (n, feet) measured contact instants, s.
    errors
        Errors of inputs and outputs; by default there are none.
    units
        (q,) units in which errors of the outputs count alike, by which the order of the terms is
        chosen; by default their standard deviations.
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
    highest = affordable_degree(len(x), x.shape[1], instants.shape[1], LANDINGS_PER_TERM)
    for degree in range(highest + 1):
        curved = mean_terms(moved, delays / unit, degree, doubt)
        slopes, se = _regress(moved, y - drift, curved, astray)
        fits.append(LinearMap(slopes, se, degree, known.removed))
    best = _least_error(fits, y.std(axis=0) if units is None else units)
    return replace(
        best,
        coefficients=best.coefficients / scale[:, None],
        standard_errors=best.standard_errors / scale[:, None],
    )


def _least_error(fits: list[LinearMap], units: FloatArray) -> LinearMap:
    """Return the fit of the least expected error, bias and scatter together.

    The last one has all terms and counts as unbiased. Another's bias is its distance from that,
    less what the scatter of the last one makes of it (the focused criterion of Claeskens and Hjort
    2003).

    Parameters
    ----------
    fits
        Maps of standardised inputs with more and more terms.
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
    others: FloatArray | None = None,
    astray: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of the linear terms, (p, q), and their standard errors.

    Where inputs and outputs are those expected given the measured ones, `astray` has what was taken
    off both, (n, p) and (n, q). Landings count by their measured values: so the moments that make
    the expectation are uncertain too (Fuller 1987, sec. 2.2).
    """
    rest = np.ones((len(linear), 1))
    if others is not None:
        rest = np.column_stack([rest, others])
    basis = np.linalg.qr(rest)[0]
    linear, y = (part - basis @ (basis.T @ part) for part in (linear, y))
    own, triangle = np.linalg.qr(linear)
    if np.abs(np.diag(triangle)).min() <= 1e-10 * np.abs(np.diag(triangle)).max():
        raise AnalysisError("map: expected inputs that vary apart from the curved terms")
    slopes = np.linalg.solve(triangle, own.T @ y)
    influence = np.linalg.solve(triangle, own.T)
    slack = 1.0 - np.sum(basis**2, axis=1) - np.sum(own**2, axis=1)
    residuals = (y - linear @ slopes) / np.sqrt(np.maximum(slack, 1e-3))[:, None]
    if astray is None:
        return slopes, np.sqrt(influence**2 @ residuals**2)
    lost = astray[1] - astray[0] @ slopes
    residuals, mean = residuals + lost, influence @ lost / len(lost)
    # The mean is what the corrections stand for: no scatter. Squares about it are never negative.
    square = influence**2 @ residuals**2 + mean * (len(lost) * mean - 2 * influence @ residuals)
    return slopes, np.sqrt(np.maximum(square, 0.0))


def _enough(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    x, y = checked(x, y)
    if len(x) < x.shape[1] + 2:
        raise AnalysisError(f"map: {len(x)} landings do not suffice for {x.shape[1]} inputs")
    return x, y
