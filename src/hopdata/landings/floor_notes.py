"""What is said of a floor beside its numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.rest import RestPoints
from hopdata.recordings.recording import Recording

FloatArray = NDArray[np.float64]

NOTED_SHARE = 0.05  # of a foot's rests, above the floor, from which that is told
NOTED_SLOPE_DEG = 1.0  # cameras are levelled better than this


def raised_notes(recording: Recording, rest: RestPoints, raised: NDArray[np.bool_]) -> list[str]:
    """Say which feet often rest above the floor."""
    names = recording.names("foot")
    shares = [float(raised[rest.foot == foot].mean()) for foot in range(len(names))]
    return [
        f"{name} rests above the floor in {100 * share:.0f} % of its frames at rest, left out"
        for name, share in zip(names, shares, strict=True)
        if share >= NOTED_SHARE
    ]


def degree_notes(found: int, wanted: int, largest_error_m: float) -> list[str]:
    """Say why the degree is lower than asked for."""
    if found == wanted:
        return []
    return [f"the feet at rest do not fix a floor of degree {wanted} to {largest_error_m:g} m"]


def slope_notes(places: FloatArray, ground_m: FloatArray, degree: int) -> list[str]:
    """Say that the floor slopes, if the plane through the feet at rest does and they fix one."""
    if degree == 0:
        return []
    columns = np.column_stack([np.ones(len(places)), places])
    plane = np.linalg.lstsq(columns, ground_m, rcond=None)[0]
    slope = np.rad2deg(np.arctan(np.hypot(plane[1], plane[2])))
    if slope < NOTED_SLOPE_DEG:
        return []
    return [
        f"the floor slopes by {slope:.1f} degrees; turn the file's axes upright, or raise "
        "floor.rest_band_m if feet at rest are left out"
    ]
