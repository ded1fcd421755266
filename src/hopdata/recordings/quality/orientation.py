"""Guess the unit of a file and the axis that points up, each with its reason."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError, chosen, require_choice
from hopdata.messages import Message
from hopdata.recording import extent, sampled
from hopdata.recordings.axes import FILE_AXES, along
from hopdata.recordings.quality.frame_rate import rate_by_stamps
from hopdata.recordings.quality.free_fall import (
    UNITS_IN_M,
    FreeFall,
    free_fall,
    liveliness,
)
from hopdata.recordings.quality.guess import Guess
from hopdata.recordings.quality.rests import CLEARER, FLAT, flattest_direction
from hopdata.recordings.raw import METRES_PER_UNIT, RawRecording
from hopdata.recordings.wording import also

#: Smallest size of an animal or a robot with its markers.
#: Unit: m. Origin: chosen. The range spans a factor of less than 1000, so at most one
#: of mm and m can be plausible.
SMALLEST_M = 0.015

#: Largest size of an animal or a robot with its markers.
#: Unit: m. Origin: chosen. See `SMALLEST_M`.
LARGEST_M = 12.0

#: Ratio of the frames in free fall to those in the next best unit.
#: Unit: 1. Origin: chosen.
UNIT_CLEARER = 2.0

#: Least acceleration of a running, walking or hopping animal: of the median marker, in
#: the fastest tenth of the time. In a unit that is ten times too small it hardly moves.
#: Unit: m/s². Origin: chosen.
LEAST_LIVELY_M_S2 = 5.0

#: Largest acceleration of such an animal.
#: Unit: m/s². Origin: chosen.
MOST_LIVELY_M_S2 = 100.0

#: How many times farther the body is from its feet along the vertical than along any
#: other axis.
#: Unit: 1. Origin: measured. In 19 public recordings of standing, walking, running and
#: a serve it is 3.9 times or more. At 1.5 times as much all of them are still sure.
UPRIGHT = 2.0

UNITS = ("auto", *METRES_PER_UNIT)
UPWARD = ("auto", *FILE_AXES)

# Names of markers by role.
Markers = Mapping[str, Sequence[str]]


# The unit of a file's positions: given, stated or guessed from their size.


def choose_unit(positions: FloatArray, *, unit: str, nominal: str) -> str:
    """Choose the unit as given; ``"auto"`` takes the format's unless only another fits.

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
    for one, metres in METRES_PER_UNIT.items():
        if _is_plausible(size * metres):
            return one
    return nominal


def _is_plausible(size_m: float) -> bool:
    """Tell whether an animal or a robot can have this size."""
    return SMALLEST_M <= size_m <= LARGEST_M


