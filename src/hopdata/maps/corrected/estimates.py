"""All estimates of a study's landing map.

The printed map is affine in the 6B marker coordinates of the home frame. Its
coefficients are not a derivative, for two reasons: the home frame moves with the
landing, so some columns are outcomes rather than states, and on a section many
directions contain only noise. It is therefore given in rigid-body coordinates, like the
other estimates: the predictions of the printed map, in these coordinates, are fitted by
the state in the same coordinates (`printed_map`). To first order that is least squares
on the landings themselves (Frisch and Waugh 1933).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.maps.affine import affine_predictions
from hopdata.maps.coordinates import (
    output_weights,
    rigid_states,
    section_coordinates,
    split_states,
)
from hopdata.maps.corrected.marker_noise import (
    InputErrors,
    MarkerNoise,
    input_errors,
    marker_noise,
)
from hopdata.maps.corrected.regression import (
    LinearMap,
    corrected_map,
    curved_map,
    ols_map,
)
from hopdata.maps.draws import Notes
from hopdata.rigid import INPUT_NAMES, OUTPUT_NAMES, body_shape

# The estimates as a table for readers and as plain data for other stages.

#: Estimators in the order of the table -> description.
ESTIMATORS = {
    "printed": "affine least squares on marker coordinates, as printed",
    "ols": "least squares on rigid-body coordinates",
    "corrected": "errors in variables",
    "curved": "curvature-aware",
    "corrected_curved": "errors in variables and curvature-aware",
}


@dataclass(frozen=True)
class MapEstimates:
    """Estimates of one study.

    Attributes
    ----------
    maps
        Name of the estimator -> map of 8 inputs by 11 outputs in SI units; estimates
        that could not be computed are missing.
    n_landings
        Number of landings used.
    notes
        Estimates that failed or are limited, each ``{"what": ..., "reason": ...}``.
    shape
        (B, 3) body markers in the mean attitude, m, which define the coordinates;
        without rows if the markers are not a rigid body.
    noise
        Noise of the markers at the pre section.
    errors
        Errors of inputs and outputs that follow from this noise.
    input_covariance
        (8, 8) covariance of the measured inputs.
    output_weights
        (11,) factors from outputs to rms displacements of the markers, m.
    """

    maps: Mapping[str, LinearMap]
    n_landings: int
    notes: Notes
    shape: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    noise: MarkerNoise = field(default_factory=lambda: MarkerNoise(0.0, 0.0, 0.0))
    errors: InputErrors = field(default_factory=lambda: InputErrors.none(8, 11))
    input_covariance: FloatArray = field(default_factory=lambda: np.zeros((8, 8)))
    output_weights: FloatArray = field(default_factory=lambda: np.zeros(11))

    def table(self) -> pd.DataFrame:
        """Return one row per estimator, input and output.

        ``value`` and ``standard_error`` are in SI units; ``standardised`` is the rms
        displacement of the markers, mm, per standard deviation of the input.
        """
        sd = np.sqrt(np.diag(self.input_covariance))
        columns = [
            "estimator",
            "input",
            "output",
            "value",
            "standard_error",
            "standardised",
        ]
        if not self.maps:
            return pd.DataFrame(columns=columns)
        tables = []
        for name, one in self.maps.items():
            table = coefficient_table(one.coefficients, sd, self.output_weights)
            errors = one.standard_errors.ravel()
            tables.append(table.assign(estimator=name, standard_error=errors))
        return pd.concat(tables, ignore_index=True)[columns]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain data, for ``map_estimates.json``."""
        maps = {}
        for name, one in self.maps.items():
            maps[name] = {
                "what": ESTIMATORS[name],
                "coefficients": one.coefficients.tolist(),
                "standard_errors": one.standard_errors.tolist(),
                "degree": one.degree,
                "noise_removed": one.removed,
            }
        return {
            "inputs": INPUT_NAMES,
            "outputs": OUTPUT_NAMES,
            "maps": maps,
            "shape_m": self.shape.tolist(),
            "position_noise_m": float(np.sqrt(self.noise.position)),
            "velocity_noise_m_s": float(np.sqrt(self.noise.velocity)),
            "input_noise": np.sqrt(np.diag(self.errors.inputs)).tolist(),
            "input_covariance": self.input_covariance.tolist(),
            "output_weights_m": self.output_weights.tolist(),
            "n_landings": self.n_landings,
            "notes": self.notes,
        }


