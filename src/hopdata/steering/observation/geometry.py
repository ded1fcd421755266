"""Geometry of a hopper, calibrated once and read by live use.

It holds the body markers, the circle of the boom marker, and the heights of a hop.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError, RecordingError, did_you_mean
from hopdata.foreign.texts import json_of
from hopdata.jobs import write_json

FORMAT = "hopper geometry 1"


@dataclass(frozen=True)
class BoomCircle:
    """Circle on which the boom marker moves, in body axes.

    Parameters
    ----------
    centre_m : (3,) array
        Centre relative to the mean of the body markers, m.
    normal : (3,) array
        Unit normal of its plane, pointing up.
    radius_m : float
    """

    centre_m: FloatArray
    normal: FloatArray
    radius_m: float

    @cached_property
    def axes(self) -> FloatArray:
        """Unit vectors in the plane, (2, 3): along the body x axis, then across it."""
        first = np.array([1.0, 0.0, 0.0]) - self.normal[0] * self.normal
        first /= np.linalg.norm(first)
        return np.stack([first, np.cross(self.normal, first)])

    def angles(self, boom: FloatArray) -> FloatArray:
        """Return the boom angle, (...), rad, of the marker (..., 3) in body axes.

        It is zero along the body x axis, counter-clockwise seen from above, and in
        (-pi, pi].
        """
        x, y = np.moveaxis((boom - self.centre_m) @ self.axes.T, -1, 0)
        return np.asarray(np.arctan2(y, x))

    def misses(self, boom: FloatArray) -> FloatArray:
        """Return the distance from the circle, (...), m, of markers (..., 3)."""
        arm = boom - self.centre_m
        across = np.linalg.norm(np.cross(arm, self.normal), axis=-1)
        return np.asarray(np.hypot(across - self.radius_m, arm @ self.normal))


@dataclass(frozen=True)
class HopperGeometry:
    """Geometry of a hopper as the cameras see it, from `calibration.calibrate`.

    Body axes: z up when the hopper is level, x forward, origin at the mean of the body
    markers.

    Parameters
    ----------
    body_names : tuple of str
        Names of the B body markers.
    body_m : (B, 3) array
        Their positions in body axes, m.
    noise_m : float
        Noise of a marker coordinate, estimated from the residuals of a rigid body, m.
    stance_below_m, flight_above_m : float
        Heights of the mean body marker: every stance falls below the first, and every
        flight rises above the second.
    boom_name : str, optional
        Name of the boom marker, if there is one.
    circle : BoomCircle, optional
        Circle on which it moves.
    """

    body_names: tuple[str, ...]
    body_m: FloatArray
    noise_m: float
    stance_below_m: float
    flight_above_m: float
    boom_name: str | None = None
    circle: BoomCircle | None = None

    def body_places(self, markers: Sequence[str]) -> list[int]:
        """Return the indices of the body markers in a stream or a recording.

        Raises
        ------
        AnalysisError
            If one of them is missing.
        """
        return [_place(name, markers) for name in self.body_names]

    def boom_place(self, markers: Sequence[str]) -> int | None:
        """Return the index of the boom marker; None if this hopper has none."""
        if self.boom_name is None:
            return None
        return _place(self.boom_name, markers)

    def save(self, path: str | Path) -> None:
        """Write the geometry as JSON, whole or not at all."""
        write_json(path, {"format": FORMAT, **asdict(self, dict_factory=_plain)})


def load_geometry(path: str | Path) -> HopperGeometry:
    """Read a saved geometry.

    Raises
    ------
    RecordingError
        If the file is missing or holds something else.
    """
    try:
        content = json_of(path, wanted=f"a {FORMAT} as JSON", error=RecordingError)
        if content["format"] != FORMAT:
            raise ValueError(f"its format is {content['format']!r}")
        return _from_json(content)
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        found = f"no {error}" if isinstance(error, KeyError) else error
        raise RecordingError(
            f"{path}: expected a {FORMAT} as JSON, found: {found}"
        ) from None


def _plain(fields_of_one: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields, with arrays as lists."""
    plain = {}
    for name, value in fields_of_one:
        plain[name] = value.tolist() if isinstance(value, np.ndarray) else value
    return plain


def _from_json(content: dict[str, Any]) -> HopperGeometry:
    names = tuple(map(str, content["body_names"]))
    body = np.array(content["body_m"], dtype=float)
    if body.shape != (len(names), 3) or len(names) < 3:
        raise ValueError(f"body_m of shape {body.shape} for {len(names)} body markers")
    circle = content.get("circle")
    return HopperGeometry(
        body_names=names,
        body_m=body,
        noise_m=float(content["noise_m"]),
        stance_below_m=float(content["stance_below_m"]),
        flight_above_m=float(content["flight_above_m"]),
        boom_name=content.get("boom_name"),
        circle=None if circle is None else _circle_from_json(circle),
    )


def _circle_from_json(content: dict[str, Any]) -> BoomCircle:
    return BoomCircle(
        centre_m=np.array(content["centre_m"], float).reshape(3),
        normal=np.array(content["normal"], float).reshape(3),
        radius_m=float(content["radius_m"]),
    )


def _place(name: str, markers: Sequence[str]) -> int:
    if name not in markers:
        found = f"{', '.join(markers)}{did_you_mean(name, markers)}"
        wanted = f"the marker {name!r} of the hopper's geometry"
        raise AnalysisError(f"expected {wanted}, found {found}")
    return list(markers).index(name)


# Heights that separate stances from flights.

#: Percentile of the heights that stands for the lowest points.
#: Unit: %. Origin: chosen.
LOW = 2.0
#: Percentile of the heights that stands for the apexes.
#: Unit: %. Origin: chosen.
HIGH = 90.0
#: Share of the travel between `LOW` and `HIGH` that every stance falls below.
#: Unit: 1. Origin: chosen.
BELOW = 0.35
#: Share of the travel between `LOW` and `HIGH` that every flight rises above.
#: Unit: 1. Origin: chosen.
ABOVE = 0.45


def height_band(height_m: FloatArray) -> tuple[float, float]:
    """Return a height that stances fall below and one that flights rise above, m.

    They are at 35 and 45 % of the travel between low and high heights, (N,), m, NaN
    where unknown. Percentiles hardly depend on how long the hopper is carried about or
    stands still.
    """
    low, high = np.nanpercentile(height_m, [LOW, HIGH])
    travel = high - low
    return float(low + BELOW * travel), float(low + ABOVE * travel)
