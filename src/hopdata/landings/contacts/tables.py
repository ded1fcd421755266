"""The table of a recording's landings: made from contacts, and read again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray, pd
from hopdata.landings.contacts import descents, joined, steps
from hopdata.landings.contacts.judged import NO_MARKER, Contacts
from hopdata.landings.contacts.law import UNDETERMINED_S
from hopdata.landings.contacts.together import landed_together
from hopdata.landings.contacts.where import Descending
from hopdata.recording import Recording


def table_of(found: Descending, contacts: Contacts, method: str) -> pd.DataFrame:
    """Return the table of `find_study_landings` for one recording, at its own size."""
    recording = found.recording
    feet = recording.names("foot")
    time_scale = recording.time_scale
    contacts = _without_strangers(found, contacts)
    spans, hidden = found.spans, found.hidden
    if found.steps is not None:
        spans, hidden, contacts = landed_together(spans, hidden, contacts)
    down = contacts.down
    if not down.size:
        down = contacts.instant
    columns: dict[str, Any] = {
        "method": method,
        "begin_s": spans[:, 0] * time_scale,
        "end_s": spans[:, 1] * time_scale,
        "hidden": hidden,
    }
    for i, foot in enumerate(feet):
        columns[f"contact_{foot}_s"] = contacts.instant[:, i] * time_scale
    for i, foot in enumerate(feet):
        columns[f"se_{foot}_s"] = contacts.se[:, i] * time_scale
    for i, foot in enumerate(feet):
        columns[f"status_{foot}"] = contacts.status[:, i]
    for i, foot in enumerate(feet):
        columns[f"common_{foot}_s"] = contacts.common[i] * time_scale
    for i, foot in enumerate(feet):
        columns[f"down_{foot}_s"] = down[:, i] * time_scale
    if found.steps is not None:
        columns |= _marker_columns(recording, contacts)
    return pd.DataFrame(columns)


def _marker_columns(recording: Recording, contacts: Contacts) -> dict[str, Any]:
    """Return which marker of each foot touches first in L landings, and how surely."""
    columns: dict[str, Any] = {}
    feet = zip(recording.names("foot"), joined.parts_of_feet(recording), strict=True)
    for i, (foot, parts) in enumerate(feet):
        if contacts.marker.size:
            place = contacts.marker[:, i]
            probability = contacts.marker_probability[:, i]
        else:
            only = 0 if len(parts) == 1 else NO_MARKER
            place = np.full(len(contacts.instant), only)
            probability = np.full(len(contacts.instant), np.nan)
        # The last name is that of `NO_MARKER`.
        names = np.array([*(recording.markers[part] for part in parts), ""], object)
        columns[f"marker_{foot}"] = names[place]
        columns[f"probability_{foot}"] = probability
    return columns


def _without_strangers(found: Descending, contacts: Contacts) -> Contacts:
    """Leave out contacts (L, n) that are another landing's, or that have two rows.

    So is one without a kink of a foot that had come down long before.
    """
    if found.steps is None:
        return contacts
    without_kink = contacts.se >= UNDETERMINED_S
    settles = steps.only_settles(found.steps, contacts.instant)
    stranger = found.stranger | (without_kink & settles)
    instant = np.where(stranger, np.nan, contacts.instant)
    twice, choice_s, other = steps.found_twice(
        found.steps, instant, contacts.se, contacts.status
    )
    stranger |= twice
    return replace(
        contacts,
        instant=np.where(stranger, np.nan, contacts.instant),
        se=np.where(stranger, np.nan, np.hypot(contacts.se, choice_s)),
        status=np.where(stranger, descents.NOT_LANDED, contacts.status),
        marker_probability=_of_either(contacts, other),
    )


def _of_either(contacts: Contacts, other: IntArray) -> FloatArray:
    """Return the probability (L, n) that a marker is first, by one contact or another.

    Where another row may hold the contact, both are as likely (`steps.found_twice`). If
    that row tells of another marker, nothing there speaks for this one.
    """
    probability = contacts.marker_probability
    if not probability.size:
        return probability
    # The row of a foot without another contact is never taken.
    of_other = np.take_along_axis(probability, other, axis=0)
    agrees = np.take_along_axis(contacts.marker, other, axis=0) == contacts.marker
    either = (probability + np.where(agrees, of_other, 0.0)) / 2
    return np.where(other == steps.NO_OTHER, probability, either)


def contacts_of(landings: pd.DataFrame) -> Contacts:
    """Read the contacts from a table made by `find_landings`."""
    instant = landings.filter(regex="^contact_").to_numpy(float)
    se = landings.filter(regex="^se_").to_numpy(float)
    status = landings.filter(regex="^status_").to_numpy(float)
    common = landings.filter(regex="^common_").to_numpy(float)
    return Contacts(
        instant=instant,
        se=se,
        status=status.astype(np.int64),
        noise_m=np.nan,  # the errors already contain the noise
        common=common.max(axis=0, initial=0.0),
    )


def floor_instants(landings: pd.DataFrame) -> FloatArray:
    """Return when each foot reached the floor, (L, n), s, by `find_landings`."""
    return np.asarray(landings.filter(regex="^down_").to_numpy(float))


def are_by(landings: pd.DataFrame, method: str) -> bool:
    """Return whether a table by `find_landings` holds the contacts of a method."""
    return bool((landings["method"] == method).all())
