"""Rigid motions: fits to marker positions, headings, and motions of the plane."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import AnalysisError

#: Width of the markers across their line, relative to along it, that fixes the turn
#: about it.
LEAST_WIDTH = 0.01
#: Weight of an earlier attitude relative to the markers: it decides only what they
#: leave open.
PRIOR_WEIGHT = 1e-6


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
    """Find the rotation and translation that best map a reference to markers, by least squares.

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
    weight, count = seen.astype(float), seen.sum(axis=1)
    share = weight / np.maximum(count, 1)[:, None]
    here = np.where(seen[:, :, None], markers, 0.0)
    middle, home = np.einsum("nb,nbi->ni", share, here), share @ reference
    arms, points = reference - home[:, None], here - middle[:, None]
    moment = np.einsum("nb,nbi,nbj->nij", weight, points, arms)
    left, spread, right = np.linalg.svd(moment)
    wide = np.asarray(spread[:, 1] > LEAST_WIDTH**2 * spread[:, 0])
    determined = np.asarray((count >= 3) & wide)
    leaned = np.zeros(len(markers), dtype=bool)
    if earlier is not None and not determined.all():
        leaned = np.asarray(
            ~determined & (count >= 2) & np.isfinite(earlier).all(axis=(1, 2))
        )
        helped = PRIOR_WEIGHT * spread[leaned, :1, None] * earlier[leaned]
        left[leaned], _, right[leaned] = np.linalg.svd(moment[leaned] + helped)
    left[:, :, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    rotation = left @ right
    rotation[~(determined | leaned)] = np.nan
    misses = points - np.einsum("nij,nbj->nbi", rotation, arms)
    free = (3 * count - 6 + leaned).clip(1)
    square = np.einsum("nb,nbi,nbi->n", weight, misses, misses)
    centre = middle - np.einsum("nij,nj->ni", rotation, home)
    return RigidFit(centre, rotation, np.sqrt(square / free), leaned)


def headings(rotation: FloatArray) -> FloatArray:
    """Return the yaw (...), rad, of rotations (..., 3, 3): the body x axis seen from above.

    It is the yaw of ``Rz(yaw) Ry(pitch) Rx(roll)``.
    """
    return np.asarray(np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0]))


def twists(rotation: FloatArray) -> FloatArray:
    """Return the turn about the vertical, (...), rad, of rotations (..., 3, 3).

    It is the turn that remains after the body has been tilted upright by the shortest
    way. It does not depend on which body axis is called x, and differs from the yaw by
    half the product of pitch and roll.
    """
    (xx, xy, _), (yx, yy, _), _ = np.moveaxis(rotation, (-2, -1), (0, 1))
    return np.asarray(np.arctan2(yx - xy, xx + yy))


# Inputs: the eight coordinates of a rigid body on a section, without place and heading.
# Outputs: the change of place and heading, then the same eight at the post section.
INPUT_NAMES = (
    *("pitch_rad", "roll_rad"),
    *("forward_m_s", "sideways_m_s", "climb_m_s"),
    *("spin_x_rad_s", "spin_y_rad_s", "spin_z_rad_s"),
)
OUTPUT_NAMES = ("step_x_m", "step_y_m", "turn_rad", *INPUT_NAMES)


def turned(vectors: Any, yaw: Any) -> Any:
    """Return vectors (..., 3), of any numeric type, in frames turned by `yaw` (...)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x, vectors[..., 2]], axis=-1)


# Rigid motions of the plane, SE(2): poses (x, y, heading), m and rad, on the last array
# axis.


def wrapped(angle: ArrayLike) -> FloatArray:
    """Wrap angles to [-pi, pi), rad."""
    return np.asarray((np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi)


def composed(pose: ArrayLike, change: ArrayLike) -> FloatArray:
    """Return the pose (..., 3) after a motion given in the frame of the pose.

    Headings are added and not wrapped, so that turns can be counted.
    """
    (x, y, heading), (dx, dy, turn) = (_parts(one) for one in (pose, change))
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([x + c * dx - s * dy, y + s * dx + c * dy, heading + turn], axis=-1)


def inverse(pose: ArrayLike) -> FloatArray:
    """Return the inverse (..., 3) of a motion."""
    x, y, heading = _parts(pose)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([-c * x - s * y, s * x - c * y, -heading], axis=-1)


def relative(start: ArrayLike, end: ArrayLike) -> FloatArray:
    """Return the frame change (..., 3) between two poses in the frame of the first: ``g1^-1 g2``.

    The turn is wrapped to [-pi, pi) (dissertation, Sec. 3.4.2).
    """
    (x, y, heading), (x_end, y_end, heading_end) = (_parts(one) for one in (start, end))
    c, s, dx, dy = np.cos(heading), np.sin(heading), x_end - x, y_end - y
    return np.stack(
        [c * dx + s * dy, c * dy - s * dx, wrapped(heading_end - heading)], axis=-1
    )


def _parts(pose: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    whole = np.asarray(pose, dtype=float)
    return whole[..., 0], whole[..., 1], whole[..., 2]


_ALIGNMENTS = 20
_SETTLED = 1e-15  # relative change of the shape at which the alignment has converged
_LEAST_BODY_WIDTH = 1e-3


def body_shape(positions: FloatArray) -> FloatArray:
    """Return the mean shape (B, 3) of marker positions (n, B, 3), centred, in the mean attitude.

    The method is generalised Procrustes alignment without scaling (Gower 1975).

    Raises
    ------
    AnalysisError
        If there are fewer than three markers, or they lie on a line.
    """
    if (markers := positions.shape[1]) < 3:
        raise AnalysisError(
            f"rigid body: at least 3 body markers are needed, found {markers}"
        )
    centred = positions - positions.mean(axis=1, keepdims=True)
    shape = centred.mean(axis=0)
    for _ in range(_ALIGNMENTS):
        before = shape
        shape = np.einsum("nji,nbj->bi", kabsch(centred, shape), centred) / len(centred)
        if np.abs(shape - before).max() <= _SETTLED * np.abs(shape).max():
            break
    widths = np.linalg.svd(shape, compute_uv=False)
    if widths[1] <= _LEAST_BODY_WIDTH * widths[0]:
        raise AnalysisError(
            "rigid body: expected body markers that are not on one line"
        )
    return shape


def kabsch(centred: FloatArray, shape: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) that bring `shape` (B, 3) closest to points (n, B, 3).

    The fit is by least squares over proper rotations (Kabsch 1976); shape and points
    are centred.
    """
    left, _, right = np.linalg.svd(np.einsum("nbi,bj->nij", centred, shape))
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return np.asarray(left @ right)
