"""Limits of the control loop: ages, times, swings, and the arena."""

from dataclasses import dataclass

import numpy as np

from hopdata.errors import require
from hopdata.steering.goals import FENCE_M, SWING_LIMIT_RAD


@dataclass(frozen=True)
class Limits:
    """Limits of the control loop.

    Parameters
    ----------
    pose_age_s : float
        Largest age of a pose or boom angle used for planning. If there is no frame for
        this long, the boom is brought to rest.
    command_s : float
        Latest time after its stance at which a plan is sent: after that, the flight it
        was made for has begun.
    swing_rad : float
        Largest swing that is sent.
    hop_s : float
        Longest time between two stances that are taken for consecutive; if it is
        longer, the swing between them is unknown.
    fence_m : float
        The drive ends when the hopper is farther than this from the world's origin.
    tilt_rad : float
        The drive ends when the hopper leans by more; in normal hops it leans by a tenth
        of this.
    wrong_swings : int
        The drive ends after so many hops in a row whose swing, as measured, is not the
        one that was sent. A single one may have been sent too late for its flight.
    alive_s : float
        Time between two heartbeats to a boom that answers them.
    heard_s : float
        Longest time for a heartbeat to be answered; after that, the boom rests.

    Raises
    ------
    ConfigError
        If a time or the fence is not above 0, swing or tilt is not from 0 to pi, or
        `wrong_swings` is below 1. A limit that is not a number, or is in degrees, would
        let every swing or tilt pass.
    """

    pose_age_s: float = 0.1
    command_s: float = 0.2
    swing_rad: float = SWING_LIMIT_RAD
    hop_s: float = 1.0
    fence_m: float = FENCE_M
    tilt_rad: float = np.pi / 4
    wrong_swings: int = 2
    alive_s: float = 0.02
    heard_s: float = 0.2

    def __post_init__(self) -> None:
        times = ("pose_age_s", "command_s", "hop_s", "alive_s", "heard_s")
        for name in (*times, "fence_m"):
            value = getattr(self, name)
            require(value > 0, name, "more than 0", value)
        for name in ("swing_rad", "tilt_rad"):
            angle = getattr(self, name)
            require(0 <= angle <= np.pi, name, "0 to pi", angle)
        require(self.wrong_swings >= 1, "wrong_swings", "1 or more", self.wrong_swings)
