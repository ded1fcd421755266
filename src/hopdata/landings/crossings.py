"""Fitted tracks where the mean height of the markers passes a section, with standard errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.coefficients import Coefficients
from hopdata.landings.marker_tracks import Moments, turned

FloatArray = NDArray[np.float64]

NEWTON_STEPS = 8
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class SectionStates:
    """States of B body markers at L crossings of a section, in the world; NaN where not determined.

    Parameters
    ----------
    time : (L,) array
        Instants at which the mean height of the fitted markers equals the section's, s.
    position, velocity : (L, B, 3) array
        Positions, m, and velocities, m/s.
    position_covariance, velocity_covariance : (L, B, 3, 3) array
        Covariance of the errors of each marker, m^2 and m^2/s^2. The error of the instant is in
        them: the mean height is that of the section, whatever the noise.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    position_covariance: FloatArray
    velocity_covariance: FloatArray


def cross(sums: Moments, fit: Coefficients, near: FloatArray, height_m: float) -> SectionStates:
    """Evaluate polynomials at the instant at which the mean height is that of the section.

    Parameters
    ----------
    sums : Moments
        What was fitted, about `near`.
    fit : Coefficients
        Of K powers.
    near : (L,) array
        Instants at which u is zero, s.
    height_m : float
        Height of the section, m.

    Returns
    -------
    SectionStates
    """
    coefficients = _whole(sums, fit.mean)
    u = _instants(coefficients[:, :, 2].mean(axis=1), height_m)
    place, speed, bend = (
        (coefficients * _powers(u, coefficients.shape[-1], order)[:, None, None]).sum(axis=3)
        / sums.scale**order
        for order in range(3)
    )
    errors = _errors(fit.covariance, u, sums.scale)
    covariances = (
        _with_instant(errors, motion, speed[..., 2].mean(axis=1), of)
        for of, motion in ((0, speed), (1, bend))
    )
    return SectionStates(
        near + u * sums.scale,
        turned(place, sums.direction, back=True),
        turned(speed, sums.direction, back=True),
        *(turned_covariance(c, sums.direction, back=True) for c in covariances),
    )


def turned_covariance(
    covariance: FloatArray, direction: FloatArray, *, back: bool = False
) -> FloatArray:
    """Turn covariances (L, B, 3, 3) into frames with these x axes (L, 2), or back."""
    once = turned(covariance, direction, back=back)
    return turned(np.swapaxes(once, 2, 3), direction, back=back)


def _whole(sums: Moments, fitted: FloatArray) -> FloatArray:
    """Put back what was taken off before the fit, (L, B, 3, K') with K' of at least three."""
    terms = max(fitted.shape[-1], 3)
    whole = np.concatenate([fitted, np.zeros((*fitted.shape[:3], terms - fitted.shape[3]))], axis=3)
    whole[..., 0] += sums.centre
    whole[:, :, 2, 2] += sums.fall
    return whole


def _powers(u: FloatArray, terms: int, order: int) -> FloatArray:
    """Return the derivatives of an order of the powers 1, u, ..., (L, terms)."""
    columns = np.zeros((len(u), terms))
    for k in range(order, terms):
        factor = float(np.prod(np.arange(k - order + 1, k + 1)))
        columns[:, k] = factor * u ** (k - order)
    return columns


def _instants(mean: FloatArray, height_m: float) -> FloatArray:
    """Scaled times (L,) at which polynomials (L, K) have a value; NaN beyond the window."""
    u = np.zeros(len(mean))
    for _ in range(NEWTON_STEPS):
        miss = (mean * _powers(u, mean.shape[1], 0)).sum(axis=1) - height_m
        slope = (mean * _powers(u, mean.shape[1], 1)).sum(axis=1)
        u = u - miss / np.where(slope == 0, np.nan, slope)
        u = np.where(np.abs(u) <= 1.0, u, np.nan)
    return u


def _errors(covariance: FloatArray, u: FloatArray, scale: float) -> FloatArray:
    """Covariance (2, 2, L, B, 3) of place and velocity of each coordinate at given u."""
    terms = covariance.shape[-1]
    rows = np.stack([_powers(u, terms, order) / scale**order for order in (0, 1)])
    found: FloatArray = np.einsum("olk,lbckj,plj->oplbc", rows, covariance, rows, optimize=True)
    return found


def _with_instant(
    errors: FloatArray, motion: FloatArray, sinking: FloatArray, of: int
) -> FloatArray:
    """Covariances (L, B, 3, 3) with what an error of the mean height moves along the track."""
    markers = motion.shape[1]
    along = -motion / sinking[:, None, None]
    height = errors[0, 0, :, :, 2].sum(axis=1) / markers**2
    shared = errors[of, 0, :, :, 2] / markers
    own = errors[of, of][..., None] * np.eye(3)
    moved = along[..., None] * along[..., None, :] * height[:, None, None, None]
    mixed = shared[..., None, None] * along[..., None] * UP
    whole: FloatArray = own + moved + mixed + np.swapaxes(mixed, 2, 3)
    return whole
