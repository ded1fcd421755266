"""A file read and measured: unit, axes and rate are guessed if not given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hopdata.errors import RecordingError
from hopdata.landings.role_guesses import guessed_roles

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection
    from hopdata.recordings.quality.roles import Roles
    from hopdata.recordings.raw import RateUnknownError, RawRecording

# Rate with which a file is read to guess its rate.
_ANY_RATE_HZ = 100.0


def inspected_file(
    file: str | Path,
    *,
    unit: str | None = None,
    vertical_axis: str | None = None,
    rate_hz: float | None = None,
    progress: Callable[[str], None] = lambda _what: None,
) -> Inspection:
    """Read and measure a file; what is given of it overrides the guesses.

    Parameters
    ----------
    file : path
        A recording of any known format.
    unit, vertical_axis, rate_hz
        What is known of it; the rate in Hz.
    progress : callable
        Called with what begins.
    """
    from hopdata.recordings.quality.inspection import inspect_recording
    from hopdata.recordings.raw import RateUnknownError
    from hopdata.recordings.readers.formats import read_raw

    try:
        raw = read_raw(file, rate_hz=rate_hz)
    except RateUnknownError as error:
        raw = read_raw(file, rate_hz=_ANY_RATE_HZ)
        raise _with_likely_rate(error, raw) from None
    _require_likely_unit(file, unit, raw)
    inspection = inspect_recording(
        raw, unit=unit, up=vertical_axis, rate_hz=rate_hz, progress=progress
    )
    return replace(inspection, place=f"{file}")


def _with_likely_rate(error: RateUnknownError, raw: RawRecording) -> RecordingError:
    """Return the error with the two likeliest rates, by how the markers fall."""
    from hopdata.recordings.quality.frame_rate import guess_rate
    from hopdata.recordings.quality.orientation import choose_unit

    unit = choose_unit(raw.positions, unit="auto", nominal=raw.unit)
    rate = guess_rate(raw, unit, is_stated=False)
    message = f"{error}; {rate.reason}"
    if rate.value:
        message += f": --rate {rate.value} or {rate.other}?"
    return RecordingError(message)


def _require_likely_unit(file: str | Path, unit: str | None, raw: RawRecording) -> None:
    """Refuse a unit in which the recording would be of an impossible size."""
    from hopdata.recordings.quality.orientation import choose_unit
    from hopdata.recordings.raw import METRES_PER_UNIT
    from hopdata.scale import extent

    nominal = unit or raw.unit
    likely = choose_unit(raw.positions, unit="auto", nominal=nominal)
    if unit and unit != likely:
        size_m = METRES_PER_UNIT[likely] * extent(raw.positions)
        wanted = f"{likely}, in which the markers span {size_m:.3g} m"
        raise RecordingError.at(f"{file}: --unit", wanted, unit)


# What a recording's processing does, in ms and mm.


def with_effects(inspection: Inspection, roles: Roles | None = None) -> Inspection:
    """Add what processing and soft tissue do to contacts and states of guessed roles.

    Nothing is added if there are no such signs, if roles could not be guessed, or if
    the frames have no order in time, of which the inspection tells.

    Parameters
    ----------
    inspection : Inspection
        The recording.
    roles : Roles, optional
        As guessed before.
    """
    from hopdata.landings.effects import Methods, effects

    try:
        roles = roles or guessed_roles(inspection)
        if roles.problems:
            return inspection
        recording = inspection.recording(roles.feet, roles.body)
    except RecordingError:
        return inspection
    joined = [{"name": name, "markers": own} for name, own in roles.joined.items()]
    found = effects(recording, Methods(feet=joined))
    return replace(inspection, treated=(*inspection.treated, *found))
