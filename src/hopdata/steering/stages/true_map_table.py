"""The true frame changes as a table, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hopdata.errors import RecordingError
from hopdata.steering.plant.true_map import TrueFrameChanges

if TYPE_CHECKING:
    import pandas as pd

INPUTS = ["boom_angle_rad", "swing_rad", "previous_swing_rad"]
CHANGE = ["dx_m", "dy_m", "dtheta_rad"]


def true_map_table(true: TrueFrameChanges) -> pd.DataFrame:
    """Return one row for each boom angle, swing and previous swing, in this order."""
    import pandas as pd

    axes = (true.boom_angle_rad, true.swing_rad, true.previous_swing_rad)
    columns = [axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")]
    table = pd.DataFrame(np.column_stack(columns), columns=INPUTS)
    table[CHANGE] = true.change.reshape(-1, 3)
    return table


def true_map_of(table: pd.DataFrame) -> TrueFrameChanges:
    """Read the table that `true_map_table` made.

    Raises
    ------
    RecordingError
        If its rows are not those of a grid.
    """
    axes = [table[name].drop_duplicates().to_numpy(dtype=float) for name in INPUTS]
    shape = tuple(len(axis) for axis in axes)
    if len(table) != np.prod(shape):
        raise RecordingError(f"true map: expected a grid of {shape}, found {len(table)} rows")
    change = table[CHANGE].to_numpy(dtype=float).reshape(*shape, 3)
    return TrueFrameChanges(axes[0], axes[1], axes[2], change)
