"""Landings that a verdict leaves out as far off, by the names that a study gives them.

`judge` knows them by their rows. A configuration names a landing by its recording and
the number of its touchdown, which are not the rows where others were left out before.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.notes import Note

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hopdata.maps.verdict.judge import Verdict

# The note on these landings.
NOTE = "maps.gross_errors"

#: More landings than this are not named in a sentence; lists have them all.
#: Unit: landings. Origin: chosen.
MOST_NAMED = 5


def with_names(
    found: "Verdict",
    recording: "NDArray[np.str_]",
    touchdown: "NDArray[np.int64]",
    t_pre_s: FloatArray,
) -> "Verdict":
    """Return a verdict whose landings left out as far off have their names.

    Parameters
    ----------
    found
        What `judge` found in n landings.
    recording, touchdown
        (n,) recording of each landing, and number of its touchdown there, from 1.
    t_pre_s
        (n,) its instant at the pre section on the clock of the recording, s.
    """
    if not found.gross_errors:
        return found
    named: list[dict[str, Any]] = []
    for reason, rows in found.gross_errors.items():
        for row in rows:
            landing = row - 1
            named.append(
                {
                    "recording": str(recording[landing]),
                    "touchdown": int(touchdown[landing]),
                    "t_pre_s": float(t_pre_s[landing]),
                    "reason": reason,
                    "row": row,
                }
            )
    named.sort(key=lambda one: one["row"])
    notes = [_named(note, named) for note in found.notes]
    return replace(found, far_off=tuple(named), notes=notes)


def _named(note: Note, landings: Sequence[Mapping[str, Any]]) -> Note:
    """Return the note on these landings with their names; another as it is."""
    if note.code != NOTE:
        return note
    which = Message("maps.far_off_in_lists")
    if len(landings) <= MOST_NAMED:
        listed = {"listed": "; ".join(_told(one) for one in landings)}
        which = Message("maps.far_off_named", listed)
    values = {**note.values, "which": which}
    return Note.of(NOTE, **values)


def _told(landing: Mapping[str, Any]) -> str:
    """Return a landing by its recording, number and time."""
    values = {**landing, "time": f"{landing['t_pre_s']:.2f}"}
    return str(Message("maps.far_off_landing", values))
