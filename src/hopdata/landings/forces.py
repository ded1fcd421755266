"""Contacts from force plates, an example, and what the threshold of a force does."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import SD_PER_MAD, BoolArray, FloatArray, IntArray, pd
from hopdata.errors import AnalysisError
from hopdata.landings.overlay import MATCHED, compare_contacts, summarise_overlay
from hopdata.recording import Recording
from hopdata.recordings import external

#: Shortest time without force; less is a rattle within a contact.
#: Unit: s. Origin: chosen.
UNLOADED_S = 0.01

#: Share of the large forces from which a foot carries load.
#: Unit: 1. Origin: chosen.
LOADED_SHARE = 0.3

#: Quantile of the forces above the threshold that counts as large.
#: Unit: 1. Origin: chosen.
LARGE_QUANTILE = 0.9

#: Least force of a loaded foot, in thresholds.
#: Unit: thresholds. Origin: chosen.
LOADED_THRESHOLDS = 2

#: Multiples of the threshold at which the comparison is repeated.
#: Unit: 1. Origin: chosen.
FACTORS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)

#: Time shown before the first external contact of the example; it moves no answer.
#: Unit: s. Origin: chosen.
BEFORE_S = 0.08

#: Time shown after it; it moves no answer.
#: Unit: s. Origin: chosen.
AFTER_S = 0.12

#: How far an onset is extrapolated, in times that the line through the threshold and
#: twice the threshold takes to the unloaded force. If the force grows with the power p
#: of the time since the contact, that was 2.4 (p = 2), 1.7 (p = 1.5), 1 (p = 1) or 0.3
#: (p = 0.5) such times ago.
#: Unit: 1. Origin: derived: the middle of 0.3 and 2.4.
EXTRAPOLATED = 1.35

#: Standard error of an extrapolated onset, in the same times.
#: Unit: 1. Origin: derived: 2.1 / sqrt(12), of a uniform distribution from 0.3 to 2.4.
SHAPE = 0.6

#: Longest time by which an onset is extrapolated.
#: Unit: s. Origin: chosen. A force that rises more slowly is no contact.
LONGEST_RISE_S = 0.02

#: Time after the threshold from which an onset is extrapolated, in deviations of the
#: filter. A ramp behind it crosses a low threshold two deviations before it begins, and
#: is straight again two deviations after that.
#: Unit: 1. Origin: chosen.
CLEAR_OF_BLUR = 3.0

Signals = Sequence[external.ForceSignal]
EXAMPLE_COLUMNS = ("recording", "time_s", "kind", "name", "value", "unit")
MEASURES = ("n_matched", "n_missed", "n_invented", "bias_s", "robust_sd_s")
THRESHOLD_COLUMNS = ("recording", "column", "threshold", "unit", *MEASURES)

# When a foot came down, according to a force plate.


def force_onsets(
    time: ArrayLike, force: ArrayLike, *, least_n: float = 50.0, sure_n: float = 400.0
) -> FloatArray:
    """Find the instants at which the vertical force rises through a threshold.

    There is one for each stance. A stance reaches `sure_n` after the force has been
    below the threshold for `UNLOADED_S`. So a rattle of the plate is not a contact, and
    a dip during the rise or the stance is not a new one. A stance that has begun before
    the first sample has no onset, nor has a stance beside a missing sample. Two feet on
    the plate at the same time make one stance. The instant is interpolated between two
    samples.

    Parameters
    ----------
    time : (N,) array
        Times of the samples, s.
    force : (N,) array
        Vertical force, N (or the unit of the thresholds, if different), positive in
        stance; NaN where missing.
    least_n : float
        Threshold of the onset, N; it must exceed the noise of the unloaded plate.
    sure_n : float
        Force that a stance reaches and noise does not, N.

    Returns
    -------
    (S,) array
        Onsets, s.
    """
    t = np.asarray(time, float)
    f = np.asarray(force, float)
    last = _last_unloaded(t, f, least_n, sure_n)
    share = (least_n - f[last]) / (f[last + 1] - f[last])
    return t[last] + share * (t[last + 1] - t[last])


def _last_unloaded(
    t: FloatArray, f: FloatArray, least_n: float, sure_n: float
) -> IntArray:
    """Find the last unloaded sample before each rise to `sure_n`.

    The next sample is above the threshold.
    """
    loaded = np.flatnonzero(f >= sure_n)
    if len(loaded) == 0:
        return loaded
    below = np.concatenate([[False], f < least_n, [False]])
    first, after = np.flatnonzero(np.diff(below.astype(np.int8))).reshape(-1, 2).T
    is_long = t[after - 1] - t[first] >= UNLOADED_S - np.median(np.diff(t))
    last = after[is_long] - 1
    next_loaded = np.minimum(np.searchsorted(loaded, last), len(loaded) - 1)
    reached = loaded[next_loaded]
    until = np.append(last[1:], len(f))  # the next unloaded stretch ends the attempt
    rises = last[(reached > last) & (reached < until)]
    return rises[f[rises + 1] >= least_n]  # false beside a missing sample


def extrapolated(
    time: FloatArray,
    force: FloatArray,
    crossed: FloatArray,
    *,
    noise_n: float,
    blur_s: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Extrapolate onsets from the threshold to the force of the unloaded plate.

    Parameters
    ----------
    time, force : (N,) arrays
        Times of the samples, s, and the force above that of the unloaded plate.
    crossed : (S,) array
        When the force crosses the threshold, from `force_onsets`, s.
    noise_n : float
        Standard deviation of the noise, in the unit of the force.
    blur_s : float
        Standard deviation of a filter that the force has passed, s.

    Returns
    -------
    instant : (S,) array
        When the force begins, s.
    error_s : (S,) array
        Their standard errors, s: of the shape of the rise, the noise, the filter and
        the rate of the samples. It is also that of the crossing itself, but for the
        delay that all crossings share.
    """
    instants = []
    errors = []
    step_s = float(np.median(np.diff(time)))
    most = max(1, round(LONGEST_RISE_S / step_s))
    for at in crossed:
        # The first sample above the threshold, or clear of the filter's effect.
        first = int(np.searchsorted(time, at + CLEAR_OF_BLUR * blur_s))
        first = min(first, len(time) - 2)
        ahead = force[first + 1 : first + 1 + most]
        twice = np.flatnonzero(ahead >= 2 * force[first])
        # A rise that ends before twice the force is taken as far as it goes.
        second = first + 1 + (int(twice[0]) if len(twice) else int(np.argmax(ahead)))
        risen = float(force[second] - force[first])
        # Not above the threshold clear of the filter, or no rise: no line to draw.
        if not (risen > 0 and force[first] > 0):
            instants.append(float(at))
            errors.append(LONGEST_RISE_S)
            continue
        share = float(force[first]) / risen
        before_s = min(share * float(time[second] - time[first]), LONGEST_RISE_S)
        per_n = before_s / float(force[first])
        by_noise = noise_n * per_n * np.sqrt((1 + share) ** 2 + share**2)
        instants.append(time[first] - EXTRAPOLATED * before_s)
        errors.append(np.hypot(SHAPE * before_s, min(by_noise, LONGEST_RISE_S)))
    others = blur_s**2 + step_s**2 / 12
    error_s = np.sqrt(np.array(errors, dtype=float) ** 2 + others)
    return np.array(instants, dtype=float), error_s


