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

#: An affine map whose rms error is below this share of the mean's is exact, and the
#: rest is rounding.
#: Unit: 1. Origin: chosen.
EXACT = 1e-9

# How units are chosen, in words.
TIME_RULE = "rms position error over rms velocity error, leave-one-out {} predictor"
LENGTH_RULE = "rms norm of the centred post-section positions of all body markers"


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
        """Return all values and the printed units, for ``units.json``."""
        content = asdict(self)
        content["velocity_unit_m_s"] = self.velocity_unit_m_s
        content["printed_length_unit_m"] = 0.02913
        content["printed_time_unit_s"] = 0.027
        return content


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
    x = np.asarray(x, float)
    y = np.asarray(y, float)
    if len(x) < 3:
        raise AnalysisError.at("units", "at least 3 landings", len(x))
    errors, predictor = prediction_errors(x, y)
    position_errors, velocity_errors = np.split(errors, 2, axis=1)
    rms_position = _rms(position_errors)
    rms_velocity = _rms(velocity_errors)

    if length_m is None:
        positions, _ = np.split(y - y.mean(0), 2, axis=1)
        length = float(np.sqrt(np.mean(np.sum(positions**2, axis=1))))
        length_rule = LENGTH_RULE
    else:
        length = float(length_m)
        length_rule = "given"

    if time_s is None:
        # Landings without any error in velocity have no unit of time.
        time = rms_position / rms_velocity if rms_velocity > 0 else 0.0
        time_rule = TIME_RULE.format(predictor)
    else:
        time = float(time_s)
        time_rule = "given"

    if not (np.isfinite([length, time]).all() and length > 0 and time > 0):
        found = f"a length unit of {length:g} m and a time unit of {time:g} s"
        found += "; set units.length_m and units.time_s"
        raise AnalysisError.at("units", "landings that differ from each other", found)
    return Units(
        length_unit_m=length,
        time_unit_s=time,
        length_rule=length_rule,
        time_rule=time_rule,
        rms_position_error_m=rms_position,
        rms_velocity_error_m_s=rms_velocity,
        predictor=predictor,
        n_landings=len(x),
    )


def prediction_errors(x: FloatArray, y: FloatArray) -> tuple[FloatArray, str]:
    """Return leave-one-out errors (n, 6B) of the unspecialised map, and its predictor.

    The mean predictor is used if there are too few landings for an affine map, or if
    the affine map is exact, so that its errors are only rounding.
    """
    # The error of the mean of the others is n / (n - 1) times the distance from the
    # mean of all.
    of_mean = (y - y.mean(0)) * len(y) / (len(y) - 1)
    try:
        of_map = leave_one_out_residuals(x, y)
    except AnalysisError:
        return of_mean, "mean"
    map_parts = np.split(of_map, 2, axis=1)  # positions, then velocities
    mean_parts = np.split(of_mean, 2, axis=1)
    for map_errors, mean_errors in zip(map_parts, mean_parts, strict=True):
        if _rms(map_errors) < EXACT * _rms(mean_errors):
            return of_mean, "mean"
    return of_map, "affine"


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
