"""The unit of a file's positions: as given, as stated or by their size, and what is said of it."""

from __future__ import annotations

from collections.abc import Sequence

from hopdata.recordings.plausibility import PLAUSIBLE_EXTENT_M
from hopdata.recordings.quality.free_fall import free_fall
from hopdata.recordings.raw import METRES_PER_UNIT, FloatArray, RawRecording
from hopdata.recordings.span import extent


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
    if unit != "auto":
        return unit
    size = extent(positions)
    fitting = [u for u, metres in METRES_PER_UNIT.items() if _fits(size * metres)]
    return fitting[0] if fitting else nominal


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
        One line with the reason and the key that settles it; none if all files state `taken`.
    """
    silent = [file for file, piece in zip(files, pieces, strict=True) if not piece.unit_is_stated]
    if silent:
        found = "expected the file to state it, found none"
    elif taken != raw.unit:
        size = extent(raw.positions) * METRES_PER_UNIT[raw.unit]
        found = f"expected {raw.unit} as stated, found markers that would span {size:.3g} m in it"
    else:
        return ()
    return (f"{_listed(silent or files)}: unit: {found}; {_guess(raw, taken)}",)


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
