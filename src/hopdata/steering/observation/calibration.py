"""Calibration: estimate the geometry of a hopper from a recording."""

import math

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.recording import Recording
from hopdata.rigid import RigidFit, rigid_fit
from hopdata.steering.observation.geometry import (
    BoomCircle,
    HopperGeometry,
    height_band,
)

# Circles through points in a plane or in space.


def algebraic_circle(points: FloatArray) -> tuple[FloatArray, float]:
    """Fit a circle by linear least squares on squared distances (Kasa 1976).

    Exact without noise; on a short arc, noise makes the circle too small.

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
    arms = points - middle
    # |arm|^2 = 2 arm . centre + (radius^2 - |centre|^2) is linear in what is unknown.
    design = np.column_stack([2 * arms, np.ones(len(arms))])
    squares = (arms**2).sum(axis=1)
    a, b, c = np.linalg.lstsq(design, squares, rcond=None)[0]
    return middle + np.array([a, b]), float(np.sqrt(c + a**2 + b**2))


def geometric_circle(points: FloatArray) -> tuple[FloatArray, float]:
    """Fit a circle by least squares on the distances; see `algebraic_circle`."""
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
        found = least_squares(
            misses, [*centre, radius], jac=slopes, x_scale=max(radius, 1e-9)
        ).x
    return np.asarray(found[:2]), float(abs(found[2]))


def arc_span(angles: FloatArray) -> float:
    """Return the angle spanned by directions (N,) in (-pi, pi], rad.

    It is a turn less the widest gap between neighbours.
    """
    angles = np.sort(angles)
    gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
    return float(2 * np.pi - gaps.max())


# The circle of the boom marker in body axes (dissertation, Algorithm 3).

#: Most positions of the boom marker that are fitted, to bound the time.
#: Unit: 1. Origin: chosen.
MOST_POINTS = 20000
#: Least positions of the boom marker.
#: Unit: 1. Origin: chosen.
LEAST_POINTS = 30
#: Least arc on which the boom marker must be seen.
#: Unit: rad. Origin: chosen.
LEAST_ARC_RAD = np.deg2rad(30.0)
#: Least radius of the circle, in rms distances from it; a smaller circle is noise.
#: Unit: 1. Origin: derived: with fewer, the boom angle errs by more than 0.1 rad.
LEAST_RADIUS_RESIDUALS = 10.0
#: Distance from the circle beyond which a position is discarded, in median distances.
#: Unit: 1. Origin: chosen.
OUTLIER_SIGMAS = 5.0
#: The same for the circle through three positions, in noises of a coordinate: it errs
#: more than a fitted one.
#: Unit: 1. Origin: chosen.
START_NOISES = 4
#: How often the circle is fitted and positions are discarded in turn.
#: Unit: 1. Origin: chosen.
ROUNDS = 5
#: Circles through three random positions, of which the best is the start.
#: Unit: 1. Origin: chosen.
TRIES = 300
#: Most positions by which these circles are compared, to bound the time.
#: Unit: 1. Origin: chosen.
MOST_COMPARED = 1000
#: Percentile of the distances by which these circles are compared.
#: Unit: %. Origin: chosen.
COMPARED_PERCENTILE = 75


def fit_boom_circle(boom: FloatArray, noise_m: float) -> BoomCircle:
    """Fit the circle to the positions of the boom marker.

    The plane is spanned by the two leading principal components of the centred points;
    its normal is the last. The circle in it minimises distances; unlike an algebraic
    fit, this has practically no bias on a short arc. Points beyond five times the
    typical distance are discarded, starting from the best of many circles through three
    points.

    Parameters
    ----------
    boom : (N, 3) array
        Boom marker in body axes, m; NaN where unknown.
    noise_m : float
        Noise per coordinate of a marker, m.

    Raises
    ------
    AnalysisError
        If the boom is rarely seen, does not move (a circle through noise is hardly
        larger than the distances from it), or spans less than 30 degrees.
    """
    points = boom[np.isfinite(boom).all(axis=1)]
    if len(points) < LEAST_POINTS:
        wanted = f"its marker in at least {LEAST_POINTS} frames with a pose"
        raise AnalysisError.at("boom", wanted, len(points))
    points = _thinned(points, MOST_POINTS)
    start = _start(points)
    if not np.isfinite(start.radius_m):
        raise AnalysisError(
            "boom: expected it to move, found positions at a point or on a line"
        )
    kept = _near(points, start, START_NOISES * noise_m)
    for _ in range(ROUNDS):
        circle = _circle_through(kept)
        kept = _near(points, circle, noise_m)
    _require_motion(circle, kept)
    return circle


def _thinned(rows: FloatArray, most: int) -> FloatArray:
    """Return every n-th row, so that there are at most so many."""
    every = math.ceil(len(rows) / most)
    return rows[::every]


def _near(points: FloatArray, circle: BoomCircle, noise_m: float) -> FloatArray:
    """Return the points near a circle, by their typical distance or the noise."""
    misses = circle.misses(points)
    typical = max(float(np.median(misses)), noise_m)
    return points[misses <= OUTLIER_SIGMAS * typical]


def _start(points: FloatArray) -> BoomCircle:
    """Return the best of many circles through three points.

    It has the smallest upper quartile of distances. The draws are the same each time.
    """
    rng = np.random.default_rng(np.random.SeedSequence(0))
    compared = _thinned(points, MOST_COMPARED)
    circles = []
    for _ in range(TRIES):
        three = points[rng.integers(0, len(points), 3)]
        circles.append(_through_three(*three))

    def size(circle: BoomCircle) -> float:
        distance = np.percentile(circle.misses(compared), COMPARED_PERCENTILE)
        return float(np.nan_to_num(distance, nan=np.inf))

    return min(circles, key=size)


def _through_three(a: FloatArray, b: FloatArray, c: FloatArray) -> BoomCircle:
    """Return the circle through three points; NaN if they lie on a line."""
    u = b - a
    v = c - a
    normal = np.cross(u, v)
    square = float(normal @ normal)
    with np.errstate(invalid="ignore", divide="ignore"):
        arm = np.cross((u @ u) * v - (v @ v) * u, normal) / (-2 * square)
        return BoomCircle(a + arm, normal / np.sqrt(square), float(np.linalg.norm(arm)))


def _circle_through(points: FloatArray) -> BoomCircle:
    """Return the circle in the plane of the points that is nearest to them."""
    middle = points.mean(axis=0)
    components = np.linalg.svd(points - middle, full_matrices=False)[2]
    plane = np.stack([components[0], components[1]])
    normal = components[2]
    if not normal[2] > 0:
        normal = -normal
    centre, radius = geometric_circle((points - middle) @ plane.T)
    return BoomCircle(middle + centre @ plane, normal, radius)


def _require_motion(circle: BoomCircle, points: FloatArray) -> None:
    """Refuse a circle of too short an arc, or that noise makes of a boom at rest."""
    residual = float(np.sqrt(np.mean(circle.misses(points) ** 2)))
    if not circle.radius_m > LEAST_RADIUS_RESIDUALS * residual:
        wanted = (
            "it to move on a circle with a radius of more than "
            f"{LEAST_RADIUS_RESIDUALS:.0f} times its rms distance from the circle"
        )
        found = (
            f"{1e3 * circle.radius_m:.2g} mm and {1e3 * residual:.2g} mm: "
            "does the boom move in this recording?"
        )
        raise AnalysisError.at("boom", wanted, found)
    span = arc_span(circle.angles(points))
    if span < LEAST_ARC_RAD:
        least = f"at least {np.rad2deg(LEAST_ARC_RAD):.0f} degrees to define a circle"
        raise AnalysisError.at(
            "boom", f"it to move through {least}", f"{np.rad2deg(span):.1f}"
        )


# Positions of the body markers in the body, estimated robustly from the recording
# itself.

#: Most frames that the shape is estimated from, to bound the time.
#: Unit: 1. Origin: chosen.
MOST_FRAMES = 4000
#: Least frames with three markers or more.
#: Unit: 1. Origin: chosen.
LEAST_FRAMES = 20
#: How often the shape is aligned and frames are discarded in turn.
#: Unit: 1. Origin: chosen.
REFERENCE_ROUNDS = 10
#: Residual beyond which a frame is discarded, in median residuals.
#: Unit: 1. Origin: chosen.
REFERENCE_OUTLIER_SIGMAS = 4.0
#: Width of the markers across their line, as a share of that along it, below which they
#: lie on a line; and across their plane, below which they lie in a plane.
#: Unit: 1. Origin: chosen.
ON_A_LINE = 0.02


def marker_shape(markers: FloatArray) -> tuple[FloatArray, float]:
    """Estimate the shape of a rigid set of markers, and the noise.

    The median distances between markers give an initial shape, which generalised
    Procrustes alignment (Gower 1975) refines, ignoring unseen markers. Frames that do
    not fit, such as those with two markers swapped, are discarded: their residual
    exceeds four times the median.

    Parameters
    ----------
    markers : (N, B, 3) array
        Positions, m; NaN where unseen. B is at least 3.

    Returns
    -------
    (B, 3) array
        Positions relative to their mean, m; the attitude is arbitrary.
    float
        Standard deviation of the noise per coordinate, m.

    Raises
    ------
    AnalysisError
        If there are too few markers or frames, the markers lie on a line, or four or
        more markers do not lie in a plane and four are rarely seen at once.
    """
    number = markers.shape[1]
    if number < 3:
        raise AnalysisError(f"body markers: expected at least 3, found {number}")
    frames = _usable(markers)
    shape = _handed(frames, _from_distances(frames))
    kept = frames
    for _ in range(REFERENCE_ROUNDS):
        residual = rigid_fit(frames, shape).residual_m
        kept = frames[residual <= REFERENCE_OUTLIER_SIGMAS * np.median(residual)]
        shape = _mean_shape(kept, shape)
    residual = rigid_fit(kept, shape).residual_m
    return shape, float(np.sqrt(np.mean(residual**2)))


def _handed(frames: FloatArray, shape: FloatArray) -> FloatArray:
    """Return the shape, its mirror image, or the flat one between: the best fit.

    The mirror image has the same distances. If the markers are flat except for noise,
    neither image fits better than the other.
    """
    widths = np.linalg.norm(shape, axis=0)
    if widths[2] < ON_A_LINE * widths[0]:
        return shape
    telling = frames[np.isfinite(frames).all(axis=2).sum(axis=1) > 3]
    if len(telling) < LEAST_FRAMES:
        wanted = (
            f"four in sight in {LEAST_FRAMES} frames, to rule out their mirror image"
        )
        raise AnalysisError.at("body markers", wanted, len(telling))

    def misfit(one: FloatArray) -> float:
        return float(np.median(rigid_fit(telling, one).residual_m))

    flat = shape * [1, 1, 0]
    mirrored = shape * [1, 1, -1]
    return min([flat, shape * [1, 1, 1], mirrored], key=misfit)


def _usable(markers: FloatArray) -> FloatArray:
    """Return at most `MOST_FRAMES` frames with three markers or more, evenly spread."""
    seen = np.isfinite(markers).all(axis=2)
    usable = np.flatnonzero(seen.sum(axis=1) >= 3)
    together = seen.T.astype(int) @ seen.astype(int)  # frames in which a pair is seen
    if len(usable) < LEAST_FRAMES or together.min() == 0:
        wanted = (
            f"{LEAST_FRAMES} frames with three of them in sight, "
            "and each pair in sight together"
        )
        found = f"{len(usable)} of {len(markers)} frames"
        raise AnalysisError.at("body markers", wanted, found)
    return _thinned(markers[usable], MOST_FRAMES)


def _from_distances(frames: FloatArray) -> FloatArray:
    """Return a shape with the median distances, by classical scaling.

    References
    ----------
    Torgerson 1952.
    """
    apart = np.linalg.norm(frames[:, :, None] - frames[:, None], axis=3)
    square = np.nanmedian(apart, axis=0) ** 2
    centring = np.eye(len(square)) - 1.0 / len(square)
    values, vectors = np.linalg.eigh(-0.5 * centring @ square @ centring)
    largest = np.argsort(values)[::-1][:3]
    width = np.sqrt(np.maximum(values[largest], 0.0))
    if width[1] < ON_A_LINE * width[0]:
        raise AnalysisError(
            "body markers: expected three that are not on a line, found none"
        )
    return np.asarray(vectors[:, largest] * width)


def _mean_shape(frames: FloatArray, shape: FloatArray) -> FloatArray:
    """Return the mean of the frames, each turned onto the shape."""
    fit = rigid_fit(frames, shape)
    known = fit.known
    arms = frames[known] - fit.centre[known, None]
    aligned = np.nanmean(np.einsum("nji,nbj->nbi", fit.rotation[known], arms), axis=0)
    return np.asarray(aligned - aligned.mean(axis=0))


#: Least distance of the first foot from the vertical axis, so that forward is known.
#: Unit: m. Origin: chosen.
LEAST_LENGTH_M = 1e-3


def calibrate(recording: Recording) -> HopperGeometry:
    """Estimate the markers' positions, the boom's circle, and the heights of a hop.

    The level plane is that of the feet in free fall or, with fewer than three feet,
    that of the median attitude over the recording, which leans if the boom does. The
    body x axis points from the middle of the feet in free fall towards the first foot.

    Parameters
    ----------
    recording : Recording
        At least three markers with the role "body", and some hops. A marker with the
        role "boom" must move through 30 degrees or more.

    Raises
    ------
    AnalysisError
        If the recording is insufficient; see `marker_shape` and `fit_boom_circle`.
    """
    shape, noise_m = marker_shape(recording.body)
    fit = rigid_fit(recording.body, shape)
    below, above = height_band(fit.centre[:, 2])
    feet = _feet(recording, fit, above)
    up = np.median(fit.rotation[fit.known, 2], axis=0)
    up /= np.linalg.norm(up)
    if len(feet) > 2:
        up = _normal_of(feet, up)
    axes = _body_axes(up, _first_foot(feet))
    boom_name = None
    circle = None
    if recording.indices("boom"):
        boom_name = recording.names("boom")[0]
        boom = recording.positions[:, recording.indices("boom")[0]]
        circle = fit_boom_circle(_in_body(fit, boom) @ axes.T, noise_m)
    return HopperGeometry(
        body_names=recording.names("body"),
        body_m=shape @ axes.T,
        noise_m=noise_m,
        stance_below_m=below,
        flight_above_m=above,
        boom_name=boom_name,
        circle=circle,
    )


def _in_body(fit: RigidFit, marker: FloatArray) -> FloatArray:
    """Return one marker (N, 3) in the axes of the fit, relative to its origin."""
    return np.asarray(np.einsum("nji,nj->ni", fit.rotation, marker - fit.centre))


def _feet(recording: Recording, fit: RigidFit, above_m: float) -> FloatArray:
    """Return median foot positions (n, 3) in free fall, in the axes of the fit.

    A foot that is not seen then is NaN. Only falling frames count, since the legs are
    still retracting while the hopper rises.
    """
    height = fit.centre[:, 2]
    flying = (height > above_m) & (np.gradient(height, recording.time) < 0)
    places = np.full((len(recording.indices("foot")), 3), np.nan)
    for row, index in zip(places, recording.indices("foot"), strict=True):
        seen = _in_body(fit, recording.positions[:, index])[flying]
        seen = seen[np.isfinite(seen).all(axis=1)]
        if len(seen):
            row[:] = np.median(seen, axis=0)
    return places


def _normal_of(feet: FloatArray, up: FloatArray) -> FloatArray:
    """Return the normal of the plane through the feet, on the side of `up`."""
    feet = feet[np.isfinite(feet).all(axis=1)]
    if len(feet) < 3:
        raise AnalysisError.at("level", "at least 3 feet in sight in flight", len(feet))
    normal = np.linalg.svd(feet - feet.mean(axis=0))[2][2]
    return np.asarray(normal * np.sign(normal @ up))


def _first_foot(feet: FloatArray) -> FloatArray:
    """Return the direction from the middle of the feet to the first foot."""
    if len(feet) < 2 or not np.isfinite(feet).all():
        found = f"{np.isfinite(feet).all(axis=1).sum()} of {len(feet)}"
        raise AnalysisError.at(
            "forward", "at least two foot markers, each seen in flight", found
        )
    return np.asarray(feet[0] - feet.mean(axis=0))


def _body_axes(up: FloatArray, toward: FloatArray) -> FloatArray:
    """Return the body axes as rows, in the axes of the shape."""
    flat = toward - (toward @ up) * up
    if np.linalg.norm(flat) < LEAST_LENGTH_M:
        wanted = "a direction across the vertical"
        raise AnalysisError.at("forward", wanted, "one along it within 1 mm")
    ahead = flat / np.linalg.norm(flat)
    return np.stack([ahead, np.cross(up, ahead), up])
