"""Contacts from force plates, an example, and what the threshold of a force does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, IntArray, pd
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


# Contact instants from a force under the feet: threshold, load, and the foot it may
# belong to.


def contact_times_of(
    signal: external.ForceSignal, *, threshold: float | None = None
) -> external.ContactTimes:
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
    others_above_m = signal.options["other_feet_above_m"]
    return external.ContactTimes(
        signal.column, instants, "forces", span_s, others_above_m
    )


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
    above = signal.force[signal.force >= threshold]
    large = 0.0
    if len(above):
        large = float(np.quantile(above, LARGE_QUANTILE))
    if not large > LOADED_THRESHOLDS * threshold:
        most = np.nanmax(signal.force)
        raise AnalysisError.at(
            f"force '{signal.column.name}'",
            f"loads of more than twice the threshold of {threshold:.4g} {signal.unit}",
            f"at most {most:.4g}; do forces.unit and the threshold fit?",
        )
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
    same = overlay[(overlay["index"] == middle["index"]) & is_matched]
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


# All external data on a study's recordings, compared with what hopdata found in them.


@dataclass(frozen=True)
class ExternalTruth:
    """Tables of the overlay.

    Parameters
    ----------
    contacts : pandas.DataFrame
        One row for each contact, see `compare_contacts`.
    summary : pandas.DataFrame
        One row for each column, see `summarise_overlay`.
    thresholds : pandas.DataFrame
        See `threshold_rows`; empty if there are no forces.
    example : pandas.DataFrame
        See `example_landing`.
    """

    contacts: pd.DataFrame
    summary: pd.DataFrame
    thresholds: pd.DataFrame
    example: pd.DataFrame


def overlay_external_truth(
    recordings: Sequence[Recording],
    touchdowns: pd.DataFrame,
    configured: Mapping[str, Mapping[str, Any]],
    *,
    window_s: float,
    rate_hz: float | None = None,
) -> ExternalTruth:
    """Read the external data of a study and compare them with the contacts found.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled recordings that have external data.
    touchdowns : pandas.DataFrame
        Touchdowns of the study.
    configured : mapping
        The blocks ``contacts`` and ``forces`` of the configuration, by recording name.
    window_s : float
        ``external.window_s``.
    rate_hz : float, optional
        ``input.rate_hz``.
    """
    contacts = []
    thresholds = []
    examples = []
    for recording in recordings:
        blocks = configured[recording.name]
        feet = recording.names("foot")
        is_own = touchdowns["recording"] == recording.name
        own = touchdowns[is_own].reset_index(drop=True)
        known: list[external.ContactTimes] = []
        signals: list[external.ForceSignal] = []
        if blocks["contacts"]["file"] is not None:
            known += external.read_contact_times(
                blocks["contacts"], feet=feet, rate_hz=rate_hz
            )
        if blocks["forces"]["file"] is not None:
            signals = external.read_force_signals(blocks["forces"], feet=feet)
            known += [contact_times_of(signal) for signal in signals]
        compared = [
            compare_contacts(recording, own, one, window_s=window_s) for one in known
        ]
        contacts += compared
        thresholds += threshold_rows(recording, own, signals, window_s=window_s)
        # The columns of forces if there are any, else all.
        shown = pd.concat(compared[-len(signals) :], ignore_index=True)
        examples.append(example_landing(recording, shown, signals))
    table = pd.concat(contacts, ignore_index=True)
    at_thresholds = pd.DataFrame(thresholds, columns=list(THRESHOLD_COLUMNS))
    example = next((one for one in examples if len(one)), examples[0])
    return ExternalTruth(table, summarise_overlay(table), at_thresholds, example)
