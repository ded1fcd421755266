"""Frame changes: how a hop changes the pose, by boom angle and swing (Sec. 3.4.2)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import FloatArray, IntArray, pd
from hopdata.errors import RecordingError
from hopdata.rigid import relative, wrapped

TextArray = NDArray[np.str_]

USED = ""
NO_POSE = "pose missing"
NO_BOOM = "boom angle missing"
FAR_SWING = "swing beyond the limit"
TILTED = "tilted in a stance"

#: How far a swing may be beyond the limit; farther, the boom angle must be wrong.
#: Unit: rad. Origin: derived: ten times the error of a boom angle.
SWING_MARGIN_RAD = 0.05
#: Largest tilt in a stance of a hop that is used.
#: Unit: rad. Origin: measured: the simulated hopper leans by less than 5 degrees in its
#: stances. If it is kicked until 3 to 12 % of its stances are not on all feet, it leans
#: by more than 20 degrees in 82 % of those, and in at most 0.8 % of the others.
UPRIGHT_RAD = np.deg2rad(20)


@dataclass(frozen=True)
class StanceStates:
    """States of K stances.

    Parameters
    ----------
    time_s : (K,) array
    pose : (K, 3) array
        x m, y m, unwrapped heading rad; NaN where unknown.
    boom_angle_rad : (K,) array
        Unwrapped, rad; NaN where unknown.
    pairs : (P, 2) array of int
        Pairs of stances that are one hop apart.
    tilt_rad : (K,) array
        Tilt of the body at the stance, rad; NaN where unknown.
    """

    time_s: FloatArray
    pose: FloatArray
    boom_angle_rad: FloatArray
    pairs: IntArray
    tilt_rad: FloatArray


@dataclass(frozen=True)
class FrameChanges:
    """Hops between consecutive stances, one hop per row.

    Parameters
    ----------
    recording : (n,) str array
        Recording the hop belongs to.
    time_s : (n,) array
        Time of the first stance.
    boom_angle_rad : (n,) array
        Boom angle at the first stance, in [0, 2 pi).
    swing_rad : (n,) array
        Swing from the first stance to the second.
    change : (n, 3) array
        Pose at the second stance in the frame of the first: x m, y m, heading rad.
    reason : (n,) str array
        Why the hop is not used; empty if it is.
    """

    recording: TextArray
    time_s: FloatArray
    boom_angle_rad: FloatArray
    swing_rad: FloatArray
    change: FloatArray
    reason: TextArray

    def __len__(self) -> int:
        return len(self.time_s)

    def rows(self, chosen: ArrayLike) -> FrameChanges:
        """Return some of the hops, chosen by number or by a boolean for each."""
        picked = np.asarray(chosen)
        return FrameChanges(*(column[picked] for column in vars(self).values()))

    def used(self) -> FrameChanges:
        """Return the hops that are used."""
        return self.rows(self.reason == USED)

    def excluded(self) -> dict[str, int]:
        """Return how many hops are not used, by reason."""
        reasons = self.reason[self.reason != USED].tolist()
        return dict(sorted(Counter(reasons).items()))


def frame_changes(
    stances: StanceStates, *, swing_limit_rad: float, recording: str = ""
) -> FrameChanges:
    """Collect the frame changes between stances.

    Parameters
    ----------
    stances : StanceStates
        A hop from or to a stance tilted by more than `UPRIGHT_RAD` is not used, since
        the robot is tipping over.
    swing_limit_rad : float
        Largest commanded swing, below pi. A swing that exceeds it by more than
        `SWING_MARGIN_RAD` is taken for an error of the boom angle, and its hop is not
        used.
    recording : str
        Name of the recording.

    Returns
    -------
    FrameChanges
        One row for each pair, used or not.
    """
    booms = stances.boom_angle_rad
    leans = stances.tilt_rad > UPRIGHT_RAD
    first, second = stances.pairs.T
    swing = np.asarray(wrapped(booms[second] - booms[first]))
    change = relative(stances.pose[first], stances.pose[second])
    # Of several reasons the last one stays.
    reason = np.full(len(first), USED, dtype="<U32")
    reason[np.abs(swing) > swing_limit_rad + SWING_MARGIN_RAD] = FAR_SWING
    reason[np.isnan(swing)] = NO_BOOM
    reason[leans[first] | leans[second]] = TILTED
    reason[np.isnan(change).any(axis=1)] = NO_POSE
    return FrameChanges(
        recording=np.full(len(first), recording),
        time_s=stances.time_s[first],
        boom_angle_rad=booms[first] % (2 * np.pi),
        swing_rad=swing,
        change=change,
        reason=reason,
    )


def joined(parts: Iterable[FrameChanges]) -> FrameChanges:
    """Return the hops of several recordings as one table."""
    tables = [vars(part) for part in parts]
    columns = {
        field.name: np.concatenate([table[field.name] for table in tables])
        for field in fields(FrameChanges)
    }
    return FrameChanges(**columns)


# Tables of frame changes: one hop per row, with the unit in the name of each column.

CHANGE = ["dx_m", "dy_m", "dtheta_rad"]
COLUMNS = ["recording", "time_s", "boom_angle_rad", "swing_rad", *CHANGE, "reason"]


def to_table(changes: FrameChanges) -> pd.DataFrame:
    """Return the hops as a table with the unit in each column's name."""
    columns = dict(vars(changes))
    for name, component in zip(CHANGE, changes.change.T, strict=True):
        columns[name] = component
    return pd.DataFrame({name: columns[name] for name in COLUMNS})


def from_table(table: pd.DataFrame) -> FrameChanges:
    """Return the hops of a table that `to_table` made.

    Raises
    ------
    RecordingError
        If a column is missing.
    """
    missing = ", ".join(name for name in COLUMNS if name not in table)
    if missing:
        wanted = f"the columns {', '.join(COLUMNS)}"
        raise RecordingError(f"frame changes: expected {wanted}, missing {missing}")
    return FrameChanges(
        recording=table["recording"].to_numpy(dtype=str),
        time_s=table["time_s"].to_numpy(dtype=float),
        boom_angle_rad=table["boom_angle_rad"].to_numpy(dtype=float),
        swing_rad=table["swing_rad"].to_numpy(dtype=float),
        change=table[CHANGE].to_numpy(dtype=float),
        reason=table["reason"].to_numpy(dtype=str),
    )
