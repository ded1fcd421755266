"""The hopper's frame changes: how a hop changes the pose (Sec. 3.4.2).

Its hops are strides whose state is the boom angle and whose input is the swing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray, pd
from hopdata.rigid import relative, wrapped
from hopdata.steering import strides
from hopdata.steering.strides import (
    NO_POSE,
    TURN,
    USED,
    Input,
    State,
    StrideAxes,
    Strides,
    TextArray,
)

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


def hopper_axes(swing_limit_rad: float = np.pi) -> StrideAxes:
    """Return the axes of the steered hopper: boom angle and swing.

    Parameters
    ----------
    swing_limit_rad : float
        Largest swing; by default the largest that a change of the boom angle can show.
    """
    swing = Input(name="swing", lower=-swing_limit_rad, upper=swing_limit_rad)
    boom_angle = State(name="boom_angle", moved_by=swing.name)
    return StrideAxes(periodic=(boom_angle,), inputs=(swing,))


HOPPER = hopper_axes()


def is_hopper(axes: StrideAxes) -> bool:
    """Tell whether these are axes of the steered hopper, with whatever limit."""
    return axes.input_names == HOPPER.input_names


class FrameChanges(Strides):
    """Strides of the steered hopper: its hops, made by `hops` or `frame_changes`."""

    @property
    def boom_angle_rad(self) -> FloatArray:
        """Boom angle at the first stance, in [0, 2 pi), (n,)."""
        return self.state[:, 0]

    @property
    def swing_rad(self) -> FloatArray:
        """Swing from the first stance to the second, (n,)."""
        return self.inputs[:, 0]

    @classmethod
    def hops(
        cls,
        *,
        recording: TextArray,
        time_s: FloatArray,
        boom_angle_rad: FloatArray,
        swing_rad: FloatArray,
        change: FloatArray,
        reason: TextArray,
        axes: StrideAxes = HOPPER,
    ) -> FrameChanges:
        """Return hops by their columns; see `Strides`."""
        return cls(
            axes=axes,
            recording=recording,
            time_s=time_s,
            state=boom_angle_rad[:, None],
            inputs=swing_rad[:, None],
            change=change,
            next_state=axes.next_state(boom_angle_rad, swing_rad),
            reason=reason,
        )


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
    return FrameChanges.hops(
        recording=np.full(len(first), recording),
        time_s=stances.time_s[first],
        boom_angle_rad=booms[first] % TURN,
        swing_rad=swing,
        change=change,
        reason=reason,
        axes=hopper_axes(swing_limit_rad),
    )


def from_table(table: pd.DataFrame) -> FrameChanges:
    """Return the hops of a table that `hopdata.steering.strides.to_table` made.

    Raises
    ------
    RecordingError
        If a column is missing.
    """
    return FrameChanges(**vars(strides.from_table(table, HOPPER)))
