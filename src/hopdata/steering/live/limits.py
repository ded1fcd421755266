"""What the control loop will not go beyond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.errors import ConfigError


@dataclass(frozen=True)
class Limits:
    """What the loop will not go beyond.

    Parameters
    ----------
    pose_age_s : float
        A pose or boom angle older than this is not planned with.
    command_s : float
        A plan that is made later than this after its stance is not sent: the flight that it was
        meant for has begun.
    swing_rad : float
        Largest swing that is sent.
    hop_s : float
        Two stances farther apart than this are not of two hops in a row; the swing between them
        is not known then.

    Raises
    ------
    ConfigError
        If a time is not above 0, or the swing is not one from 0 to half a turn: a limit that is
        not a number, or in degrees, would let every swing through.
    """

    pose_age_s: float = 0.1
    command_s: float = 0.2
    swing_rad: float = 3 * np.pi / 8
    hop_s: float = 1.0

    def __post_init__(self) -> None:
        for name in ("pose_age_s", "command_s", "hop_s"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name}: expected more than 0, found {getattr(self, name)}")
        if not 0 <= self.swing_rad <= np.pi:
            raise ConfigError(f"swing_rad: expected 0 to pi, found {self.swing_rad}")
