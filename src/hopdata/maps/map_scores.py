"""Estimated landing maps against the exact one.

The error of a map is the rms error of what it predicts over the rms of what the exact map
predicts, for the deviations of the study's true inputs. Outputs count as rms displacements of the
body markers, velocities by the way they make in the unit of time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.entries import Entries, entry
from hopdata.maps.rigid import (
    INPUT_NAMES,
    OUTPUT_NAMES,
    kabsch,
    output_weights,
    rigid_states,
    section_coordinates,
)

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ExactMap:
    """The exact derivative in the coordinates of a study.

    Attributes
    ----------
    coefficients
        (8, 11), SI units.
    input_covariance
        (8, 8) of the true inputs.
    weights
        (11,) from outputs to displacements, m.
    """

    coefficients: Floats
    input_covariance: Floats
    weights: Floats

    def error(self, coefficients: Floats) -> float:
        """Return the relative error of an estimate (8, 11)."""
        return self._size(coefficients - self.coefficients) / self._size(self.coefficients)

    def table(self) -> pd.DataFrame:
        """Return one row an input and output, as `MapEstimates.table` has them."""
        import pandas as pd

        sd = np.sqrt(np.diag(self.input_covariance))
        shown = 1e3 * sd[:, None] * self.coefficients * self.weights
        return pd.DataFrame(
            {
                "input": np.repeat(INPUT_NAMES, len(OUTPUT_NAMES)),
                "output": np.tile(OUTPUT_NAMES, len(INPUT_NAMES)),
                "value": self.coefficients.ravel(),
                "standardised": shown.ravel(),
            }
        )

    def _size(self, coefficients: Floats) -> float:
        weighted = coefficients * self.weights
        return float(np.sqrt(np.trace(weighted.T @ self.input_covariance @ weighted)))


def exact_map(
    before: Floats,
    after: Floats,
    states: Floats,
    points: Floats,
    *,
    shape: Floats,
    time_unit_s: float,
) -> ExactMap:
    """Bring the exact map to the coordinates that the estimates use.

    Parameters
    ----------
    before, after
        (16, 6B) marker states of neighbouring landings; see `hopdata.synthesis.known_maps`.
    states
        (n, 6B) true marker states of the study's landings at the pre section.
    points
        (B, 3) markers in the body, m, in any attitude.
    shape
        (B, 3) the same as estimated, in the attitude of the coordinates.
    time_unit_s
        Unit of time that weighs velocities against positions.

    Raises
    ------
    ValueError
        If the arrays do not match.
    """
    half, odd = divmod(len(before), 2)
    if odd or len(after) != len(before) or half != len(INPUT_NAMES):
        raise ValueError(f"expected 16 neighbours, found {len(before)} and {len(after)}")
    centred = points - points.mean(axis=0)
    turned = centred @ kabsch(shape[None], centred)[0].T
    x, y = section_coordinates(rigid_states(before, turned), rigid_states(after, turned))
    slopes = np.linalg.solve(x[:half] - x[half:], y[:half] - y[half:])
    known = rigid_states(states, turned)
    inputs, _ = section_coordinates(known, known)
    return ExactMap(slopes, np.cov(inputs, rowvar=False), output_weights(turned, time_unit_s))


def score_maps(exact: ExactMap, estimates: Mapping[str, Mapping[str, object]]) -> Entries:
    """Say how far the estimates of ``map_estimates.json`` are from the exact map."""
    errors = {
        name: exact.error(np.array(one["coefficients"], float)) for name, one in estimates.items()
    }
    entries = {
        f"map_error_{name}": entry(
            error, "1", f"Relative error of the landing map, {estimates[name]['what']}"
        )
        for name, error in errors.items()
    }
    if {"printed", "corrected_curved"} <= errors.keys():
        what = "Error of the printed landing map over that of the one with both corrections"
        gain = errors["printed"] / errors["corrected_curved"]
        entries["map_error_gain"] = entry(gain, "1", what)
    return entries
