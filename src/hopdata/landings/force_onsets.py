"""When a force under the feet begins: it crosses a threshold on its way to a loaded foot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.recordings.external import ContactTimes, ForceSignal

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LOADED_SHARE = 0.3  # of the large forces: from here on a foot carries load
LARGE_QUANTILE = 0.9  # of the forces above the threshold
UNLOADED_S = 0.01  # a force that is gone for less than this is a rattle within a contact


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
    instants = force_onsets(signal, threshold=at)
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


def force_onsets(signal: ForceSignal, *, threshold: float) -> FloatArray:
    """Find where the force rises through `threshold` from an unloaded foot to a loaded one.

    A foot is loaded from `LOADED_SHARE` of the large forces on, and at least at twice the
    threshold; it is unloaded where the force has been below the threshold for `UNLOADED_S`. So a
    rattle of the plate is no contact, and a dip during the rise or in stance no new one. Two feet
    that are on the plate together make one onset. The crossing is interpolated between the samples.

    Parameters
    ----------
    signal : ForceSignal
        K samples.
    threshold : float
        In the signal's unit.

    Returns
    -------
    (K,) array
        Instants in order of time, s. A crossing with a missing sample beside it is left out.

    Raises
    ------
    AnalysisError
        If the force never rises through the threshold to a load.
    """
    force = signal.force
    above = force[force >= threshold]
    large = float(np.quantile(above, LARGE_QUANTILE)) if len(above) else 0.0
    if not large > 2 * threshold:
        raise AnalysisError(
            f"force '{signal.column.name}': expected loads of more than twice the threshold of "
            f"{threshold:.4g} {signal.unit}, found at most {np.nanmax(force):.4g}; "
            "do forces.unit and the threshold fit?"
        )
    load = max(2 * threshold, LOADED_SHARE * large)
    before = _last_unloaded(signal.time, force, threshold, load)
    left, right = force[before], force[before + 1]
    part = (threshold - left) / (right - left)
    width = signal.time[before + 1] - signal.time[before]
    instants: FloatArray = signal.time[before] + part * width
    return instants


def _last_unloaded(time: FloatArray, force: FloatArray, threshold: float, load: float) -> IntArray:
    """Last unloaded sample before each rise to `load`; its neighbour is above the threshold."""
    below = np.concatenate([[False], force < threshold, [False]])
    first, after = np.flatnonzero(np.diff(below.astype(np.int8))).reshape(-1, 2).T
    long = time[after - 1] - time[first] >= UNLOADED_S - np.median(np.diff(time))
    last = after[long] - 1
    loaded = np.flatnonzero(force >= load)
    reached = loaded[np.minimum(np.searchsorted(loaded, last), len(loaded) - 1)]
    until = np.append(last[1:], len(force))  # the next unloaded stretch ends the attempt
    rises = last[(reached > last) & (reached < until)]
    return rises[force[rises + 1] >= threshold]  # not so beside a missing sample
