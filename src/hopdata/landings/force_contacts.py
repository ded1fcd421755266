"""Contact instants by a force under the feet: its threshold, its load, whose foot it may be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.landings.force_onsets import force_onsets
from hopdata.recordings.external import ContactTimes, ForceSignal

FloatArray = NDArray[np.float64]

LOADED_SHARE = 0.3  # of the large forces: from here on a foot carries load
LARGE_QUANTILE = 0.9  # of the forces above the threshold


def contact_times_of(signal: ForceSignal, *, threshold: float | None = None) -> ContactTimes:
    """Contact instants of a force signal.

    Parameters
    ----------
    signal : ForceSignal
        Its options name the threshold, and the height above which other feet are at work.
    threshold : float, optional
        In the signal's unit; by default as the options say, see `threshold_of`.

    Raises
    ------
    AnalysisError
        If the force never crosses the threshold.
    """
    at = threshold_of(signal) if threshold is None else threshold
    load = load_of(signal, threshold=at)
    instants = force_onsets(signal.time, signal.force, least_n=at, sure_n=load)
    span = (float(signal.time[0]), float(signal.time[-1]))
    others = signal.options["other_feet_above_m"]
    return ContactTimes(signal.column, instants, "forces", span, others)


def threshold_of(signal: ForceSignal) -> float:
    """Threshold in the signal's unit: as given in N, else a share of body weight.

    The weight is the mean force, where the configuration does not give it: over whole strides what
    the feet carry is the weight. That needs a column that all feet step on.
    """
    options = signal.options
    if options["threshold_n"] is not None:
        return float(options["threshold_n"])
    share = float(options["threshold_share"])
    if signal.unit == "body_weight":
        return share
    weight = options["body_weight_n"]
    return share * float(np.nanmean(signal.force) if weight is None else weight)


def load_of(signal: ForceSignal, *, threshold: float) -> float:
    """Force from which a foot carries load: a share of the large ones, or twice the threshold.

    Raises
    ------
    AnalysisError
        If the force never reaches twice the threshold.
    """
    above = signal.force[signal.force >= threshold]
    large = float(np.quantile(above, LARGE_QUANTILE)) if len(above) else 0.0
    if not large > 2 * threshold:
        raise AnalysisError(
            f"force '{signal.column.name}': expected loads of more than twice the threshold of "
            f"{threshold:.4g} {signal.unit}, found at most {np.nanmax(signal.force):.4g}; "
            "do forces.unit and the threshold fit?"
        )
    return max(2 * threshold, LOADED_SHARE * large)
