"""What another device knows of a recording: contact instants, or forces under the feet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """A column of an external file, and the feet it belongs to.

    Parameters
    ----------
    name : str
        Column (or event label, or analog channel) of the file.
    feet : tuple of str
        The feet of the recording that it cannot tell apart: it knows the first contact of these.
    """

    name: str
    feet: tuple[str, ...]


@dataclass(frozen=True)
class ContactTimes:
    """Contact instants of one column of an external file.

    Parameters
    ----------
    column : Column
        Where they come from, and whose they are.
    instant : (K,) array
        Contact instants on the recording's clock, s, increasing.
    source : str
        ``"contacts"`` or ``"forces"``: the block of the configuration.
    span_s : tuple of float
        First and last instant at which a contact would have been listed, s.
    other_feet_above_m : float, optional
        A contact during which all feet of the column are higher than this is another foot's, m.
        None if the column knows no other foot.
    """

    column: Column
    instant: FloatArray
    source: str
    span_s: tuple[float, float]
    other_feet_above_m: float | None = None


@dataclass(frozen=True)
class ForceSignal:
    """Vertical force of one column of an external file.

    Parameters
    ----------
    column : Column
        Where it comes from, and whose it is.
    time : (K,) array
        On the recording's clock, s, strictly increasing.
    force : (K,) array
        Upward force on the feet, N, or multiples of body weight; NaN where missing.
    unit : str
        ``"N"`` or ``"body_weight"``.
    options : mapping
        The block ``forces`` of the configuration, for the threshold.
    """

    column: Column
    time: FloatArray
    force: FloatArray
    unit: str
    options: Mapping[str, Any] = field(default_factory=dict)


def columns_of(entries: Sequence[Mapping[str, Any]], feet: Sequence[str]) -> tuple[Column, ...]:
    """Columns as configured; without any, one of each foot's own name.

    Parameters
    ----------
    entries : sequence of mappings
        ``columns`` of the configuration, each with ``name`` and ``feet``; without ``feet`` the
        column belongs to the foot of its own name.
    feet : sequence of str
        Feet of the recording.
    """
    if not entries:
        return tuple(Column(foot, (foot,)) for foot in feet)
    return tuple(Column(e["name"], tuple(e["feet"] or [e["name"]])) for e in entries)
