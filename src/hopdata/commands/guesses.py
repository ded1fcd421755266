"""What `inspect`, `view` and `init` guess from a file: unit, axes, rate and roles."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from hopdata.commands import terminal
from hopdata.errors import AnalysisError, RecordingError
from hopdata.messages import Message

if TYPE_CHECKING:
    from hopdata.landings.floor_surface import FloorModel
    from hopdata.recording import Recording
    from hopdata.recordings.quality.inspection import Inspection
    from hopdata.recordings.quality.roles import Roles
    from hopdata.recordings.raw import RateUnknownError, RawRecording

# Rate with which a file is read to guess its rate.
_ANY_RATE_HZ = 100.0


def inspected(options: argparse.Namespace) -> Inspection:
    """Read and measure the file of a command; its other options override the guesses.

    Parameters
    ----------
    options : Namespace
        With ``file``, ``unit``, ``vertical_axis``, ``rate`` and ``most_unpacked_mb``.
    """
    from hopdata.recordings.quality.inspection import inspect_recording
    from hopdata.recordings.raw import RateUnknownError
    from hopdata.recordings.readers.formats import read_raw

    limit_mb = options.most_unpacked_mb
    with terminal.progress_line(f"reading {options.file}") as progress:
        try:
            raw = read_raw(
                options.file, rate_hz=options.rate, most_unpacked_mb=limit_mb
            )
        except RateUnknownError as error:
            raw = read_raw(
                options.file, rate_hz=_ANY_RATE_HZ, most_unpacked_mb=limit_mb
            )
            raise _with_likely_rate(error, raw) from None
        _require_likely_unit(options, raw)
        return inspect_recording(
            raw,
            unit=options.unit,
            up=options.vertical_axis,
            rate_hz=options.rate,
            progress=progress,
        )


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


def _require_likely_unit(options: argparse.Namespace, raw: RawRecording) -> None:
    """Refuse a unit in which the recording would be of an impossible size."""
    from hopdata.recording import extent
    from hopdata.recordings.quality.orientation import choose_unit
    from hopdata.recordings.raw import METRES_PER_UNIT

    nominal = options.unit or raw.unit
    likely = choose_unit(raw.positions, unit="auto", nominal=nominal)
    if options.unit and options.unit != likely:
        size_m = METRES_PER_UNIT[likely] * extent(raw.positions)
        wanted = f"{likely}, in which the markers span {size_m:.3g} m"
        raise RecordingError.at(f"{options.file}: --unit", wanted, options.unit)


# Roles: guessed again on the levelled floor, where it slopes.

#: Largest error of a sloping floor that is used to find feet, at its rim.
#: Unit: 1, of the recording's scale. Origin: chosen.
ROUGH = 0.005

#: Factor on the rim of that floor, which extends beyond the feet that are known.
#: Unit: 1. Origin: chosen.
BEYOND_RIM = 1e3


def guessed_roles(inspection: Inspection) -> Roles:
    """Guess the roles; if a sloping floor may hide feet, again with it levelled."""
    from hopdata.landings.floor import level
    from hopdata.recordings.quality.roles import guess_roles
    from hopdata.recordings.quality.vocabulary import named_parts
    from hopdata.recordings.wording import also

    markers = inspection.markers
    roles = guess_roles(inspection)
    named = [markers[m] for m in named_parts(tuple(markers)).feet]
    feet = named if len(named) > 1 else list(roles.feet)
    while _feet_may_be_missing(feet, roles, markers):
        others = [name for name in markers if name not in feet]
        standing = inspection.recording(feet, others)
        floor = _sloping_floor(standing)
        if floor is None:
            return roles
        level_positions = level(standing, floor).positions
        again = guess_roles(replace(inspection, positions=level_positions))
        has_more_feet = set(roles.feet) < set(again.feet)
        if again.problems or not has_more_feet:
            return roles
        on_a_slope = Message("recordings.feet_on_a_slope")
        reason = again.reasons["feet"]
        again.reasons["feet"] = also(reason, on_a_slope) if reason else on_a_slope
        roles = again
        feet = list(roles.feet)
    return roles


def _feet_may_be_missing(
    feet: Sequence[str], roles: Roles, markers: Sequence[str]
) -> bool:
    """Tell whether a marker without a role may be a foot."""
    if not feet or len(feet) == len(markers):
        return False
    not_taken = set(feet) - set(roles.feet)
    return bool(not_taken or roles.reasons.get("unused"))


def _sloping_floor(standing: Recording) -> FloorModel | None:
    """Return the plane on which the feet stand; None if it is level or not known."""
    from hopdata.landings.floor import fit_floor

    largest_error_m = ROUGH * standing.scale
    try:
        floor = fit_floor(standing, degree=1, largest_error_m=largest_error_m)
    except AnalysisError:
        return None
    if not floor.slopes:
        return None
    return replace(floor, rim_m=BEYOND_RIM * floor.rim_m)


# What a recording's processing does, in ms and mm.


def with_effects(inspection: Inspection) -> Inspection:
    """Add what processing and soft tissue do to contacts and states of guessed roles.

    Nothing is added if there are no such signs, or roles could not be guessed.
    """
    from hopdata.landings.effects import effects

    roles = guessed_roles(inspection)
    if roles.problems:
        return inspection
    found = effects(inspection.recording(roles.feet, roles.body))
    return replace(inspection, treated=(*inspection.treated, *found))