# Contact instants from a force under the feet: threshold, load, and the foot it may
# belong to.


def contact_times_of(
    signal: external.ForceSignal, *, threshold: float | None = None
) -> external.ExternalContacts:
    """Find the contact instants of a force signal.

    Parameters
    ----------
    signal : ForceSignal
        Its options give the threshold, and the height above which the force is from
        other feet.
    threshold : float, optional
        Threshold in the signal's unit; by default from the options, see `threshold_of`.

    Raises
    ------
    AnalysisError
        If the force never crosses the threshold.
    """
    if threshold is None:
        threshold = threshold_of(signal)
    load = load_of(signal, threshold=threshold)
    instants = force_onsets(signal.time, signal.force, least_n=threshold, sure_n=load)
    span_s = (float(signal.time[0]), float(signal.time[-1]))
    _, error_s = extrapolated(
        signal.time, signal.force, instants, noise_n=_noise(signal.force, threshold)
    )
    return external.ExternalContacts(
        signal.column,
        instants,
        "forces",
        span_s,
        signal.options["other_feet_above_m"],
        error_s,
    )


def _noise(force: FloatArray, threshold: float) -> float:
    """Return the noise of the unloaded plate: of the forces below the threshold."""
    below = force[force < threshold]
    if not len(below):
        return 0.0
    return noise_sd(below)


def noise_sd(unloaded: FloatArray) -> float:
    """Return the standard deviation of the noise of an unloaded plate, in its unit.

    It is that of a normal distribution with the same median absolute deviation, which
    a few samples under load do not change.

    Parameters
    ----------
    unloaded : (K,) array
        Vertical force in samples without load; at least one.
    """
    away = np.abs(unloaded - np.median(unloaded))
    return float(SD_PER_MAD * np.median(away))


def threshold_of(signal: external.ForceSignal) -> float:
    """Return the threshold, in the signal's unit: in N, or a share of body weight.

    If the configuration does not give the weight, it is the mean force, since the feet
    carry the weight over whole strides. This requires a column that all feet step on.
    """
    options = signal.options
    if options["threshold_n"] is not None:
        return float(options["threshold_n"])
    share = float(options["threshold_share"])
    if signal.unit == "body_weight":
        return share
    weight = options["body_weight_n"]
    if weight is None:
        weight = np.nanmean(signal.force)
    return share * float(weight)


