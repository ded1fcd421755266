"""Reader of BVH files: a skeleton and its joint angles, read as places of the joints.

The hierarchy names joints with their offsets from the parent and their channels. Each
row below it has the values of all channels in one frame. A joint's rotation is the
product of its rotation channels in the order in which they are listed, and position
channels take the place of the offset, as most programs write them. The ends of limbs
(``End Site``) become markers too, since feet end there. The format states neither a
unit nor which axis points up.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recordings import raw
from hopdata.recordings.budget import MOST_CELLS, MOST_COLUMNS, MOST_MARKERS
from hopdata.recordings.readers import text

_CHANNEL = re.compile(r"([xyz])(position|rotation)", re.I)

#: Size of a skeleton, in numbers of the file, below which these are metres and above
#: which they are millimetres; between them they are centimetres, the format's habit.
#: Unit: that of the file. Origin: chosen. A skeleton of 5 in cm would be that of a
#: mouse, and of 1000 in cm that of no animal.
SMALL_SKELETON = 5.0
#: See `SMALL_SKELETON`.
#: Unit: that of the file. Origin: chosen.
LARGE_SKELETON = 1000.0

# Unit and factor to which numbers in a unit are converted, since recordings have no
# centimetres.
_CONVERTED = {"m": ("m", 1.0), "cm": ("mm", 10.0), "mm": ("mm", 1.0)}

#: Frame rates that are looked for behind a rounded frame time.
#: Unit: Hz. Origin: convention: the rates of cameras are mostly multiples of 10.
USUAL_STEP_HZ = 10


@dataclass
class _Joint:
    """A joint or the end of a limb.

    Parameters
    ----------
    name : str
        Name of the joint; that of its parent and ``end`` for the end of a limb.
    parent : int
        Index of its parent; -1 for a root.
    line : int
        Line of the file that names it.
    offset : tuple of float
        Offset from the parent, in the parent's axes.
    channels : list of tuple
        Axis (0, 1, 2) and whether it is a rotation, in the order of their values.
    first : int
        Column of the first of these values.
    """

    name: str
    parent: int
    line: int
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    channels: list[tuple[int, bool]] = field(default_factory=list)
    first: int = 0


@dataclass(frozen=True)
class _Head:
    """What stands above the rows of numbers, and where these begin."""

    joints: list[_Joint]
    n_channels: int
    n_frames: float | None
    frame_s: str
    n_lines: int
    offset: int


def read_bvh(path: Path, *, rate_hz: float | None = None) -> raw.RawRecording:
    """Read the joints of a BVH file as markers.

    Parameters
    ----------
    path : path
        The ``.bvh`` file.
    rate_hz : float, optional
        Frame rate, for a file that states no frame time.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the line, what was expected and
        found.
    """
    head = _read_head(path)
    values, n_lines = _rows(path, head)
    positions = _forward_kinematics(head.joints, values)
    unit, factor, of_unit = _unit(path, head.joints, positions)
    positions *= factor
    n_ends = sum(not joint.channels for joint in head.joints)
    made = {
        "place": str(path),
        "n_joints": len(head.joints) - n_ends,
        "n_ends": n_ends,
    }
    miscounted = raw.frame_count(
        f"{path}, line {n_lines}", "Frames", head.n_frames, len(values)
    )
    stated_hz, of_rate = _rate(path, head.frame_s)
    return raw.assembled(
        str(path),
        raw.distinct_names(str(path), [joint.name for joint in head.joints]),
        positions,
        number=np.arange(1.0, len(values) + 1),
        unit=(str(path), unit),
        unit_is_stated=False,
        rates_hz=(stated_hz, rate_hz),
        remarks=(
            Message("recordings.bvh_joints", made),
            of_unit,
            *of_rate,
            *miscounted,
        ),
    )


# The hierarchy.


def _read_head(path: Path) -> _Head:
    """Read the hierarchy, and the statements before the rows of numbers."""
    with text.readable(path) as file:
        lines = _Lines(path, file)
        first = next(iter(lines), [""])
        if first[0].upper() != "HIERARCHY":
            found = f"'{' '.join(first)[:40]}'"
            raise RecordingError.at(f"{path}, line 1", "HIERARCHY", found)
        joints = _hierarchy(lines)
        n_frames: float | None = None
        frame_s = ""
        for fields in lines:
            key = " ".join(fields).lower()
            if key.startswith("frames:"):
                stated = key.partition(":")[2].strip()
                n_frames = text.stated_number(lines.place, "Frames", stated)
            elif key.startswith("frame time:"):
                frame_s = key.partition(":")[2].strip()
                break
            elif text.is_number(text.pointed(fields[0])):
                lines.step_back()
                break
            else:
                wanted = "Frames: or Frame Time:"
                raise RecordingError.at(lines.place, wanted, f"'{key[:40]}'")
        n_channels = sum(len(joint.channels) for joint in joints)
        if not n_channels:
            raise RecordingError.at(path, "joints with channels", "none")
        return _Head(joints, n_channels, n_frames, frame_s, lines.number, lines.n_bytes)


class _Lines:
    """The statements of a file, with their place: fields of a line, or one brace."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path = path
        self._file = file
        self.number = 0
        self.n_bytes = 0
        self._last_bytes = 0

    @property
    def place(self) -> str:
        """File and line, for messages."""
        return f"{self._path}, line {self.number}"

    def __iter__(self) -> Iterator[list[str]]:
        for line in iter(self._file.readline, b""):
            self.number += 1
            self.n_bytes += len(line)
            self._last_bytes = len(line)
            if b"\0" in line:
                raise RecordingError.at(self.place, "text", "binary data")
            # A brace may stand behind a name.
            for statement in re.split(r"([{}])", text.decoded(line)):
                fields = statement.split()
                if fields:
                    yield fields

    def step_back(self) -> None:
        """Give back the last line, which is not the header's."""
        self.number -= 1
        self.n_bytes -= self._last_bytes


