"""Gaps of the body markers: filled where that is safe, and marked."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import chosen
from hopdata.landings.cubic_filling import cubic_places
from hopdata.landings.rigid_filling import learn_shape, rigid_places
from hopdata.landings.section_fits import WINDOWS_S
from hopdata.recordings.quality.gaps import seen
from hopdata.recordings.quality.runs import runs
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

REACH_S = max(WINDOWS_S)  # about the sections: frames that states may be fitted to
TOO_MUCH_FILLED = "too much of the body filled in"


@one_blas_thread()
def fill_gaps(recording: Recording, *, longest_s: float = 0.1, method: str = "rigid") -> Recording:
    """Fill short gaps of the body markers.

    Feet are never filled: a contact is to be seen, not made.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    longest_s : float
        Longest gap that is filled, s; gaps that are longer stay as they are.
    method : {"rigid", "cubic", "rigid_or_cubic"}
        From three or more other markers of the body in the same frame; by a cubic through the
        frames about the gap, never across a contact or lift-off; or the former where it can be
        and the latter else.

    Returns
    -------
    Recording
        The same, with the places and with `filled` marking them. What was seen is not touched.

    Raises
    ------
    ConfigError
        If `method` is unknown.
    """
    ways = chosen("filling.method", method, METHODS)
    bodies = recording.indices("body")
    body = recording.body.copy()
    longest = int(longest_s * recording.rate_hz + 1e-6)
    wanted = _short_gaps(~seen(body), longest)
    for fill in ways:
        left = wanted & ~seen(body)
        body = np.where(left[..., None], fill(recording, left, longest), body)
    positions, filled = recording.positions.copy(), np.zeros(recording.positions.shape[:2], bool)
    positions[:, bodies] = body
    filled[:, bodies] = seen(body) & ~seen(recording.body)
    return replace(recording, positions=positions, filled=filled)


def _rigid(recording: Recording, wanted: BoolArray, _longest: int) -> FloatArray:
    shape = learn_shape(recording.body)
    return recording.body if shape is None else rigid_places(recording.body, wanted, shape)


def _cubic(recording: Recording, wanted: BoolArray, longest: int) -> FloatArray:
    feet = recording.feet[:, :, 2]
    return cubic_places(recording.time, recording.body, feet, wanted, longest=longest)


METHODS = {"rigid": (_rigid,), "cubic": (_cubic,), "rigid_or_cubic": (_rigid, _cubic)}


def mark_filled(
    recording: Recording, table: pd.DataFrame, *, largest_share: float = 1.0
) -> pd.DataFrame:
    """Say of each touchdown how much of it was filled in, and leave out those with too much.

    Parameters
    ----------
    recording : Recording
        Whose gaps were filled; with `filled` None the table is returned as it is.
    table : pandas.DataFrame
        Its touchdowns.
    largest_share : float
        Touchdowns of which more than this share was filled in are left out, 0 to 1.

    Returns
    -------
    pandas.DataFrame
        With a column filled_share: filled places over all places of the body markers, from 0.22 s
        before the pre section to 0.22 s after the post section (or the pre section, where the post
        section was not reached).
    """
    if recording.filled is None:
        return table
    t_pre = table["t_pre_s"].to_numpy(float)
    t_end = np.fmax(table["t_post_s"].to_numpy(float), t_pre) + REACH_S
    body = recording.filled[:, recording.indices("body")]
    total = np.append(0, body.sum(axis=1).cumsum())
    start, stop = (np.searchsorted(recording.time, at) for at in (t_pre - REACH_S, t_end))
    share = (total[stop] - total[start]) / np.maximum((stop - start) * body.shape[1], 1)
    excluded = table["excluded"].to_numpy(bool)
    too_much = (share > largest_share) & ~excluded
    return table.assign(
        excluded=excluded | too_much,
        reason=table["reason"].where(~too_much, TOO_MUCH_FILLED),
        filled_share=share,
    )


def _short_gaps(unseen: BoolArray, longest: int) -> BoolArray:
    """Mark the gaps of (N, B) markers that last at most `longest` frames."""
    short = np.zeros_like(unseen)
    for marker in range(unseen.shape[1]):
        for start, stop in runs(unseen[:, marker]):
            short[start:stop, marker] = stop - start <= longest
    return short
