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
from hopdata.foreign import door
from hopdata.recording import Event
from hopdata.recordings import raw
from hopdata.recordings.readers import c3d_parameters as head
from hopdata.recordings.readers import c3d_rotations
from hopdata.recordings.readers.c3d_parameters import BLOCK, C3dHeader, Parameters
from hopdata.recordings.readers.text import listed, only_place, readable

MOST_PARAMETER_BYTES = 255 * BLOCK

# Names of markers, and remarks on them.
Named = tuple[tuple[str, ...], tuple[raw.Remark, ...]]

# Parameters of POINT that name model outputs, which are points but not markers.
MODEL_OUTPUTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")

# Model outputs as named by Plug-in Gait.
_OUTPUT = re.compile(r".*[a-z](Angles?|Forces?|Moments?|Powers?)")


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
    rate_of_file_hz = frame_rate(header, parameters)
    segments = c3d_rotations.read_segments(path, header, parameters, rate_of_file_hz)
    if header.n_points:
        named, positions, of_points = _points(path, header, parameters, available)
    elif segments is not None and segments.names:
        named, positions, of_points = ((), ()), segments.origins[:, :0], ()
    else:
        raise RecordingError.at(path, "markers", _without_points(header, segments))
    if segments is not None and segments.names:
        named, positions = _joined(parameters, named, positions, segments)
        of_points += segments.remarks
    events, unread = read_events(parameters)
    first = head.first_frame(header, parameters)
    unit = parameters.texts("POINT", "UNITS")
    return raw.assembled(
        f"{path}: header",
        named,
        positions,
        number=first + np.arange(len(positions), dtype=float),
        unit=(parameters.place("POINT", "UNITS"), unit[0] if unit else ""),
        rates_hz=(rate_of_file_hz or None, rate_hz),  # 0 is no rate
        remarks=parameters.remarks + miscounted + of_points + unread,
        events=events or header.events,
        stated_up=_stated_up(parameters),
        plate_corners=_plate_corners(parameters),
    )


def _points(
    path: Path, header: C3dHeader, parameters: Parameters, available: int
) -> tuple[Named, FloatArray, tuple[raw.Remark, ...]]:
    """Return names of the markers with remarks, positions (N, M, 3), and remarks."""
    n_zeros = head.zeros_at_end(path, header.data_start + available)
    n_frames, of_frames = head.count_frames(
        header, parameters, available, n_zeros=n_zeros
    )
    markers, kept, of_markers = _markers(parameters, header.n_points)
    numbers = _numbers(path, header, parameters, n_frames)
    positions, doubted = _positions(path, header, numbers, kept)
    return (markers, of_markers), positions, of_frames + doubted


def _without_points(header: C3dHeader, segments: c3d_rotations.Segments | None) -> str:
    """Return what a file without points holds."""
    if segments is not None:
        return "rotations of segments that never leave the origin"
    if header.n_analog:
        return "none, only analog channels; export the trajectories as well"
    return "none"


def _joined(
    parameters: Parameters,
    named: Named,
    positions: FloatArray,
    segments: c3d_rotations.Segments,
) -> tuple[Named, FloatArray]:
    """Return markers and the origins of segments behind them, with their positions."""
    place = parameters.place("ROTATION", "LABELS")
    if len(positions) != len(segments.origins):
        wanted = f"{len(positions)} frames of rotations as of points"
        raise RecordingError.at(place, wanted, len(segments.origins))
    markers, remarks = named
    origins = [f"{name} origin" if name in markers else name for name in segments.names]
    names, of_names = raw.distinct_names(place, [*markers, *origins])
    all_positions = np.concatenate([positions, segments.origins], axis=1)
    return (names, (*remarks, *of_names)), all_positions