def _hierarchy(lines: _Lines) -> list[_Joint]:
    """Read the joints down to ``MOTION``, each after its parent."""
    joints: list[_Joint] = []
    open_joints: list[int] = []  # whose closing brace has not come
    named: int | None = None  # whose opening brace has not come
    n_channels = 0
    for fields in lines:
        key = fields[0].upper()
        if key == "MOTION":
            if open_joints or not joints:
                found = f"MOTION with {len(open_joints)} joints still open"
                raise RecordingError.at(lines.place, "the whole hierarchy", found)
            return joints
        if key in ("ROOT", "JOINT", "END"):
            named = _named(lines, joints, open_joints, fields)
        elif key == "{" and named is not None:
            open_joints.append(named)
            named = None
        elif key == "}" and open_joints:
            open_joints.pop()
        elif key == "OFFSET" and open_joints:
            joints[open_joints[-1]].offset = _offset(lines, fields[1:])
        elif key == "CHANNELS" and open_joints:
            joint = joints[open_joints[-1]]
            if joint.channels:
                found = f"another in the joint of line {joint.line}"
                raise RecordingError.at(lines.place, "one CHANNELS a joint", found)
            joint.channels = _channels(lines, fields[1:])
            joint.first = n_channels
            n_channels += len(joint.channels)
        else:
            wanted = "ROOT, JOINT, End Site, OFFSET, CHANNELS or a brace"
            found = f"'{' '.join(fields)[:40]}'"
            raise RecordingError.at(lines.place, wanted, found)
    raise RecordingError.at(lines.place, "MOTION", "the end of the file")


def _named(
    lines: _Lines, joints: list[_Joint], open_joints: list[int], fields: list[str]
) -> int:
    """Add a joint, and return its index."""
    parent = open_joints[-1] if open_joints else -1
    key = fields[0].upper()
    name = " ".join(fields[1:])
    if key == "END":
        if parent < 0:
            raise RecordingError.at(lines.place, "an end within a joint", "none")
        name = f"{joints[parent].name} end"
    elif not name:
        raise RecordingError.at(lines.place, f"a name after {key}", "none")
    if len(joints) >= MOST_MARKERS:
        wanted = f"at most {MOST_MARKERS:,} joints"
        raise RecordingError.at(lines.place, wanted, "more")
    joints.append(_Joint(name, parent, lines.number))
    return len(joints) - 1


def _offset(lines: _Lines, fields: list[str]) -> tuple[float, ...]:
    """Return the offset of a joint from its parent, in the unit of the file."""
    faults = [text.no_number(text.pointed(one)) for one in fields[:3]]
    if len(fields) != 3 or any(faults):
        found = f"'{' '.join(fields)[:40]}'"
        raise RecordingError.at(lines.place, "three numbers after OFFSET", found)
    return tuple(float(text.pointed(one)) for one in fields)


def _channels(lines: _Lines, fields: list[str]) -> list[tuple[int, bool]]:
    """Return axis and kind of each channel; the number before them must agree."""
    channels = []
    for name in fields[1:]:
        match = _CHANNEL.fullmatch(name)
        if match is None:
            wanted = "channels such as Xposition and Zrotation"
            raise RecordingError.at(lines.place, wanted, f"'{name[:40]}'")
        axis, kind = match.groups()
        channels.append(("xyz".index(axis.lower()), kind.lower() == "rotation"))
    if not fields or fields[0] != str(len(channels)):
        found = f"'{fields[0][:40] if fields else ''}'"
        raise RecordingError.at(lines.place, f"{len(channels)} after CHANNELS", found)
    return channels


# The motion.


