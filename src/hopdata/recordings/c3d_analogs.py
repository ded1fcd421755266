"""Analog channels of a C3D file, such as the forces of a plate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.c3d import frame_rate, open_c3d
from hopdata.recordings.c3d_header import C3dHeader, count_frames, first_frame
from hopdata.recordings.c3d_parameters import Parameters
from hopdata.recordings.columns import FloatArray, listed


@dataclass(frozen=True)
class Analogs:
    """Analog channels, scaled, on the clock of the file's frames and events.

    Parameters
    ----------
    path : Path
        The file.
    names, units : tuple of str
        Label and unit of each of the C channels.
    time : (K,) array
        Time of each sample, s; the first frame is number 1 at 0 s.
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
            If no channel has this name, or several have.
        """
        n_found = self.names.count(name)
        if n_found != 1:
            found = f"found {n_found} of that name" if n_found else f"found no '{name}'"
            raise RecordingError(
                f"{self.path}: ANALOG:LABELS: expected '{name}' once among {listed(self.names)}, "
                f"{found}{'' if n_found else did_you_mean(name, self.names)}"
            )
        place = self.names.index(name)
        return self.values[:, place], self.units[place]


def read_analogs(path: str | Path) -> Analogs:
    """Read all analog channels of a C3D file.

    A channel's value is (stored - ``ANALOG:OFFSET``) x ``ANALOG:SCALE`` x ``ANALOG:GEN_SCALE``
    (C3D user guide).

    Parameters
    ----------
    path : path
        The ``.c3d`` file.

    Raises
    ------
    RecordingError
        Naming the file, the place in it, what was expected and what was found.
    """
    path = Path(path)
    header, parameters, size = open_c3d(path)
    n_channels = int(parameters.number("ANALOG", "USED") or 0)
    if not n_channels or not header.n_analog:
        raise RecordingError(f"{parameters.place('ANALOG', 'USED')}: expected channels, found none")
    if header.n_analog % n_channels:
        raise RecordingError(
            f"{parameters.place('ANALOG', 'USED')}: expected a divisor of the {header.n_analog} "
            f"analog numbers in each frame, found {n_channels}"
        )
    n_frames, _ = count_frames(header, parameters, size - header.data_start)
    per_frame = header.n_analog // n_channels
    stored = _stored(path, header, parameters, n_frames).reshape(n_frames * per_frame, n_channels)
    offset = _per_channel(parameters, "OFFSET", n_channels, default=0.0)
    scale = _per_channel(parameters, "SCALE", n_channels, default=1.0)
    general = parameters.number("ANALOG", "GEN_SCALE")
    start = first_frame(header, parameters) - 1
    samples = start * per_frame + np.arange(n_frames * per_frame)
    names, units = (_texts(parameters, key, n_channels) for key in ("LABELS", "UNITS"))
    return Analogs(
        path=path,
        names=names,
        units=units,
        time=samples / (frame_rate(header, parameters) * per_frame),
        values=(stored - offset) * scale * (1.0 if general is None else general),
    )


def _stored(path: Path, header: C3dHeader, parameters: Parameters, n_frames: int) -> FloatArray:
    """Analog numbers as they stand in the file, (N, n_analog)."""
    raw = np.asarray(np.memmap(path, dtype=np.uint8, mode="r", offset=header.data_start))
    data, processor = raw[: n_frames * header.frame_bytes], parameters.processor
    numbers: NDArray[Any] = processor.floats(data) if header.scale < 0 else processor.whole(data)
    values = numbers.reshape(n_frames, -1)[:, 4 * header.n_points :].astype(np.float64)
    unsigned = (parameters.texts("ANALOG", "FORMAT") or [""])[0].upper() == "UNSIGNED"
    return np.where(values < 0, values + 65536, values) if unsigned and header.scale > 0 else values


def _per_channel(
    parameters: Parameters, name: str, n_channels: int, *, default: float
) -> FloatArray:
    """One number a channel, (C,); the default where the file has none."""
    found = parameters.numbers("ANALOG", name)
    if found and len(found) < n_channels:
        raise RecordingError(
            f"{parameters.place('ANALOG', name)}: expected {n_channels} numbers, found {len(found)}"
        )
    return np.array(found[:n_channels] or [default] * n_channels, dtype=np.float64)


def _texts(parameters: Parameters, name: str, n_channels: int) -> tuple[str, ...]:
    found = [text.strip() for text in parameters.texts("ANALOG", name)[:n_channels]]
    return tuple(found + [""] * (n_channels - len(found)))
