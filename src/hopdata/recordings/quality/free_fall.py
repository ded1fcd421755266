"""Free fall of markers, which accelerate downwards by g: it shows the unit and up.

Nothing but gravity accelerates markers by 9.81 m/s² in one direction for 80 ms.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray
from hopdata.recordings.axes import DIRECTIONS, along
from hopdata.recordings.quality.rests import scale_of_all
from hopdata.scale import sampled

#: Half the time over which a parabola gives an acceleration, for an animal of 1 m.
#: Unit: s. Origin: chosen.
HALF_WINDOW_S = 0.04

#: Largest deviation of an acceleration from free fall, relative to g.
#: Unit: 1. Origin: chosen.
WITHIN = 0.25

#: Least share of a marker's frames in free fall, as a mean over the markers.
#: Unit: 1. Origin: chosen.
LEAST_SHARE = 0.01

#: Ratio of the frames in free fall to those along the next best direction, above which
#: the direction is clear.
#: Unit: 1. Origin: chosen.
CLEARER = 4.0

#: The same where less is at stake.
#: Unit: 1. Origin: chosen.
SOME_CLEARER = 1.5

#: Share of a marker's frames in free fall from which on it counts as falling.
#: Unit: 1. Origin: derived: as for the mean over all markers.
FALLS = LEAST_SHARE

#: Share of the markers seen that fall at once in a flight. In a step one foot stands,
#: and a swinging leg falls with few markers.
#: Unit: 1. Origin: chosen. At two thirds of it one made-up walker in six more is asked
#: about; at 0.9 half the rate of a hopper is no longer noticed.
ALL_AT_ONCE = 0.75

#: Evenly spaced frames that are evaluated, about.
#: Unit: frames. Origin: chosen.
MOST_FRAMES = 20_000

UNITS_IN_M = MappingProxyType({"mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "m": 1.0})


@dataclass(frozen=True)
class FreeFall:
    """How much of a recording looks like free fall.

    Parameters
    ----------
    unit : str
        The unit in which most frames are in free fall.
    up : str
        The direction opposite to the fall: ``"z"``, ``"-y"`` and so on.
    share : float
        Share of the frames in free fall, mean over the markers.
    next_share : float
        The same for the best other direction in this unit.
    other_unit_share : float
        The same for the best other unit, in any direction.
    spread : float
        Share of the markers that fall in this direction. Whatever leaves the ground
        falls with all of them; a swinging limb falls with few, along any axis.
    together : float
        Share of the frames in which most markers fall in this direction at once.
    """

    unit: str
    up: str
    share: float
    next_share: float
    other_unit_share: float = 0.0
    spread: float = 0.0
    together: float = 0.0

    @property
    def is_clear(self) -> bool:
        """Tell whether free fall is frequent, and far more so than along others."""
        return self._is_clearer(CLEARER)

    @property
    def is_rather_clear(self) -> bool:
        """Tell whether free fall is frequent, and more so than along others."""
        return self._is_clearer(SOME_CLEARER)

    def _is_clearer(self, ratio: float) -> bool:
        is_frequent = self.share >= LEAST_SHARE
        return is_frequent and self.share > ratio * self.next_share


def accelerations(
    positions: FloatArray, rate_hz: float, *, metres: float
) -> FloatArray:
    """Return accelerations of (N, M, 3) positions from parabolas, (K, M, 3), per s².

    A parabola spans 80 ms, or less for a small animal. At most about `MOST_FRAMES`
    evenly spaced frames are evaluated.

    Parameters
    ----------
    positions : (N, M, 3) array
        In any unit.
    rate_hz : float
        Frame rate, Hz.
    metres : float
        Length of one unit, m.
    """
    # Small animals are faster by the root of their size.
    time_scale = np.sqrt(scale_of_all(sampled(positions) * metres))
    half = max(2, round(HALF_WINDOW_S * time_scale * rate_hz))
    n_windows = len(positions) - 2 * half
    if n_windows < 1:
        return np.zeros((0, *positions.shape[1:]))
    stride = max(1, n_windows // MOST_FRAMES)
    total = 0
    for k, weight in enumerate(_second_derivative(half, rate_hz)):
        total = total + weight * positions[k : k + n_windows : stride]
    return np.asarray(total)


def _second_derivative(half: int, rate_hz: float) -> FloatArray:
    """Return the weights of 2 half + 1 frames in a parabola's second derivative."""
    time = np.arange(-half, half + 1) / rate_hz
    powers = np.stack([np.ones_like(time), time, time**2], axis=1)
    return np.asarray(2 * np.linalg.pinv(powers)[2])


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
        Units to try, and their lengths in m.

    Returns
    -------
    FreeFall
        The best guess; see `FreeFall.is_clear`.
    """
    measured: dict[str, FloatArray] = {}
    shares: dict[str, dict[str, float]] = {}
    spreads: dict[str, dict[str, float]] = {}
    for unit, metres in units.items():
        measured[unit] = accelerations(positions, rate_hz, metres=metres)
        falling = falling_markers(measured[unit], metres)
        shares[unit] = {}
        spreads[unit] = {}
        for up, of_markers in falling.items():
            shares[unit][up] = float(of_markers.mean())
            spreads[unit][up] = float(np.mean(of_markers >= FALLS))
    best_of_unit = {unit: max(shares[unit].values()) for unit in units}
    unit = max(best_of_unit, key=lambda unit: best_of_unit[unit])
    ranked = sorted(shares[unit].items(), key=lambda item: -item[1])
    up, share = ranked[0]
    _, next_share = ranked[1]
    others = [best_of_unit[other] for other in units if other != unit]
    other_share = max(others, default=0.0)
    together = share_falling_together(measured[unit], units[unit], up)
    spread = spreads[unit][up]
    return FreeFall(unit, up, share, next_share, other_share, spread, together)


def shares_in_free_fall(measured: FloatArray, metres: float) -> dict[str, float]:
    """Return the share of frames in free fall along each direction.

    It is the mean over the markers that are seen; see `falling_markers`.
    """
    falling = falling_markers(measured, metres)
    return {up: float(of_markers.mean()) for up, of_markers in falling.items()}


def falling_markers(measured: FloatArray, metres: float) -> dict[str, FloatArray]:
    """Return the share of its frames in which each seen marker falls, by direction.

    With g in the unit of the
    accelerations, ``|a - g|² < (c g)²`` is tested as ``|a|² - 2 a·g < (c² - 1) g²``, so
    that squares are formed only once.

    Parameters
    ----------
    measured : (K, M, 3) array
        Accelerations, per s².
    metres : float
        Length of their unit, m.
    """
    squares: FloatArray = np.einsum("kmi,kmi->km", measured, measured)
    known = np.asarray(np.isfinite(squares))
    seen = known.any(axis=0)
    if not seen.any():
        return {up: np.zeros(1) for up in DIRECTIONS}
    n_known = known.sum(axis=0)[seen]
    shares: dict[str, FloatArray] = {}
    for up in DIRECTIONS:
        falls = _falls(measured, squares, metres, up)
        n_falling = np.count_nonzero(falls[:, seen], axis=0)
        shares[up] = np.asarray(n_falling / n_known)
    return shares


def share_falling_together(measured: FloatArray, metres: float, up: str) -> float:
    """Return the share of the frames in which most of the markers seen fall at once.

    Parameters
    ----------
    measured : (K, M, 3) array
        Accelerations, per s².
    metres : float
        Length of their unit, m.
    up : str
        Direction opposite to the fall, one of `axes.DIRECTIONS`.
    """
    squares: FloatArray = np.einsum("kmi,kmi->km", measured, measured)
    n_seen = np.isfinite(squares).sum(axis=1)
    if not n_seen.any():
        return 0.0
    n_falling = _falls(measured, squares, metres, up).sum(axis=1)
    together = n_falling >= ALL_AT_ONCE * n_seen
    return float(np.mean(together[n_seen > 0]))


def _falls(
    measured: FloatArray, squares: FloatArray, metres: float, up: str
) -> BoolArray:
    """Return where accelerations (K, M, 3), of these squares, are those of a fall."""
    gravity = GRAVITY_M_S2 / metres
    pulled = 2 * gravity * along(measured, up)
    return np.asarray(squares + pulled < (WITHIN**2 - 1) * gravity**2)


def liveliness(positions: FloatArray, rate_hz: float, *, metres: float) -> float:
    """Return the acceleration that the median marker exceeds in a tenth of the time.

    Per s², in the unit of the positions, which is `metres` long.
    """
    measured = accelerations(positions, rate_hz, metres=metres)
    size: FloatArray = np.linalg.norm(measured, axis=2)
    of_seen = size[:, np.isfinite(size).any(axis=0)]
    if not of_seen.size:
        return np.nan
    return float(np.median(np.nanquantile(of_seen, 0.9, axis=0)))