def _rows(path: Path, head: _Head) -> tuple[FloatArray, int]:
    """Return the values of all channels (N, C), and the line above them."""
    if head.n_channels > MOST_COLUMNS:
        wanted = f"at most {MOST_COLUMNS:,} channels"
        raise RecordingError.at(path, wanted, f"{head.n_channels:,}")
    with text.readable(path) as file:
        file.seek(head.offset)
        first = file.readline().strip()
    mark = "\t" if b"\t" in first and b" " not in first else " "
    rows = text.Rows(
        path,
        n_lines=head.n_lines,
        offset=head.offset,
        width=head.n_channels,
        mark=mark,
    )
    (values,) = rows.numbers(range(head.n_channels))
    missing = np.argwhere(np.isnan(values))
    if len(missing):
        row, column = missing[0]
        place = f"{rows.line(row)}, value {column + 1}"
        raise RecordingError.at(place, "a number", "a missing value")
    return values, head.n_lines


def _forward_kinematics(joints: list[_Joint], values: FloatArray) -> FloatArray:
    """Return the place of each joint (N, J, 3), a block of frames at a time."""
    places = np.empty((len(values), len(joints), 3))
    # Absurd offsets are refused by their size, like those of any format.
    with np.errstate(over="ignore", invalid="ignore"):
        _place(joints, values, places)
    return places


def _place(joints: list[_Joint], values: FloatArray, places: FloatArray) -> None:
    """Fill in the place of each joint (N, J, 3)."""
    step = max(1, MOST_CELLS // (12 * len(joints)))
    for first in range(0, len(values), step):
        block = slice(first, first + step)
        turned: list[FloatArray] = []
        for k, joint in enumerate(joints):
            moved, turn = _moved(joint, values[block])
            if joint.parent >= 0:
                parent = turned[joint.parent]
                moved = np.einsum("nij,nj->ni", parent, moved)
                moved += places[block, joint.parent]
                turn = parent if not joint.channels else parent @ turn
            places[block, k] = moved
            turned.append(turn)


def _moved(joint: _Joint, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a joint's place (N, 3) and rotation (N, 3, 3) in its parent's axes."""
    moved = np.tile(joint.offset, (len(values), 1)).astype(float)
    turn = np.broadcast_to(np.eye(3), (len(values), 3, 3))
    for k, (axis, is_rotation) in enumerate(joint.channels):
        column = values[:, joint.first + k]
        if is_rotation:
            turn = turn @ _about(axis, np.deg2rad(column))
        else:
            moved[:, axis] = column
    return moved, turn


def _about(axis: int, angle: FloatArray) -> FloatArray:
    """Return rotations (N, 3, 3) about a coordinate axis, by angles (N,) in rad."""
    turn = np.zeros((len(angle), 3, 3))
    i = (axis + 1) % 3
    j = (axis + 2) % 3
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = np.cos(angle)
    turn[:, j, j] = turn[:, i, i]
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn


# Unit and rate.


def _unit(
    path: Path, joints: list[_Joint], positions: FloatArray
) -> tuple[str, float, raw.Remark]:
    """Guess the unit by the size of the skeleton, and say so.

    Returns
    -------
    unit : {"mm", "m"}
    factor : float
        What turns the numbers to this unit.
    remark : Remark
    """
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.ptp(positions[0], axis=0).max())
    taken = "cm"
    if size < SMALL_SKELETON:
        taken = "m"
    elif size > LARGE_SKELETON:
        taken = "mm"
    unit, factor = _CONVERTED[taken]
    values = {"place": str(path), "unit": taken, "size": size, "n": len(joints)}
    return unit, factor, Message("recordings.bvh_unit", values)


def _rate(path: Path, printed: str) -> tuple[float | None, tuple[raw.Remark, ...]]:
    """Return the frame rate, Hz, of which a frame time is the rounded inverse.

    ``0.008333`` means 120 Hz. A whole number of Hz is taken if only one of them, or
    only one multiple of 10, has this frame time when it is rounded in the same way.
    """
    frame_s = text.stated_number(str(path), "Frame Time", printed)
    if not frame_s:  # 0 stands in files of one pose
        return None, ()
    if not frame_s > 0:
        place = f"{path}: Frame Time"
        raise RecordingError.at(place, "more than 0 s", f"{printed[:40]}")
    _, _, decimals = text.pointed(printed).partition(".")
    half_s = 0.5 * 10.0 ** -len(decimals)
    if not decimals.isdigit() or not half_s < 0.1 * frame_s:
        return 1 / frame_s, ()
    low = int(np.ceil(1 / (frame_s + half_s)))
    high = int(np.floor(1 / (frame_s - half_s)))
    whole = range(low, high + 1)
    usual = [rate for rate in whole if rate % USUAL_STEP_HZ == 0]
    for rates in (whole, usual):
        if len(rates) == 1:
            values = {"place": str(path), "printed": printed, "rate_hz": rates[0]}
            remark = Message("recordings.rate_of_rounded_time", values)
            is_new = abs(rates[0] * frame_s - 1) > raw.RATE_TOLERANCE
            return float(rates[0]), (remark,) if is_new else ()
    return 1 / frame_s, ()
