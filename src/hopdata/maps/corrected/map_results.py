"""The estimates of a study's landing map: a table for people, plain data for other stages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.corrected.marker_noise import InputErrors, MarkerNoise
from hopdata.maps.corrected.regression import LinearMap
from hopdata.maps.rigid import INPUT_NAMES, OUTPUT_NAMES

if TYPE_CHECKING:
    import pandas as pd

#: Estimators in the order of the table, with what each is.
ESTIMATORS = {
    "printed": "affine least squares on marker coordinates, as printed",
    "ols": "least squares on rigid-body coordinates",
    "corrected": "errors in variables",
    "curved": "curvature-aware",
    "corrected_curved": "errors in variables and curvature-aware",
}

Floats = NDArray[np.float64]
Notes = list[dict[str, str]]


@dataclass(frozen=True)
class MapEstimates:
    """Estimates of one study.

    Attributes
    ----------
    maps
        Name of the estimator -> the map, 8 inputs by 11 outputs in SI units; those that could not
        be made are missing.
    shape
        (B, 3) body markers in the mean attitude, m: what the coordinates rest on; without rows if
        they show no rigid body.
    noise
        Of the markers at the pre section.
    errors
        What it does to the inputs.
    input_covariance
        (8, 8) of the measured inputs.
    output_weights
        (11,) from outputs to rms displacements of the markers, m.
    n_landings
        Landings that they rest on.
    notes
        What could not be done, each ``{"what": ..., "reason": ...}``.
    """

    maps: Mapping[str, LinearMap]
    shape: Floats
    noise: MarkerNoise
    errors: InputErrors
    input_covariance: Floats
    output_weights: Floats
    n_landings: int
    notes: Notes

    def table(self) -> pd.DataFrame:
        """Return one row an estimator, input and output.

        ``value`` and ``standard_error`` are in SI units; ``standardised`` is the rms displacement
        of the markers, mm, by one standard deviation of the input.
        """
        import pandas as pd

        sd = np.sqrt(np.diag(self.input_covariance))
        rows = [
            (
                name,
                INPUT_NAMES[i],
                OUTPUT_NAMES[j],
                one.coefficients[i, j],
                one.standard_errors[i, j],
                1e3 * sd[i] * one.coefficients[i, j] * self.output_weights[j],
            )
            for name, one in self.maps.items()
            for i in range(len(INPUT_NAMES))
            for j in range(len(OUTPUT_NAMES))
        ]
        columns = ["estimator", "input", "output", "value", "standard_error", "standardised"]
        return pd.DataFrame(rows, columns=columns)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain data, for ``map_estimates.json``."""
        return {
            "inputs": INPUT_NAMES,
            "outputs": OUTPUT_NAMES,
            "maps": {
                name: {
                    "what": ESTIMATORS[name],
                    "coefficients": one.coefficients.tolist(),
                    "standard_errors": one.standard_errors.tolist(),
                    "degree": one.degree,
                    "noise_removed": one.removed,
                }
                for name, one in self.maps.items()
            },
            "shape_m": self.shape.tolist(),
            "position_noise_m": float(np.sqrt(self.noise.position)),
            "velocity_noise_m_s": float(np.sqrt(self.noise.velocity)),
            "input_noise": np.sqrt(np.diag(self.errors.inputs)).tolist(),
            "input_covariance": self.input_covariance.tolist(),
            "output_weights_m": self.output_weights.tolist(),
            "n_landings": self.n_landings,
            "notes": self.notes,
        }
