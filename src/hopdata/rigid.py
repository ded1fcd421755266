"""Rigid motions: fits to marker positions, headings, and motions of the plane."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import AnalysisError

#: Width of the markers across their line, relative to along it, that fixes the turn
#: about it.
#: Unit: 1. Origin: chosen.
LEAST_WIDTH = 0.01

#: Weight of an earlier attitude relative to the markers: it decides only what they
#: leave open.
#: Unit: 1. Origin: chosen.
PRIOR_WEIGHT = 1e-6

#: Width of a body's mean shape across its line, relative to along it, up to which its
#: markers lie on a line.
#: Unit: 1. Origin: chosen.
LEAST_BODY_WIDTH = 1e-3

#: Most times that all attitudes are turned to the mean shape.
#: Unit: 1. Origin: chosen.
MOST_ALIGNMENTS = 20

#: Change of the mean shape, relative to its size, at which it has converged.
#: Unit: 1. Origin: rounding: a few units in the last place.
CONVERGED = 1e-15

# Inputs: the eight coordinates of a rigid body on a section, without place and heading.
# Outputs: the change of place and heading, then the same eight at the post section.
INPUT_NAMES = (
    "pitch_rad",
    "roll_rad",
    "forward_m_s",
    "sideways_m_s",
    "climb_m_s",
    "spin_x_rad_s",
    "spin_y_rad_s",
    "spin_z_rad_s",
)
OUTPUT_NAMES = ("step_x_m", "step_y_m", "turn_rad", *INPUT_NAMES)


@dataclass(frozen=True)
class RigidFit:
    """Rigid motions of N frames.

    Parameters
    ----------
    centre : (N, 3) array
        Origin of the reference in the world frame, m; NaN where not determined.
    rotation : (N, 3, 3) array
        Rotation from the axes of the reference to those of the world; NaN where not
        determined.
    residual_m : (N,) array
        Rms residual per degree of freedom, m, which estimates the noise per coordinate;
        NaN where not determined.
    leaned : (N,) bool array
        Whether an earlier attitude was needed.
    """

    centre: FloatArray
    rotation: FloatArray
    residual_m: FloatArray
    leaned: BoolArray

    @property
    def known(self) -> BoolArray:
        """Whether there is a fit, (N,)."""
        return np.asarray(np.isfinite(self.residual_m))


def rigid_fit(
    markers: FloatArray, reference: FloatArray, earlier: FloatArray | None = None
) -> RigidFit:
    """Find the rigid motion that best maps a reference to markers, by least squares.

    The method is Kabsch's (Acta Cryst. A32, 1976), restricted to proper rotations.
    Three markers that are not on a line determine the motion. Two determine all but the
    turn about their line, which is taken from an earlier attitude if there is one.

    Parameters
    ----------
    markers : (N, B, 3) array
        Positions in the world, m; NaN where unseen.
    reference : (B, 3) array
        The same markers in the body, m.
    earlier : (N, 3, 3) array, optional
        Attitude shortly before or after each frame; NaN where there is none.
    """
    seen = np.asarray(np.isfinite(markers).all(axis=2))
    weight = seen.astype(float)
    n_seen = seen.sum(axis=1)
    share = weight / np.maximum(n_seen, 1)[:, None]
    places = np.where(seen[:, :, None], markers, 0.0)
    middle = np.einsum("nb,nbi->ni", share, places)
    # Of the markers that are seen, so it differs from frame to frame.
    middle_of_reference = share @ reference
    arms = reference - middle_of_reference[:, None]
    points = places - middle[:, None]
    moment = np.einsum("nb,nbi,nbj->nij", weight, points, arms)

    left, spread, right = np.linalg.svd(moment)
    # The singular values are squares of lengths.
    wide = np.asarray(spread[:, 1] > LEAST_WIDTH**2 * spread[:, 0])
    determined = np.asarray((n_seen >= 3) & wide)
    leaned = np.zeros(len(markers), dtype=bool)
    if earlier is not None and not determined.all():
        has_earlier = np.isfinite(earlier).all(axis=(1, 2))
        leaned = np.asarray(~determined & (n_seen >= 2) & has_earlier)
        prior = PRIOR_WEIGHT * spread[leaned, :1, None] * earlier[leaned]
        left[leaned], _, right[leaned] = np.linalg.svd(moment[leaned] + prior)
    rotation = _proper_rotations(left, right)
    rotation[~(determined | leaned)] = np.nan

    misses = points - np.einsum("nij,nbj->nbi", rotation, arms)
    square = np.einsum("nb,nbi,nbi->n", weight, misses, misses)
    # A rigid motion has six degrees of freedom; an earlier attitude supplies one.
    n_free = (3 * n_seen - 6 + leaned).clip(1)
    centre = middle - np.einsum("nij,nj->ni", rotation, middle_of_reference)
    return RigidFit(centre, rotation, np.sqrt(square / n_free), leaned)


def kabsch(centred: FloatArray, shape: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) that bring a shape closest to points.

    The fit is by least squares over proper rotations (Kabsch 1976).

    Parameters
    ----------
    centred : (n, B, 3) array
        Sets of points, each with its mean at the origin.
    shape : (B, 3) array
        The shape, likewise.
    """
    left, _, right = np.linalg.svd(np.einsum("nbi,bj->nij", centred, shape))
    return _proper_rotations(left, right)