def coefficient_table(
    coefficients: FloatArray, input_sd: FloatArray, weights: FloatArray
) -> pd.DataFrame:
    """Return one row per input and output of a map (8, 11).

    Columns are ``input, output, value, standardised``; the last is the rms displacement
    of the markers, mm, per standard deviation of the input.
    """
    standardised = 1e3 * input_sd[:, None] * coefficients * weights
    columns = {
        "input": np.repeat(INPUT_NAMES, len(OUTPUT_NAMES)),
        "output": np.tile(OUTPUT_NAMES, len(INPUT_NAMES)),
        "value": coefficients.ravel(),
        "standardised": standardised.ravel(),
    }
    return pd.DataFrame(columns)


@one_blas_thread()
def estimate_maps(
    x: ArrayLike, y: ArrayLike, instants: ArrayLike, *, time_unit_s: float
) -> MapEstimates:
    """Estimate the landing map in every way that the landings allow.

    Parameters
    ----------
    x, y
        (n, 6B) home-frame states at the pre and the post section: positions, m, and
        velocities, m/s, of the markers of a rigid body.
    instants
        (n, feet) contact instants, s. Landings with an unknown state or instant are
        left out.
    time_unit_s
        Unit of time that weights velocities against positions.

    Returns
    -------
    MapEstimates
        The estimates; if the markers are not a rigid body, a note and no maps.
    """
    before = np.asarray(x, float)
    after = np.asarray(y, float)
    times = np.asarray(instants, float)
    known = np.asarray(np.isfinite(np.hstack([before, after, times])).all(axis=1))
    try:
        return _estimates(before[known], after[known], times[known], time_unit_s)
    except AnalysisError as error:
        note = {"what": "landing map", "reason": str(error)}
        return MapEstimates({}, int(known.sum()), [note])


def _estimates(
    before: FloatArray, after: FloatArray, times: FloatArray, time_unit_s: float
) -> MapEstimates:
    if len(before) < 2:
        raise AnalysisError(f"{len(before)} landings with known contact instants")
    shape = body_shape(split_states(before)[0])
    pre = rigid_states(before, shape)
    post = rigid_states(after, shape)
    inputs, outputs = section_coordinates(pre, post)
    noise = marker_noise(before, shape)
    errors = input_errors(before, after, shape, noise)
    weights = output_weights(shape, time_unit_s)
    units = 1 / weights
    estimators = {
        "printed": lambda: printed_map(before, after, shape),
        "ols": lambda: ols_map(inputs, outputs),
        "corrected": lambda: corrected_map(inputs, outputs, errors),
        "curved": lambda: curved_map(inputs, outputs, times, units=units),
        "corrected_curved": lambda: curved_map(
            inputs, outputs, times, errors, units=units
        ),
    }
    maps = {}
    notes: list[dict[str, Any]] = []
    for name, what in ESTIMATORS.items():
        try:
            maps[name] = estimators[name]()
        except AnalysisError as error:
            notes.append({"what": f"landing map, {what}", "reason": str(error)})
            continue
        removed = maps[name].removed
        if 0.0 < removed < 1.0:
            reason = (
                f"only {100 * removed:.2g} % of the noise covariance could be taken "
                "off, since the states vary little beyond it"
            )
            note = {"what": f"landing map, {what}", "reason": reason}
            notes.append({**note, "removed": float(removed)})
    return MapEstimates(
        maps=maps,
        n_landings=len(inputs),
        notes=notes,
        shape=shape,
        noise=noise,
        errors=errors,
        input_covariance=np.cov(inputs, rowvar=False),
        output_weights=weights,
    )


def printed_map(before: FloatArray, after: FloatArray, shape: FloatArray) -> LinearMap:
    """Return the affine map of the marker coordinates in rigid-body coordinates.

    The predictions lie on the map and do not scatter as landings do. The standard
    errors are therefore those of least squares on the landings themselves, which equals
    this map to first order.

    Parameters
    ----------
    before, after
        (n, 6B) home-frame states at the two sections, m and m/s.
    shape
        (B, 3) markers in the body, m.
    """
    pre = rigid_states(before, shape)
    predicted = rigid_states(affine_predictions(before, after), shape)
    observed = rigid_states(after, shape)
    of_predictions = ols_map(*section_coordinates(pre, predicted))
    of_landings = ols_map(*section_coordinates(pre, observed))
    return replace(of_predictions, standard_errors=of_landings.standard_errors)
