"""The unit of a file and the axis that points up, each with the reason for it."""

from __future__ import annotations

from dataclasses import dataclass

from hopdata.errors import chosen
from hopdata.recordings.length_unit import choose_unit
from hopdata.recordings.plausibility import PLAUSIBLE_EXTENT_M
from hopdata.recordings.quality.free_fall import UNITS_IN_M, FreeFall, free_fall
from hopdata.recordings.quality.resting import CLEARER, FLAT, flattest_direction
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.span import extent


@dataclass(frozen=True)
class Guess:
    """A value and why it is believed.

    Parameters
    ----------
    value : str
        The value.
    reason : str
        A phrase for the user.
    is_sure : bool
        Whether the data speak for it; otherwise it is only what is usual.
    """

    value: str
    reason: str
    is_sure: bool = True


def guess_unit_and_up(
    raw: RawRecording, *, unit: str | None = None, up: str | None = None
) -> tuple[Guess, Guess]:
    """Guess the unit and the direction that points up.

    Parameters
    ----------
    raw : RawRecording
        As read.
    unit, up : str, optional
        Given by the user: taken as they are.

    Returns
    -------
    unit, up : Guess
        The unit ``"m"``, ``"mm"``, ``"cm"`` or ``"inch"``; the direction as ``"z"`` or ``"-y"``.
    """
    units = UNITS_IN_M if unit is None else {unit: chosen("unit", unit, UNITS_IN_M)}
    fall = free_fall(raw.positions, raw.rate_hz, units=units)
    return (
        Guess(unit, "as given") if unit else _unit(raw, fall),
        Guess(up, "as given") if up else _up(raw, fall),
    )


def _unit(raw: RawRecording, fall: FreeFall) -> Guess:
    if fall.is_clear:
        return Guess(
            fall.unit,
            f"in {100 * fall.share:.0f} % of the frames the markers fall at 9.81 m/s², "
            f"if the numbers are {fall.unit}",
        )
    unit = choose_unit(raw.positions, unit="auto", nominal=raw.unit)
    size = extent(raw.positions) * UNITS_IN_M[unit]
    low, high = PLAUSIBLE_EXTENT_M
    fits = low <= size <= high
    own = "the format's own unit" if raw.unit_is_stated else "usual, the file states none"
    why = own if unit == raw.unit else f"in {raw.unit} the size would be absurd"
    return Guess(unit, f"{why}; the markers span {size:.2f} m", is_sure=fits)


def _up(raw: RawRecording, fall: FreeFall) -> Guess:
    if fall.is_clear:
        return Guess(
            fall.up,
            f"the markers fall along it, in {100 * fall.share:.0f} % of the frames; "
            f"along the next best axis in {100 * fall.next_share:.1f} %",
        )
    direction, flatness, following = flattest_direction(raw.positions)
    if flatness < FLAT and CLEARER * flatness < following:
        return Guess(direction, "markers come to rest at their lowest along it, as on a floor")
    if raw.stated_up:
        return Guess(raw.stated_up, "the file says so; nothing falls freely that would show it")
    return Guess(
        "z", "nothing falls freely and nothing rests at a lowest place: only usual", is_sure=False
    )
