"""Entries of ``truth.json``: name -> value, unit and what it is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Entry = dict[str, Any]
Entries = dict[str, Entry]


def entry(value: float | int | bool, unit: str, what: str) -> Entry:
    """Return one entry; a value that could not be computed is None, which JSON can hold."""
    if isinstance(value, bool | int):
        return {"value": value, "unit": unit, "what": what}
    return {"value": float(value) if np.isfinite(value) else None, "unit": unit, "what": what}


def mean(values: NDArray[Any]) -> float:
    """Return the mean; NaN of nothing."""
    return float(np.mean(values)) if values.size else float("nan")


def quantile(values: NDArray[Any], fraction: float) -> float:
    """Return a quantile; NaN of nothing."""
    return float(np.quantile(values, fraction)) if values.size else float("nan")
