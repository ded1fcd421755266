"""The `Recording`: marker positions over time, in SI units, with z up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import require_choice
from hopdata.recordings.raw import Event

FloatArray = NDArray[np.float64]

ROLES = ("body", "foot", "boom", "other")


@dataclass(frozen=True)
class Recording:
    """Motion capture of one trial.

    Parameters
    ----------
    name : str
        Short name, unique in a study.
    time : (N,) array
        Time of each frame, s, strictly increasing.
    positions : (N, M, 3) array
        Marker positions in the world frame with z up, m; NaN where a marker was not seen.
    markers : tuple of str
        The M marker names.
    roles : tuple of str
        One of ``"body"``, ``"foot"``, ``"boom"``, ``"other"`` for each marker.
    rate_hz : float
        Nominal frame rate, Hz.
    source : str
        Name of the file that the recording was read from.
    source_sha256 : str
        Digest of that file.
    vertical_axis : str
        Direction of the source file that was up, such as ``"y"`` or ``"-z"`` (`axes.FILE_AXES`).
    events : tuple of Event
        Events marked in the file, on the same clock as `time`.
    remarks : tuple of str
        What the file said that did not hold and was put right, one line each.
    filled : (N, M) bool array, optional
        Positions that were not seen but filled in; None if no gaps were filled.
    """

    name: str
    time: FloatArray
    positions: FloatArray
    markers: tuple[str, ...]
    roles: tuple[str, ...]
    rate_hz: float
    source: str = ""
    source_sha256: str = ""
    vertical_axis: str = "z"
    events: tuple[Event, ...] = ()
    remarks: tuple[str, ...] = ()
    filled: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        n_frames, n_markers = len(self.time), len(self.markers)
        if self.time.ndim != 1:
            raise ValueError(f"time: expected shape (N,), found {self.time.shape}")
        if self.positions.shape != (n_frames, n_markers, 3):
            raise ValueError(
                f"positions: expected shape {(n_frames, n_markers, 3)}, "
                f"found {self.positions.shape}"
            )
        if len(self.roles) != n_markers:
            raise ValueError(f"roles: expected {n_markers} entries, found {len(self.roles)}")
        if self.filled is not None and self.filled.shape != (n_frames, n_markers):
            raise ValueError(
                f"filled: expected shape {(n_frames, n_markers)}, found {self.filled.shape}"
            )

    def indices(self, role: str) -> list[int]:
        """Return indices of the markers with this role, in order."""
        require_choice("role", role, ROLES)
        return [i for i, r in enumerate(self.roles) if r == role]

    def names(self, role: str) -> tuple[str, ...]:
        """Return names of the markers with this role, in order."""
        return tuple(self.markers[i] for i in self.indices(role))

    @property
    def place(self) -> str:
        """Where it comes from, as a message names it."""
        return self.source or f"recording '{self.name}'"

    def part(self, frames: slice) -> Recording:
        """Return the recording of these frames alone."""
        filled = None if self.filled is None else self.filled[frames]
        return replace(
            self, time=self.time[frames], positions=self.positions[frames], filled=filled
        )

    @cached_property
    def body(self) -> FloatArray:
        """Body markers, (N, B, 3), m."""
        return self.positions[:, self.indices("body")]

    @cached_property
    def feet(self) -> FloatArray:
        """Foot markers, (N, n, 3), m."""
        return self.positions[:, self.indices("foot")]

    @cached_property
    def body_height(self) -> FloatArray:
        """Mean height of the body markers, (N,), m; NaN where one of them is not seen."""
        return self.body[:, :, 2].mean(axis=1)
