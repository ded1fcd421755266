"""Reader of MVNX files, the XML of Xsens MVN: places of a body's segments, in m, z up.

Only the names of the segments and the element ``position`` of each frame of type
``normal`` are read; reference poses are left out. The file is parsed piece by piece,
and anything that could make XML expand is refused: a document type or an entity. Depth
and length of elements are limited.
"""

import contextlib
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from xml.parsers import expat

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recordings import raw
from hopdata.recordings.budget import DEEPEST, LONGEST_LINE, MOST_MARKERS
from hopdata.recordings.readers.text import BLOCK, no_number, one_line, readable

# Type of a frame that was recorded; others are reference poses.
_NORMAL = "normal"


def read_mvnx(path: Path, *, rate_hz: float | None = None) -> raw.RawRecording:
    """Read the origins of the segments of an MVNX file as markers.

    Parameters
    ----------
    path : path
        The ``.mvnx`` file.
    rate_hz : float, optional
        Frame rate, for a file that states none.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the line, what was expected and
        found.
    """
    content = _parsed(path)
    names = content.names
    if not content.frames:
        found = f"none of type {_NORMAL} that has an element position"
        how = "; export the positions of segments from MVN as well"
        raise RecordingError.at(path, "frames", found + how)
    n_segments = len(content.frames[0]) // 3
    if len(names) != n_segments:
        if names:
            wanted = f"{len(names)} segments in element position"
            raise RecordingError.at(path, wanted, n_segments)
        names = [""] * n_segments
    values = {"place": str(path), "n_segments": n_segments}
    remarks: list[raw.Remark] = [Message("recordings.xsens_segments", values)]
    if content.n_poses:
        left_out = {"place": str(path), "n_frames": content.n_poses}
        remarks.append(Message("recordings.frames_of_poses", left_out))
    positions = np.array(content.frames).reshape(-1, n_segments, 3)
    return raw.assembled(
        str(path),
        raw.distinct_names(f"{path}: segments", names, may_lack=True),
        positions,
        number=_numbers(path, content.indices),
        unit=(str(path), "m"),
        rates_hz=(content.rate_hz, rate_hz),
        rate_place=f"{path}: subject: frameRate",
        remarks=tuple(remarks),
        stated_up="z",
        started=content.started,
    )


def _numbers(path: Path, indices: list[float]) -> FloatArray:
    """Return the number of each frame, from 1; the file counts from 0."""
    number = np.asarray(indices, float) + 1
    backward = np.diff(number) <= 0
    if backward.any():
        frame = int(np.argmax(backward)) + 1
        place = f"{path}: frame {frame + 1}: index"
        raise RecordingError.at(
            place, f"more than {indices[frame - 1]:g}", indices[frame]
        )
    return number


@dataclass
class _Content:
    """What was found so far.

    Parameters
    ----------
    names : list of str
        Names of the segments.
    rate_hz : float or None
        Frame rate, Hz.
    started : datetime or None
        When the measurement began.
    indices : list of float
        Index of each frame, from 0.
    frames : list of array
        Positions (3 M,) of the segments in each frame, m.
    n_poses : int
        Frames that are reference poses.
    """

    names: list[str] = field(default_factory=list)
    rate_hz: float | None = None
    started: datetime | None = None
    indices: list[float] = field(default_factory=list)
    frames: list[FloatArray] = field(default_factory=list)
    n_poses: int = 0


def _parsed(path: Path) -> _Content:
    parsing = _Parsing(path)
    try:
        with readable(path, is_text=False) as file:
            for block in iter(lambda: file.read(BLOCK), b""):
                parsing.parser.Parse(block, False)
            parsing.parser.Parse(b"", True)
    except expat.ExpatError as error:
        place = f"{path}, line {error.lineno}"
        found = one_line(expat.errors.messages.get(error.code, str(error)))
        if error.code in _CUT:
            found += "; the file ends here, was it cut short? export it again"
        raise RecordingError.at(place, "XML of Xsens MVN", found) from None
    except (LookupError, ValueError) as error:  # an encoding that does not exist
        raise RecordingError.at(
            path, "XML of Xsens MVN", one_line(str(error))
        ) from None
    return parsing.content


# Errors of a file that ends too early.
_CUT = tuple(
    expat.errors.codes[message]
    for message in (
        expat.errors.XML_ERROR_NO_ELEMENTS,
        expat.errors.XML_ERROR_UNCLOSED_TOKEN,
        expat.errors.XML_ERROR_UNCLOSED_CDATA_SECTION,
    )
)