def _proper_rotations(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) from singular vectors; `left` is overwritten.

    Where their product is a reflection, the direction of the least singular value is
    reversed.
    """
    left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    return np.asarray(left @ right)


def body_shape(positions: FloatArray) -> FloatArray:
    """Return the mean shape (B, 3) of a body, centred, in its mean attitude.

    The method is generalised Procrustes alignment without scaling (Gower 1975).

    Parameters
    ----------
    positions : (n, B, 3) array
        Marker positions, m.

    Raises
    ------
    AnalysisError
        If there are fewer than three markers, or they lie on a line.
    """
    n_markers = positions.shape[1]
    if n_markers < 3:
        raise AnalysisError(
            f"rigid body: at least 3 body markers are needed, found {n_markers}"
        )
    centred = positions - positions.mean(axis=1, keepdims=True)
    shape = centred.mean(axis=0)
    for _ in range(MOST_ALIGNMENTS):
        before = shape
        rotation = kabsch(centred, shape)
        shape = np.einsum("nji,nbj->bi", rotation, centred) / len(centred)
        if np.abs(shape - before).max() <= CONVERGED * np.abs(shape).max():
            break
    widths = np.linalg.svd(shape, compute_uv=False)
    if widths[1] <= LEAST_BODY_WIDTH * widths[0]:
        raise AnalysisError(
            "rigid body: expected body markers that are not on one line"
        )
    return shape


def headings(rotation: FloatArray) -> FloatArray:
    """Return the yaw (...), rad, of rotations (..., 3, 3).

    It is the direction of the body's x axis seen from above, and the yaw of ``Rz(yaw)
    Ry(pitch) Rx(roll)``.
    """
    return np.asarray(np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0]))


def twists(rotation: FloatArray) -> FloatArray:
    """Return the turn about the vertical, (...), rad, of rotations (..., 3, 3).

    It is the turn that remains after the body has been tilted upright by the shortest
    way. It does not depend on which body axis is called x, and differs from the yaw by
    half the product of pitch and roll.
    """
    xx = rotation[..., 0, 0]
    xy = rotation[..., 0, 1]
    yx = rotation[..., 1, 0]
    yy = rotation[..., 1, 1]
    return np.asarray(np.arctan2(yx - xy, xx + yy))


def turned(vectors: Any, yaw: Any) -> Any:
    """Return vectors (..., 3), of any numeric type, in frames turned by `yaw` (...)."""
    cos = np.cos(yaw)
    sin = np.sin(yaw)
    x = vectors[..., 0]
    y = vectors[..., 1]
    return np.stack([cos * x + sin * y, cos * y - sin * x, vectors[..., 2]], axis=-1)


# Rigid motions of the plane, SE(2): poses (x, y, heading), m and rad, on the last array
# axis.


def wrapped(angle: ArrayLike) -> FloatArray:
    """Wrap angles to [-pi, pi), rad."""
    return np.asarray((np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi)


def composed(pose: ArrayLike, change: ArrayLike) -> FloatArray:
    """Return the pose (..., 3) after a motion given in the frame of the pose.

    Headings are added and not wrapped, so that turns can be counted.
    """
    x, y, heading = _parts(pose)
    dx, dy, turn = _parts(change)
    cos = np.cos(heading)
    sin = np.sin(heading)
    return np.stack(
        [x + cos * dx - sin * dy, y + sin * dx + cos * dy, heading + turn], axis=-1
    )


def inverse(pose: ArrayLike) -> FloatArray:
    """Return the inverse (..., 3) of a motion."""
    x, y, heading = _parts(pose)
    cos = np.cos(heading)
    sin = np.sin(heading)
    return np.stack([-cos * x - sin * y, sin * x - cos * y, -heading], axis=-1)


def relative(start: ArrayLike, end: ArrayLike) -> FloatArray:
    """Return the frame change (..., 3) between two poses in the frame of the first.

    It is ``g1^-1 g2``, with the turn wrapped to [-pi, pi) (dissertation, Sec. 3.4.2).
    """
    x, y, heading = _parts(start)
    x_end, y_end, heading_end = _parts(end)
    cos = np.cos(heading)
    sin = np.sin(heading)
    dx = x_end - x
    dy = y_end - y
    turn = wrapped(heading_end - heading)
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx, turn], axis=-1)


def _parts(pose: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    whole = np.asarray(pose, dtype=float)
    return whole[..., 0], whole[..., 1], whole[..., 2]
