"""The true frame change of the simulated hopper, on a grid, without chance.

A hop depends on more than boom angle and swing: what is left of the last hop's motion goes on.
So the map is that of a hopper that has settled with the boom at rest, has made one swing since,
and makes the next; averaged over that one swing it is a function of boom angle and swing alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.steering.plant.robot import Apex, SteeredHop, SteeredHopper, released, steer_hop
from hopdata.steering.se2 import relative

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TrueFrameChanges:
    """True frame changes on a grid.

    Parameters
    ----------
    boom_angle_rad : (A,) array
        Boom angle at the first stance, evenly spaced over a turn, 2 pi left out.
    swing_rad, previous_swing_rad : (S,) and (P,) arrays
        Swing between the stances, and the one before.
    change : (A, S, P, 3) array
        Frame change from stance to stance, in the frame of the first; m, m, rad.
    """

    boom_angle_rad: FloatArray
    swing_rad: FloatArray
    previous_swing_rad: FloatArray
    change: FloatArray

    def average(self) -> FloatArray:
        """Mean over the previous swing, (A, S, 3)."""
        return np.asarray(self.change.mean(axis=2))


@one_blas_thread()
def true_frame_changes(
    robot: SteeredHopper,
    *,
    boom_angles: int = 24,
    swings: int = 7,
    settling_hops: int = 10,
) -> TrueFrameChanges:
    """Measure the frame changes of a hopper that nothing disturbs.

    Parameters
    ----------
    robot : SteeredHopper
        Its kicks are left out.
    boom_angles, swings : int
        Number of boom angles over a turn, and of swings from limit to limit (also of previous
        ones).
    settling_hops : int
        Hops with the boom at rest that come before.

    Raises
    ------
    AnalysisError
        If the hopper falls.
    """
    angles = 2 * np.pi * np.arange(boom_angles) / boom_angles
    grid = np.linspace(-robot.swing_limit_rad, robot.swing_limit_rad, swings)
    still = robot.still()
    changes = [_at_angle(still, grid, settling_hops, angle) for angle in angles]
    return TrueFrameChanges(angles, grid, grid, np.array(changes))


def _at_angle(
    robot: SteeredHopper, grid: FloatArray, settling_hops: int, boom_angle_rad: float
) -> FloatArray:
    """Frame changes (S, P, 3) from one boom angle."""
    changes = np.empty((len(grid), len(grid), 3))
    for p, previous in enumerate(grid):
        apex = _settled(robot, boom_angle_rad - previous, settling_hops)
        before = _whole(robot, apex, previous)
        for s, swing in enumerate(grid):
            after = _whole(robot, before.end, swing)
            changes[s, p] = relative(before.stance.pose, after.stance.pose)
    return changes


def _settled(robot: SteeredHopper, boom_angle_rad: float, hops: int) -> Apex:
    apex = released(robot, np.zeros(3), boom_angle_rad)
    for _ in range(hops):
        apex = _whole(robot, apex, 0.0).end
    return apex


def _whole(robot: SteeredHopper, apex: Apex, swing_rad: float) -> SteeredHop:
    hop = steer_hop(robot, apex, swing_rad, rng=np.random.default_rng(0))
    if hop.stance.fell:
        raise AnalysisError(
            f"true map: expected a hopper that does not fall, found one that did after a swing of "
            f"{swing_rad:.2f} rad from {apex.boom_angle_rad:.2f} rad: {hop.hop.ending}"
        )
    return hop
