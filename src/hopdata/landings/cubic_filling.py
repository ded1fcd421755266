"""Short gaps of a body marker, bridged by a cubic where no foot touches or lifts off."""

from __future__ import annotations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.contacts.descents import height_noise
from hopdata.recordings.quality.stretches import runs

FLANK = 5  # frames on either side that the cubic is fitted to
DEGREE = 3
AT_REST_SIGMAS = 8.0  # range of a foot's heights, in their noise, up to which it stands
LARGEST_MISFIT = 3.0  # of the cubic to these frames, in the marker's noise
CLEAR_SIGMAS = 10.0
CLEAR_M = 0.005  # a foot above this, and above that many times the noise, is in the air


def cubic_places(
    time: FloatArray, body: FloatArray, feet: FloatArray, wanted: BoolArray, *, longest: int
) -> FloatArray:
    """Places of the wanted markers on a cubic through the frames on either side of each gap.

    A gap is bridged only if its marker is seen in five frames on either side, and every foot is
    seen from the first of these to the last and stands still throughout, or is clear of the floor
    throughout: a body's acceleration jumps when a foot touches, and no smooth curve knows by how
    much. Nor is it bridged where a cubic does not fit the frames on either side.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Body markers, m; NaN where unseen.
    feet : (N, n) array
        Heights of the feet above the levelled floor, m; NaN where unseen.
    wanted : (N, B) bool array
        Which to place; none of them is seen.
    longest : int
        Longest gap to bridge, frames.

    Returns
    -------
    (N, B, 3) array
        m; NaN where not placed.
    """
    places = np.full(body.shape, np.nan)
    seen = np.asarray(np.isfinite(body).all(axis=2))
    noise_m = height_noise(feet)
    for marker in range(body.shape[1]):
        largest_m = LARGEST_MISFIT * height_noise(body[:, marker])
        for start, stop in runs(~seen[:, marker]):
            first, last = start - FLANK, stop + FLANK
            fits = stop - start <= longest and first >= 0 and last <= len(time)
            if not fits or not wanted[start:stop, marker].all():
                continue
            flanks = np.r_[first:start, stop:last]
            if seen[flanks, marker].all() and one_phase(feet[first:last], noise_m):
                places[start:stop, marker] = _cubic(
                    time[flanks], body[flanks, marker], time[start:stop], largest_m
                )
    return places


def one_phase(heights: FloatArray, noise_m: float) -> bool:
    """Tell whether each foot stands, or is in the air, through all of (K, n) frames."""
    standing = np.ptp(heights, axis=0) <= AT_REST_SIGMAS * noise_m
    flying = heights.min(axis=0) > max(CLEAR_M, CLEAR_SIGMAS * noise_m)
    return bool((standing | flying).all())  # both false for a foot that is not seen


def _cubic(time: FloatArray, points: FloatArray, at: FloatArray, largest_m: float) -> FloatArray:
    """Values at times (k,) of the cubic nearest to points (m, 3), (k, 3); NaN if it fits badly."""
    middle, half = 0.5 * (time[0] + time[-1]), 0.5 * (time[-1] - time[0])
    powers = np.arange(DEGREE + 1)
    columns = ((time - middle) / half)[:, None] ** powers
    fitted = np.linalg.lstsq(columns, points, rcond=None)[0]
    square = ((points - columns @ fitted) ** 2).sum(axis=0) / (len(points) - len(powers))
    if square.max() > largest_m**2:  # of any coordinate
        return np.full((len(at), 3), np.nan)
    return np.asarray(((at - middle) / half)[:, None] ** powers @ fitted)
