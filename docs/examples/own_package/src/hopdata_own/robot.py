"""A robot that `hopdata drive --robot heavy-hopper` steers, here a simulated one."""

from hopdata.steering.live.limits import Limits
from hopdata.steering.live.robots import DrivenRobot
from hopdata.steering.observation.bodies import SpeedShown
from hopdata.steering.robots.planar_hopper import PlanarHopper


def simulation():
    """Return the bundled planar hopper with 0.2 kg more."""
    return PlanarHopper(mass_kg=2.9)


heavy_hopper = DrivenRobot(
    axes=PlanarHopper.axes,
    shown=SpeedShown,
    limits=Limits(command_s=0.12),
    simulated=simulation,
)
