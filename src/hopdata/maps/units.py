"""Units of length and time in which position and velocity errors have equal weight.

They follow Sec. 2.2.4 of the dissertation, which prints 29.13 mm and 27 ms but not the
rule. Here:

- the length unit is the rms norm of the centred post-section position vector of all
  body markers, so that one unit is the typical distance of a landing's outcome from the
  mean outcome;
- the time unit is the ratio of the rms position prediction error to the rms velocity
  prediction error of the unspecialised affine map, where each landing is predicted from
  all the others.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.maps.affine import leave_one_out_residuals


@dataclass(frozen=True)
class Units:
    """Units of a study, and the prediction errors they rest on.

    Attributes
    ----------
    length_unit_m, time_unit_s
        The units; their ratio is the velocity unit.
    length_rule, time_rule
        How each unit was chosen, in words: from the data, or given in the
        configuration.
    rms_position_error_m, rms_velocity_error_m_s
        Rms prediction error per coordinate of the predictor.
    predictor
        ``"affine"``, or ``"mean"`` if no affine map can be used: see
        `prediction_errors`.
    n_landings
        Number of landings used.
    """

    length_unit_m: float
    time_unit_s: float
    length_rule: str
    time_rule: str
    rms_position_error_m: float
    rms_velocity_error_m_s: float
    predictor: str
    n_landings: int

    @property
    def velocity_unit_m_s(self) -> float:
        """Unit of velocity, in m/s."""
        return self.length_unit_m / self.time_unit_s

    def to_dict(self) -> dict[str, Any]:
        """Return all values and the dissertation's printed units, for ``units.json``."""
        printed = {"printed_length_unit_m": 0.02913, "printed_time_unit_s": 0.027}
        return {**asdict(self), "velocity_unit_m_s": self.velocity_unit_m_s, **printed}


@one_blas_thread()
def choose_units(
    x: FloatArray,
    y: FloatArray,
    *,
    length_m: float | None = None,
    time_s: float | None = None,
) -> Units:
    """Choose the units of a study from its pairs.

    Parameters
    ----------
    x, y
        (n, 6B) home-frame states at the pre and the post section: 3B positions in m,
        then 3B velocities in m/s.
    length_m, time_s
        Fixed units; by default the rules of this module choose them.

    Raises
    ------
    AnalysisError
        If there are fewer than three landings, or if the data do not vary at all.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    if len(x) < 3:
        raise AnalysisError.at("units", "at least 3 landings", len(x))
    errors, predictor = prediction_errors(x, y)
    position, velocity = map(_rms, np.split(errors, 2, axis=1))
    places = np.split(y - y.mean(0), 2, axis=1)[0]
    spread = float(np.sqrt(np.mean(np.sum(places**2, axis=1))))
    length = spread if length_m is None else float(length_m)
    time = (
        position / velocity if time_s is None and velocity > 0 else float(time_s or 0)
    )
    if not (np.isfinite([length, time]).all() and length > 0 and time > 0):
        found = f"a length unit of {length:g} m and a time unit of {time:g} s"
        found += "; set units.length_m and units.time_s"
        raise AnalysisError.at("units", "landings that differ from each other", found)
    return Units(
        length_unit_m=length,
        time_unit_s=time,
        length_rule=_LENGTH_RULE if length_m is None else "given",
        time_rule=_TIME_RULE.format(predictor) if time_s is None else "given",
        rms_position_error_m=position,
        rms_velocity_error_m_s=velocity,
        predictor=predictor,
        n_landings=len(x),
    )


def prediction_errors(x: FloatArray, y: FloatArray) -> tuple[FloatArray, str]:
    """Return the leave-one-out errors (n, 6B) of the unspecialised map and the predictor's name.

    The mean predictor is used if there are too few landings for an affine map, or if
    the affine map is exact, so that its errors are only rounding.
    """
    # The error of the mean of the others is n / (n - 1) times the distance from the
    # mean of all.
    of_mean = (y - y.mean(0)) * len(y) / (len(y) - 1)
    try:
        errors = leave_one_out_residuals(x, y)
    except AnalysisError:
        return of_mean, "mean"
    parts = zip(np.split(errors, 2, axis=1), np.split(of_mean, 2, axis=1), strict=True)
    exact = any(_rms(left) < 1e-9 * _rms(whole) for left, whole in parts)
    return (of_mean, "mean") if exact else (errors, "affine")


_TIME_RULE = "rms position error over rms velocity error, leave-one-out {} predictor"
_LENGTH_RULE = "rms norm of the centred post-section positions of all body markers"


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
