"""Contact instants of every foot in every landing, by the chosen method.

`find_landings` makes the table of a recording, and `find_study_landings` those of all
recordings of a study, which learn from one another: descents of the body
(`hopdata.landings.contacts.where`), and the contacts of its feet in them
(`hopdata.landings.contacts.timing`). Everything there is tuned on an animal of 1 m;
times and heights of others are scaled to it first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hopdata.arrays import IntArray, one_blas_thread, pd
from hopdata.errors import chosen
from hopdata.landings.contacts import joined
from hopdata.landings.contacts.altered import with_processing
from hopdata.landings.contacts.doubted import doubted
from hopdata.landings.contacts.judged import Contacts
from hopdata.landings.contacts.noise import noise_correlation
from hopdata.landings.contacts.tables import table_of
from hopdata.landings.contacts.timing import (
    METHODS,
    Trial,
    find_all_contacts,
    find_contacts,
)
from hopdata.landings.contacts.where import (
    Descending,
    body_height,
    descents_of,
    whole_spans,
)
from hopdata.recording import Recording


def find_landings(recording: Recording, **options: Any) -> pd.DataFrame:
    """Find the descents of the body, and time each foot's contact in them.

    It is `find_study_landings` for one recording, which then learns from itself alone.
    """
    return find_study_landings([recording], **options)[0]


@one_blas_thread()
def find_study_landings(
    recordings: Sequence[Recording],
    *,
    method: str = "kink",
    gravity: str = "learned",
    window_before_s: float | None = None,
    window_after_s: float | None = None,
    down_height_m: float | None = None,
    maximum_misfit: float = 5.0,
    of_feet: bool = False,
) -> list[pd.DataFrame]:
    """Find the descents of the body in each recording, and time the contacts in them.

    The recordings are those of one subject and session. Those with the same feet share
    what they have in common; their order does not matter.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled: feet rest at height 0.
    down_height_m : float, optional
        Height to which a foot must sink to have landed, m. By default 15 % of the
        median descent of the body, but at least four times the noise.
    method, gravity, window_before_s, window_after_s, maximum_misfit
        See `find_contacts`. No sections are known yet, so every method searches from
        the apex to the nadir of the body.
    of_feet : bool
        Whether to look also for landings that no descent of the body shows, in the
        descents of each foot (`hopdata.landings.contacts.steps`). One foot is then
        enough, and no body is needed.

    Returns
    -------
    list of pandas.DataFrame
        For each recording, one row for each descent, in order of time: begin_s and
        end_s (apex and nadir of
        the body), hidden (whether only the feet show the landing; it then lasts from
        all up to all down), and for each foot contact_<foot>_s, se_<foot>_s,
        status_<foot> and common_<foot>_s, which is the same in all rows, and NaN for
        the printed methods. down_<foot>_s is when the foot reached the floor, as far as
        the method knows: the contact by the kink fit, else the instant at which the
        foot's height says so. In all rows, method. With `of_feet` also
        marker_<foot>, the name of the marker that touches first, empty where it is
        unknown, and probability_<foot>, that it is the first, NaN where the foot has no
        other.

    Raises
    ------
    AnalysisError
        If there are fewer than two feet, or none with `of_feet`.
    ConfigError
        If `method` or `gravity` is unknown.
    """
    printed = chosen("touchdowns.method", method, METHODS) is not None
    descending = [
        descents_of(one, down_height_m, of_feet=of_feet) for one in recordings
    ]
    if printed:
        contacts = [_printed_contacts(one, method) for one in descending]
    else:
        contacts = _kink_contacts(
            descending,
            gravity=gravity,
            window_before_s=window_before_s,
            window_after_s=window_after_s,
            maximum_misfit=maximum_misfit,
        )
    return [
        table_of(one, its, method)
        for one, its in zip(descending, contacts, strict=True)
    ]


def _at_time_scale(duration_s: float | None, time_scale: float) -> float | None:
    """Return a duration of the recording, s, for an animal of 1 m."""
    if duration_s is None:
        return None
    return duration_s / time_scale


def _kink_contacts(
    descending: Sequence[Descending],
    *,
    window_before_s: float | None,
    window_after_s: float | None,
    **options: Any,
) -> list[Contacts]:
    """Return contacts by the kink fit, of animals of 1 m, in each recording."""
    trials = [_trial_of(one) for one in descending]
    markers = [_foot_markers(one.recording) for one in descending]
    contacts: list[Contacts | None] = [None] * len(trials)
    # Recordings learn from those with the same feet, in an order that is their own.
    for same in sorted(set(markers)):
        numbers = [n for n, own in enumerate(markers) if own == same]
        numbers.sort(key=lambda n: descending[n].recording.name)
        paces = [descending[n].recording.time_scale for n in numbers]
        # Sums round by their order, and on few landings the last digits can decide
        # what these learn: the order must not be that of names or of a list.
        order = _order_by_heights(trials[numbers[0]])
        found = find_all_contacts(
            [_in_order(trials[n], order) for n in numbers],
            window_before_s=[
                _at_time_scale(window_before_s, time_scale) for time_scale in paces
            ],
            window_after_s=[
                _at_time_scale(window_after_s, time_scale) for time_scale in paces
            ],
            **options,
        )
        for n, in_order in zip(numbers, found, strict=True):
            of_markers = _contacts_in_order(in_order, np.argsort(order))
            processed = with_processing(descending[n].recording, of_markers)
            contacts[n] = _of_feet(processed, trials[n].foot_of)
    return [one for one in contacts if one is not None]


def _foot_markers(recording: Recording) -> tuple[tuple[str, ...], ...]:
    """Return the names of the markers of each foot."""
    return tuple(
        tuple(recording.markers[marker] for marker in own)
        for own in joined.parts_of_feet(recording)
    )


def _trial_of(found: Descending) -> Trial:
    """Return what is sought in a recording, of an animal of 1 m."""
    recording = found.recording
    parts = joined.parts_of_feet(recording)
    tracks = joined.tracks_of_feet(recording)
    heights = tracks[:, :, 2] / recording.scale
    is_doubted = doubted(tracks, rate_hz=recording.rate_hz, scale=recording.scale)
    if is_doubted.any():
        heights = np.where(is_doubted, np.nan, heights)
    return Trial(
        recording.time / recording.time_scale,
        heights,
        whole_spans(found.spans),
        found.down_m,
        lead_s=0.0,
        correlation=noise_correlation(recording.body),
        foot_of=tuple(foot for foot, own in enumerate(parts) for _ in own),
        body=body_height(recording),
    )


def _order_by_heights(trial: Trial) -> IntArray:
    """Return the numbers of the markers, foot by foot, in order of their heights."""
    of_marker = np.nan_to_num(trial.heights).sum(axis=0).tolist()
    of_foot: dict[int, float] = {}
    for foot, height in zip(trial.foot_of, of_marker, strict=True):
        of_foot[foot] = min(of_foot.get(foot, np.inf), height)
    feet = [of_foot[foot] for foot in trial.foot_of]
    return np.lexsort((of_marker, trial.foot_of, feet))


def _in_order(trial: Trial, order: IntArray) -> Trial:
    """Return a trial with its markers in an order, and its feet numbered by it."""
    feet = [trial.foot_of[marker] for marker in order.tolist()]
    numbers = {foot: number for number, foot in enumerate(dict.fromkeys(feet))}
    foot_of = tuple(numbers[foot] for foot in feet)
    return replace(trial, heights=trial.heights[:, order], foot_of=foot_of)


def _contacts_in_order(contacts: Contacts, order: IntArray) -> Contacts:
    """Return contacts with their markers in an order."""
    return replace(
        contacts,
        instant=contacts.instant[:, order],
        se=contacts.se[:, order],
        status=contacts.status[:, order],
        earliest=contacts.earliest[:, order],
        common=contacts.common[order],
    )


def _printed_contacts(found: Descending, method: str) -> Contacts:
    """Return contacts by a printed method, of an animal of 1 m.

    The recording is not scaled: the filter of these methods lasts 0.07 s whatever the
    size of the animal.
    """
    recording = found.recording
    time_scale = recording.time_scale
    contacts = find_contacts(
        recording.time,
        recording.feet[:, :, 2],
        whole_spans(found.spans * time_scale),
        down_height_m=found.down_m * recording.scale,
        lead_s=0.0,
        method=method,
    )
    n_feet = contacts.instant.shape[1]
    return replace(
        contacts,
        instant=contacts.instant / time_scale,
        se=contacts.se / time_scale,
        common=np.full(n_feet, np.nan),
        down=contacts.down / time_scale,
    )


def _of_feet(contacts: Contacts, foot_of: tuple[int, ...]) -> Contacts:
    """Combine the contacts of markers into those of feet, numbered by `foot_of`."""
    feet = sorted(set(foot_of))
    if len(feet) == len(foot_of):
        return contacts
    instants = []
    errors = []
    statuses = []
    markers = []
    probabilities = []
    common = []
    for foot in feet:
        own = np.flatnonzero(np.equal(foot_of, foot))
        of_markers = contacts.instant[:, own]
        known = (
            of_markers,
            contacts.se[:, own],
            contacts.status[:, own],
            contacts.earliest[:, own],
        )
        instant, se, status = joined.first_of(*known)
        marker, probability = joined.first_marker(*known, contacts.common[own])
        instants.append(instant)
        errors.append(se)
        statuses.append(status)
        markers.append(marker)
        probabilities.append(probability)
        # The foot shares the error of the marker that touches first most often.
        touches = np.where(np.isfinite(of_markers), of_markers, np.inf)
        # Where no marker is timed, none is first.
        first_marker = touches.argmin(axis=1)[np.isfinite(of_markers).any(axis=1)]
        usual_first = np.bincount(first_marker, minlength=1).argmax()
        common.append(contacts.common[own][usual_first])
    return replace(
        contacts,
        instant=np.stack(instants, axis=1),
        se=np.stack(errors, axis=1),
        status=np.stack(statuses, axis=1),
        common=np.array(common),
        marker=np.stack(markers, axis=1),
        marker_probability=np.stack(probabilities, axis=1),
    )
