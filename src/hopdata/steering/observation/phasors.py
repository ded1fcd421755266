"""Pose in the plane from markers as seen from above (dissertation, Algorithm 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


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
