"""What a simulation knows about a recording and a camera does not; only scoring reads it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Truth:
    """Truth of a synthetic recording of N frames, L landings and n feet.

    A landing runs from the apex of one hop to the apex of the next.

    Parameters
    ----------
    contact_times : (L, n) array
        Instant at which each foot first touched in each landing, s; NaN if it did not.
    apex_times : (L,) array
        Time of the apex before each landing, s.
    complete : (L,) bool array
        Whether all feet stood at once.
    foot_down : (N, n) bool array
        Whether each foot was in contact, at each frame.
    body_height : (N,) array
        Mean height of the body markers above the flat simulated floor, without noise, m.
    contact_points : (L, n, 2) array
        Where each foot first touched, world frame, m.
    floor_at_contacts : (L, n) array
        Height of the measured (curved) floor at these points, m.
    apex_states : (L, 12) array
        State of the hopper at the apex, after its kick (see `hopdata.scenes.hopper`).
    preloads_n : (L, n) array
        Preload of each leg in each landing, N.
    noise_m : float
        Standard deviation of the noise per marker coordinate, m.
    parameters_json : str
        Everything that the recording was made with, as JSON.
    """

    contact_times: FloatArray
    apex_times: FloatArray
    complete: BoolArray
    foot_down: BoolArray
    body_height: FloatArray
    contact_points: FloatArray
    floor_at_contacts: FloatArray
    apex_states: FloatArray
    preloads_n: FloatArray
    noise_m: float
    parameters_json: str
