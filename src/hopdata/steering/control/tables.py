"""Models as the tables that the compiled controllers take."""

from __future__ import annotations

from typing import TypeGuard

from hopdata.steering.models.interface import FrameChangeMap
from hopdata.steering.models.tabulated import TabulatedMap, tabulated


def table_of(model: FrameChangeMap, swing_limit_rad: float) -> TabulatedMap:
    """Tabulate a model unless it is a table of boom angle and swing with this limit."""
    if _fits(model, swing_limit_rad):
        return model
    return tabulated(model, swing_limit_rad)


def _fits(model: FrameChangeMap, swing_limit_rad: float) -> TypeGuard[TabulatedMap]:
    if not isinstance(model, TabulatedMap):
        return False
    return model.values.ndim == 3 and model.swing_limit_rad == swing_limit_rad
