"""Vertical forces under the feet, from a text table or the analog channels of a C3D file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.errors import RecordingError, chosen
from hopdata.recordings.columns import ColumnTable, FloatArray, open_table
from hopdata.recordings.external import Column, ForceSignal, columns_of

NEWTONS_PER_UNIT = {"N": 1.0, "kN": 1000.0, "body_weight": 1.0}
LEAST_RATE_HZ = 50.0  # below it an onset is not known to better than a camera knows it
RATE_TOLERANCE = 1e-3  # relative


def read_force_signals(options: Mapping[str, Any], *, feet: Sequence[str]) -> list[ForceSignal]:
    """Read the forces that a recording's block ``forces`` names.

    Parameters
    ----------
    options : mapping
        ``recordings[].forces`` of the configuration: file, columns, time_column, rate_hz, unit,
        inverted, offset_s, and the threshold, which is passed on.
    feet : sequence of str
        Feet of the recording.

    Returns
    -------
    list of ForceSignal
        One a column, upward force positive, on the recording's clock.

    Raises
    ------
    RecordingError
        Naming the file, the column, what was expected and what was found.
    """
    path = Path(options["file"])
    columns = columns_of(options["columns"], feet)
    if path.suffix.lower() == ".c3d":
        return _analog_signals(path, columns, options)
    table = open_table(path)
    forces = {column.name: table.numbers(column.name) for column in columns}
    time = _times(table, options, len(forces[columns[0].name])) + options["offset_s"]
    return [_signal(path, column, time, forces[column.name], options) for column in columns]


def _analog_signals(
    path: Path, columns: Sequence[Column], options: Mapping[str, Any]
) -> list[ForceSignal]:
    """Read forces from analog channels of a C3D file, which has its own clock and units."""
    from hopdata.recordings.c3d_analogs import read_analogs

    analogs = read_analogs(path)
    if options["rate_hz"] is not None:
        _check_times(f"{path}: analog rate", analogs.time, options["rate_hz"])
    signals = []
    for column in columns:
        force, unit = analogs.channel(column.name)
        if unit in NEWTONS_PER_UNIT and unit != options["unit"]:
            raise RecordingError(
                f"{path}: channel '{column.name}': expected forces.unit: {unit} as the file "
                f"states, found {options['unit']}"
            )
        time = analogs.time + options["offset_s"]
        signals.append(_signal(path, column, time, force, options))
    return signals


def _times(table: ColumnTable, options: Mapping[str, Any], n_samples: int) -> FloatArray:
    """Time of each sample from the start of the file's clock, (K,), s."""
    rate, name = options["rate_hz"], options["time_column"]
    if name is None and rate is None:
        raise RecordingError(
            f"{table.path}: forces.rate_hz: expected the samples' rate or forces.time_column, "
            "found neither"
        )
    if name is None:
        return np.arange(n_samples) / float(rate)
    time = table.numbers(name)
    _check_times(f"{table.path}, column '{name}'", time, rate)
    return time


def _check_times(place: str, time: FloatArray, rate: float | None) -> None:
    steps = np.diff(time)
    if len(time) < 2 or not (steps > 0).all():
        bad = int(np.flatnonzero(~(steps > 0))[0]) if len(time) > 1 else 0
        raise RecordingError(
            f"{place}: expected times in s that increase from row to row, found otherwise "
            f"at line {bad + 3}"
        )
    found = 1 / float(np.median(steps))
    if rate is not None and abs(found / rate - 1) > RATE_TOLERANCE:
        raise RecordingError(
            f"{place}: expected steps of {1 / rate:.6g} s as forces.rate_hz: {rate:g} says, "
            f"found {1 / found:.6g} s ({found:.6g} Hz)" + _counting(found)
        )
    if found < LEAST_RATE_HZ:
        raise RecordingError(
            f"{place}: expected at least {LEAST_RATE_HZ:g} samples a second, "
            f"found {found:.6g}{_counting(found)}"
        )


def _counting(rate: float) -> str:
    if rate != 1:
        return ""
    return "; a column that counts samples is no time: leave it out and give forces.rate_hz"


def _signal(
    path: Path, column: Column, time: FloatArray, force: FloatArray, options: Mapping[str, Any]
) -> ForceSignal:
    newtons = chosen("forces.unit", options["unit"], NEWTONS_PER_UNIT)
    upward = force * newtons * (-1.0 if options["inverted"] else 1.0)
    place = f"{path}: column '{column.name}'"
    if len(upward) < 2 or np.isnan(upward).all():
        raise RecordingError(f"{place}: expected a force in each row, found none")
    low, high = np.nanquantile(upward, [0.02, 0.98])
    if -low > high:
        raise RecordingError(
            f"{place}: expected the upward force on the feet to be positive, found {low:.4g} to "
            f"{high:.4g}; set forces.inverted: {str(not options['inverted']).lower()}"
        )
    unit = "body_weight" if options["unit"] == "body_weight" else "N"
    return ForceSignal(column, time, upward, unit, options)