def open_c3d(path: Path) -> tuple[C3dHeader, Parameters, int]:
    """Return header and parameters of a file, and the byte at which its data end."""
    with readable(path, is_text=False) as file:
        block = file.read(BLOCK)
        start = head.parameter_start(path, block)
        file.seek(start)
        section = file.read(MOST_PARAMETER_BYTES)
        size = os.fstat(file.fileno()).st_size
    parameters = head.read_parameters(path, _whole(section, block, start), start)
    header = head.read_c3d_header(block, parameters.processor)
    if not BLOCK <= header.data_start <= size:
        header = head.with_stated_start(header, parameters)
    if not BLOCK <= header.data_start <= size:
        wanted = f"to start between byte {BLOCK} and the end of the file (byte {size})"
        found = f"byte {header.data_start}"
        raise RecordingError.at(f"{path}, byte 16: data", wanted, found)
    if not np.isfinite(header.scale) or header.scale == 0:
        found = f"{header.scale:g}"
        place = f"{path}, byte 12: scale"
        raise RecordingError.at(place, "a number other than 0", found)
    # Rotations of segments follow the points and analog samples.
    rotations_at = c3d_rotations.start_of(parameters)
    if rotations_at is not None and header.data_start < rotations_at <= size:
        size = rotations_at
    return header, parameters, size


def _whole(section: bytes, block: bytes, start: int) -> bytes:
    """Return the parameter section without what follows it.

    Some writers count fewer blocks than they fill; the data begin where the section
    ends.
    """
    if len(section) < 4 or not section[2]:
        return section
    stated_bytes = section[2] * BLOCK
    processor = head.PROCESSORS.get(section[3], head.PROCESSORS[84])
    data_start = (head.unsigned(processor.whole(block)[8]) - 1) * BLOCK
    return section[: max(stated_bytes, data_start - start)]


def frame_rate(header: C3dHeader, parameters: Parameters) -> float:
    """Return the frame rate, Hz; that of the header and ``POINT:RATE`` must agree."""
    stated_hz = parameters.number("POINT", "RATE")
    if stated_hz is None or not stated_hz > 0:
        return header.rate_hz
    if not header.rate_hz > 0:
        return stated_hz
    if not abs(stated_hz - header.rate_hz) <= raw.RATE_TOLERANCE * abs(stated_hz):
        place = parameters.place("POINT", "RATE")
        wanted = f"{header.rate_hz:g} Hz as in the header"
        raise RecordingError.at(place, wanted, f"{stated_hz:g} Hz")
    return stated_hz


def _markers(
    parameters: Parameters, n_points: int
) -> tuple[tuple[str, ...], list[int] | slice, tuple[raw.Remark, ...]]:
    """Return the names and indices of the points that are markers, and remarks."""
    place = parameters.place("POINT", "LABELS")
    labels = parameters.texts("POINT", "LABELS")[:n_points]
    labels += [""] * (n_points - len(labels))
    outputs = _model_outputs(parameters, labels)
    no_outputs = [i for i, label in enumerate(labels) if label not in outputs]
    if not no_outputs:
        found = f"model outputs only ({listed(labels)})"
        raise RecordingError.at(place, "markers", found)
    labelled, unlabelled = raw.labelled(place, [labels[i] for i in no_outputs])
    kept = [no_outputs[i] for i in labelled]
    kept_labels = [labels[i] for i in kept]
    markers, remarks = raw.distinct_names(place, kept_labels, may_lack=True)
    if len(kept) == n_points:
        return markers, slice(None), remarks
    remarks += unlabelled
    n_outputs = n_points - len(no_outputs)
    if n_outputs:
        names = listed([label for label in labels if label in outputs])
        left_out = f"{n_outputs} model outputs are no markers and left out: {names}"
        remarks += (f"{place}: {left_out}",)
    return markers, kept, remarks


def _model_outputs(parameters: Parameters, labels: list[str]) -> set[str]:
    outputs = {label for label in labels if _OUTPUT.fullmatch(label)}
    for key in MODEL_OUTPUTS:
        outputs |= set(parameters.texts("POINT", key))
    return outputs - {""}


