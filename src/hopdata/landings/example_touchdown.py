"""One typical touchdown, to be shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hopdata.errors import AnalysisError
from hopdata.landings.velocity_minimum import filter_window, savitzky_golay_velocity
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd


def example_touchdown(
    recordings: Sequence[Recording], table: pd.DataFrame, *, margin_s: float = 0.05
) -> pd.DataFrame:
    """Heights and velocities of the feet in one typical touchdown (Fig. 2.3).

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled, with different names.
    table : pandas.DataFrame
        Their touchdowns.
    margin_s : float
        Time shown before the pre and after the post section, s.

    Returns
    -------
    pandas.DataFrame
        recording, index, time_s (from the pre section), foot, height_m, velocity_m_s (by the filter
        of the printed method). The touchdown is the one of median spread in the commonest schedule.

    Raises
    ------
    AnalysisError
        If no touchdown is used.
    """
    import pandas as pd

    used = table[~table["excluded"].astype(bool)]
    if used.empty:
        raise AnalysisError("touchdowns: expected at least one usable one to show, found none")
    counts = used["schedule"].value_counts(sort=False)
    commonest = min(counts.index[counts == counts.max()])
    ranked = used[used["schedule"] == commonest].sort_values(["spread_s", "recording", "index"])
    row = ranked.iloc[(len(ranked) - 1) // 2]
    recording = next(r for r in recordings if r.name == row["recording"])
    time = recording.time
    frames = (time >= row["t_pre_s"] - margin_s) & (time <= row["t_post_s"] + margin_s)
    heights = recording.feet[:, :, 2]
    rate_hz = 1 / float(np.median(np.diff(time)))
    reach = filter_window(rate_hz)
    shown = np.flatnonzero(frames)
    about = slice(max(shown[0] - reach, 0), shown[-1] + reach + 1)
    velocity = np.full(heights.shape, np.nan)
    velocity[about] = savitzky_golay_velocity(heights[about], rate_hz)
    pieces = [
        pd.DataFrame(
            {
                "recording": recording.name,
                "index": int(row["index"]),
                "time_s": time[frames] - row["t_pre_s"],
                "foot": foot,
                "height_m": heights[frames, i],
                "velocity_m_s": velocity[frames, i],
            }
        )
        for i, foot in enumerate(recording.names("foot"))
    ]
    return pd.concat(pieces, ignore_index=True)
