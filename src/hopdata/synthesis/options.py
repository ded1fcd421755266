"""Options of a synthetic recording, as they stand in the configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar

from hopdata.errors import ConfigError, did_you_mean

Options = TypeVar("Options")
Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Kicks:
    """Random disturbance at each apex, each normal with mean zero and this standard deviation.

    Parameters
    ----------
    velocity_m_s : float
        Added to each component of the velocity.
    angular_velocity_rad_s : float
        Added to each component of the angular velocity.
    preload_fraction : float
        Relative change of each leg's preload, drawn anew for every hop.
    """

    velocity_m_s: float = 0.05
    angular_velocity_rad_s: float = 0.25
    preload_fraction: float = 0.05


@dataclass(frozen=True, kw_only=True)
class Operator:
    """The person who releases the hopper, and carries it back when it has strayed or fallen.

    Parameters
    ----------
    release_height_m : float
        Height of the feet above the floor at which the hopper is let go, at rest and level.
    release_spread_m : float
        It is let go within this distance of the centre, in x and in y.
    arena_m : float
        The hopper is carried back at the first apex farther than this from the centre, in x or y.
    carry_s : float
        How long that takes.
    hop_limit_s : float
        Time without an apex after which it has fallen.
    """

    release_height_m: float = 0.24
    release_spread_m: float = 0.1
    arena_m: float = 0.9
    carry_s: float = 1.5
    hop_limit_s: float = 3.0


@dataclass(frozen=True, kw_only=True)
class FloorOptions:
    """Curvature of the measured floor: a bowl and a few waves of random direction and phase.

    Parameters
    ----------
    bowl_depth_m, bowl_radius_m : float
        Rise of the bowl far from the centre, and the distance at which half of it is reached.
    waves : int
        Number of waves.
    wave_amplitude_m, wave_length_m : float
        Amplitude of each wave, and the shortest wave length; the longest is 1.5 times that.
    """

    bowl_depth_m: float = 0.004
    bowl_radius_m: float = 1.2
    waves: int = 3
    wave_amplitude_m: float = 0.001
    wave_length_m: float = 2.4


@dataclass(frozen=True, kw_only=True)
class GapOptions:
    """Drop-outs: stretches of frames in which a marker is not seen.

    Parameters
    ----------
    rate_per_min : float
        Mean number of drop-outs of each marker per minute; 0 for none.
    mean_s : float
        Mean length of a drop-out (geometric distribution, at least one frame).
    """

    rate_per_min: float = 0.0
    mean_s: float = 0.08


@dataclass(frozen=True, kw_only=True)
class MarkerOptions:
    """Where the markers are glued, and how fast a leg draws back after lift-off.

    Parameters
    ----------
    body_m : tuple of (x, y, z)
        Body markers, body frame.
    boom_m : (x, y, z)
        Boom marker relative to the counterweight, body axes.
    retraction_s : float
        Time in which a leg extended at lift-off comes back to its rest length.
    """

    body_m: tuple[Point, ...] = ((0.13, 0.03, 0.05), (-0.08, 0.11, 0.075), (-0.07, -0.14, 0.055))
    boom_m: Point = (0.0, 0.0, 0.0)
    retraction_s: float = 0.15


def from_mapping(kind: type[Options], values: Mapping[str, Any] | None, where: str) -> Options:
    """Build options from a mapping of some of their fields; the others keep their defaults.

    Raises
    ------
    ConfigError
        If a key is not a field of `kind`.
    """
    names = [f.name for f in fields(kind)]  # type: ignore[arg-type]
    for key in values or {}:
        if key not in names:
            raise ConfigError(f"{where}.{key}: no such key{did_you_mean(key, names)}")
    return kind(**{key: _frozen(value) for key, value in (values or {}).items()})


def require(holds: bool, key: str, expected: str, found: Any) -> None:
    """Raise a ConfigError that names the key, unless the condition holds."""
    if not holds:
        raise ConfigError(f"{key}: expected {expected}, found {found}")


def _frozen(value: Any) -> Any:
    return tuple(_frozen(v) for v in value) if isinstance(value, list | tuple) else value