def _stated_up(parameters: Parameters) -> str:
    """Return the axis that points up on the screen, if it is one of x, y, z."""
    axes = parameters.texts("POINT", "Y_SCREEN")
    if axes and axes[0].upper() in ("+X", "+Y", "+Z"):
        return axes[0][1].lower()
    return ""


def _plate_corners(parameters: Parameters) -> FloatArray:
    """Return the corners of the force plates as stored, (P, 4, 3)."""
    try:
        numbers = parameters.numbers("FORCE_PLATFORM", "CORNERS")
    except RecordingError:  # text; whoever wants the forces is told
        numbers = []
    n_whole = len(numbers) - len(numbers) % 12
    return np.array(numbers[:n_whole]).reshape(-1, 4, 3)


def _numbers(
    path: Path, header: C3dHeader, parameters: Parameters, n_frames: int
) -> NDArray[Any]:
    """Return the file's numbers, a row per frame: four a point, then analog samples."""
    stored = np.asarray(
        np.memmap(path, dtype=np.uint8, mode="r", offset=header.data_start)
    )
    data = stored[: n_frames * header.frame_bytes]
    processor = parameters.processor
    # A scale below 0 marks floats.
    if header.scale < 0:
        numbers: NDArray[Any] = processor.floats(data)
    else:
        numbers = processor.whole(data)
    return numbers.reshape(n_frames, -1)


# Residual of a point that was not seen; as an unsigned word it is 65,535.
UNSEEN_WORD = -1

# Words below it are a residual beside a mask of eight cameras, and not -1.
EIGHT_CAMERAS = -256


