"""Which way is up, and the unit, from markers in free fall: they accelerate by g, downwards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
HALF_WINDOW_S = 0.04
WITHIN = 0.25  # of g: how far an acceleration may be from free fall
LEAST_SHARE = 0.01  # of all frames of a marker, mean over markers
CLEARER = 2.0  # the best guess must have more frames in free fall than the next by this factor
MOST_FRAMES = 20_000  # evaluated, evenly spaced

UNITS_IN_M: Mapping[str, float] = MappingProxyType(
    {"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "m": 1.0}
)
DIRECTIONS = ("x", "-x", "y", "-y", "z", "-z")


@dataclass(frozen=True)
class FreeFall:
    """How much of a recording looks like free fall.

    Parameters
    ----------
    unit : str
        The unit that shows most of it.
    up : str
        The direction away from which it falls: ``"z"``, ``"-y"`` and so on.
    share : float
        Share of the frames in free fall, mean over the markers.
    next_share : float
        The same for the best other direction in this unit.
    """

    unit: str
    up: str
    share: float
    next_share: float

    @property
    def is_clear(self) -> bool:
        """Whether there is enough free fall, and much more than along any other direction."""
        return self.share >= LEAST_SHARE and self.share > CLEARER * self.next_share


def accelerations(positions: FloatArray, rate_hz: float) -> FloatArray:
    """Second derivative of (N, M, 3) positions by parabolas over 80 ms, (K, M, 3), per s².

    At most about `MOST_FRAMES` evenly spaced frames are evaluated.
    """
    half = max(2, round(HALF_WINDOW_S * rate_hz))
    time = np.arange(-half, half + 1) / rate_hz
    weights = 2 * np.linalg.pinv(np.stack([np.ones_like(time), time, time**2], axis=1))[2]
    n = len(positions) - 2 * half
    if n < 1:
        return np.zeros((0, *positions.shape[1:]))
    stride = max(1, n // MOST_FRAMES)
    return sum(weight * positions[k : k + n : stride] for k, weight in enumerate(weights))


def free_fall(
    positions: FloatArray, rate_hz: float, *, units: Mapping[str, float] = UNITS_IN_M
) -> FreeFall:
    """Look for free fall in every direction and unit.

    Parameters
    ----------
    positions : (N, M, 3) array
        In the unknown unit, along the file's axes.
    rate_hz : float
        Frame rate, Hz.
    units : mapping
        Units to try, in m.

    Returns
    -------
    FreeFall
        The best guess; see `FreeFall.is_clear`.
    """
    measured = accelerations(positions, rate_hz)
    shares = {
        unit: {up: _share(measured * metres, up) for up in DIRECTIONS}
        for unit, metres in units.items()
    }
    unit = max(shares, key=lambda u: max(shares[u].values()))
    ranked = sorted(shares[unit].items(), key=lambda item: -item[1])
    return FreeFall(unit, ranked[0][0], ranked[0][1], ranked[1][1])


def _share(measured: FloatArray, up: str) -> float:
    """Share of the accelerations (K, M, 3), m/s², that are free fall, mean over markers seen."""
    fall = np.zeros(3)
    fall["xyz".index(up[-1])] = GRAVITY_M_S2 if up.startswith("-") else -GRAVITY_M_S2
    known = np.isfinite(measured).all(axis=2)
    near = np.zeros(known.shape, dtype=bool)
    near[known] = np.linalg.norm(measured[known] - fall, axis=1) < WITHIN * GRAVITY_M_S2
    counts = known.sum(axis=0)
    return (
        float(np.mean(near.sum(axis=0)[counts > 0] / counts[counts > 0])) if counts.any() else 0.0
    )
