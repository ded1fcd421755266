"""Circles through points in a plane or in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread

FloatArray = NDArray[np.float64]


def algebraic_circle(points: FloatArray) -> tuple[FloatArray, float]:
    """Fit a circle by linear least squares on squared distances (Kasa 1976).

    Exact without noise; on a short arc the noise makes the circle too small.

    Parameters
    ----------
    points : (N, 2) array, m

    Returns
    -------
    (2,) array
        Centre, m.
    float
        Radius, m.
    """
    middle = points.mean(axis=0)
    x = points - middle
    design = np.column_stack([2 * x, np.ones(len(x))])
    (a, b, c), *_ = np.linalg.lstsq(design, (x**2).sum(axis=1), rcond=None)
    return middle + np.array([a, b]), float(np.sqrt(c + a**2 + b**2))


def geometric_circle(points: FloatArray) -> tuple[FloatArray, float]:
    """Fit a circle by least squares on distances from it; see `algebraic_circle`."""
    from scipy.optimize import least_squares

    centre, radius = algebraic_circle(points)

    def misses(parameters: FloatArray) -> FloatArray:
        arms = points - parameters[:2]
        return np.asarray(np.hypot(arms[:, 0], arms[:, 1]) - parameters[2])

    def slopes(parameters: FloatArray) -> FloatArray:
        arms = points - parameters[:2]
        directions = arms / np.linalg.norm(arms, axis=1, keepdims=True)
        return np.column_stack([-directions, -np.ones(len(arms))])

    with one_blas_thread():
        found = least_squares(misses, [*centre, radius], jac=slopes, x_scale=max(radius, 1e-9)).x
    return np.asarray(found[:2]), float(abs(found[2]))


def arc_span(points: FloatArray, centre: FloatArray) -> float:
    """Angle that points (N, 2) span about a centre, rad: a turn less the widest gap."""
    arms = points - centre
    angles = np.sort(np.arctan2(arms[:, 1], arms[:, 0]))
    gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
    return float(2 * np.pi - gaps.max())
