"""What the user is shown of a derived system: guards, modes, directions, status."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid import layout as at
from hopdata.hybrid.sliding.flags import (
    LEAVES,
    RESTING,
    RESTS,
    SLIDES,
    SLIDING,
    STUCK,
    UNCLEAR,
)


@dataclass(frozen=True)
class Slides:
    """How the records of a derived system show what the user knows.

    Parameters
    ----------
    surfaces : tuple of int
        The user's guards that may slide.
    n_guards, n_modes : int
        Numbers of the user's guards, and of integers in the user's mode.
    n_due : int
        Number of integers that tell a law for several guards at once which are due.
    """

    surfaces: tuple[int, ...]
    n_guards: int
    n_modes: int
    n_due: int = 0

    @property
    def count(self) -> int:
        """Number of guards that may slide."""
        return len(self.surfaces)

    def _flags(self, modes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the flags (..., count) in the derived system's modes (..., m)."""
        first = self.count + self.n_modes
        return modes[..., first : first + self.count]

    def guards(self, found: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the user's guards, of the derived system's; -1 stays."""
        known = np.array((*self.surfaces, *range(self.n_guards), -1))
        return known[found]

    def modes(self, found: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the user's modes (..., m), with a lock of 0 where a guard slides."""
        own = found[..., self.count : self.count + self.n_modes].copy()
        flags = self._flags(found)
        for j, k in enumerate(self.surfaces):
            held = np.isin(flags[..., j], (SLIDING, RESTING))
            own[..., k] = np.where(held, 0, own[..., k])
        return own

    def directions(
        self,
        guard: NDArray[np.int64],
        direction: NDArray[np.int64],
        modes: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Return the directions that tell what has happened, of the driver's."""
        told = direction.copy()
        flags = self._flags(modes)
        for j, k in enumerate(self.surfaces):
            begun = (guard == self.count + k) & (flags[:, j] == SLIDING)
            told[begun] *= SLIDES
            rests = (guard == self.count + k) & (flags[:, j] == RESTING)
            told[rests] *= RESTS
            left = guard == j
            told[left] = LEAVES * modes[left, self.count + k]
        return told

    def status(
        self, status: NDArray[np.int64], modes: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the statuses, of the driver's and the final modes (..., m)."""
        flags = self._flags(modes)
        told = np.where((flags == UNCLEAR).any(axis=-1), at.NOT_UNIQUE, status)
        return np.where((flags == STUCK).any(axis=-1), at.ZENO, told)

    def start_mode(self, mode: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the derived system's mode at the start, of the user's."""
        free = np.zeros(self.count, dtype=np.int64)
        none_due = np.zeros(self.n_due, dtype=np.int64)
        return np.concatenate([free - 1, mode, free, none_due])
