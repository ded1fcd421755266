"""The unit of a file's positions: as given, as stated or by their size, and what is said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hopdata.errors import RecordingError, require_choice
from hopdata.recordings.plausibility import PLAUSIBLE_EXTENT_M
from hopdata.recordings.quality.free_fall import free_fall
from hopdata.recordings.raw import METRES_PER_UNIT, FloatArray, RawRecording
from hopdata.recordings.span import extent

UNITS = ("auto", *METRES_PER_UNIT)


def choose_unit(positions: FloatArray, *, unit: str, nominal: str) -> str:
    """Choose the unit: as given, or for ``"auto"`` the format's unless only another fits.

    Parameters
    ----------
    positions : (N, M, 3) array
        In the unknown unit.
    unit : {"auto", "m", "mm"}
        ``input.unit`` of the configuration.
    nominal : {"m", "mm"}
        The format's own unit.
    """
    require_choice("input.unit", unit, UNITS)
    if unit != "auto":
        return unit
    size = extent(positions)
    fitting = [u for u, metres in METRES_PER_UNIT.items() if _fits(size * metres)]
    return fitting[0] if fitting else nominal


def speak_for_silent(
    files: Sequence[str], pieces: Sequence[RawRecording], unit: str
) -> list[RawRecording]:
    """Give files that do not state their unit that of the others, if these agree on one.

    Parameters
    ----------
    files, pieces
        Names of a recording's files, and what was read from each.
    unit : {"auto", "m", "mm"}
        ``input.unit`` of the configuration.

    Raises
    ------
    RecordingError
        If none is given, and by its size a silent file has another unit than those that state it.
    """
    stating = [i for i, piece in enumerate(pieces) if piece.unit_is_stated]
    if len({pieces[i].unit for i in stating}) != 1:
        return list(pieces)
    first = stating[0]
    nominal = pieces[first].unit
    theirs = choose_unit(pieces[first].positions, unit=unit, nominal=nominal)
    for file, piece in zip(files, pieces, strict=True):
        own = choose_unit(piece.positions, unit=unit, nominal=nominal)
        if not piece.unit_is_stated and own != theirs:
            raise RecordingError(
                f"{file}: unit: expected {theirs} as in {files[first]}, found no unit, and markers "
                f"whose distances fit {own} only; files joined in one recording must agree"
            )
    return [replace(piece, unit=nominal) for piece in pieces]


def unit_remarks(
    files: Sequence[str], pieces: Sequence[RawRecording], raw: RawRecording, taken: str
) -> tuple[str, ...]:
    """Say that the unit is a guess: the files do not state it, or state one that cannot be.

    Parameters
    ----------
    files, pieces
        Names of a recording's files, and what was read from each.
    raw : RawRecording
        The whole recording.
    taken : {"m", "mm"}
        What `choose_unit` chose without being given a unit.

    Returns
    -------
    tuple of str
        A line for the files that are silent and one for those that are overruled, with the reason
        and the key that settles it; none if all files state `taken`.
    """
    silent = [file for file, piece in zip(files, pieces, strict=True) if not piece.unit_is_stated]
    stating = [file for file in files if file not in silent]
    faults = []
    if silent:
        faults.append((silent, "expected the file to state it, found none"))
    if stating and taken != raw.unit:
        size = extent(raw.positions) * METRES_PER_UNIT[raw.unit]
        found = f"expected {raw.unit} as stated, found markers that would span {size:.3g} m in it"
        faults.append((stating, found))
    return tuple(
        f"{_listed(named)}: unit: {found}; {_guess(raw, taken)}" for named, found in faults
    )


def _guess(raw: RawRecording, taken: str) -> str:
    """Say which unit was taken, what speaks for it and how to settle it."""
    size = extent(raw.positions) * METRES_PER_UNIT[taken]
    fall = free_fall(raw.positions, raw.rate_hz, units=METRES_PER_UNIT)
    reason = f"in which the markers span {size:.3g} m" if _fits(size) else "which is usual"
    if _fits(size) and fall.is_clear and fall.unit == taken:
        reason += f" and fall at 9.81 m/s² in {100 * fall.share:.0f} % of the frames"
    return f"taken for {taken}, {reason}; input.unit: {taken} makes it certain"


def _fits(size_m: float) -> bool:
    """Whether an animal or a robot can have this size."""
    low, high = PLAUSIBLE_EXTENT_M
    return low <= size_m <= high


def _listed(files: Sequence[str]) -> str:
    more = f" and {len(files) - 1} more" if len(files) > 1 else ""
    return f"{files[0]}{more}"
