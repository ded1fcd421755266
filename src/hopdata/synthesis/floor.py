"""A floor that looks curved by a few millimetres, as cameras see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.synthesis.options import FloorOptions

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class CurvedFloor:
    """Height of the measured floor: a bowl that levels off, and waves; no polynomial.

    Parameters
    ----------
    bowl_depth_m, bowl_radius_m : float
        See `FloorOptions`.
    wave_vectors : (W, 2) array
        Wave vectors, rad/m.
    phases : (W,) array
        Phase of each wave at the origin, rad.
    wave_amplitude_m : float
        Amplitude of each wave.
    """

    bowl_depth_m: float
    bowl_radius_m: float
    wave_vectors: FloatArray
    phases: FloatArray
    wave_amplitude_m: float

    def height(self, xy: FloatArray) -> FloatArray:
        """Height, (...), m, at points (..., 2), m."""
        square = np.sum(xy**2, axis=-1) / self.bowl_radius_m**2
        waves = np.sin(xy @ self.wave_vectors.T + self.phases).sum(axis=-1)
        return self.bowl_depth_m * square / (1.0 + square) + self.wave_amplitude_m * waves


def draw_floor(options: FloorOptions, rng: np.random.Generator) -> CurvedFloor:
    """Draw the directions, lengths and phases of a floor's waves."""
    angle = rng.uniform(0.0, 2.0 * np.pi, options.waves)
    length = options.wave_length_m * rng.uniform(1.0, 1.5, options.waves)
    number = 2.0 * np.pi / length
    return CurvedFloor(
        bowl_depth_m=options.bowl_depth_m,
        bowl_radius_m=options.bowl_radius_m,
        wave_vectors=np.column_stack([number * np.cos(angle), number * np.sin(angle)]),
        phases=rng.uniform(0.0, 2.0 * np.pi, options.waves),
        wave_amplitude_m=options.wave_amplitude_m,
    )
