"""From a table of frame changes to a trained process."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.models.hyperparameters import fitted_regressor, hyper_parameters
from hopdata.steering.models.options import (
    RECOMMENDED,
    ProcessOptions,
    process_inputs,
)
from hopdata.steering.models.process import TURN, FrameChangeProcess

FloatArray = NDArray[np.float64]

LEAST_HOPS = 10

logger = logging.getLogger(__name__)


def trained_process(
    changes: FrameChanges, options: ProcessOptions = RECOMMENDED, *, seed: int = 0
) -> FrameChangeProcess:
    """Train the three processes on the used hops of a table.

    Hops whose inputs are not all known, as with history after a break, are left out; their number
    is logged.

    Parameters
    ----------
    changes : FrameChanges
    options : ProcessOptions
    seed : int
        Of the random restarts of the search for hyper-parameters.

    Raises
    ------
    AnalysisError
        If fewer than `LEAST_HOPS` hops remain.
    """
    inputs, outputs = training_set(changes, options.history)
    offset, unit = _modelled(outputs, options)
    scale = input_units(inputs, options)
    if not options.periodic:
        inputs, outputs = _copies(inputs), np.tile(outputs, (3, 1))
    targets = (outputs - offset) / unit
    regressors = [fitted_regressor(inputs / scale, y, options, seed) for y in targets.T]
    found = [hyper_parameters(regressor, inputs.shape[1]) for regressor in regressors]
    variance, lengths, noise = zip(*found, strict=True)
    return FrameChangeProcess(
        smoothness=options.smoothness,
        periodic=options.periodic,
        inputs=inputs,
        outputs=outputs,
        offset=offset,
        unit=unit,
        variance=np.array(variance),
        noise=np.array(noise),
        length_scales=np.array(lengths) * scale,
    )


def training_set(changes: FrameChanges, history: str = "none") -> tuple[FloatArray, FloatArray]:
    """Return inputs (n, d) and frame changes (n, 3) of the used hops whose inputs are known."""
    used = changes.used()
    inputs = process_inputs(used, history)
    known = np.asarray(np.isfinite(inputs).all(axis=1))
    if not known.all():
        logger.info("%d of %d hops have no hop before them", np.sum(~known), len(known))
    if known.sum() < LEAST_HOPS:
        raise AnalysisError(
            f"frame changes: expected at least {LEAST_HOPS} hops to learn from, "
            f"found {known.sum()} of {len(changes)} (excluded: {changes.excluded() or 'none'}; "
            f"without a hop before: {np.sum(~known)})"
        )
    return inputs[known], used.change[known]


def _modelled(outputs: FloatArray, options: ProcessOptions) -> tuple[FloatArray, FloatArray]:
    """Offset and unit of the modelled outputs."""
    if not options.standardised:
        return np.zeros(3), np.array([options.length_unit_m, options.length_unit_m, 1.0])
    unit = outputs.std(axis=0)
    return outputs.mean(axis=0), np.where(unit > 0, unit, 1.0)


def input_units(inputs: FloatArray, options: ProcessOptions) -> FloatArray:
    """Units of the inputs, (d,): 1 rad for the boom angle, the standard deviation of the others."""
    units = np.ones(inputs.shape[1])
    if options.standardised:
        units[1:] = inputs[:, 1:].std(axis=0)
    return np.where(units > 0, units, 1.0)


def _copies(inputs: FloatArray) -> FloatArray:
    """Return the inputs a turn before, where they are, and a turn after (Sec. 3.4.2)."""
    shift = np.zeros(inputs.shape[1])
    shift[0] = TURN
    return np.concatenate([inputs - shift, inputs, inputs + shift])
