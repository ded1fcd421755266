"""Fitted tracks where the mean height of the markers crosses a section, with errors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.landings.states.coefficients import Coefficients
from hopdata.landings.states.tracks import Moments, turned

#: Steps of Newton's method for the instant of a crossing.
#: Unit: 1. Origin: chosen.
NEWTON_STEPS = 8

UP = np.array([0.0, 0.0, 1.0])

Fitted = tuple[Moments, Coefficients]


@dataclass(frozen=True)
class InstantStates:
    """States of B markers at L instants, in the world; NaN where not determined.

    Parameters
    ----------
    position, velocity : (L, B, 3) array
        Positions, m, and velocities, m/s.
    covariance : (L, B, 3, 3) array
        Covariance of the errors of each position at the instant as it stands, m^2.
    """

    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class SectionStates:
    """States of B body markers at L crossings of a section, in the world.

    All are NaN where they are not determined.

    Parameters
    ----------
    time, time_se : (L,) array
        Instants at which the mean height of the fitted markers equals the section's,
        and their standard errors, s.
    position, velocity : (L, B, 3) array
        Positions, m, and velocities, m/s.
    position_covariance, velocity_covariance : (L, B, 3, 3) array
        Covariance of the errors of each marker, m^2 and m^2/s^2. It includes the error
        of the instant: the mean height equals that of the section for any noise.
    """

    time: FloatArray
    time_se: FloatArray
    position: FloatArray
    velocity: FloatArray
    position_covariance: FloatArray
    velocity_covariance: FloatArray


Block = TypeVar("Block", InstantStates, SectionStates)


def cross(parts: Iterable[Fitted], near: FloatArray, height_m: float) -> SectionStates:
    """Evaluate polynomials when the mean height is that of the section.

    Parameters
    ----------
    parts : iterable of (Moments, Coefficients)
        Moments about `near`, and the fit, for each block of landings.
    near : (L,) array
        Instants at which u is zero, s.
    height_m : float
        Height of the section, m.

    Returns
    -------
    SectionStates
    """
    return _joined([_cross(sums, fit, near, height_m) for sums, fit in parts])


def at_instants(parts: Iterable[Fitted]) -> InstantStates:
    """Evaluate polynomials at the instants of their windows, where u is zero."""
    return _joined([_at_instants(sums, fit) for sums, fit in parts])


def _joined(blocks: list[Block]) -> Block:
    """Join blocks of states."""
    arrays = {}
    for field in fields(blocks[0]):
        arrays[field.name] = np.concatenate(
            [getattr(block, field.name) for block in blocks]
        )
    return type(blocks[0])(**arrays)


def _at_instants(sums: Moments, fit: Coefficients) -> InstantStates:
    """Evaluate the polynomials of one block at the instants of its windows."""
    coefficients = _whole(sums, fit.mean)
    errors = fit.covariance[..., 0, 0, None] * np.eye(3)
    return InstantStates(
        position=turned(coefficients[..., 0], sums.direction, back=True),
        velocity=turned(coefficients[..., 1] / sums.scale, sums.direction, back=True),
        covariance=_turned_back(errors, sums.direction),
    )


def _cross(
    sums: Moments, fit: Coefficients, near: FloatArray, height_m: float
) -> SectionStates:
    """Evaluate the polynomials of one block."""
    coefficients = _whole(sums, fit.mean)
    u = _instants(coefficients[:, :, 2].mean(axis=1), height_m)
    place = _derivative(coefficients, u, sums.scale, order=0)
    speed = _derivative(coefficients, u, sums.scale, order=1)
    acceleration = _derivative(coefficients, u, sums.scale, order=2)
    errors = _errors(fit.covariance, u, sums.scale)
    sinking = speed[..., 2].mean(axis=1)
    of_place = _with_instant(errors, speed, sinking, order=0)
    of_speed = _with_instant(errors, acceleration, sinking, order=1)
    return SectionStates(
        time=near[sums.rows] + u * sums.scale,
        time_se=np.sqrt(_of_mean_height(errors)) / np.abs(sinking),
        position=turned(place, sums.direction, back=True),
        velocity=turned(speed, sums.direction, back=True),
        position_covariance=_turned_back(of_place, sums.direction),
        velocity_covariance=_turned_back(of_speed, sums.direction),
    )


def _derivative(
    coefficients: FloatArray, u: FloatArray, scale: float, *, order: int
) -> FloatArray:
    """Return a derivative by time, (L, B, 3), of polynomials (L, B, 3, K) at u (L,)."""
    powers = _powers(u, coefficients.shape[-1], order)[:, None, None]
    return np.asarray((coefficients * powers).sum(axis=3) / scale**order)


def _turned_back(covariance: FloatArray, direction: FloatArray) -> FloatArray:
    """Turn covariances (L, B, 3, 3) from frames with these x axes into the world."""
    once = turned(covariance, direction, back=True)
    return turned(np.swapaxes(once, 2, 3), direction, back=True)


def _whole(sums: Moments, fitted: FloatArray) -> FloatArray:
    """Add back what was subtracted before the fit, (L, B, 3, K') with K' at least 3."""
    terms = max(fitted.shape[-1], 3)
    padding = np.zeros((*fitted.shape[:3], terms - fitted.shape[3]))
    whole = np.concatenate([fitted, padding], axis=3)
    whole[..., 0] += sums.centre
    whole[:, :, 2, 2] += sums.fall
    return whole


def _powers(u: FloatArray, terms: int, order: int) -> FloatArray:
    """Return the derivatives of the given order of the powers 1, u, ..., (L, terms)."""
    columns = np.zeros((len(u), terms))
    for k in range(order, terms):
        factor = float(np.prod(np.arange(k - order + 1, k + 1)))
        columns[:, k] = factor * u ** (k - order)
    return columns


def _instants(mean: FloatArray, height_m: float) -> FloatArray:
    """Return scaled times (L,) at which polynomials (L, K) equal `height_m`.

    NaN where that is out of the window.
    """
    u = np.zeros(len(mean))
    for _ in range(NEWTON_STEPS):
        miss = (mean * _powers(u, mean.shape[1], 0)).sum(axis=1) - height_m
        slope = (mean * _powers(u, mean.shape[1], 1)).sum(axis=1)
        u = u - miss / np.where(slope == 0, np.nan, slope)
        u = np.where(np.abs(u) <= 1.0, u, np.nan)
    return u


def _errors(covariance: FloatArray, u: FloatArray, scale: float) -> FloatArray:
    """Return the covariance (2, 2, L, B, 3) of position and velocity at u.

    It is that of each coordinate by itself.
    """
    terms = covariance.shape[-1]
    rows = np.stack([_powers(u, terms, order) / scale**order for order in (0, 1)])
    return np.asarray(
        np.einsum("olk,lbckj,plj->oplbc", rows, covariance, rows, optimize=True)
    )


def _of_mean_height(errors: FloatArray) -> FloatArray:
    """Return the variance (L,) of the mean height of the markers: see `_errors`."""
    of_heights = errors[0, 0, :, :, 2]
    return np.asarray(of_heights.sum(axis=1) / of_heights.shape[1] ** 2)


def _with_instant(
    errors: FloatArray, motion: FloatArray, sinking: FloatArray, *, order: int
) -> FloatArray:
    """Return covariances (L, B, 3, 3), with the error of the instant.

    An error of the mean height shifts the instant, and so every marker along its track.

    Parameters
    ----------
    errors : (2, 2, L, B, 3) array
        See `_errors`.
    motion : (L, B, 3) array
        How fast the position (order 0) or the velocity (order 1) changes with time.
    sinking : (L,) array
        Vertical velocity of the mean height, m/s.
    order : int
        Whether the covariance is that of positions (0) or velocities (1).
    """
    markers = motion.shape[1]
    along = -motion / sinking[:, None, None]
    height = _of_mean_height(errors)
    shared = errors[order, 0, :, :, 2] / markers
    own = errors[order, order][..., None] * np.eye(3)
    moved = along[..., None] * along[..., None, :] * height[:, None, None, None]
    mixed = shared[..., None, None] * along[..., None] * UP
    return np.asarray(own + moved + mixed + np.swapaxes(mixed, 2, 3), float)
