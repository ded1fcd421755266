"""Models as the tables that the compiled controllers take."""

from __future__ import annotations

from hopdata.steering.models.interface import FrameChangeMap
from hopdata.steering.models.tabulated import TabulatedMap, tabulated


def table_of(model: FrameChangeMap, swing_limit_rad: float) -> TabulatedMap:
    """Tabulate a model unless it is a table of boom angle and swing with this limit."""
    if isinstance(model, TabulatedMap) and model.values.ndim == 3:
        if model.swing_limit_rad == swing_limit_rad:
            return model
    return tabulated(model, swing_limit_rad)