def _positions(
    path: Path, header: C3dHeader, numbers: NDArray[Any], kept: list[int] | slice
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return positions (N, M, 3) of some points, NaN where unseen, and remarks."""
    points = numbers[:, : 4 * header.n_points].reshape(len(numbers), header.n_points, 4)
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        positions = points[:, kept, :3].astype(np.float64)
        unseen, remarks = _unseen(path, points[:, :, 3])
    positions[unseen[:, kept]] = np.nan
    if header.scale > 0:
        positions *= header.scale
    return positions, remarks


def _unseen(
    path: Path, words: NDArray[Any]
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Tell which points their residual words (N, M) mark as unseen, with remarks.

    The format's word holds the residual in its lower byte and a mask of seven cameras
    in the upper one; below 0 it marks an unseen point. Two habits differ. Some programs
    write a word below 0 for each point of a file. Others mask eight cameras, which sets
    the sign of a good point; the word -1, or 65,535 without a sign, still marks an
    unseen one.
    """
    if not (words >= 0).any():
        ignored = "all residuals are below 0, as for unseen points; they are ignored"
        return np.zeros(words.shape, bool), (f"{path}: {ignored}",)
    unseen = ~(words >= 0) | (words == UNSEEN_WORD % 65536)
    is_below_mask = words < EIGHT_CAMERAS
    if not is_below_mask.any():
        return unseen, ()
    is_word = (words >= -32768) & (words % 1 == 0)
    masked = is_below_mask & is_word
    unseen &= ~masked
    count = f"{masked.sum()} of {masked.size} residual words"
    why = f"are below {EIGHT_CAMERAS}, as with a mask of eight cameras"
    return unseen, (f"{path}: {count} {why}; these points count as seen",)


def read_events(parameters: Parameters) -> tuple[tuple[Event, ...], tuple[str, ...]]:
    """Return the events of the group ``EVENT``, and remarks.

    They are labels with times in minutes and seconds. Markers do not depend on them, so
    inconsistent events are skipped rather than refused.
    """
    used = parameters.count("EVENT", "USED")
    labels = parameters.texts("EVENT", "LABELS")
    times = parameters.numbers("EVENT", "TIMES")
    contexts = parameters.texts("EVENT", "CONTEXTS") or [""] * len(labels)
    are_enough = 0 <= used <= min(len(labels), len(contexts), len(times) // 2)
    if not are_enough or not np.isfinite(times[: 2 * used]).all():
        counts = f"{len(labels)} labels, {len(contexts)} contexts"
        found = f"{counts} and {len(times) / 2:g} times; none is read"
        place = parameters.place("EVENT", "USED")
        return (), (mismatch(place, f"{used} events", found),)
    events = []
    minutes = times[::2]
    seconds = times[1::2]
    for i in range(used):
        name = f"{contexts[i]} {labels[i]}".strip()
        events.append(Event(name, 60 * minutes[i] + seconds[i]))
    return tuple(events), ()


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
    found: Analogs = door.read(
        f"{__name__}:analogs_here",
        Path(path),
        place=path,
        n_bytes=door.size_of(path),
        reader="the reader of .c3d files",
        kinds=(Analogs,),
    )
    return found


def analogs_here(path: Path) -> Analogs:
    """Read the analog channels in this process; `read_analogs` has another do so."""
    header, parameters, size = open_c3d(path)
    n_channels = _channels_of(header, parameters)
    available = size - header.data_start
    header, _ = head.settle_points(header, parameters, available)
    n_zeros = head.zeros_at_end(path, size)
    n_frames, _ = head.count_frames(header, parameters, available, n_zeros=n_zeros)
    per_frame = header.n_analog // n_channels
    rate_hz = frame_rate(header, parameters)
    if not rate_hz > 0:
        place = parameters.place("POINT", "RATE")
        raise RecordingError.at(place, "a rate above 0 Hz", f"{rate_hz:g} Hz")
    numbers = _numbers(path, header, parameters, n_frames)
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        stored = numbers[:, 4 * header.n_points :].astype(float)
    formats = parameters.texts("ANALOG", "FORMAT")
    is_unsigned = bool(formats) and formats[0].upper() == "UNSIGNED"
    if is_unsigned:
        offsets = parameters.unsigned_numbers("ANALOG", "OFFSET")
        if header.scale > 0:
            stored = np.where(stored < 0, stored + 65536, stored)
    else:
        offsets = parameters.numbers("ANALOG", "OFFSET")
    stored = stored.reshape(n_frames * per_frame, n_channels)
    offset = _per_channel(parameters, "OFFSET", offsets, n_channels, default=0.0)
    scales = parameters.numbers("ANALOG", "SCALE")
    scale = _per_channel(parameters, "SCALE", scales, n_channels, default=1.0)
    general_scale = parameters.number("ANALOG", "GEN_SCALE")
    if general_scale is None:
        general_scale = 1.0
    with np.errstate(over="ignore", invalid="ignore"):  # no number stays none
        values = (stored - offset) * scale * general_scale
    first = (head.first_frame(header, parameters) - 1) * per_frame
    samples = first + np.arange(n_frames * per_frame)
    return Analogs(
        path,
        names=_texts(parameters, "LABELS", n_channels),
        units=_texts(parameters, "UNITS", n_channels),
        time=samples / (rate_hz * per_frame),
        values=values,
    )


def has_channels(path: Path) -> bool:
    """Tell whether a C3D file states analog channels."""
    header, parameters, _ = open_c3d(path)
    return bool(header.n_analog and parameters.number("ANALOG", "USED"))


def _channels_of(header: C3dHeader, parameters: Parameters) -> int:
    """Return the number of channels, by which the analog numbers of a frame divide."""
    place = parameters.place("ANALOG", "USED")
    n_channels = parameters.count("ANALOG", "USED")
    if not n_channels or not header.n_analog:
        raise RecordingError.at(place, "channels", "none")
    if header.n_analog % n_channels:
        wanted = f"a divisor of the {header.n_analog} analog numbers in each frame"
        raise RecordingError.at(place, wanted, n_channels)
    return n_channels


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
    if not found:
        return np.full(n_channels, default)
    return np.array(found[:n_channels], dtype=np.float64)


def _texts(parameters: Parameters, name: str, n_channels: int) -> tuple[str, ...]:
    found = [text.strip() for text in parameters.texts("ANALOG", name)[:n_channels]]
    return tuple(found + [""] * (n_channels - len(found)))
