"""Contacts from force plates, one example landing, and the influence of the force threshold."""

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

# When a foot came down, according to a force plate.

UNLOADED_S = 0.01  # shortest time without force, s; less is a rattle within a contact


def force_onsets(
    time: ArrayLike, force: ArrayLike, *, least_n: float = 50.0, sure_n: float = 400.0
) -> FloatArray:
    """Find the instants at which the vertical force rises through a threshold, one for each stance.

    A stance reaches `sure_n` after the force has been below the threshold for
    `UNLOADED_S`. So a rattle of the plate is not a contact, and a dip during the rise
    or the stance is not a new one. A stance that has begun before the first sample has
    no onset, nor has a stance beside a missing sample. Two feet on the plate at the
    same time make one stance. The instant is interpolated between two samples.

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
    t, f = np.asarray(time, float), np.asarray(force, float)
    last = _last_unloaded(t, f, least_n, sure_n)
    return t[last] + (least_n - f[last]) / (f[last + 1] - f[last]) * (
        t[last + 1] - t[last]
    )


def _last_unloaded(
    t: FloatArray, f: FloatArray, least_n: float, sure_n: float
) -> IntArray:
    """Find the last unloaded sample before each rise to `sure_n`; the next is above threshold."""
    loaded = np.flatnonzero(f >= sure_n)
    if len(loaded) == 0:
        return loaded
    below = np.concatenate([[False], f < least_n, [False]])
    first, after = np.flatnonzero(np.diff(below.astype(np.int8))).reshape(-1, 2).T
    long = t[after - 1] - t[first] >= UNLOADED_S - np.median(np.diff(t))
    last = after[long] - 1
    reached = loaded[np.minimum(np.searchsorted(loaded, last), len(loaded) - 1)]
    until = np.append(last[1:], len(f))  # the next unloaded stretch ends the attempt
    rises = last[(reached > last) & (reached < until)]
    return rises[f[rises + 1] >= least_n]  # false beside a missing sample


# Contact instants from a force under the feet: threshold, load, and the foot it may
# belong to.

LOADED_SHARE = 0.3  # share of the large forces from which a foot carries load
LARGE_QUANTILE = 0.9  # quantile of the forces above the threshold that counts as large


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
    at = threshold_of(signal) if threshold is None else threshold
    load = load_of(signal, threshold=at)
    instants = force_onsets(signal.time, signal.force, least_n=at, sure_n=load)
    span = (float(signal.time[0]), float(signal.time[-1]))
    others = signal.options["other_feet_above_m"]
    return external.ContactTimes(signal.column, instants, "forces", span, others)


def threshold_of(signal: external.ForceSignal) -> float:
    """Return the threshold in the signal's unit: as given in N, or a share of body weight.

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
    return share * float(np.nanmean(signal.force) if weight is None else weight)


def load_of(signal: external.ForceSignal, *, threshold: float) -> float:
    """Return the force of a loaded foot: a share of the large forces, or twice the threshold.

    Raises
    ------
    AnalysisError
        If the force never reaches twice the threshold.
    """
    above = signal.force[signal.force >= threshold]
    large = float(np.quantile(above, LARGE_QUANTILE)) if len(above) else 0.0
    if not large > 2 * threshold:
        wanted = (
            f"loads of more than twice the threshold of {threshold:.4g} {signal.unit}"
        )
        most = f"at most {np.nanmax(signal.force):.4g}; do forces.unit and the threshold fit?"
        raise AnalysisError.at(f"force '{signal.column.name}'", wanted, most)
    return max(2 * threshold, LOADED_SHARE * large)


Signals = Sequence[external.ForceSignal]
EXAMPLE_COLUMNS = ("recording", "time_s", "kind", "name", "value", "unit")
MEASURES = ("n_matched", "n_missed", "n_invented", "bias_s", "robust_sd_s")
THRESHOLD_COLUMNS = ("recording", "column", "threshold", "unit", *MEASURES)
BEFORE_S, AFTER_S = 0.08, 0.12  # time shown about the first external contact, s
FACTORS = (
    0.5,
    0.75,
    1.0,
    1.5,
    2.0,
    3.0,
)  # multiples of the threshold that are compared


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
    matched = overlay[
        (overlay["status"] == MATCHED) & ~overlay["excluded"].astype(bool)
    ]
    if matched.empty:
        return pd.DataFrame(columns=list(EXAMPLE_COLUMNS))
    row = matched.sort_values("difference_s", kind="stable").iloc[
        (len(matched) - 1) // 2
    ]
    same = overlay[(overlay["index"] == row["index"]) & (overlay["status"] == MATCHED)]
    origin = float(same["external_s"].min())
    known = recording.names("foot")
    told, pieces = f" {' '.join(same['feet'])} ", []

    def add(kind: str, name: str, unit: str, time_s: Any, value: Any) -> None:
        columns = (
            recording.name,
            np.atleast_1d(time_s) - origin,
            kind,
            name,
            value,
            unit,
        )
        pieces.append(pd.DataFrame(dict(zip(EXAMPLE_COLUMNS, columns, strict=True))))

    def near(time: FloatArray) -> BoolArray:
        since = time - origin
        return np.asarray((since >= -BEFORE_S) & (since <= AFTER_S))

    shown = near(recording.time)
    for i, foot in enumerate(known):
        if f" {foot} " in told:
            add("height", foot, "m", recording.time[shown], recording.feet[shown, i, 2])
    for one in same.to_dict("records"):
        name = str(one["feet"] if one["feet"] in known else one["column"])
        add("external", name, "s", float(one["external_s"]), np.nan)
        add("found", str(one["first_foot"]), "s", float(one["found_s"]), np.nan)
    for signal in signals:
        if signal.column.name in set(same["column"]):
            rows, name = near(signal.time), signal.column.name
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
        except (
            AnalysisError
        ):  # too high for this force; the chosen threshold was compared before
            continue
        measures = summarise_overlay(table).iloc[0]
        told = (recording.name, signal.column.name, threshold, signal.unit)
        rows.append((*told, *measures[list(MEASURES)]))
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
    contacts, thresholds, examples = [], [], []
    for recording in recordings:
        blocks, feet = configured[recording.name], recording.names("foot")
        own = touchdowns[touchdowns["recording"] == recording.name].reset_index(
            drop=True
        )
        known, signals = [], []
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
        shown = pd.concat(
            compared[-len(signals) :], ignore_index=True
        )  # forces if there are any
        examples.append(example_landing(recording, shown, signals))
    table = pd.concat(contacts, ignore_index=True)
    at_thresholds = pd.DataFrame(thresholds, columns=list(THRESHOLD_COLUMNS))
    example = next((one for one in examples if len(one)), examples[0])
    return ExternalTruth(table, summarise_overlay(table), at_thresholds, example)
