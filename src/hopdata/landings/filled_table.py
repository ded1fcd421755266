"""The gaps of every marker, and what was filled of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from hopdata.recordings.quality.gaps import seen
from hopdata.recordings.quality.runs import runs
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd


def filled_table(recordings: Iterable[Recording]) -> pd.DataFrame:
    """Count the gaps of every marker, and what was filled of them.

    Parameters
    ----------
    recordings : iterable of Recording
        With filled gaps, or without.

    Returns
    -------
    pandas.DataFrame
        One row a marker of each recording: recording, marker, role, frames, gaps, longest_s,
        missing, filled, left. Gaps are those of the cameras, filled or not; the last three count
        frames, and missing = filled + left.
    """
    import pandas as pd

    return pd.DataFrame([row for recording in recordings for row in _gap_rows(recording)])


def _gap_rows(recording: Recording) -> list[dict[str, object]]:
    unseen = ~seen(recording.positions)
    filled = np.zeros_like(unseen) if recording.filled is None else recording.filled
    rows: list[dict[str, object]] = []
    for m, (marker, role) in enumerate(zip(recording.markers, recording.roles, strict=True)):
        lengths = np.diff(runs(unseen[:, m] | filled[:, m]), axis=1)
        rows.append(
            {
                "recording": recording.name,
                "marker": marker,
                "role": role,
                "frames": len(unseen),
                "gaps": len(lengths),
                "longest_s": float(lengths.max(initial=0)) / recording.rate_hz,
                "missing": int(lengths.sum()),
                "filled": int(filled[:, m].sum()),
                "left": int(unseen[:, m].sum()),
            }
        )
    return rows
