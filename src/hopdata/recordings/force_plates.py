"""Force plates of a recording's file: forces and centres of pressure, z up.

A plate's own axes point along its sides and into the floor. Its corners tell how it
lies in the laboratory (C3D user guide, c3d.org). Forces are those of the plate on the
subject, so the vertical force of a stance is positive.

No baseline is subtracted: ``FORCE_PLATFORM:ZERO`` often names frames in which somebody
stands on the plate. `landings.plate_contacts` measures what an unloaded plate shows.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.external import FORCE_UNIT_SPELLINGS, NEWTONS_PER_UNIT
from hopdata.recordings.quality.orientation import choose_unit
from hopdata.recordings.raw import METRES_PER_UNIT
from hopdata.recordings.readers import c3d_plates
from hopdata.recordings.readers.c3d_plates import StoredPlate
from hopdata.recordings.readers.formats import read_raw

#: Share of a plate's largest vertical force from which its centre of pressure is used
#: to judge the unit of its moments.
#: Unit: 1. Origin: chosen.
WELL_LOADED = 0.5

#: Half widths of a plate within which its centre of pressure counts as on it.
#: Unit: 1. Origin: chosen: a unit that is wrong changes the distance by 10 or more.
ON_PLATE = 2.0

# Units of moments in N m, spelled without blanks, dots and the like.
_MOMENTS = (
    (r"(n|nt|newtons?)(mm|millimet(er|re)s?)", 1e-3),
    (r"(n|nt|newtons?)(cm|centimet(er|re)s?)", 1e-2),
    (r"(n|nt|newtons?)(m|met(er|re)s?)", 1.0),
)

# What moments may have been stored in, N m.
_POSSIBLE_MOMENTS = (1.0, 1e-2, 1e-3)


def _sides(corners: FloatArray) -> tuple[float, float]:
    """Return the lengths of a plate's sides along its x and y, in the corners' unit."""
    along_x = np.linalg.norm(corners[0] - corners[1])
    along_y = np.linalg.norm(corners[0] - corners[3])
    return float(along_x), float(along_y)


@dataclass(frozen=True)
class ForcePlate:
    """A force plate in the laboratory.

    Parameters
    ----------
    number : int
        From 1, in the order of the file.
    type : int
        Type of the C3D format, 1 to 4.
    corners : (4, 3) array
        m, z up.
    channels, units : tuple of str
        Labels and units of its analog channels.
    time : (K,) array
        Time of each sample on the recording's clock, s.
    force : (K, 3) array
        Force of the plate on the subject, N, z up.
    pressure : (K, 3) array
        Centre of pressure on the plate's surface, m; NaN where it bears nothing.
    remarks : tuple of Message
        What had to be put right.
    """

    number: int
    type: int
    corners: FloatArray
    channels: tuple[str, ...]
    units: tuple[str, ...]
    time: FloatArray
    force: FloatArray
    pressure: FloatArray
    remarks: tuple[Message, ...] = ()

    @property
    def name(self) -> str:
        """Return the name in tables: ``plate 1``."""
        return f"plate {self.number}"

    @property
    def rate_hz(self) -> float:
        """Return the samples per second; NaN if there are fewer than two."""
        if len(self.time) < 2:
            return float("nan")
        return float((len(self.time) - 1) / (self.time[-1] - self.time[0]))

    @property
    def sides_m(self) -> tuple[float, float]:
        """Return the lengths of the sides along the plate's x and y, m."""
        return _sides(self.corners)


@dataclass(frozen=True)
class FilePlates:
    """The force plates of a file, and why others of it cannot be used."""

    plates: tuple[ForcePlate, ...] = ()
    refused: tuple[Message, ...] = ()


