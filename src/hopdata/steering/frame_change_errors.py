"""Measured frame changes against those that truly happened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.steering.frame_changes import FrameChanges
from hopdata.steering.se2 import wrapped

FloatArray = NDArray[np.float64]

SAME_STANCE_S = 0.1  # a sixth of a hop


@dataclass(frozen=True)
class FrameChangeErrors:
    """Errors of the hops that were found.

    Parameters
    ----------
    boom_angle_rad, swing_rad : (n,) arrays
        Measured less true.
    change : (n, 3) array
        Likewise, m, m, rad.
    missed, invented : int
        True hops without a measured one, and measured ones without a true one.
    """

    boom_angle_rad: FloatArray
    swing_rad: FloatArray
    change: FloatArray
    missed: int
    invented: int

    def rms(self) -> dict[str, float]:
        """Return root mean square errors by name, with the unit in it."""
        columns = {
            "boom_angle_rad": self.boom_angle_rad,
            "swing_rad": self.swing_rad,
            **dict(zip(("dx_m", "dy_m", "dtheta_rad"), self.change.T, strict=True)),
        }
        return {name: float(np.sqrt(np.mean(error**2))) for name, error in columns.items()}


def frame_change_errors(measured: FrameChanges, true: FrameChanges) -> FrameChangeErrors:
    """Compare the used hops of a recording with the true ones.

    Parameters
    ----------
    measured, true : FrameChanges
        Of one recording, in order of time; hops whose first stances are within `SAME_STANCE_S` of
        each other are the same.
    """
    seen, real = measured.used(), true.used()
    if not len(seen) or not len(real):
        empty = np.zeros(0)
        return FrameChangeErrors(empty, empty, np.zeros((0, 3)), len(real), len(seen))
    nearest = np.abs(seen.time_s[:, None] - real.time_s).argmin(axis=1)
    matched = np.abs(seen.time_s - real.time_s[nearest]) <= SAME_STANCE_S
    _, first = np.unique(nearest[matched], return_index=True)
    found = np.flatnonzero(matched)[first]
    a, b = seen.rows(found), real.rows(nearest[found])
    change = a.change - b.change
    change[:, 2] = wrapped(change[:, 2])
    return FrameChangeErrors(
        boom_angle_rad=wrapped(a.boom_angle_rad - b.boom_angle_rad),
        swing_rad=wrapped(a.swing_rad - b.swing_rad),
        change=change,
        missed=len(real) - len(found),
        invented=len(seen) - len(found),
    )
