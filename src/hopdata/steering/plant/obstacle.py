"""A board in the hopper's way that it pushes along (dissertation, Sec. 3.5, Fig. 3.7)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.errors import ConfigError
from hopdata.scenes.hopper_drag import HopperDrag
from hopdata.steering.plant.robot import Apex, SteeredHop, SteeredHopper, steer_hop

LANDING_S = 0.2  # from the apex to the first contact


@dataclass(frozen=True, kw_only=True)
class Board:
    """A board across the floor, pushed along its normal and left where it was pushed to.

    It is met while the hopper stands beyond it: in flight the hopper is above it.

    Parameters
    ----------
    direction : (x, y)
        Unit vector, world frame: the way into the board.
    place_m : float
        Where the board is along this direction, from the world's origin, m.
    reach_m : float
        How far ahead of its centre the hopper touches the board, m.
    drag_n : float
        Friction of the board on the floor, N.
    """

    direction: tuple[float, float]
    place_m: float
    reach_m: float = 0.38
    drag_n: float = 4.0

    def __post_init__(self) -> None:
        if not np.isclose(np.hypot(*self.direction), 1.0):
            raise ConfigError(f"obstacle.direction: expected a unit vector, found {self.direction}")

    def met(self, apex: Apex) -> HopperDrag | None:
        """Drag on the hop that begins at this apex: none if it comes down short of the board."""
        coming = apex.state[:2] + LANDING_S * apex.state[6:8]
        if float(coming @ self.direction) + self.reach_m < self.place_m:
            return None
        return HopperDrag(drag_n=self.drag_n, direction=self.direction)

    def pushed(self, hop: SteeredHop) -> Board:
        """Return the board as the hop left it."""
        if hop.stance.fell:
            return self
        front = float(hop.stance.pose[:2] @ self.direction) + self.reach_m
        return replace(self, place_m=max(self.place_m, front))


def steer_past(
    robot: SteeredHopper,
    apex: Apex,
    swing_rad: float,
    board: Board | None,
    *,
    rng: np.random.Generator,
    frame_times_s: ArrayLike = (),
) -> tuple[SteeredHop, Board | None]:
    """Fly one hop, past a board if there is one; return the hop, and the board as it left it.

    For the other parameters see `steer_hop`.
    """
    met = None if board is None else board.met(apex)
    hop = steer_hop(robot, apex, swing_rad, rng=rng, frame_times_s=frame_times_s, variant=met)
    return hop, None if board is None else board.pushed(hop)