def read_force_plates(
    path: str | Path,
    *,
    vertical_axis: str,
    unit: str = "auto",
    rate_hz: float | None = None,
) -> FilePlates:
    """Read the force plates of a file, in metres and with z up.

    Parameters
    ----------
    path : path
        A file of any format; only C3D files have force plates of their own.
    vertical_axis : {"x", "y", "z", "-x", "-y", "-z"}
        Axis of the file that points up, as for the recording.
    unit : {"auto", "m", "mm"}
        Unit of the file's positions; ``"auto"`` takes the one that it states.
    rate_hz : float, optional
        Frame rate of the recording, Hz, if it is not the one that the file states.

    Returns
    -------
    FilePlates
        A plate that cannot be read is not among them; a message says why.

    Raises
    ------
    RecordingError
        If a C3D file with plates cannot be read at all.
    """
    path = Path(path)
    if not c3d_plates.count_plates(path):
        return FilePlates()
    stored, refused = c3d_plates.read_stored_plates(path, rate_hz=rate_hz)
    plates = []
    for one in stored:
        try:
            metres = METRES_PER_UNIT.get(unit) or c3d_plates.metres_per_unit(one)
            # Numbers that no plate shows overflow; they stay infinite, and count as
            # missing.
            with np.errstate(over="ignore", invalid="ignore"):
                plates.append(in_laboratory(one, metres, vertical_axis))
        except RecordingError as error:
            values = {"number": one.number, "why": str(error)}
            refused.append(Message("recordings.plate_refused", values))
    return FilePlates(tuple(plates), tuple(refused))


def plates_of_recording(
    recording: Recording, file: Path, *, unit: str = "auto"
) -> FilePlates:
    """Read the plates of a recording's file in the recording's axes and on its clock.

    Parameters
    ----------
    recording : Recording
        Imported from `file` alone.
    file : path
        The file.
    unit : {"auto", "m", "mm"}
        ``input.unit``, as for the recording. With ``"auto"`` the unit is that which the
        import took.

    Raises
    ------
    RecordingError
        If the file cannot be read.
    """
    if not c3d_plates.count_plates(file):
        return FilePlates()
    if unit == "auto":
        stored = read_raw(file, rate_hz=recording.rate_hz)
        taken = choose_unit(stored.positions, unit="auto", nominal=stored.unit)
        if taken != stored.unit:
            unit = taken
    return read_force_plates(
        file,
        vertical_axis=recording.vertical_axis,
        unit=unit,
        rate_hz=recording.rate_hz,
    )


def in_laboratory(stored: StoredPlate, metres: float, vertical_axis: str) -> ForcePlate:
    """Return a plate's forces and centres of pressure in metres and with z up.

    Parameters
    ----------
    stored : StoredPlate
        In the units and axes of its file.
    metres : float
        Metres per unit of the file's positions.
    vertical_axis : str
        Axis of the file that points up.

    Raises
    ------
    RecordingError
        If the corners do not span a plane, or the channels are no forces.
    """
    axes = _own_axes(stored)
    forces, moments, unit_nm = _calibrated(stored, metres)
    number = {"number": stored.number}
    remarks = []
    if stored.type == 1:
        own_pressure = metres * stored.signals[:, 3:5]
    else:
        _, is_turned = _origin(stored)
        if is_turned:
            remarks.append(Message("recordings.plate_origin", number))
        own_pressure, unit_found = _at_surface(stored, forces, moments, metres, unit_nm)
        if unit_found != unit_nm:
            units = {"stated": unit_nm, "found": unit_found}
            remarks.append(Message("recordings.plate_moments", {**number, **units}))
    middle = metres * stored.corners.mean(axis=0)
    in_file = own_pressure @ axes[:, :2].T + middle
    force = np.ascontiguousarray(rotate_up(forces @ axes.T, vertical_axis))
    force[~np.isfinite(force).all(axis=1)] = np.nan
    if _points_down(force[:, 2]):
        force = -force
        remarks.append(Message("recordings.plate_inverted", number))
    return ForcePlate(
        number=stored.number,
        type=stored.type,
        corners=rotate_up(metres * stored.corners, vertical_axis),
        channels=stored.names,
        units=stored.units,
        time=stored.time,
        force=force,
        pressure=np.ascontiguousarray(rotate_up(in_file, vertical_axis)),
        remarks=tuple(remarks),
    )


