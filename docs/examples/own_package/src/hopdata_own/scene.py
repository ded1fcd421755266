"""A scene that is simulated as motion capture would see it."""

from dataclasses import dataclass

from hopdata.scenes.quadruped import Quadruped


@dataclass(frozen=True)
class StiffQuadruped(Quadruped):
    """The quadruped on legs that are stiffer aside by half."""

    side_stiffness_n_m: float = 90.0
