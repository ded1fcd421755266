"""The circle of the boom marker in the body (dissertation, Algorithm 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.steering.observation.circle import arc_span, geometric_circle
from hopdata.steering.observation.geometry import BoomCircle

FloatArray = NDArray[np.float64]

MOST_POINTS = 4000
LEAST_POINTS = 30
LEAST_ARC_RAD = np.deg2rad(30.0)
LEAST_TRAVEL_NOISES = 10.0
OUTLIER_SIGMAS = 5.0
ROUNDS = 5


def fit_boom_circle(boom: FloatArray, noise_m: float) -> BoomCircle:
    """Fit the circle to the places of the boom marker.

    The plane is that of the two leading principal components of the centred points, its normal the
    last; the circle in it is fitted by distances, which unlike an algebraic fit has no bias on a
    short arc to speak of. Points beyond five times the typical distance are set aside.

    Parameters
    ----------
    boom : (N, 3) array
        Boom marker in body axes, m; NaN where unknown.
    noise_m : float
        Noise per coordinate of a marker, m.

    Raises
    ------
    AnalysisError
        If the boom is hardly seen, does not move, or spans less than 30 degrees.
    """
    points = boom[np.isfinite(boom).all(axis=1)]
    if len(points) < LEAST_POINTS:
        raise AnalysisError(
            f"boom: expected its marker in at least {LEAST_POINTS} frames with a pose, "
            f"found {len(points)}"
        )
    points = points[:: -(-len(points) // MOST_POINTS)]
    kept = points
    for _ in range(ROUNDS):
        circle = _circle_through(kept, noise_m)
        misses = circle.misses(points)
        limit = OUTLIER_SIGMAS * max(float(np.median(misses)), noise_m)
        kept = points[misses <= limit]
    return circle


def _circle_through(points: FloatArray, noise_m: float) -> BoomCircle:
    middle = points.mean(axis=0)
    _, _, (along, across, normal) = np.linalg.svd(points - middle, full_matrices=False)
    flat = (points - middle) @ np.stack([along, across]).T
    travel = float(np.ptp(flat[:, 0]))
    if travel < LEAST_TRAVEL_NOISES * noise_m:
        raise AnalysisError(
            f"boom: expected it to move, found all its places within {1e3 * travel:.1f} mm"
        )
    centre, radius = geometric_circle(flat)
    span = arc_span(flat, centre)
    if span < LEAST_ARC_RAD:
        raise AnalysisError(
            f"boom: expected it to move through at least {np.rad2deg(LEAST_ARC_RAD):.0f} degrees "
            f"to define a circle, found {np.rad2deg(span):.1f}"
        )
    middle = middle + centre @ np.stack([along, across])
    return BoomCircle(middle, normal if normal[2] > 0 else -normal, radius)
