"""Which way is up, and the unit, from markers in free fall: they accelerate by g, downwards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from hopdata.gravity import GRAVITY_M_S2

FloatArray = NDArray[np.float64]

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
    shares = _shares(accelerations(positions, rate_hz), units)
    unit = max(shares, key=lambda u: max(shares[u].values()))
    ranked = sorted(shares[unit].items(), key=lambda item: -item[1])
    return FreeFall(unit, ranked[0][0], ranked[0][1], ranked[1][1])


def _shares(measured: FloatArray, units: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Share of the accelerations (K, M, 3), per s², that are free fall, mean over markers seen.

    For every unit and direction. With g in the unit, ``|a - g|² < (c g)²`` is looked at as
    ``|a|² - 2 a·g < (c² - 1) g²``, so that squares are formed once for all.
    """
    known = np.asarray(np.isfinite(measured).all(axis=2))
    seen = known.any(axis=0)
    counts = known.sum(axis=0)[seen]
    measured = np.where(known[..., np.newaxis], measured, np.nan)
    squares: FloatArray = np.einsum("kmi,kmi->km", measured, measured)
    shares: dict[str, dict[str, float]] = {unit: {} for unit in units}
    for up in DIRECTIONS:
        along: FloatArray = np.ascontiguousarray(measured[..., "xyz".index(up[-1])])
        for unit, metres in units.items():
            gravity = GRAVITY_M_S2 / metres
            turned = -2 * gravity if up.startswith("-") else 2 * gravity
            beyond = squares + turned * along
            near = np.asarray(beyond < (WITHIN**2 - 1) * gravity**2)
            found = np.count_nonzero(near[:, seen], axis=0)
            shares[unit][up] = float(np.mean(found / counts)) if seen.any() else 0.0
    return shares
