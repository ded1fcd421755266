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
LEAST_RADIUS_RESIDUALS = 10.0  # else an angle read from the circle errs by more than 0.1 rad
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
        If the boom is hardly seen, does not move (a circle through noise is hardly larger than
        the distances from it), or spans less than 30 degrees.
    """
    points = boom[np.isfinite(boom).all(axis=1)]
    if len(points) < LEAST_POINTS:
        raise AnalysisError(
            f"boom: expected its marker in at least {LEAST_POINTS} frames with a pose, "
            f"found {len(points)}"
        )
    points = points[:: -(-len(points) // MOST_POINTS)]
    start = _start(points)
    if not np.isfinite(start.radius_m):
        raise AnalysisError("boom: expected it to move, found all its places in one or on a line")
    kept = _near(points, start, 4 * noise_m)
    for _ in range(ROUNDS):
        circle = _circle_through(kept)
        kept = _near(points, circle, noise_m)
    _require_motion(circle, kept)
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


def _circle_through(points: FloatArray) -> BoomCircle:
    middle = points.mean(axis=0)
    _, _, (along, across, normal) = np.linalg.svd(points - middle, full_matrices=False)
    plane = np.stack([along, across])
    centre, radius = geometric_circle((points - middle) @ plane.T)
    return BoomCircle(middle + centre @ plane, normal if normal[2] > 0 else -normal, radius)


def _require_motion(circle: BoomCircle, points: FloatArray) -> None:
    """Refuse the circle that noise makes of a boom at rest, and one of which too little is seen."""
    residual = float(np.sqrt(np.mean(circle.misses(points) ** 2)))
    if not circle.radius_m > LEAST_RADIUS_RESIDUALS * residual:
        raise AnalysisError(
            "boom: expected it to move on a circle about the body of more than "
            f"{LEAST_RADIUS_RESIDUALS:.0f} times the rms distance of its places from it, found "
            f"{1e3 * circle.radius_m:.2g} mm at {1e3 * residual:.2g} mm: does the boom move in "
            "this recording?"
        )
    span = arc_span((points - circle.centre_m) @ circle.axes.T, np.zeros(2))
    if span < LEAST_ARC_RAD:
        raise AnalysisError(
            f"boom: expected it to move through at least {np.rad2deg(LEAST_ARC_RAD):.0f} degrees "
            f"to define a circle, found {np.rad2deg(span):.1f}"
        )
