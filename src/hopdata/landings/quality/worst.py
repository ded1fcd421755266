"""The landings that deserve a look: one of each reason for exclusion, then the least sure ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

MARGIN_S = 0.06
#: Time shown after the pre section where the post section was never reached, s.
OPEN_S = 0.12
SAMPLE_COLUMNS = ("landing", "foot", "time_s", "height_m")


def worst_landings(touchdowns: pd.DataFrame, number: int = 12) -> pd.DataFrame:
    """Choose landings to look at.

    Parameters
    ----------
    touchdowns : DataFrame
        The study's table of touchdowns.
    number : int
        How many.

    Returns
    -------
    pandas.DataFrame
        Rows of the table with ``landing`` (from 1) and ``why`` before them. The first half are
        excluded ones, one of each reason, the most frequent reasons first and of each reason the
        one in the middle of the study; the others are used ones, in turn that with the largest
        standard error of a contact and that with the least probable order.
    """
    import pandas as pd

    out = touchdowns["excluded"].astype(bool)
    excluded, used = touchdowns[out], touchdowns[~out]
    picked: dict[int, str] = {}
    for reason, count in excluded["reason"].value_counts().head(number // 2).items():
        same = excluded.index[excluded["reason"] == reason]
        times = "once" if count == 1 else f"{count} times"
        picked[int(same[len(same) // 2])] = f"excluded ({times}): {reason}"
    errors = used[[c for c in used.columns if c.startswith("se_")]].max(axis=1)
    by_error = errors.sort_values(ascending=False, kind="stable").index
    by_order = used["probability"].sort_values(kind="stable").index
    for largest, doubtful in zip(by_error, by_order, strict=True):
        for row, why in ((largest, "least sure contact"), (doubtful, "most doubtful order")):
            if len(picked) < number and int(row) not in picked:
                picked[int(row)] = why
    table = touchdowns.loc[list(picked)].reset_index(drop=True)
    first = pd.DataFrame({"landing": np.arange(1, len(table) + 1), "why": list(picked.values())})
    return pd.concat([first, table], axis=1)


def landing_samples(recordings: Sequence[Recording], landings: pd.DataFrame) -> pd.DataFrame:
    """Heights of the feet around each of these landings.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled.
    landings : DataFrame
        As from `worst_landings`.

    Returns
    -------
    pandas.DataFrame
        ``landing, foot, time_s`` (from the pre section), ``height_m``; a row for each frame, NaN
        where a foot was not seen.
    """
    import pandas as pd

    by_name = {recording.name: recording for recording in recordings}
    parts = []
    for row in landings.to_dict("records"):
        recording = by_name[str(row["recording"])]
        start, end = float(row["t_pre_s"]), float(row["t_post_s"])
        end = end if np.isfinite(end) else start + OPEN_S
        near = (recording.time >= start - MARGIN_S) & (recording.time <= end + MARGIN_S)
        heights = recording.feet[near, :, 2]
        parts.append(
            pd.DataFrame(
                {
                    "landing": row["landing"],
                    "foot": np.tile(recording.names("foot"), len(heights)),
                    "time_s": np.repeat(recording.time[near] - start, heights.shape[1]),
                    "height_m": heights.ravel(),
                }
            )
        )
    return pd.concat(parts) if parts else pd.DataFrame(columns=list(SAMPLE_COLUMNS))
