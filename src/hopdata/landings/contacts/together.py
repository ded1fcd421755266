"""Contacts that belong to one landing: those that follow closely on the first.

Where a contact is sought depends on the descents of the body, and so on which markers
of a trunk are in the file. What lands together must not: it is read off the instants.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.judged import Contacts
from hopdata.landings.contacts.steps import TOGETHER_S

# A foot of this state did not land, as far as it was seen.
IDLE = (descents.ALREADY_DOWN, descents.NOT_LANDED)


@dataclass
class _Group:
    """Feet that land together, each with the row in which it was timed."""

    first_s: float
    row_of: dict[int, int] = field(default_factory=dict)

    def takes(self, foot: int, instant_s: float) -> bool:
        """Return whether a contact belongs to this landing."""
        is_near = instant_s - self.first_s <= TOGETHER_S
        return is_near and foot not in self.row_of


def landed_together(
    spans: FloatArray, hidden: BoolArray, contacts: Contacts
) -> tuple[FloatArray, BoolArray, Contacts]:
    """Return a row for each landing, from a row for each descent.

    Parameters
    ----------
    spans : (L, 2) array
        When the search for each row began and ended, s, of an animal of 1 m.
    hidden : (L,) bool array
        Whether only the feet show a row.
    contacts : Contacts
        The contacts of n feet in each row, none of them twice.

    Returns
    -------
    spans : (G, 2) array
        From the first begin to the last end of the rows from which a landing is made.
    hidden : (G,) bool array
    contacts : Contacts
        Of G landings, in order of their begins. A foot that may have landed unseen
        stays with the first contact of its row. A row without any contact is kept.
    """
    groups = _groups(contacts)
    rows_of = [sorted(set(group.row_of.values())) for group in groups]
    first_group: dict[int, int] = {}
    for number, group in enumerate(groups):
        for row in group.row_of.values():
            first_group.setdefault(row, number)
    alone = [row for row in range(len(spans)) if row not in first_group]
    statuses = [
        _status(group, number, first_group, contacts.status)
        for number, group in enumerate(groups)
    ]
    n_feet = contacts.instant.shape[1]
    # Row -1 is of nothing: a foot that was not timed in any row of its landing.
    picked = np.full((len(groups) + len(alone), n_feet), -1)
    for number, group in enumerate(groups):
        for foot, row in group.row_of.items():
            picked[number, foot] = row
    picked[len(groups) :] = np.array(alone, dtype=int)[:, None]
    members = [*rows_of, *([row] for row in alone)]
    begins = np.array([spans[rows, 0].min() for rows in members])
    ends = np.array([spans[rows, 1].max() for rows in members])
    status = np.array([*statuses, *contacts.status[alone]]).reshape(picked.shape)
    order = np.argsort(begins, kind="stable")
    picked = picked[order]
    return (
        np.stack([begins, ends], axis=1)[order],
        np.array([hidden[rows].all() for rows in members], dtype=bool)[order],
        replace(
            contacts,
            instant=_picked(contacts.instant, picked),
            se=_picked(contacts.se, picked),
            status=status[order].astype(np.int64),
            down=_picked(contacts.down, picked),
        ),
    )


def _groups(contacts: Contacts) -> list[_Group]:
    """Return the landings that the instants make, in order of time."""
    lands = np.isfinite(contacts.instant) & ~np.isin(contacts.status, IDLE)
    rows, feet = np.nonzero(lands)
    instants = contacts.instant[rows, feet]
    groups: list[_Group] = []
    for contact in np.argsort(instants, kind="stable").tolist():
        foot = int(feet[contact])
        instant_s = float(instants[contact])
        if not groups or not groups[-1].takes(foot, instant_s):
            groups.append(_Group(instant_s))
        groups[-1].row_of[foot] = int(rows[contact])
    return groups


def _status(
    group: _Group, number: int, first_group: dict[int, int], status: IntArray
) -> IntArray:
    """Return what became of each foot in a landing, (n,)."""
    own = np.full(status.shape[1], descents.NOT_LANDED)
    for row in sorted(set(group.row_of.values())):
        if first_group[row] == number:
            untimed = ~np.isin(status[row], [*IDLE, descents.LANDED])
            is_idle = np.isin(own, IDLE)
            taken = is_idle & (untimed | (status[row] == descents.ALREADY_DOWN))
            own[taken] = status[row, taken]
    for foot, row in group.row_of.items():
        own[foot] = status[row, foot]
    return own


def _picked(values: FloatArray, picked: IntArray) -> FloatArray:
    """Return values (L, n) of the rows that are picked for each foot, (G, n)."""
    if not values.size:
        return values
    none = np.full((1, values.shape[1]), np.nan)
    return np.take_along_axis(np.concatenate([values, none]), picked, axis=0)
