"""Reader of TRB files, the binary tracks of Motion Analysis (EVaRT, Cortex).

The layout is that found by others, since the maker has published none. All numbers are
little-endian, and lengths count words of four bytes. The header begins with eight bytes
that never change and the address of the data. Records follow, each a key, a length and
that many words: the frame rate, and a number, a colour and a name for each marker. The
data are a record for each frame: 12 bytes of head, then 24 bytes for each marker that
was seen. A marker that has no such entry in a frame was not seen.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recordings import raw
from hopdata.recordings.budget import MOST_CELLS, MOST_MARKERS
from hopdata.recordings.readers.text import decoded, readable

BEGIN = b"\0\0\0\0\xff\xff\xff\xff"
WORD = 4

# Keys of records.
DATA_RATE = 0x0103
FIRST_TIME = 0x0105
MARKER = 0x010C
FRAME = 0x0600

# Values of a 16-bit word, after which frame numbers begin anew.
WORDS = 65536

FRAME_HEAD = 12
POINT = np.dtype(
    [("number", "<u2"), ("rest", "<u2"), ("xyz", "<f4", 3), ("more", "V8")]
)

# A file beyond this is no recording of tracks.
_MOST_BYTES = 2 << 30

#: Coordinates that are kept in memory for each byte of a file, where most markers are
#: unseen.
#: Unit: 1. Origin: derived: 8 bytes each, so that they take at most ten times the file.
_MOST_PER_BYTE = 1.25


def read_trb(path: Path, *, rate_hz: float | None = None) -> raw.RawRecording:
    """Read the markers of a TRB file. The file states no unit.

    Parameters
    ----------
    path : path
        The ``.trb`` file.
    rate_hz : float, optional
        Frame rate, for a file that states none.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the byte, what was expected and
        found.
    """
    with readable(path, is_text=False) as file:
        # Python asks for as much memory as it is told to read.
        content = file.read(min(_MOST_BYTES, path.stat().st_size))
    header = _read_header(path, content)
    frames, number, cut = _frames(path, content, header.data_start)
    positions = _positions(path, content, frames, header)
    return raw.assembled(
        str(path),
        raw.distinct_names(f"{path}: markers", header.names, may_lack=True),
        positions,
        number=number + _frames_before(header),
        rates_hz=(header.rate_hz, rate_hz),
        remarks=cut,
    )


@dataclass(frozen=True)
class _Header:
    """What the header states.

    Parameters
    ----------
    data_start : int
        Byte at which the data begin.
    rate_hz : float or None
        Frame rate, Hz.
    first_s : float
        Time of the first frame, s.
    names : tuple of str
        Names of the M markers.
    numbers : tuple of int
        Numbers by which the data name these markers.
    """

    data_start: int
    rate_hz: float | None
    first_s: float
    names: tuple[str, ...]
    numbers: tuple[int, ...]


def _frames_before(header: _Header) -> int:
    """Return the number of frames between time 0 and the first frame."""
    if header.rate_hz is None:
        return 0
    frames = header.first_s * header.rate_hz
    if not frames > 0:  # nor where one of them is not finite
        return 0
    return int(min(frames, raw.UNSEEN_FROM))


def _read_header(path: Path, content: bytes) -> _Header:
    """Read the records before the data."""
    if content[: len(BEGIN)] != BEGIN or len(content) < len(BEGIN) + WORD:
        found = content[: len(BEGIN)].hex() or "an empty file"
        wanted = f"a TRB file ({BEGIN.hex()} first)"
        raise RecordingError.at(f"{path}, byte 0", wanted, found)
    # Whole numbers of 32 bits are two words of 16 bits, the high one first.
    high, low = _words(content, len(BEGIN), 2)
    data_start = WORD * (high << 16 | low)
    at = len(BEGIN) + WORD
    if not at <= data_start < len(content):
        wanted = f"data between byte {at} and the end of the file ({len(content)})"
        raise RecordingError.at(f"{path}, byte {len(BEGIN)}", wanted, data_start)
    rate_hz: float | None = None
    first_s = 0.0
    names = []
    numbers = []
    while at + WORD <= data_start:
        key, n_words = _words(content, at, 2)
        begin = at + WORD
        at = begin + WORD * n_words
        if at > data_start:
            wanted = f"a record within the header of {data_start} bytes"
            raise RecordingError.at(f"{path}, byte {begin}", wanted, f"{n_words} words")
        if key == MARKER and n_words:
            numbers.append(_words(content, begin, 1)[0])
            names.append(_name(content[begin + WORD : at]))
        elif key == DATA_RATE and n_words:
            rate_hz = _float(content, begin)
        elif key == FIRST_TIME and n_words:
            first_s = _float(content, begin)
    if not names:
        raise RecordingError.at(f"{path}: header", "markers", "none")
    if len(names) > MOST_MARKERS:
        wanted = f"at most {MOST_MARKERS:,} markers"
        raise RecordingError.at(f"{path}: header", wanted, f"{len(names):,}")
    return _Header(data_start, rate_hz, first_s, tuple(names), tuple(numbers))


def _name(data: bytes) -> str:
    """Return a marker's name, which zeros or blanks end."""
    return decoded(data.split(b"\0")[0]).strip()


