"""Stance pairs as printed (dissertation, Algorithm 4), with its mistakes put right or not."""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import require_choice
from hopdata.rigid import rigid_fit
from hopdata.steering.observation.calibration import algebraic_circle

# Pose in the plane from markers as seen from above (dissertation, Algorithm 2).


def phasor_poses(body: FloatArray) -> FloatArray:
    """Return poses by complex phasors, (N, 3): x m, y m, heading rad.

    Each marker is a complex number from the mean of all. The others are turned on to the first by
    their mean ratio to it, and the heading is the angle of the sum, so its zero is the direction
    to the first marker, nearly. It takes the body for flat: a tilt shortens some phasors more than
    others. Put right is that the pose is the mean itself, not the markers about it. Any number of
    markers; a frame is unknown (NaN) unless all are seen.

    Parameters
    ----------
    body : (N, B, 3) array
        Body markers, m; NaN where unseen.
    """
    middle = body[:, :, :2].mean(axis=1)
    arms = body[:, :, :2] - middle[:, None]
    phasors = arms[..., 0] + 1j * arms[..., 1]
    known = np.isfinite(phasors).all(axis=1)
    heading = np.full(len(body), np.nan)
    if known.any():
        phasors = phasors[known]
        ratios = (phasors[:, :1] / phasors).mean(axis=0)
        heading[known] = np.unwrap(np.angle(phasors @ ratios))
    return np.column_stack([np.where(known[:, None], middle, np.nan), heading])


# Boom angle as printed (dissertation, Algorithm 3), with its mistakes put right.

REST_FRAMES = 40


def printed_boom_angles(
    body: FloatArray, boom: FloatArray, *, rest_frames: int = REST_FRAMES
) -> FloatArray:
    """Return boom angles, (N,), rad, wrapped, with an arbitrary zero and sense.

    The home configuration is the mean over the frames at rest at the beginning, of three body
    markers and a fourth, virtual one across their plane. Circle and angle are in the plane of the
    two leading principal components, by linear least squares. Put right: the fourth marker, the
    determinant of the rotation, the centring, and which component is the normal.

    Parameters
    ----------
    body : (N, 3, 3) array
        Body markers, m; NaN where unseen.
    boom : (N, 3) array
        Boom marker, m.
    rest_frames : int
        How many frames the hopper stands still at first.
    """
    four = np.concatenate([body, _virtual(body)[:, None]], axis=1)
    home = np.nanmean(four[:rest_frames], axis=0)
    fit = rigid_fit(four, home - home.mean(axis=0))
    places = np.einsum("nji,nj->ni", fit.rotation, boom - fit.centre)
    known = np.isfinite(places).all(axis=1)
    centred = places[known] - places[known].mean(axis=0)
    flat = centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    arms = flat - algebraic_circle(flat)[0]
    angles = np.full(len(body), np.nan)
    angles[known] = np.arctan2(arms[:, 1], arms[:, 0])
    return angles


def _virtual(body: FloatArray) -> FloatArray:
    first, second = body[:, 1] - body[:, 0], body[:, 2] - body[:, 0]
    across = np.cross(first, second)
    length = 0.5 * (np.linalg.norm(first, axis=1) + np.linalg.norm(second, axis=1))
    unit = across / np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(body[:, 0] + length[:, None] * unit)


WINDOW, ORDER = 7, 3
EXTREMA_OF = ("height", "speed")


def printed_stance_pairs(height: FloatArray, *, extrema_of: str = "height") -> IntArray:
    """Return frames of consecutive stances, (P, 2).

    Candidates are the extrema of the height, where the speed of a Savitzky-Golay filter passes
    zero; literally printed are the extrema of that speed. Stances lie more than a standard
    deviation below the mean height, flights as far above. Of several stance candidates without a
    flight between them, the lowest counts. Frames with an unknown height are bridged by straight
    lines first, which is not printed.

    Parameters
    ----------
    height : (N,) array
        m, at a constant frame rate; NaN where unknown.
    extrema_of : str
        "height", or "speed" as printed.
    """
    from scipy.signal import savgol_filter

    require_choice("extrema_of", extrema_of, EXTREMA_OF)
    frames, known = np.arange(len(height)), np.isfinite(height)
    z = np.interp(frames, frames[known], height[known])
    low, high = z.mean() - z.std(), z.mean() + z.std()
    falling = savgol_filter(z, WINDOW, ORDER, deriv=1 if extrema_of == "height" else 2) < 0
    turn = np.diff(falling.astype(int))
    stances, flights = np.flatnonzero(turn < 0) + 1, np.flatnonzero(turn > 0) + 1
    if extrema_of == "height":
        stances = _merged(stances, flights[z[flights] > high], z)
    return _paired(stances, flights, z, low, high)


def _merged(stances: IntArray, flights: IntArray, z: FloatArray) -> IntArray:
    """Return the lowest of the stances between two flights."""
    group = np.searchsorted(flights, stances)
    return np.array(
        [min(stances[group == one], key=lambda k: z[k]) for one in np.unique(group)], dtype=int
    )


def _paired(
    stances: IntArray, flights: IntArray, z: FloatArray, low: float, high: float
) -> IntArray:
    """Pair each low stance with that after the next flight, if both are far enough from the mean.

    With merged stances, a low rise in a stance must not pass for the flight: only high ones count.
    """
    pairs = []
    for first in stances[z[stances] < low]:
        flight = flights[flights > first][:1]
        last = stances[stances > flight[0]][:1] if flight.size and z[flight[0]] > high else []
        if len(last) and z[last[0]] < low:
            pairs.append((first, last[0]))
    return np.array(pairs, dtype=int).reshape(-1, 2)