def speak_for_silent(
    files: Sequence[str], pieces: Sequence[RawRecording], unit: str
) -> list[RawRecording]:
    """Give files without a stated unit the unit of the others, if those agree on one.

    Parameters
    ----------
    files, pieces
        Names of a recording's files and what was read from each.
    unit : {"auto", "m", "mm"}
        ``input.unit`` of the configuration.

    Raises
    ------
    RecordingError
        If no unit is given and the size of a file without one contradicts the unit of
        the others.
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
            raise RecordingError.at(
                f"{file}: unit",
                f"{theirs} as in {files[first]}",
                f"no unit, and markers whose distances fit {own} only; "
                "files joined in one recording must agree",
            )
    return [replace(piece, unit=nominal) for piece in pieces]


def unit_remarks(
    files: Sequence[str], pieces: Sequence[RawRecording], raw: RawRecording, taken: str
) -> tuple[Message, ...]:
    """Remark that the unit is a guess: the files state none, or an impossible one.

    Parameters
    ----------
    files, pieces
        Names of a recording's files and what was read from each.
    raw : RawRecording
        The whole recording.
    taken : {"m", "mm"}
        The unit that `choose_unit` chose for ``"auto"``.

    Returns
    -------
    tuple of Message
        One for files that state no unit and one for files that are overruled, each with
        the reason and the key that settles it; none if all files state `taken`.
    """
    silent = []
    stating = []
    for file, piece in zip(files, pieces, strict=True):
        if piece.unit_is_stated:
            stating.append(file)
        else:
            silent.append(file)
    remarks = []
    if silent:
        values = {"files": _first_of(silent), "taken": _taken(raw, taken)}
        remarks.append(Message("recordings.unit_not_stated", values))
    if stating and taken != raw.unit:
        stated = {
            "files": _first_of(stating),
            "taken": _taken(raw, taken),
            "unit": raw.unit,
            "size_m": extent(raw.positions) * METRES_PER_UNIT[raw.unit],
        }
        remarks.append(Message("recordings.unit_impossible", stated))
    return tuple(remarks)


def _first_of(files: Sequence[str]) -> Message:
    """Return the first file and how many more there are."""
    if len(files) == 1:
        return Message("recordings.one_file", {"first": files[0]})
    values = {"first": files[0], "more": len(files) - 1}
    return Message("recordings.more_files", values)


def _taken(raw: RawRecording, unit: str) -> Message:
    """Report which unit was taken, the evidence for it and how to settle it."""
    size_m = extent(raw.positions) * METRES_PER_UNIT[unit]
    fall = free_fall(raw.positions, raw.rate_hz, units=METRES_PER_UNIT)
    if not _is_plausible(size_m):
        reason = Message("recordings.unit_taken_usual")
    elif fall.is_clear and fall.unit == unit:
        values = {"size_m": size_m, "percent": 100 * fall.share}
        reason = Message("recordings.unit_taken_by_fall", values)
    else:
        reason = Message("recordings.unit_taken_by_size", {"size_m": size_m})
    return Message("recordings.unit_taken", {"unit": unit, "reason": reason})


# The unit and the direction that points up, from the data.


def guess_unit_and_up(
    raw: RawRecording,
    *,
    unit: str | None = None,
    up: str | None = None,
    markers: Markers | None = None,
) -> tuple[Guess, Guess]:
    """Guess the unit and the direction that points up.

    Parameters
    ----------
    raw : RawRecording
        As read.
    unit, up : str, optional
        Values given by the user, used as they are, except an `up` of ``"auto"``.
    markers : mapping, optional
        Names of the markers of the ``"body"`` and the ``"feet"``: a body is above its
        feet.

    Returns
    -------
    unit, up : Guess
        The unit ``"m"``, ``"mm"``, ``"cm"`` or ``"inch"``; the direction such as
        ``"z"``, ``"-y"``.
    """
    units: Mapping[str, float] = UNITS_IN_M
    if unit is not None:
        units = {unit: chosen("unit", unit, UNITS_IN_M)}
    raw = replace(raw, rate_hz=rate_by_stamps(raw))
    fall = free_fall(raw.positions, raw.rate_hz, units=units)
    as_given = Message("recordings.given")
    unit_guess = Guess(unit, as_given) if unit else _unit(raw, fall)
    if up is not None and up != "auto":
        return unit_guess, Guess(up, as_given)
    over = body_over_feet_in_file(raw, markers or {})
    return unit_guess, _up(raw, fall, over)


def choose_up(
    asked: str, source: str, raw: RawRecording, unit: str, markers: Markers
) -> tuple[str, tuple[Message, ...]]:
    """Choose the file's up direction, and return remarks on that choice.

    It is as asked, or for ``"auto"`` by the fall and the markers. `markers` names those
    of the ``"body"`` and the ``"feet"``.

    Raises
    ------
    RecordingError
        If the direction has to be found and the data do not show it clearly.
    """
    if asked != "auto":
        return asked, ()
    _, up = guess_unit_and_up(raw, unit=unit, markers=markers)
    if not up.is_sure:
        wanted = "a clear fall, or a body that is clearly above its feet"
        place = f"{source}: input.vertical_axis: auto"
        raise RecordingError.at(place, wanted, up.reason)
    values = {"source": source, "up": up.value, "reason": up.why}
    return up.value, (Message("recordings.up_found", values),)


def _unit(raw: RawRecording, fall: FreeFall) -> Guess:
    """Guess the unit by a clear fall, or by the size and the motion of the markers."""
    if fall.is_clear and fall.share > UNIT_CLEARER * fall.other_unit_share:
        code = "recordings.unit_by_fall"
        if raw.unit_is_stated and fall.unit != raw.unit:
            code = "recordings.unit_by_fall_not_stated"
        values = {"percent": 100 * fall.share, "unit": fall.unit}
        return Guess(fall.unit, Message(code, values))

    unit = choose_unit(raw.positions, unit="auto", nominal=raw.unit)
    moves_m_s2 = {}
    for one, metres in UNITS_IN_M.items():
        of_median = liveliness(raw.positions, raw.rate_hz, metres=metres)
        moves_m_s2[one] = metres * of_median
    lively = _lively_units(extent(raw.positions), moves_m_s2)
    size = _size_in(raw, unit)
    values = {"size": size, "acceleration": moves_m_s2[unit]}
    if unit in lively:
        return Guess(unit, Message("recordings.markers_move", values))
    if lively:
        other = lively[0]
    else:
        other = "cm" if unit == "mm" else "mm"
    nothing = Message(
        "recordings.nothing_falls_markers_move", {"acceleration": moves_m_s2[unit]}
    )
    return Guess(unit, also(size, nothing), is_sure=False, other=other)


def _lively_units(size: float, moves_m_s2: Mapping[str, float]) -> list[str]:
    """Return the units in which markers move as animals do, and are as far apart."""
    lively = []
    for unit, metres in UNITS_IN_M.items():
        moves = LEAST_LIVELY_M_S2 <= moves_m_s2[unit] <= MOST_LIVELY_M_S2
        if _is_plausible(size * metres) and moves:
            lively.append(unit)
    return lively


def _size_in(raw: RawRecording, unit: str) -> Message:
    """Return why a unit may be the file's, with the size of the recording in it."""
    if unit != raw.unit:
        why = Message("recordings.unit_absurd", {"unit": raw.unit})
    elif raw.unit_is_stated:
        why = Message("recordings.unit_of_the_format")
    else:
        why = Message("recordings.unit_usual")
    size_m = extent(raw.positions) * UNITS_IN_M[unit]
    return also(why, Message("recordings.markers_span", {"size_m": size_m}))


