"""Trained processes on disk: one `.npz` file, written whole or not at all.

It holds the training data, the hyper-parameters and the table, and nothing that runs.
"""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import ConfigError, RecordingError
from hopdata.foreign.npz import arrays_of
from hopdata.jobs import whole_file
from hopdata.steering.models.kernels import SMOOTHNESSES
from hopdata.steering.models.process import N_CHANGE, FrameChangeProcess, has_table
from hopdata.steering.models.stride_table import StrideTable
from hopdata.steering.strides import StrideAxes

#: Training strides of a process that is read. Covariances grow as their square.
#: Unit: 1. Origin: chosen: its covariances take 600 MB. The printed model has 1,500.
MOST_POINTS = 5_000

#: Fewest nodes of an axis of a table.
#: Unit: 1. Origin: derived: of a cubic spline.
LEAST_NODES = 4

# Bytes of its file, and of each array: up to 20 numbers for each stride, and the table.
_MOST_BYTES = 256 * MOST_POINTS

_AXES = "axes"
_TABLE = "table"


def save_process(path: str | Path, process: FrameChangeProcess) -> None:
    """Write a process: its fields, its axes as JSON, and its table."""
    arrays = {name: getattr(process, name) for name in _numbers()}
    text = json.dumps(process.axes.as_dict())
    arrays[_AXES] = np.frombuffer(text.encode(), dtype=np.uint8)
    values = np.zeros((0, 0, N_CHANGE))
    if process.table is not None:
        values = process.table.values
    arrays[_TABLE] = values
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)


def _numbers() -> list[str]:
    """Return the names of the fields of a process that are numbers."""
    return [one.name for one in fields(FrameChangeProcess) if one.name != _AXES]


def load_process(path: str | Path) -> FrameChangeProcess:
    """Read a process that `save_process` wrote.

    Raises
    ------
    RecordingError
        If the file is missing or holds something else.
    """
    names = [_AXES, *_numbers(), _TABLE]
    wanted = f"a trained process with {', '.join(names)}"
    arrays: dict[str, Any] = arrays_of(path, names, wanted=wanted, most=_MOST_BYTES)
    try:
        text = arrays.pop(_AXES).astype(np.uint8).tobytes().decode()
        axes = StrideAxes.of_dict(json.loads(text))
        # Of any precision and order of bytes; what is too large is refused below.
        with np.errstate(over="ignore"):
            arrays = {name: array.astype(float) for name, array in arrays.items()}
        values = arrays.pop(_TABLE)
        arrays["smoothness"] = float(arrays["smoothness"])
        arrays["periodic"] = bool(arrays["periodic"])
        process = FrameChangeProcess(axes=axes, **arrays)
        _require_usable(process)
        table = _checked_table(values, process)
    except (ValueError, TypeError, KeyError, ConfigError) as error:
        raise RecordingError.at(path, wanted, f"another file: {error}") from error
    # As the cached property would keep it: what is stored need not be computed.
    vars(process)[_TABLE] = table
    return process


def _checked_table(
    values: FloatArray, process: FrameChangeProcess
) -> StrideTable | None:
    """Return the table of a file, which has one where the axes allow it.

    Raises
    ------
    ValueError
        If it has the wrong shape, or a number is not finite.
    """
    if not has_table(process.axes):
        return None
    is_sound = values.ndim == 3 and values.shape[2] == N_CHANGE
    if not is_sound or min(values.shape[:2]) < LEAST_NODES:
        raise ValueError(f"table: expected (A, S, 3), found {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError("table is not finite")
    table = StrideTable.evenly_spaced(process.axes, values)
    return replace(table, noise_sd=process.noise_sd)


def _require_usable(process: FrameChangeProcess) -> None:
    """Require numbers with which a process can predict.

    Raises
    ------
    ValueError
        If one is not finite, a scale is not above zero, or there are too many strides.
    """
    if process.smoothness not in SMOOTHNESSES:
        raise ValueError(f"smoothness {process.smoothness}")
    if not 0 < len(process.points) <= MOST_POINTS:
        raise ValueError(f"{len(process.points)} points, where 1 to {MOST_POINTS} fit")
    for name in _numbers():
        # The smoothness of the Gaussian kernel is infinite.
        is_finite = bool(np.isfinite(getattr(process, name)).all())
        if not is_finite and name != "smoothness":
            raise ValueError(f"{name} is not finite")
    for name in ("unit", "variance", "noise", "length_scales"):
        if not (getattr(process, name) > 0).all():
            raise ValueError(f"{name} is not above zero")
