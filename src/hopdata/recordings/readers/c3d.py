"""Reader of C3D files: integers or floats in any of the three byte orders.

The format follows the C3D user guide (c3d.org). Every count that the file states is
checked against the bytes present before anything is read.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError, mismatch
from hopdata.recording import Event
from hopdata.recordings import raw
from hopdata.recordings.readers import c3d_parameters as head
from hopdata.recordings.readers.c3d_parameters import BLOCK, C3dHeader, Parameters
from hopdata.recordings.readers.text import listed, only_place, readable

MOST_PARAMETER_BYTES = 255 * BLOCK
# Parameters of POINT that name model outputs, which are points but not markers.
MODEL_OUTPUTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")
_OUTPUT = re.compile(
    r".*[a-z](Angles?|Forces?|Moments?|Powers?)"
)  # as named by Plug-in Gait


def read_c3d(path: Path, *, rate_hz: float | None = None) -> raw.RawRecording:
    """Read the markers of a C3D file.

    A marker counts as unseen if its residual is negative, a coordinate is NaN, or all
    three are 0. Time is (frame number - 1) / rate, the clock of the file's events.

    Parameters
    ----------
    path : path
        The ``.c3d`` file.
    rate_hz : float, optional
        Frame rate, for a file that states none.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the place, what was expected and
        found.
    """
    header, parameters, size = open_c3d(path)
    available = size - header.data_start
    header, miscounted = head.settle_points(header, parameters, available)
    n_points = header.n_points
    if not n_points:
        raise RecordingError.at(path, "markers", "none")
    n_frames, remarks = head.count_frames(header, parameters, available)
    markers, kept, more = _markers(parameters, n_points)
    numbers = _numbers(path, header, parameters, n_frames)
    positions, doubted = _positions(path, header, numbers, kept)
    remarks = miscounted + remarks + doubted
    events, unread = _events(parameters)
    return raw.assembled(
        f"{path}: header",
        (markers, more),
        positions,
        number=head.first_frame(header, parameters) + np.arange(n_frames, dtype=float),
        unit=(
            parameters.place("POINT", "UNITS"),
            "".join(parameters.texts("POINT", "UNITS")[:1]),
        ),
        rates_hz=(frame_rate(header, parameters), rate_hz),
        remarks=parameters.remarks + remarks + unread,
        events=events or header.events,
        stated_up=_stated_up(parameters),
    )


def open_c3d(path: Path) -> tuple[C3dHeader, Parameters, int]:
    """Return header, parameters and size of a file."""
    with readable(path, is_text=False) as file:
        block = file.read(BLOCK)
        start = head.parameter_start(path, block)
        file.seek(start)
        section = file.read(MOST_PARAMETER_BYTES)
        size = os.fstat(file.fileno()).st_size
    if len(section) > 3 and section[2]:
        # Some writers count fewer blocks than they fill; the data begin where the
        # section ends.
        first_words = head.PROCESSORS.get(section[3], head.PROCESSORS[84]).whole(block)
        data_start = (head.unsigned(first_words[8]) - 1) * BLOCK
        section = section[: max(section[2] * BLOCK, data_start - start)]
    parameters = head.read_parameters(path, section, start)
    header = head.read_c3d_header(block, parameters.processor)
    if not BLOCK <= header.data_start <= size:
        header = head.with_stated_start(header, parameters)
    if not BLOCK <= header.data_start <= size:
        wanted = f"to start between byte {BLOCK} and the end of the file (byte {size})"
        raise RecordingError.at(
            f"{path}, byte 16: data", wanted, f"byte {header.data_start}"
        )
    if not np.isfinite(header.scale) or header.scale == 0:
        found = f"{header.scale:g}"
        raise RecordingError.at(
            f"{path}, byte 12: scale", "a number other than 0", found
        )
    return header, parameters, size


def frame_rate(header: C3dHeader, parameters: Parameters) -> float:
    """Return the frame rate, Hz; that of the header and ``POINT:RATE`` must agree."""
    stated = parameters.number("POINT", "RATE")
    if stated is None or not stated > 0:
        return header.rate_hz
    if not header.rate_hz > 0:
        return stated
    if not abs(stated - header.rate_hz) <= raw.RATE_TOLERANCE * abs(stated):
        wanted = f"{header.rate_hz:g} Hz as in the header"
        raise RecordingError.at(
            parameters.place("POINT", "RATE"), wanted, f"{stated:g} Hz"
        )
    return stated


def _markers(
    parameters: Parameters, n_points: int
) -> tuple[tuple[str, ...], list[int] | slice, tuple[str, ...]]:
    """Return the names and indices of the points that are markers, and remarks."""
    place = parameters.place("POINT", "LABELS")
    labels = parameters.texts("POINT", "LABELS")[:n_points]
    labels += [""] * (n_points - len(labels))
    outputs = {
        name for key in MODEL_OUTPUTS for name in parameters.texts("POINT", key)
    } - {""}
    outputs |= {label for label in labels if _OUTPUT.fullmatch(label)}
    kept = [i for i, label in enumerate(labels) if label not in outputs]
    n_outputs = n_points - len(kept)
    if not kept:
        raise RecordingError.at(
            place, "markers", f"model outputs only ({listed(labels)})"
        )
    named, unlabelled = raw.labelled(place, [labels[i] for i in kept])
    kept = [kept[i] for i in named]
    markers, remarks = raw.distinct_names(
        place, [labels[i] for i in kept], may_lack=True
    )
    if len(kept) == n_points:
        return markers, slice(None), remarks
    told = listed([label for label in labels if label in outputs])
    left_out = f"{place}: {n_outputs} model outputs are no markers and left out: {told}"
    return markers, kept, (*remarks, *unlabelled, *(left_out,) * bool(n_outputs))


def _stated_up(parameters: Parameters) -> str:
    """Return the axis that points up on the screen, if it is one of x, y, z."""
    axis = (parameters.texts("POINT", "Y_SCREEN") or [""])[0].upper()
    return axis[1].lower() if axis in ("+X", "+Y", "+Z") else ""


def _numbers(
    path: Path, header: C3dHeader, parameters: Parameters, n_frames: int
) -> NDArray[Any]:
    """Return the file's numbers, a row per frame: four per point, then the analog samples."""
    stored = np.asarray(
        np.memmap(path, dtype=np.uint8, mode="r", offset=header.data_start)
    )
    data, processor = stored[: n_frames * header.frame_bytes], parameters.processor
    numbers: NDArray[Any] = (
        processor.floats(data) if header.scale < 0 else processor.whole(data)
    )
    return numbers.reshape(n_frames, -1)


