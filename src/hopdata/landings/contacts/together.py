"""Contacts that belong to one landing: those that follow closely on the first.

Where a contact is sought depends on the descents of the body, and so on which markers
of a trunk are in the file. What lands together must not: it is read off the instants.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.judged import NO_MARKER, Contacts
from hopdata.landings.contacts.steps import TOGETHER_S

Number = TypeVar("Number", np.float64, np.int64)

# The row of a foot that was not timed in any row of its landing.
NO_ROW = -1

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
    landings = _landings(contacts)
    landings.sort(key=lambda landing: spans[landing.rows, 0].min())
    n_feet = contacts.instant.shape[1]
    picked = np.empty((len(landings), n_feet), dtype=np.int64)
    status = np.empty_like(picked)
    ends = np.empty((len(landings), 2))
    only_feet = np.empty(len(landings), dtype=bool)
    for number, landing in enumerate(landings):
        picked[number] = landing.picked
        status[number] = landing.status
        ends[number] = spans[landing.rows, 0].min(), spans[landing.rows, 1].max()
        only_feet[number] = hidden[landing.rows].all()
    grouped = replace(
        contacts,
        instant=_picked(contacts.instant, picked),
        se=_picked(contacts.se, picked),
        status=status,
        down=_picked(contacts.down, picked),
        marker=_picked(contacts.marker, picked, none=NO_MARKER),
        marker_probability=_picked(contacts.marker_probability, picked),
    )
    return ends, only_feet, grouped


@dataclass(frozen=True)
class _Landing:
    """A landing, made from the rows of descents.

    Parameters
    ----------
    rows : list of int
        The rows that it has something of.
    picked : (n,) int array
        The row in which each foot was timed; `NO_ROW` if it was not.
    status : (n,) int array
        What became of each foot.
    """

    rows: list[int]
    picked: IntArray
    status: IntArray


def _landings(contacts: Contacts) -> list[_Landing]:
    """Return the landings that the instants make, and rows without any contact."""
    groups = _groups(contacts)
    first_group: dict[int, int] = {}
    for number, group in enumerate(groups):
        for row in group.row_of.values():
            first_group.setdefault(row, number)
    n_rows, n_feet = contacts.instant.shape
    landings = []
    for number, group in enumerate(groups):
        picked = np.full(n_feet, NO_ROW)
        picked[list(group.row_of)] = list(group.row_of.values())
        rows = sorted(set(group.row_of.values()))
        first_of = [row for row in rows if first_group[row] == number]
        status = _status(group, first_of, contacts.status)
        landings.append(_Landing(rows, picked, status))
    for row in range(n_rows):
        if row not in first_group:
            picked = np.full(n_feet, row)
            landings.append(_Landing([row], picked, contacts.status[row]))
    return landings


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


def _status(group: _Group, first_of: list[int], status: IntArray) -> IntArray:
    """Return what became of each foot in a landing, (n,).

    `first_of` are the rows of which this is the first landing: what they say of feet
    without a contact is said here.
    """
    own = np.full(status.shape[1], descents.NOT_LANDED)
    for row in first_of:
        may_have_landed = ~np.isin(status[row], [*IDLE, descents.LANDED])
        tells_more = may_have_landed | (status[row] == descents.ALREADY_DOWN)
        taken = np.isin(own, IDLE) & tells_more
        own[taken] = status[row, taken]
    for foot, row in group.row_of.items():
        own[foot] = status[row, foot]
    return own


def _picked(
    values: NDArray[Number], picked: IntArray, *, none: float = np.nan
) -> NDArray[Number]:
    """Return values (L, n) of the rows that are picked for each foot, (G, n)."""
    if not values.size:
        return values
    last = np.full_like(values[:1], none)  # the last row, which is `NO_ROW`
    return np.take_along_axis(np.concatenate([values, last]), picked, axis=0)
