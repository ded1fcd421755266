"""The derivative of a landing map at a simultaneous contact: four estimates of it.

Ordinary least squares errs twice. Noise of the inputs pulls its coefficients towards zero (errors
in variables; Fuller 1987), and at a finite spread of the landings it is a secant of a curved map,
not its derivative. Each can be corrected, and both.

All is in the coordinates of a rigid body on a section: 8 inputs, 11 outputs (`hopdata.maps.rigid`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.maps.corrected.calibration import calibration
from hopdata.maps.corrected.curvature import (
    affordable_degree,
    contact_slopes,
    mean_terms,
    simultaneous_point,
)
from hopdata.maps.corrected.marker_noise import InputErrors
from hopdata.maps.linear.affine import checked

Floats = NDArray[np.float64]


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

    coefficients: Floats
    standard_errors: Floats
    degree: int = 0
    removed: float = 0.0


def ols_map(x: Floats, y: Floats) -> LinearMap:
    """Fit an affine map by ordinary least squares.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs.
    """
    x, y = _enough(x, y)
    return LinearMap(*_regress(x - x.mean(axis=0), y))


def corrected_map(x: Floats, y: Floats, errors: InputErrors) -> LinearMap:
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
    x: Floats,
    y: Floats,
    instants: Floats,
    errors: InputErrors | None = None,
    *,
    units: Floats | None = None,
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
    if len(instants) != len(x) or not np.isfinite(instants).all():
        raise ValueError(f"instants: expected finite ones for {len(x)} landings")
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
    for degree in range(affordable_degree(len(x), x.shape[1], instants.shape[1]) + 1):
        curved = mean_terms(moved, delays / unit, degree, doubt)
        slopes, se = _regress(moved, y - drift, curved, astray)
        fits.append(LinearMap(slopes, se, degree, known.removed))
    best = _least_error(fits, y.std(axis=0) if units is None else units)
    return replace(
        best,
        coefficients=best.coefficients / scale[:, None],
        standard_errors=best.standard_errors / scale[:, None],
    )


def _least_error(fits: list[LinearMap], units: Floats) -> LinearMap:
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
    linear: Floats,
    y: Floats,
    others: Floats | None = None,
    astray: tuple[Floats, Floats] | None = None,
) -> tuple[Floats, Floats]:
    """Return the coefficients of the linear terms, (p, q), and their standard errors.

    Where inputs and outputs are those expected given the measured ones, `astray` has what was taken
    off both, (n, p) and (n, q). Landings count by their measured values: so the moments that make
    the expectation are uncertain too (Fuller 1987, sec. 2.2).
    """
    rest = np.ones((len(linear), 1))
    if others is not None:
        rest = np.column_stack([rest, others])
    basis: Floats = np.linalg.qr(rest)[0]
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
    bias = influence @ lost  # what the corrections stand for: no scatter
    residuals = residuals + lost
    square = influence**2 @ residuals**2 - bias**2 / len(residuals)
    return slopes, np.sqrt(np.maximum(square, 0.0))


def _enough(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    x, y = checked(x, y)
    if len(x) < x.shape[1] + 2:
        raise AnalysisError(f"map: {len(x)} landings do not suffice for {x.shape[1]} inputs")
    return x, y