def _words(content: bytes, at: int, number: int) -> list[int]:
    """Return whole numbers of 16 bits without a sign."""
    words: list[int] = np.frombuffer(content, "<u2", number, at).tolist()
    return words


def _float(content: bytes, at: int) -> float:
    """Return a number of 32 bits."""
    return float(np.frombuffer(content, "<f4", 1, at)[0])


def _frames(
    path: Path, content: bytes, start: int
) -> tuple[list[tuple[int, int]], FloatArray, tuple[raw.Remark, ...]]:
    """Return place and points of each frame, its number, and a remark on a cut file."""
    frames = []
    numbers = []
    remarks: tuple[raw.Remark, ...] = ()
    at = start
    last = 0
    while at + FRAME_HEAD <= len(content):
        first, second, key, number, n_words, _ = _words(content, at, 6)
        n_bytes = WORD * n_words
        if first or second or key != FRAME:
            if not any(content[at : at + FRAME_HEAD]):
                break  # zeros fill the last block
            wanted = f"a frame (0000 0000 {FRAME:04x})"
            found = f"{first:04x} {second:04x} {key:04x}"
            raise RecordingError.at(f"{path}, byte {at}", wanted, found)
        n_points, rest = divmod(n_bytes - FRAME_HEAD, POINT.itemsize)
        if rest or n_bytes < FRAME_HEAD:
            wanted = f"{FRAME_HEAD} bytes and {POINT.itemsize} for each marker"
            place = f"{path}, byte {at}: frame {number}"
            raise RecordingError.at(place, wanted, f"{n_bytes}")
        if at + n_bytes > len(content):
            values = {"place": str(path), "frame": number}
            remarks = (Message("recordings.last_frame_cut", values),)
            break
        last = _unwrapped(number, last)
        frames.append((at + FRAME_HEAD, n_points))
        numbers.append(last)
        at += n_bytes
    if not frames:
        raise RecordingError.at(f"{path}, byte {start}", "frames", "none")
    _require_increasing(path, numbers)
    return frames, np.asarray(numbers, float), remarks


def _unwrapped(number: int, last: int) -> int:
    """Return a frame's number, of which the file states 16 bits, after the last one."""
    number += last // WORDS * WORDS
    if number < last - WORDS // 2:
        number += WORDS
    return number


def _require_increasing(path: Path, numbers: list[int]) -> None:
    """Require the numbers of the frames to increase."""
    steps = np.diff(numbers)
    if (steps <= 0).any():
        frame = int(np.argmax(steps <= 0)) + 1
        wanted = f"a frame after {numbers[frame - 1]}"
        place = f"{path}: record {frame + 1} of the data"
        raise RecordingError.at(place, wanted, numbers[frame])


def _positions(
    path: Path, content: bytes, frames: list[tuple[int, int]], header: _Header
) -> FloatArray:
    """Return positions (N, M, 3), NaN where a frame has no entry for a marker."""
    place_of = {number: k for k, number in enumerate(header.numbers)}
    if len(place_of) < len(header.numbers):
        raise RecordingError.at(f"{path}: markers", "different numbers", "equal ones")
    n_numbers = 3 * len(frames) * len(header.numbers)
    if n_numbers > _MOST_PER_BYTE * len(content) + MOST_CELLS:
        wanted = "markers that are seen in more than a few frames"
        found = f"{len(header.numbers)} markers, nearly none in {len(frames)} frames"
        raise RecordingError.at(path, wanted, found)
    positions = np.full((len(frames), len(header.numbers), 3), np.nan)
    columns = np.full(WORDS, -1)
    columns[list(place_of)] = list(place_of.values())
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        for frame, (at, n_points) in enumerate(frames):
            points = np.frombuffer(content, POINT, n_points, at)
            of_points = columns[points["number"]]
            if (of_points < 0).any():
                number = int(points["number"][np.argmax(of_points < 0)])
                wanted = "the number of one of its markers"
                raise RecordingError.at(f"{path}, byte {at}", wanted, number)
            positions[frame, of_points] = points["xyz"]
    return positions
