"""C3D files with force plates of types 1 to 4, under a known force at a known place."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from written_files import Analog, write_c3d

from hopdata.recordings.raw import RawRecording

# Two plates side by side in a laboratory in which z is up, mm: corners in the order of
# the format, so that the plates' z points down. The second is turned by a right angle.
CORNERS = np.array(
    [
        [[400.0, 0, 0], [0, 0, 0], [0, 600, 0], [400, 600, 0]],
        [[1000.0, 600, 3], [1000, 0, 3], [500, 0, 3], [500, 600, 3]],
    ]
)
# From the plates' origins to their surfaces, along their own axes, mm.
ORIGIN = np.array([[1.5, -2.0, -40.0], [-0.5, 3.0, -25.0]])
SENSORS = np.array([[150.0, 250.0, -45.0], [180.0, 220.0, -52.0]])

MATRIX = np.diag([1.5, 1.4, 3.0, 800.0, 700.0, 500.0])
MATRIX[0, 2] = 0.02
MATRIX[2, 1] = -0.03
MATRIX[4, 0] = 12.0


@dataclass(frozen=True)
class Stance:
    """What acts on the subject at each sample of a plate.

    Parameters
    ----------
    force : (K, 3) array
        N, z up.
    place : (K, 3) array
        Where it acts, mm; on the plate's surface.
    free_moment : (K,) array
        About the vertical, N mm.
    """

    force: NDArray[np.float64]
    place: NDArray[np.float64]
    free_moment: NDArray[np.float64]


def own_axes(plate: int) -> NDArray[np.float64]:
    """Return the axes (3, 3) of a plate as rows."""
    x = CORNERS[plate, 0] - CORNERS[plate, 1]
    y = CORNERS[plate, 0] - CORNERS[plate, 3]
    x = x / np.linalg.norm(x)
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def wrench(plate: int, stance: Stance) -> tuple[NDArray[Any], ...]:
    """Return force, place and moment about the surface's middle in the plate's axes."""
    axes = own_axes(plate)
    force = stance.force @ axes.T
    place = (stance.place - CORNERS[plate].mean(axis=0)) @ axes.T
    moment = np.cross(place, force)
    moment[:, 2] -= stance.free_moment  # the plate's z is down
    return force, place, moment


def channels(kind: int, plate: int, stance: Stance) -> NDArray[np.float64]:
    """Return what the channels of a plate of a type show, in N and N mm."""
    force, place, moment = wrench(plate, stance)
    if kind == 1:
        return np.column_stack([force, place[:, :2], -stance.free_moment])
    if kind == 3:
        return _of_sensors(plate, force, moment)
    # The moments are about the plate's origin, from which the middle is at ORIGIN.
    about_origin = moment + np.cross(ORIGIN[plate], force)
    both = np.column_stack([force, about_origin])
    if kind == 4:
        return np.linalg.solve(MATRIX, both.T).T
    return both


def _of_sensors(
    plate: int, force: NDArray[Any], moment: NDArray[Any]
) -> NDArray[np.float64]:
    """Return the eight sums of four sensors, at (a, b), (-a, b), (-a, -b), (a, -b)."""
    a, b, z = SENSORS[plate]
    # About the middle of the sensors, which lies |z| below the surface.
    about = moment + np.cross(np.array([0.0, 0.0, z]), force)
    mean = force[:, 2] / 4
    by_x = about[:, 0] / (4 * b)
    by_y = about[:, 1] / (4 * a)
    vertical = [mean + by_x - by_y, mean + by_x + by_y]
    vertical += [mean - by_x + by_y, mean - by_x - by_y]
    turn = about[:, 2] / 2  # half of it by the x forces, half by the y forces
    along_x = [force[:, 0] / 2 - turn / (2 * b), force[:, 0] / 2 + turn / (2 * b)]
    along_y = [force[:, 1] / 2 + turn / (2 * a), force[:, 1] / 2 - turn / (2 * a)]
    return np.column_stack([*along_x, *along_y, *vertical])


UNITS = {
    1: ["N", "N", "N", "mm", "mm", "Nmm"],
    2: ["N", "N", "N", "Nmm", "Nmm", "Nmm"],
    3: ["N"] * 8,
    4: ["V"] * 6,
}


@dataclass(frozen=True)
class PlateFile:
    """How a file with plates is written."""

    kind: int
    processor: str = "Intel"
    whole_numbers: bool = False
    is_unsigned: bool = False
    general_scale: float = 1.0
    sign: float = 1.0
    origin_sign: float = 1.0
    units: list[str] | None = None
    group: dict[str, Any] = field(default_factory=dict)


def write_plates(
    path: Any, raw: RawRecording, stances: list[Stance], how: PlateFile
) -> None:
    """Write a recording with a stance on each of its plates."""
    n_frames = len(raw.time)
    per_frame = len(stances[0].force) // n_frames
    kind = how.kind
    values = np.hstack(
        [how.sign * channels(kind, k, stance) for k, stance in enumerate(stances)]
    )
    if kind == 1:
        for k in range(len(stances)):  # a place has no sign to turn
            values[:, 6 * k + 3 : 6 * k + 5] *= how.sign
    n = values.shape[1] // len(stances)
    of_one = how.units or UNITS[kind]
    scale = np.full(values.shape[1], 0.01)
    if how.whole_numbers:
        scale = np.abs(values).max(axis=0).clip(1e-3) / (20_000 * how.general_scale)
    offset = np.full(values.shape[1], 32768.0 if how.is_unsigned else 17.0)
    numbers = np.arange(1, values.shape[1] + 1).reshape(len(stances), n)
    origin = SENSORS if kind == 3 else how.origin_sign * ORIGIN
    group = {
        "USED": len(stances),
        "TYPE": np.full(len(stances), kind),
        "CORNERS": CORNERS[: len(stances)],
        "ORIGIN": origin[: len(stances)],
        "CHANNEL": numbers,
        "ZERO": np.array([1, 10]),
    }
    if kind == 4:
        group["CAL_MATRIX"] = np.stack([MATRIX.T] * len(stances))
    analog = Analog(
        names=[
            f"{name}{k + 1}" for k in range(len(stances)) for name in "abcdefgh"[:n]
        ],
        units=of_one * len(stances),
        values=values.reshape(n_frames, per_frame, -1),
        scale=scale,
        offset=offset,
        general_scale=how.general_scale,
        is_unsigned=how.is_unsigned,
        groups={"FORCE_PLATFORM": group | how.group},
    )
    write_c3d(
        path,
        raw,
        whole_numbers=how.whole_numbers,
        processor=how.processor,
        analog=analog,
    )
