"""Robots that ``hopdata drive --robot`` drives: what the live loop needs of each.

A `DrivenRobot` is found by its name: hopdata's own (`ROBOTS`), one that an installed
package brings by an entry point of the group `GROUP`, or MODULE:OBJECT.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pkgutil import resolve_name

from hopdata.errors import ConfigError, did_you_mean, require
from hopdata.foreign.plugins import blamed, name_of, own_code, plugins
from hopdata.foreign.working_folder import require_module, working_folder_last
from hopdata.steering.live.actuator import Actuator, UdpActuator
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import Observers
from hopdata.steering.live.seen_robots import BODY_M, DECIDED_S, LABELS
from hopdata.steering.observation.bodies import (
    NothingShown,
    Shown,
    SpeedShown,
    apex_observers,
    body_of,
)
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.robots.interface import PathRobot
from hopdata.steering.strides import StrideAxes, at_rest

#: Group of the entry points.
GROUP = "hopdata.steering.robots"
#: Robots of hopdata, by the name of ``hopdata drive --robot``.
ROBOTS = {
    "planar-hopper": f"{__name__}:planar_hopper",
    "quadruped": f"{__name__}:quadruped",
}


def _seen_from_apex() -> HopperGeometry:
    """Return the body of the simulated robots, with the noise of its markers."""
    return body_of(LABELS, BODY_M, noise_m=6e-4)


@dataclass(frozen=True, kw_only=True)
class DrivenRobot:
    """What a drive needs of a robot beside its cameras.

    Parameters
    ----------
    axes : StrideAxes
        States and inputs of the robot.
    shown : callable
        Given the frame rate, Hz, returns what measures the states; by default no state
        is measured, and each is set by an input.
    geometry : HopperGeometry
        Markers of the body, as of `body_of`; by default those of the simulated robots.
    limits : Limits
        Of these, `command_s` must end before the robot uses its inputs.
    actuator : callable, optional
        Given what follows ``--boom``, returns the actuator; by default `UdpActuator`.
    simulated : callable, optional
        Returns a simulation of the robot. Without one it can be neither simulated nor
        rehearsed.
    """

    axes: StrideAxes
    shown: Callable[[float], Shown] | None = None
    geometry: HopperGeometry = field(default_factory=_seen_from_apex)
    limits: Limits = field(default_factory=Limits)
    actuator: Callable[[str], Actuator] | None = None
    simulated: Callable[[], PathRobot] | None = None

    def observers(self, geometry: HopperGeometry, rate_hz: float) -> Observers:
        """Return a maker of tracker and stance detector."""

        def new_shown() -> Shown:
            if self.shown is None:
                return NothingShown(len(self.axes.states))
            return self.shown(rate_hz)

        return apex_observers(geometry, rate_hz, new_shown)

    def actuator_at(self, address: str) -> Actuator:
        """Return the actuator at what follows ``--boom``."""
        if self.actuator is not None:
            return self.actuator(address)
        host, _, port = address.rpartition(":")
        require(port.isdecimal(), "--boom", "HOST:PORT", repr(address))
        rest = tuple(at_rest(self.axes).tolist())
        return UdpActuator(int(port), host=host, rest=rest)

    def simulation(self) -> PathRobot:
        """Return a simulation of the robot.

        Raises
        ------
        ConfigError
            If it has none, or one that does not tell its path.
        """
        if self.simulated is None:
            wanted = "a robot with a simulation, or --host"
            raise ConfigError.at("--robot", wanted, "one without")
        made = self.simulated()
        missing = [name for name in ("release", "path") if not hasattr(made, name)]
        if missing:
            wanted = "a simulation with release and path, as cameras need (PathRobot)"
            found = f"{type(made).__name__} without {' and '.join(missing)}"
            raise ConfigError.at("--robot", wanted, found)
        return made


def driven_robot(name: str, *, by_user: bool = True) -> DrivenRobot:
    """Return a robot by its name.

    Parameters
    ----------
    name : str
        A name of `ROBOTS` or of an installed package, or MODULE:OBJECT, with a module
        that is installed or a file of the working folder. The object is a
        `DrivenRobot`, or returns one.
    by_user : bool
        Whether the user has given the name. A file, such as a log, may name any module,
        whose code must not be run for that.

    Raises
    ------
    ConfigError
        If there is none of this name, or it is something else.
    """
    if ":" in name:
        wanted = f"--robot {name} in the command, since no log may run code by itself"
        require(by_user, "robot", wanted, "the name in the log alone")
        with working_folder_last():
            require_module(name.partition(":")[0], "--robot")
            return _checked(name, name)
    brought = plugins(GROUP, "robot", ROBOTS)
    if name in brought:
        return _checked(brought[name].value, name_of("robot", brought[name]))
    if name not in ROBOTS:
        known = [*ROBOTS, *brought]
        wanted = f"one of {', '.join(known)}, or MODULE:OBJECT"
        found = f"{name!r}{did_you_mean(name, known)}"
        raise ConfigError.at("--robot", wanted, found)
    return _checked(ROBOTS[name], name)


def _checked(place: str, said: str) -> DrivenRobot:
    """Return the robot at a place, or that a function there returns."""
    # A name MODULE:OBJECT is the user's own.
    told = own_code(said, "--robot") if said == place else blamed(said, "--robot")
    with told:
        found = resolve_name(place)
        if callable(found) and not isinstance(found, DrivenRobot):
            found = found()
    is_robot = isinstance(found, DrivenRobot)
    kind = f"{place} is of type {type(found).__name__}"
    wanted = "a hopdata.steering.live.robots.DrivenRobot, or what returns one"
    require(is_robot, "--robot", wanted, kind)
    robot: DrivenRobot = found
    return robot


def planar_hopper() -> DrivenRobot:
    """Return the planar hopper, whose speed its cameras see."""
    from hopdata.steering.robots.planar_hopper import PlanarHopper

    return DrivenRobot(
        axes=PlanarHopper.axes,
        shown=SpeedShown,
        limits=Limits(command_s=DECIDED_S),
        simulated=PlanarHopper,
    )


def quadruped() -> DrivenRobot:
    """Return the quadruped, whose state is the difference that was sent last."""
    from hopdata.steering.robots.quadruped import SteeredQuadruped

    return DrivenRobot(
        axes=SteeredQuadruped.axes,
        limits=Limits(command_s=DECIDED_S),
        simulated=SteeredQuadruped,
    )