def body_over_feet_in_file(raw: RawRecording, markers: Markers) -> FloatArray:
    """Return the mean body position minus the mean foot position, (3,), on file axes.

    It is the median over frames; NaN if no marker of the body, or none of the feet, is
    in the recording.
    """
    frames = sampled(raw.positions)
    places = []
    for role in ("body", "feet"):
        names = markers.get(role) or ()
        columns = [k for k, name in enumerate(raw.markers) if name in names]
        if not columns:
            return np.full(3, np.nan)
        places.append(frames[:, columns].mean(axis=1))
    body, feet = places
    offsets = body - feet
    offsets = offsets[np.isfinite(offsets).all(axis=1)]
    if not len(offsets):
        return np.full(3, np.nan)
    return np.asarray(np.median(offsets, axis=0))


def _upright(over: FloatArray) -> str:
    """Return the direction in which a body is clearly above its feet, or ""."""
    sizes = np.abs(over)
    order = np.argsort(sizes)
    largest = int(order[-1])
    if not sizes[largest] > UPRIGHT * sizes[order[-2]]:
        return ""
    axis = "xyz"[largest]
    if over[largest] > 0:
        return axis
    return f"-{axis}"


def _up(raw: RawRecording, fall: FreeFall, over: FloatArray) -> Guess:
    """Guess the direction that points up.

    Gravity is never wrong, so a clear fall decides. Then it is the body that is above
    its feet, unless the markers come to rest along another axis, or the file states
    another. `over` (3,) is the body's place over the feet, NaN if it is not known.
    """
    if fall.is_clear:
        values = {"percent": 100 * fall.share, "next_percent": 100 * fall.next_share}
        return Guess(fall.up, Message("recordings.up_by_fall", values))

    upright = _upright(over)
    flattest, flatness, following = flattest_direction(raw.positions)
    is_flat = flatness < FLAT and CLEARER * flatness < following
    if along(over, flattest) <= 0:  # someone who squats comes back to one height
        is_flat = False
    if is_flat and upright in ("", flattest):
        return Guess(flattest, Message("recordings.up_by_rest"))
    if upright and not is_flat and raw.stated_up in ("", upright):
        return Guess(upright, _body_is_above(over))
    if raw.stated_up and not upright:
        return Guess(raw.stated_up, Message("recordings.up_as_stated"))
    if upright:
        other = flattest if is_flat else raw.stated_up
        code = "recordings.up_by_body_but_stated"
        if is_flat:
            code = "recordings.up_by_body_but_rest"
        why = Message(code, {"other": other})
        return Guess(upright, why, is_sure=False, other=other)

    likely, other = ("y", "z") if flattest == "y" else ("z", "y")  # both are common
    usual = Message("recordings.up_usual", {"other": other})
    return Guess(likely, usual, is_sure=False, other=other)


def _body_is_above(over: FloatArray) -> Message:
    """Report that the body is above its feet, and how much more than beside them."""
    beside, above = np.sort(np.abs(over))[1:].tolist()
    if not beside > 0:
        return Message("recordings.up_by_body")
    return Message("recordings.up_by_body_far", {"times": above / beside})