class _Parsing:
    """Takes what the parser meets."""

    def __init__(self, path: Path) -> None:
        self.content = _Content()
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._refuse
        self.parser.EntityDeclHandler = self._refuse
        self._path = path
        self._open: list[str] = []
        self._is_normal = False
        self._has_subject = False
        self._parts: list[str] | None = None
        self._length = 0

    def _place(self) -> str:
        return f"{self._path}, line {self.parser.CurrentLineNumber}"

    def _refuse(self, *_: object) -> None:
        found = "a document type or an entity, which can expand without limit"
        raise RecordingError.at(self._place(), "plain elements", found)

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]  # without its namespace
        if not self._open and name != "mvnx":
            found = f"<{name[:40]}>"
            raise RecordingError.at(self._place(), "<mvnx> first", found)
        self._open.append(name)
        if len(self._open) > DEEPEST:
            wanted = f"at most {DEEPEST} elements within one another"
            raise RecordingError.at(self._place(), wanted, "more")
        above = self._open[-2] if len(self._open) > 1 else ""
        if name == "subject":
            self._subject(attributes)
        elif name == "segment" and above == "segments":
            self._segment(attributes)
        elif name == "frame" and above == "frames":
            self._frame(attributes)
        elif name == "position" and above == "frame" and self._is_normal:
            self._parts = []
            self._length = 0

    def _subject(self, attributes: dict[str, str]) -> None:
        if self._has_subject:
            found = "several; export each to a file of its own"
            raise RecordingError.at(self._place(), "one subject", found)
        self._has_subject = True
        stated = attributes.get("frameRate", "")
        if stated:
            self.content.rate_hz = self._number("frameRate", stated)
        since = attributes.get("recDateMSecsSinceEpoch", "")
        with contextlib.suppress(ValueError, OverflowError, OSError):
            began = datetime.fromtimestamp(int(since) / 1000, UTC)
            self.content.started = began.replace(tzinfo=None)

    def _segment(self, attributes: dict[str, str]) -> None:
        self.content.names.append(attributes.get("label", ""))
        if len(self.content.names) > MOST_MARKERS:
            wanted = f"at most {MOST_MARKERS:,} segments"
            raise RecordingError.at(self._place(), wanted, "more")

    def _frame(self, attributes: dict[str, str]) -> None:
        self._is_normal = attributes.get("type", _NORMAL) == _NORMAL
        if not self._is_normal:
            self.content.n_poses += 1
            return
        index: float = len(self.content.frames)
        if attributes.get("index"):
            index = self._number("index", attributes["index"])
        self.content.indices.append(index)

    def _number(self, key: str, stated: str) -> float:
        fault = no_number(stated)
        if fault:
            raise RecordingError(f"{self._place()}: {key}: {fault}")
        return float(stated)

    def _text(self, data: str) -> None:
        if self._parts is None:
            return
        self._parts.append(data)
        self._length += len(data)
        if self._length > LONGEST_LINE:
            wanted = f"at most {LONGEST_LINE:,} characters in element position"
            raise RecordingError.at(self._place(), wanted, "more")

    def _end(self, tag: str) -> None:
        self._open.pop()
        name = tag.rpartition(":")[2]
        if name == "frame":
            self._require_positions()
        if name != "position" or self._parts is None:
            return
        fields = "".join(self._parts).split()
        self._parts = None
        content = self.content
        if not fields or len(fields) % 3:
            found = f"{len(fields)} numbers in element position"
            raise RecordingError.at(self._place(), "x, y, z of each segment", found)
        if content.frames and len(fields) != len(content.frames[0]):
            wanted = f"{len(content.frames[0])} numbers as in the frames before"
            raise RecordingError.at(self._place(), wanted, len(fields))
        for one in fields:
            fault = "" if one.lower() == "nan" else no_number(one)
            if fault:
                raise RecordingError(f"{self._place()}: position: {fault}")
        content.frames.append(np.array([float(one) for one in fields]))

    def _require_positions(self) -> None:
        """Require a frame to have one element position, or none of them to have any."""
        if not self._is_normal:
            return
        content = self.content
        if not content.frames:
            content.indices.clear()  # an export without positions
        elif len(content.frames) != len(content.indices):
            found = "none, or more than one"
            raise RecordingError.at(self._place(), "an element position", found)
