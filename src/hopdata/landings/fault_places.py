"""Where faults of markers lie: at contacts, or between them.

A foot that strikes the floor may shake its markers, so faults at contacts often are the
impact; those between are of the recording system.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.messages import Message

#: Time about a contact within which a fault is said to lie at it.
#: Unit: s. Origin: chosen: so long do markers shake after an impact.
AT_CONTACT_S = 0.05

#: Faults that are named; of more, only the number is told.
MOST_NAMED = 3


def are_at_contacts(times_s: FloatArray, contacts_s: FloatArray) -> BoolArray:
    """Return which times (n,) lie at one of the contacts (k,), which may have NaN."""
    contacts_s = contacts_s[np.isfinite(contacts_s)]
    apart_s = np.abs(times_s[:, None] - contacts_s[None, :])
    return np.asarray((apart_s <= AT_CONTACT_S).any(axis=1))


def fault_places(
    faults: pd.DataFrame,
    landings: pd.DataFrame,
    starts_s: Mapping[str, float] = MappingProxyType({}),
) -> Message | None:
    """Tell how many faults of markers lie at contacts, and name the first.

    Parameters
    ----------
    faults
        With ``recording, marker, start_s``, from the first frame of the recording. One
        that concerns several markers has a row for each. Rows without a marker, which
        are faults of the time stamps, do not count.
    landings
        With ``recording`` and, for each foot, ``contact_<foot>_s``.
    starts_s
        Time of each recording's first frame, s; 0 by default.

    Returns
    -------
    Message or None
        None if no fault is of a marker, or if no contact is known.
    """
    columns = [name for name in map(str, landings) if _is_contact(name)]
    of_markers = faults[faults["marker"].fillna("") != ""]
    if of_markers.empty or not landings[columns].notna().to_numpy().any():
        return None
    by_fault = [name for name in of_markers if name != "marker"]
    joined = of_markers.groupby(by_fault, sort=False, dropna=False)["marker"]
    one_each = joined.agg(" and ".join).reset_index()
    n_at_contacts = 0
    for recording, own in one_each.groupby("recording"):
        of_recording = landings[landings["recording"] == recording]
        contacts_s = of_recording[columns].to_numpy(float).ravel()
        times_s = own["start_s"].to_numpy(float) + starts_s.get(str(recording), 0.0)
        n_at_contacts += int(are_at_contacts(times_s, contacts_s).sum())
    values = {
        "at": n_at_contacts,
        "between": len(one_each) - n_at_contacts,
        "within_ms": 1e3 * AT_CONTACT_S,
        "first": _first(one_each),
    }
    return Message("landings.fault_places", values)


def _is_contact(column: str) -> bool:
    """Tell whether a column has the contact times of a foot."""
    return column.startswith("contact_") and column.endswith("_s")


def _first(faults: pd.DataFrame) -> str:
    """Name the first faults by marker, time and, of several recordings, recording."""
    several = faults["recording"].nunique() > 1
    named = []
    for one in faults.head(MOST_NAMED).itertuples(index=False):
        place = f"{one.marker} at {one.start_s:.2f} s"
        if several:
            place += f" of {one.recording}"
        named.append(place)
    more = len(faults) - len(named)
    if more:
        named.append(f"and {more} more")
    return ", ".join(named)
