"""Errors of the states at the sections, of a study whose true landings are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.maps.rigid import split_states
from hopdata.maps.truth.entries import Entries, entry
from hopdata.maps.truth.matching import match_landings

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def true_rows(
    pairs: Any, table: pd.DataFrame, true: Any, contacts: Mapping[str, Floats], feet: Sequence[str]
) -> Integers:
    """Return the row of `true` that each row of `pairs` is, (n,), -1 where there is none.

    Parameters
    ----------
    pairs, true
        Measured and true `Pairs`; the index of the latter is the number of the landing.
    table
        The study's touchdowns.
    contacts
        Recording -> true contact instants (L, feet), s.
    feet
        Names of the feet, in the order of the truth.
    """
    keyed = table.set_index(["recording", "index"])[[f"contact_{foot}_s" for foot in feet]]
    keys = list(zip(pairs.recording.tolist(), pairs.index.tolist(), strict=True))
    found = keyed.loc[keys].to_numpy(float)
    places = {
        key: row
        for row, key in enumerate(zip(true.recording.tolist(), true.index.tolist(), strict=True))
    }
    rows = np.full(len(found), -1)
    for name, instants in contacts.items():
        mine = np.flatnonzero(pairs.recording == name)
        landing = match_landings(found[mine], instants)
        rows[mine] = [places.get((name, int(number)), -1) for number in landing]
    return rows


@one_blas_thread()
def state_errors(pairs: Any, true: Any, rows: Integers) -> pd.DataFrame:
    """Return the errors of the states at the sections.

    Each touchdown's home frame is where it lies best on the true states, at both sections at once:
    a shift in the plane and a turn about the vertical.

    Returns
    -------
    DataFrame
        Columns section (``pre``, ``post``), landings, position_rms_mm, velocity_rms_mm_s; per
        coordinate of a marker.
    """
    import pandas as pd

    known = np.flatnonzero(rows >= 0)
    mine = [split_states(states[known]) for states in (pairs.x, pairs.y)]
    truly = [split_states(states[rows[known]]) for states in (true.x, true.y)]
    turn = _plane_turns(
        np.concatenate([state[0] for state in truly], axis=1),
        np.concatenate([state[0] for state in mine], axis=1),
    )
    offset = np.zeros((len(known), 1, 3))
    both = [(m[0] - t[0] @ turn)[..., :2] for m, t in zip(mine, truly, strict=True)]
    offset[..., :2] = np.concatenate(both, axis=1).mean(axis=1, keepdims=True)
    table = []
    for section, measured, known_state in zip(("pre", "post"), mine, truly, strict=True):
        position = measured[0] - known_state[0] @ turn - offset
        velocity = measured[1] - known_state[1] @ turn
        table.append((section, len(known), 1e3 * _rms(position), 1e3 * _rms(velocity)))
    columns = ["section", "landings", "position_rms_mm", "velocity_rms_mm_s"]
    return pd.DataFrame(table, columns=columns)


def _plane_turns(source: Floats, target: Floats) -> Floats:
    """Return the turns (n, 3, 3), for rows on the left, that bring points (n, k, 3) to others."""
    a, b = (p[..., :2] - p[..., :2].mean(axis=1, keepdims=True) for p in (source, target))
    along = (a * b).sum(axis=(1, 2))
    across = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(axis=1)
    length = np.hypot(along, across)
    turn = np.tile(np.eye(3), (len(a), 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = along / length
    turn[:, 0, 1], turn[:, 1, 0] = across / length, -across / length
    return turn


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def score_states(errors: pd.DataFrame) -> Entries:
    """Say how good positions and velocities at the sections are."""
    entries: Entries = {}
    for row in errors.to_dict("records"):
        section = row["section"]
        entries[f"position_rms_{section}"] = entry(
            row["position_rms_mm"],
            "mm",
            f"Rms error of the marker positions at the {section} section, per coordinate",
        )
        entries[f"velocity_rms_{section}"] = entry(
            row["velocity_rms_mm_s"],
            "mm/s",
            f"Rms error of the marker velocities at the {section} section, per coordinate",
        )
    return entries