UNSEEN_WORD = -1  # residual of a point that was not seen; as an unsigned word 65,535
EIGHT_CAMERAS = (
    -256
)  # words below it are a residual beside a mask of eight cameras, not -1


def _positions(
    path: Path, header: C3dHeader, numbers: NDArray[Any], kept: list[int] | slice
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return positions (N, M, 3) of the selected points, NaN where unseen, and remarks."""
    points = numbers[:, : 4 * header.n_points].reshape(len(numbers), header.n_points, 4)
    words = points[:, :, 3]
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        positions = points[:, kept, :3].astype(np.float64)
        unseen, remarks = _unseen(path, words)
    positions[unseen[:, kept]] = np.nan
    if header.scale > 0:
        positions *= header.scale
    return positions, remarks


def _unseen(
    path: Path, words: NDArray[Any]
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Tell which points their residual words (N, M) mark as unseen, and what was odd about them.

    The format's word holds the residual in its lower byte and a mask of seven cameras
    in the upper one; below 0 it marks an unseen point. Two habits differ. Some programs
    write a word below 0 for each point of a file. Others mask eight cameras, which sets
    the sign of a good point; the word -1, or 65,535 without a sign, still marks an
    unseen one.
    """
    if not (words >= 0).any():
        told = "all residuals are below 0, as for unseen points; they are ignored"
        return np.zeros(words.shape, bool), (f"{path}: {told}",)
    unseen = ~(words >= 0) | (words == UNSEEN_WORD % 65536)
    if not (words < EIGHT_CAMERAS).any():
        return unseen, ()
    masked = (words < EIGHT_CAMERAS) & (words >= -32768) & (words % 1 == 0)
    unseen &= ~masked
    told = (
        f"{masked.sum()} of {masked.size} residual words are below {EIGHT_CAMERAS}, as with a mask "
        "of eight cameras; these points count as seen"
    )
    return unseen, (f"{path}: {told}",)


def _events(parameters: Parameters) -> tuple[tuple[Event, ...], tuple[str, ...]]:
    """Return events of the group ``EVENT``, labels with times in minutes and seconds, and remarks.

    Markers do not depend on them, so inconsistent events are skipped rather than
    refused.
    """
    used = int(parameters.number("EVENT", "USED") or 0)
    labels, times = (
        parameters.texts("EVENT", "LABELS"),
        parameters.numbers("EVENT", "TIMES"),
    )
    contexts = parameters.texts("EVENT", "CONTEXTS") or [""] * len(labels)
    enough = 0 <= used <= min(len(labels), len(contexts), len(times) // 2)
    if not enough or not np.isfinite(times[: 2 * used]).all():
        found = f"{len(labels)} labels, {len(contexts)} contexts and {len(times) / 2:g} times"
        place = parameters.place("EVENT", "USED")
        return (), (mismatch(place, f"{used} events", f"{found}; none is read"),)
    parts = zip(contexts[:used], labels, times[::2], times[1::2], strict=False)
    return tuple(
        Event(f"{where} {what}".strip(), 60 * m + s) for where, what, m, s in parts
    ), ()


# Analog channels of a C3D file, such as the forces of a plate.


@dataclass(frozen=True)
class Analogs:
    """Scaled analog channels, on the clock of the file's frames and events.

    Parameters
    ----------
    path : Path
        The file.
    names, units : tuple of str
        Label and unit of each of the C channels.
    time : (K,) array
        Time of each sample, s; frame number 1 is at 0 s.
    values : (K, C) array
        In `units`.
    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    time: FloatArray
    values: FloatArray

    def channel(self, name: str) -> tuple[FloatArray, str]:
        """Return the samples (K,) and the unit of a channel.

        Raises
        ------
        RecordingError
            If no channel or several channels have this name.
        """
        place = only_place(f"{self.path}: ANALOG:LABELS", name, self.names)
        return self.values[:, place], self.units[place]


def read_analogs(path: Path) -> Analogs:
    """Read all analog channels of a C3D file.

    A channel's value is (stored - ``ANALOG:OFFSET``) x ``ANALOG:SCALE`` x
    ``ANALOG:GEN_SCALE`` (C3D user guide). If ``ANALOG:FORMAT`` is UNSIGNED, samples and
    offsets are unsigned words.

    Parameters
    ----------
    path : path
        The ``.c3d`` file.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the place, what was expected and
        found.
    """
    header, parameters, size = open_c3d(path)
    n_channels = int(parameters.number("ANALOG", "USED") or 0)
    if not n_channels or not header.n_analog:
        raise RecordingError.at(parameters.place("ANALOG", "USED"), "channels", "none")
    if header.n_analog % n_channels:
        wanted = f"a divisor of the {header.n_analog} analog numbers in each frame"
        raise RecordingError.at(parameters.place("ANALOG", "USED"), wanted, n_channels)
    available = size - header.data_start
    header, _ = head.settle_points(header, parameters, available)
    n_frames, _ = head.count_frames(header, parameters, available)
    per_frame = header.n_analog // n_channels
    stored = _numbers(path, header, parameters, n_frames)[
        :, 4 * header.n_points :
    ].astype(float)
    unsigned = (parameters.texts("ANALOG", "FORMAT") or [""])[0].upper() == "UNSIGNED"
    if unsigned and header.scale > 0:
        stored = np.where(stored < 0, stored + 65536, stored)
    stored = stored.reshape(n_frames * per_frame, n_channels)
    offsets = (parameters.unsigned_numbers if unsigned else parameters.numbers)(
        "ANALOG", "OFFSET"
    )
    offset = _per_channel(parameters, "OFFSET", offsets, n_channels, default=0.0)
    scales = parameters.numbers("ANALOG", "SCALE")
    scale = _per_channel(parameters, "SCALE", scales, n_channels, default=1.0)
    general = parameters.number("ANALOG", "GEN_SCALE")
    start = head.first_frame(header, parameters) - 1
    samples = start * per_frame + np.arange(n_frames * per_frame)
    names, units = (_texts(parameters, key, n_channels) for key in ("LABELS", "UNITS"))
    time = samples / (frame_rate(header, parameters) * per_frame)
    values = (stored - offset) * scale * (1.0 if general is None else general)
    return Analogs(path, names, units, time, values)


def _per_channel(
    parameters: Parameters,
    name: str,
    found: list[float],
    n_channels: int,
    *,
    default: float,
) -> FloatArray:
    """Return one number per channel, (C,); the default if the file has none."""
    if found and len(found) < n_channels:
        wanted = f"{n_channels} numbers"
        raise RecordingError.at(parameters.place("ANALOG", name), wanted, len(found))
    return np.array(found[:n_channels] or [default] * n_channels, dtype=np.float64)


def _texts(parameters: Parameters, name: str, n_channels: int) -> tuple[str, ...]:
    found = [text.strip() for text in parameters.texts("ANALOG", name)[:n_channels]]
    return tuple(found + [""] * (n_channels - len(found)))