def _own_axes(stored: StoredPlate) -> FloatArray:
    """Return the plate's axes as columns (3, 3), along the axes of the file."""
    x = stored.corners[0] - stored.corners[1]
    z = np.cross(x, stored.corners[0] - stored.corners[3])
    y = np.cross(z, x)
    lengths = np.linalg.norm([x, y, z], axis=1)
    if not (lengths > 0).all():
        found = stored.corners.tolist()
        place = f"{stored.place}: corners"
        raise RecordingError.at(place, "four corners of an area", found)
    return np.column_stack([x, y, z]) / lengths


# Forces and moments from the channels.


def _calibrated(
    stored: StoredPlate, metres: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return forces, N, and moments along the plate's axes, and the moments' N m.

    Moments are in their own unit, and about the point that the channels refer to.

    Raises
    ------
    RecordingError
        If a channel of forces is in volts or another unit that is no force.
    """
    usual = metres  # N times the unit of the positions
    signals = stored.signals
    if stored.type == 4 and stored.matrix is not None:
        both = signals @ stored.matrix.T
        return both[:, :3], both[:, 3:], usual
    newtons = _newtons(stored)
    if stored.type == 3:
        forces, moments = _of_four_sensors(newtons * signals, stored.origin)
        return forces, moments, usual
    forces = newtons * signals[:, :3]
    moments = signals[:, 3:]
    return forces, moments, _moment_unit(stored.units[3:]) or newtons * usual


def _of_four_sensors(
    signals: FloatArray, origin: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return forces and moments (K, 3) along the axes of a plate of type 3.

    Parameters
    ----------
    signals : (K, 8) array
        Forces of its sensors, N: x of 1 and 2, x of 3 and 4, y of 1 and 4, y of 2 and
        3, and z of each.
    origin : (3,) array
        Its first two values are the distances of the sensors from the plate's axes, in
        the unit of the positions.
    """
    fx12, fx34, fy14, fy23, fz1, fz2, fz3, fz4 = signals.T
    a, b = np.abs(origin[:2])
    forces = np.column_stack([fx12 + fx34, fy14 + fy23, fz1 + fz2 + fz3 + fz4])
    about_x = b * (fz1 + fz2 - fz3 - fz4)
    about_y = a * (fz2 + fz3 - fz1 - fz4)
    about_z = b * (fx34 - fx12) + a * (fy14 - fy23)
    return forces, np.column_stack([about_x, about_y, about_z])


def _newtons(stored: StoredPlate) -> float:
    """Return the newtons per unit of the forces; they must share one."""
    n_moments = 3 if stored.type != 3 else 0
    of_forces = stored.units[: len(stored.units) - n_moments]
    found = set()
    named = zip(stored.names, of_forces, strict=False)
    for name, spelling in named:
        unit = FORCE_UNIT_SPELLINGS.get(spelling.lower()) if spelling else "N"
        if unit not in ("N", "kN"):
            wanted = f"a unit of force in a plate of type {stored.type}"
            advice = "export the plate's forces calibrated"
            if spelling.lower() in c3d_plates.VOLTS:
                advice = "its calibration matrix belongs to type 4; or " + advice
            place = f"{stored.place}: channel '{name}'"
            raise RecordingError.at(place, wanted, f"'{spelling}'; {advice}")
        found.add(NEWTONS_PER_UNIT[unit])
    if len(found) > 1:
        listed = ", ".join(of_forces)
        raise RecordingError.at(f"{stored.place}: units", "one unit of force", listed)
    return found.pop()


def _moment_unit(units: Sequence[str]) -> float | None:
    """Return the N m per unit of moments as files spell it; None if it is not known."""
    plain = re.sub(r"[\s.*·_-]", "", units[0].lower())
    for form, factor in _MOMENTS:
        if re.fullmatch(form, plain):
            return factor
    return None


def _origin(stored: StoredPlate) -> tuple[FloatArray, bool]:
    """Return the way from the plate's origin to its surface, and whether it was turned.

    The plate's z points into the floor, and its origin lies below the surface, so the
    way up is negative. Some programs store the way down. Of type 3 only z is such a
    way.
    """
    origin = stored.origin.copy()
    if stored.type == 3:
        origin[:2] = 0.0
    is_turned = bool(origin[2] > 0)
    return (-origin if is_turned else origin), is_turned


def _at_surface(
    stored: StoredPlate,
    forces: FloatArray,
    moments: FloatArray,
    metres: float,
    stated_nm: float,
) -> tuple[FloatArray, float]:
    """Return the centre of pressure (K, 2) along the plate's x and y, m.

    Also the N m per unit of the moments: the stated one, unless it puts the subject off
    the plate and another does not. The moments about the middle of the surface vanish
    but for that about z if the force acts at the centre of pressure.
    """
    origin, _ = _origin(stored)
    of_lever = np.cross(forces, metres * origin)
    half_m = metres * np.array(_sides(stored.corners)) / 2

    as_stated = _pressure(forces, stated_nm * moments + of_lever)
    if stored.type == 3 or _is_on_plate(as_stated, forces[:, 2], half_m):
        return _corrected(stored, as_stated, metres), stated_nm
    for unit_nm in _POSSIBLE_MOMENTS:
        other = _pressure(forces, unit_nm * moments + of_lever)
        if _is_on_plate(other, forces[:, 2], half_m):
            return other, unit_nm
    return as_stated, stated_nm


def _pressure(forces: FloatArray, moments: FloatArray) -> FloatArray:
    """Return where forces (K, 3), N, act on a surface: x and y, (K, 2), m.

    The moments (K, 3), N m, are those about the origin of the axes, which lies in the
    surface. NaN where there is no vertical force.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.column_stack([-moments[:, 1], moments[:, 0]]) / forces[:, 2:]
    place[~np.isfinite(place).all(axis=1)] = np.nan
    return place


def _is_on_plate(
    pressure: FloatArray, vertical: FloatArray, half_m: FloatArray
) -> bool:
    """Tell whether the centre of pressure is mostly on the plate under large forces.

    A unit of moments that is too small puts it at the same place all the time, near the
    middle; so this can only tell that a unit is too large.
    """
    size = np.abs(vertical)
    known = np.isfinite(pressure).all(axis=1)
    loaded = known & (size >= WELL_LOADED * np.nanmax(size, initial=0.0))
    if not loaded.any():
        return True
    away = np.abs(pressure[loaded]) / half_m
    return float(np.median(away.max(axis=1))) <= ON_PLATE


def _corrected(stored: StoredPlate, pressure: FloatArray, metres: float) -> FloatArray:
    """Apply a Kistler plate's polynomials to a centre of pressure (K, 2), m.

    They are in the unit of the positions, odd in the coordinate that they correct and
    even in the other one.
    """
    if stored.polynomial is None:
        return pressure
    x, y = pressure.T / metres
    p = stored.polynomial
    off_x = np.polyval(p[0:3], y**2) * x**3 + np.polyval(p[3:6], y**2) * x
    off_y = np.polyval(p[6:9], x**2) * y**3 + np.polyval(p[9:12], x**2) * y
    return metres * np.column_stack([x - off_x, y - off_y])


def _points_down(vertical: FloatArray) -> bool:
    """Tell whether the vertical force (K,) presses the subject into the floor.

    A plate only pushes. Of a plate that nobody stepped on, the noise decides, and it
    does not matter.
    """
    known = vertical[np.isfinite(vertical)]
    above = known[known > WELL_LOADED * known.max(initial=0.0)]
    below = known[known < WELL_LOADED * known.min(initial=0.0)]
    return float(-below.sum()) > float(above.sum())
