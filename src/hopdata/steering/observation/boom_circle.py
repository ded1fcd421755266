"""The circle of the boom marker in the body (dissertation, Algorithm 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.steering.observation.circle import arc_span, geometric_circle
from hopdata.steering.observation.geometry import BoomCircle

FloatArray = NDArray[np.float64]

MOST_POINTS = 20000
LEAST_POINTS = 30
LEAST_ARC_RAD = np.deg2rad(30.0)
LEAST_TRAVEL_NOISES = 10.0
OUTLIER_SIGMAS = 5.0
ROUNDS = 5
TRIES = 300


def fit_boom_circle(boom: FloatArray, noise_m: float) -> BoomCircle:
    """Fit the circle to the places of the boom marker.

    The plane is that of the two leading principal components of the centred points, its normal the
    last; the circle in it is fitted by distances, which unlike an algebraic fit has no bias on a
    short arc to speak of. Points beyond five times the typical distance, at first from the best of
    many circles through three points, are set aside.

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
    kept = _near(points, _start(points), 4 * noise_m)
    for _ in range(ROUNDS):
        circle = _circle_through(kept, noise_m)
        kept = _near(points, circle, noise_m)
    return circle


def _near(points: FloatArray, circle: BoomCircle, noise_m: float) -> FloatArray:
    misses = circle.misses(points)
    return points[misses <= OUTLIER_SIGMAS * max(float(np.median(misses)), noise_m)]


def _start(points: FloatArray) -> BoomCircle:
    """Return the circle through three points to which three quarters of all are nearest."""
    rng = np.random.default_rng(np.random.SeedSequence(0))
    circles = [_through_three(*points[rng.integers(0, len(points), 3)]) for _ in range(TRIES)]
    few = points[:: -(-len(points) // 1000)]

    def size(circle: BoomCircle) -> float:
        return float(np.nan_to_num(np.percentile(circle.misses(few), 75), nan=np.inf))

    return min(circles, key=size)


def _through_three(a: FloatArray, b: FloatArray, c: FloatArray) -> BoomCircle:
    """Return the circle through three points; NaN if they are on a line."""
    u, v = b - a, c - a
    normal = np.cross(u, v)
    square = float(normal @ normal)
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = np.cross((u @ u) * v - (v @ v) * u, normal) / (-2 * square)
        return BoomCircle(a + arm, normal / np.sqrt(square), float(np.linalg.norm(arm)))


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