def load_of(signal: external.ForceSignal, *, threshold: float) -> float:
    """Return the force of a loaded foot: a share of large ones, or twice the threshold.

    Raises
    ------
    AnalysisError
        If the force never reaches twice the threshold.
    """
    large = large_force(signal.force[signal.force >= threshold])
    if not large > LOADED_THRESHOLDS * threshold:
        most = np.nanmax(signal.force)
        raise AnalysisError.at(
            f"force '{signal.column.name}'",
            f"loads of more than twice the threshold of {threshold:.4g} {signal.unit}",
            f"at most {most:.4g}; do forces.unit and the threshold fit?",
        )
    return loaded_from(threshold, large)


def large_force(loads: FloatArray) -> float:
    """Return the force that counts as large among loads (K,), in their unit.

    0 if there are no loads.
    """
    if not len(loads):
        return 0.0
    return float(np.quantile(loads, LARGE_QUANTILE))


def loaded_from(threshold: float, large: float) -> float:
    """Return the force from which a foot carries load, in the unit of the arguments.

    Parameters
    ----------
    threshold : float
        Threshold of the onsets, above the unloaded force.
    large : float
        The large forces, from `large_force`.
    """
    return max(LOADED_THRESHOLDS * threshold, LOADED_SHARE * large)


def example_landing(
    recording: Recording, overlay: pd.DataFrame, signals: Signals = ()
) -> pd.DataFrame:
    """Tabulate foot heights and forces about one typical landing.

    Parameters
    ----------
    recording : Recording
        Levelled.
    overlay : pandas.DataFrame
        Comparison of this recording from `compare_contacts`, for one or more columns.
    signals : sequence of ForceSignal
        Its forces.

    Returns
    -------
    pandas.DataFrame
        recording, time_s (from the first external contact), kind (``height``,
        ``force``, ``threshold``, ``external`` or ``found``), name (the foot, or the
        column for a force and for a contact of several feet), value (m, N, body
        weights; s for instants), unit. The landing is the matched one with the median
        difference, with all columns that contain it. Empty if there is none.
    """
    is_matched = overlay["status"] == MATCHED
    matched = overlay[is_matched & ~overlay["excluded"].astype(bool)]
    if matched.empty:
        return pd.DataFrame(columns=list(EXAMPLE_COLUMNS))
    by_difference = matched.sort_values("difference_s", kind="stable")
    middle = by_difference.iloc[(len(matched) - 1) // 2]
    same = overlay[(overlay["touchdown"] == middle["touchdown"]) & is_matched]
    origin = float(same["external_s"].min())
    feet = recording.names("foot")
    # Names of feet may hold spaces, so they are looked for between two of them.
    compared = f" {' '.join(same['feet'])} "
    pieces = []

    def add(kind: str, name: str, unit: str, time_s: Any, value: Any) -> None:
        columns = {
            "recording": recording.name,
            "time_s": np.atleast_1d(time_s) - origin,
            "kind": kind,
            "name": name,
            "value": value,
            "unit": unit,
        }
        pieces.append(pd.DataFrame(columns))

    def near(time: FloatArray) -> BoolArray:
        since = time - origin
        return np.asarray((since >= -BEFORE_S) & (since <= AFTER_S))

    shown = near(recording.time)
    for i, foot in enumerate(feet):
        if f" {foot} " in compared:
            add("height", foot, "m", recording.time[shown], recording.feet[shown, i, 2])
    for one in same.to_dict("records"):
        name = str(one["feet"] if one["feet"] in feet else one["column"])
        add("external", name, "s", float(one["external_s"]), np.nan)
        add("found", str(one["first_foot"]), "s", float(one["found_s"]), np.nan)
    for signal in signals:
        name = signal.column.name
        if name in set(same["column"]):
            rows = near(signal.time)
            add("force", name, signal.unit, signal.time[rows], signal.force[rows])
            add("threshold", name, signal.unit, origin, threshold_of(signal))
    return pd.concat(pieces, ignore_index=True)


def threshold_rows(
    recording: Recording, touchdowns: pd.DataFrame, signals: Signals, window_s: float
) -> list[tuple[Any, ...]]:
    """Compare the contacts at lower and higher thresholds of each force.

    Returns
    -------
    list of tuple
        `THRESHOLD_COLUMNS` for each threshold at which the force can be read.
    """
    rows = []
    for signal, factor in product(signals, FACTORS):
        threshold = factor * threshold_of(signal)
        try:
            contacts = contact_times_of(signal, threshold=threshold)
            table = compare_contacts(recording, touchdowns, contacts, window_s=window_s)
        except AnalysisError:
            # Too high for this force; the chosen threshold was compared before.
            continue
        measures = summarise_overlay(table).iloc[0][list(MEASURES)]
        name = signal.column.name
        rows.append((recording.name, name, threshold, signal.unit, *measures))
    return rows
