"""How far what should stay the same differs between recordings, or within a single one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

#: Name -> unit of what is compared, one value a touchdown.
QUANTITIES = {
    "time between the sections": "s",
    "contact spread": "s",
    "height of the feet at the post section": "m",
    "distance between body markers": "m",
}
PARTS_OF_ONE = 4
MAD_TO_SD = 1.4826
SE_OF_MEDIAN = 1.2533  # times sd / sqrt(n), for normal values
LEAST = 5


@one_blas_thread()
def drift_table(recordings: Sequence[Recording], touchdowns: pd.DataFrame) -> pd.DataFrame:
    """Compare used touchdowns between recordings, or between quarters of a single one.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled.
    touchdowns : DataFrame
        The study's table of touchdowns.

    Returns
    -------
    pandas.DataFrame
        One row a quantity and part: ``quantity, unit, part, touchdowns, median, se`` (of the
        median), ``typical`` (median of all), ``spread`` (robust standard deviation within parts)
        and ``deviation`` of the part's median in spreads. Parts with fewer than five touchdowns
        are left out, and there are no rows where fewer than two parts remain.
    """
    import pandas as pd

    values = pd.concat([_values(one, touchdowns) for one in recordings], ignore_index=True)
    if len(recordings) == 1:
        values["part"] = _quarters(values["t_pre_s"].to_numpy(float))
    rows = [row for name in QUANTITIES for row in _rows(values, name)]
    columns = ["quantity", "unit", "part", "touchdowns", "median", "se", "typical", "spread"]
    return pd.DataFrame(rows, columns=[*columns, "deviation"])


def _values(recording: Recording, touchdowns: pd.DataFrame) -> pd.DataFrame:
    """Return each quantity at each used touchdown of one recording."""
    import pandas as pd

    own = touchdowns["recording"].astype(str) == recording.name
    used = touchdowns[own & ~touchdowns["excluded"].astype(bool)]
    pre, post = used["t_pre_s"].to_numpy(float), used["t_post_s"].to_numpy(float)
    columns = (
        post - pre,
        used["spread_s"].to_numpy(float),
        recording.feet[_frames(recording, post), :, 2].mean(axis=1),
        _mean_distance(recording.body[_frames(recording, pre)]),
    )
    table = pd.DataFrame(dict(zip(QUANTITIES, columns, strict=True)))
    return table.assign(part=recording.name, t_pre_s=pre)


def _frames(recording: Recording, times: FloatArray) -> NDArray[np.int64]:
    """Return the frame after each time, (n,)."""
    frames: NDArray[np.int64] = np.searchsorted(recording.time, times)
    return frames.clip(max=max(len(recording.time) - 1, 0))


def _mean_distance(body: FloatArray) -> FloatArray:
    """Return the mean distance between the markers of (n, B, 3) bodies, (n,)."""
    a, b = np.triu_indices(body.shape[1], 1)
    mean: FloatArray = np.linalg.norm(body[:, a] - body[:, b], axis=2).mean(axis=1)
    return mean


def _quarters(times: FloatArray) -> list[str]:
    place = np.argsort(np.argsort(times, kind="stable"), kind="stable")
    quarter = 1 + place * PARTS_OF_ONE // max(len(times), 1)
    return [f"part {k} of {PARTS_OF_ONE}" for k in quarter]


def _rows(values: pd.DataFrame, name: str) -> list[tuple[object, ...]]:
    known = values[np.isfinite(values[name].to_numpy(float))]
    parts = {
        str(part): group[name].to_numpy(float)
        for part, group in known.groupby("part", sort=False)
        if len(group) >= LEAST
    }
    if len(parts) < 2:  # nothing to compare
        return []
    within = np.concatenate([np.abs(v - np.median(v)) for v in parts.values()])
    spread = MAD_TO_SD * float(np.median(within))
    typical = float(np.median(np.concatenate(list(parts.values()))))
    rows: list[tuple[object, ...]] = []
    for part, v in parts.items():
        median = float(np.median(v))
        se = SE_OF_MEDIAN * spread / np.sqrt(len(v))
        off = (median - typical) / spread if spread > 0 else 0.0
        rows.append((name, QUANTITIES[name], part, len(v), median, se, typical, spread, off))
    return rows
