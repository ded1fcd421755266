"""Tables of frame changes: one hop a row, a unit in the name of each column."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.errors import RecordingError
from hopdata.steering.frame_changes import FrameChanges

if TYPE_CHECKING:
    import pandas as pd

_COLUMNS = {
    "recording": ("recording",),
    "time_s": ("time_s",),
    "boom_angle_rad": ("boom_angle_rad",),
    "swing_rad": ("swing_rad",),
    "change": ("dx_m", "dy_m", "dtheta_rad"),
    "previous_swing_rad": ("previous_swing_rad",),
    "previous_change": ("previous_dx_m", "previous_dy_m", "previous_dtheta_rad"),
    "reason": ("reason",),
}


def to_table(changes: FrameChanges) -> pd.DataFrame:
    """Return the hops as a table with a unit in each column's name."""
    import pandas as pd

    columns: dict[str, Any] = {}
    for name, names in _COLUMNS.items():
        values = getattr(changes, name)
        columns.update(
            zip(names, values.T, strict=True) if values.ndim > 1 else [(names[0], values)]
        )
    return pd.DataFrame(columns)


def from_table(table: pd.DataFrame) -> FrameChanges:
    """Return the hops of a table that `to_table` made.

    Raises
    ------
    RecordingError
        If a column is missing.
    """
    wanted = [name for names in _COLUMNS.values() for name in names]
    missing = [name for name in wanted if name not in table]
    if missing:
        raise RecordingError(
            f"frame changes: expected the columns {', '.join(wanted)}, missing {', '.join(missing)}"
        )
    return FrameChanges(**{name: _values(table, names) for name, names in _COLUMNS.items()})


def _values(table: pd.DataFrame, names: tuple[str, ...]) -> Any:
    """Values of a field, text or numbers, from its columns."""
    if names[0] in ("recording", "reason"):
        return table[names[0]].to_numpy(dtype=str)
    values = table[list(names)].to_numpy(dtype=float)
    return values if len(names) > 1 else values[:, 0]
