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


# Sizes that go by letters: N frames, L landings, n feet; the others are fixed.
_SIZES: dict[str, str] = {
    "contact_times": "L n",
    "apex_times": "L",
    "complete": "L",
    "foot_down": "N n",
    "body_height": "N",
    "contact_points": "L n 2",
    "floor_at_contacts": "L n",
    "apex_states": "L 12",
    "preloads_n": "L n",
}


def check_sizes(truth: Truth) -> None:
    """Require that the arrays of a truth agree in their numbers of frames, landings and feet.

    Raises
    ------
    ValueError
        Naming the array that does not fit those before it.
    """
    known: dict[str, int] = {}
    for name, letters in _SIZES.items():
        shape, sizes = getattr(truth, name).shape, letters.split()
        expected = [
            int(letter) if letter.isdigit() else known.setdefault(letter, size)
            for letter, size in zip(sizes, shape, strict=False)
        ]
        if len(shape) != len(sizes) or list(shape) != expected:
            raise ValueError(
                f"{name}: expected shape ({', '.join(sizes)}) of {known}, found {shape}"
            )
