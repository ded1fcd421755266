"""How the simulated robot turns: sustained turns, its turning radius, and its drift.

In a sustained turn the boom swings by the same angle in each hop. The body turns the
other way. With the boom at rest, what is left is the drift (Sec. 3.4.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.errors import AnalysisError
from hopdata.steering import robot as plant

#: Hops before a turn is measured, in which the gait settles.
#: Unit: 1. Origin: chosen.
SETTLING_HOPS = 6


@dataclass(frozen=True)
class SustainedTurn:
    """A turn with the same swing in each hop.

    Parameters
    ----------
    swing_rad : float
        Swing in each hop; positive is counter-clockwise.
    turn_rad : float
        Mean turn of the heading in one hop; positive is counter-clockwise.
    step_m : float
        Mean distance between neighbouring stances.
    """

    swing_rad: float
    turn_rad: float
    step_m: float

    @property
    def radius_m(self) -> float:
        """Turning radius: distance per turned radian."""
        return float(self.step_m / abs(self.turn_rad))


def sustained_turn(
    robot: plant.SteeredHopper, swing_rad: float, *, seed: int = 0, hops: int = 40
) -> SustainedTurn:
    """Let the robot swing its boom by the same angle in each hop.

    Parameters
    ----------
    robot : SteeredHopper
    swing_rad : float
        Clipped to the limit of the robot.
    seed : int
        Seed of the kicks.
    hops : int
        Hops that are measured, after `SETTLING_HOPS`.

    Raises
    ------
    AnalysisError
        If the robot falls.
    """
    rng = np.random.default_rng(seed)
    apex = plant.released(robot, np.zeros(3))
    poses = []
    for _ in range(SETTLING_HOPS + hops + 1):
        hop = plant.steer_hop(robot, apex, swing_rad, rng=rng)
        if hop.stance.fell:
            raise AnalysisError.at("turn", "a robot that hops on", hop.hop.ending)
        poses.append(hop.stance.pose)
        apex = hop.end
    measured = np.array(poses[SETTLING_HOPS:])
    steps = np.diff(measured, axis=0)
    return SustainedTurn(
        swing_rad=hop.swing_rad,
        turn_rad=float(steps[:, 2].mean()),
        step_m=float(np.hypot(steps[:, 0], steps[:, 1]).mean()),
    )


@dataclass(frozen=True)
class Falls:
    """Hops with swings of one size to either side: how many, and how many fell."""

    swing_rad: float
    hops: int
    fell: int

    @property
    def share(self) -> float:
        """Share of the hops that ended in a fall."""
        return self.fell / self.hops


def falls_by_swing(
    robot: plant.SteeredHopper, swing_rad: float, *, seed: int = 0, hops: int = 40
) -> Falls:
    """Let the robot swing by this angle to a random side in each hop, and count falls.

    After a fall it is released anew.

    Parameters
    ----------
    robot : SteeredHopper
        Its `swing_limit_rad` cuts the swings.
    swing_rad : float
    seed : int
        Seed of sides and kicks.
    hops : int
    """
    rng = np.random.default_rng(seed)
    apex = plant.released(robot, np.zeros(3))
    n_fell = 0
    for _ in range(hops):
        side = rng.choice([-1.0, 1.0])
        hop = plant.steer_hop(robot, apex, side * swing_rad, rng=rng)
        apex = hop.end
        if hop.stance.fell:
            n_fell += 1
            apex = plant.released(robot, np.zeros(3))
    return Falls(swing_rad=abs(hop.swing_rad), hops=hops, fell=n_fell)
