"""Guess the unit of a file and the axis that points up, each with its reason."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError, chosen, require_choice
from hopdata.messages import Message
from hopdata.recordings.axes import FILE_AXES
from hopdata.recordings.quality import evidence
from hopdata.recordings.quality.evidence import Evidence
from hopdata.recordings.quality.frame_rate import rate_by_stamps
from hopdata.recordings.quality.free_fall import (
    UNITS_IN_M,
    FreeFall,
    free_fall,
    liveliness,
)
from hopdata.recordings.quality.guess import Guess
from hopdata.recordings.quality.vocabulary import named_parts
from hopdata.recordings.raw import METRES_PER_UNIT, RawRecording
from hopdata.recordings.wording import also
from hopdata.scale import extent, sampled

# The key that settles what points up.
KEY_OF_AXIS = "input.vertical_axis"

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

#: Odds of the likeliest direction to the next, from which on it is sure.
#: Unit: nepers. Origin: derived: one sure guess in a hundred may be wrong.
SURE = float(np.log(100.0))

#: How much likelier one piece of evidence must find another direction to speak strongly
#: against the likeliest.
#: Unit: nepers. Origin: chosen. A probability ratio of 20.
STRONG = float(np.log(20.0))

#: The same from which on it is told though the likeliest is sure.
#: Unit: nepers. Origin: chosen. A probability ratio of 2.
WEAK = float(np.log(2.0))

#: Largest chance that a fall misleads which overrules all else.
#: Unit: 1. Origin: chosen. Between those of few and of most markers that fall.
FALL_DECIDES = 1e-4

#: Least stature of a person by the places of the markers, who may sit.
#: Unit: m. Origin: chosen. A child of a year is taller where it stands.
SHORTEST_M = 0.6

#: Largest stature of a person by the places of the markers.
#: Unit: m. Origin: chosen. Headgear and shoes are counted in.
TALLEST_M = 2.4

#: Stature of most people, if that must decide between units.
#: Unit: m. Origin: chosen.
USUAL_STATURE_M = 1.65

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
    if not unit and raw.unit_is_stated and unit_guess.value != raw.unit:
        unit_guess = replace(unit_guess, overrules=raw.unit)
    if up is not None and up != "auto":
        return unit_guess, Guess(up, as_given)
    return unit_guess, _up(up_evidence(raw, fall, markers or {}))


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
        raise RecordingError.at(place, wanted, up.reason, key=KEY_OF_AXIS)
    values = {"source": source, "up": up.value, "reason": up.why}
    return up.value, (Message("recordings.up_found", values),)


def _unit(raw: RawRecording, fall: FreeFall) -> Guess:
    """Guess the unit by a clear fall, or by the size and the motion of the markers."""
    tall = _units_by_stature(raw)
    falls = fall.is_clear and fall.share > UNIT_CLEARER * fall.other_unit_share
    # Jerks and wrong rates pass for falls in another unit than the one that the file
    # states and in which the person is as tall as people are.
    is_belied = raw.unit in tall and raw.unit_is_stated and fall.unit not in tall
    if falls and not is_belied:
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
    if unit in tall:
        values = {"size": size, "stature_m": tall[unit]}
        return Guess(unit, Message("recordings.unit_by_stature", values))
    if tall:
        other = min(tall, key=lambda one: abs(np.log(tall[one] / USUAL_STATURE_M)))
        values = {"size": size, "stature_m": tall[other], "other": other}
        why = Message("recordings.unit_but_stature", values)
        return Guess(unit, why, is_sure=False, other=other)
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


def _units_by_stature(raw: RawRecording) -> dict[str, float]:
    """Return the units in which a person is as tall as people are, and how tall, m.

    By the markers' names; empty if these do not tell of a whole person.
    """
    stature = _stature(raw.positions, raw.markers)
    tall = {}
    for unit, metres in UNITS_IN_M.items():
        if SHORTEST_M <= stature * metres <= TALLEST_M:
            tall[unit] = stature * metres
    return tall


def is_of_a_persons_size(positions: FloatArray, markers: Sequence[str]) -> bool:
    """Tell whether positions (N, M, 3), m, are of a person as tall as people are.

    By the markers' names; not if these do not tell of a whole person.
    """
    return SHORTEST_M <= _stature(positions, markers) <= TALLEST_M


def _stature(positions: FloatArray, markers: Sequence[str]) -> float:
    """Return a person's stature by the markers' names, in their unit, or NaN."""
    named = named_parts(tuple(markers))
    posture = evidence.posture_of(positions, named)
    if posture is None or not named.is_human or not posture.is_whole:
        return float("nan")
    return float(np.linalg.norm(posture.stature))


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


def up_evidence(
    raw: RawRecording, fall: FreeFall, markers: Markers
) -> tuple[Evidence, ...]:
    """Return all that speaks for or against each direction, one piece each.

    Parameters
    ----------
    raw : RawRecording
        As read, at its true rate.
    fall : FreeFall
        How much of it looks like free fall.
    markers : mapping
        Names of the markers of the ``"body"`` and the ``"feet"``, if given by the user.
    """
    named = named_parts(tuple(raw.markers))
    given = {}
    for role in ("body", "feet"):
        names = markers.get(role) or ()
        given[role] = [m for m, name in enumerate(raw.markers) if name in names]
    are_given = all(given.values())
    if not are_given:
        given = {"body": [], "feet": named.feet}
    over = _over_feet(raw.positions, given["feet"], given["body"])
    roles = given if are_given else {}
    posture = evidence.posture_of(raw.positions, named, **roles)
    pieces = [
        evidence.by_habit(raw.suffix),
        evidence.by_fall(fall),
        evidence.by_statement(raw.stated_up),
        evidence.by_plates(raw.plate_corners, raw.positions),
        evidence.by_rests(raw.positions, given["feet"], over),
        evidence.by_stance(raw.positions, raw.rate_hz),
        evidence.by_sides(raw.positions, named),
    ]
    found = [piece for piece in pieces if piece is not None]
    upright = evidence.by_posture(posture, named, given=are_given, others=found)
    if upright is not None:
        found.append(upright)
    return tuple(found)


def _over_feet(
    positions: FloatArray, feet: Sequence[int], body: Sequence[int]
) -> FloatArray:
    """Return the mean place of a body, or of all others, over the feet, (3,)."""
    others = list(body)
    if not others:
        others = [m for m in range(positions.shape[1]) if m not in feet]
    if not len(feet) or not others:
        return np.full(3, np.nan)
    frames = sampled(positions)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without any marker
        offsets = np.nanmean(frames[:, others], axis=1)
        offsets -= np.nanmean(frames[:, list(feet)], axis=1)
        return np.asarray(np.nanmedian(offsets, axis=0))


def _up(pieces: Sequence[Evidence]) -> Guess:
    """Guess the direction that points up: the likeliest by all evidence together.

    It is sure if its odds are high and if nothing strong speaks for another; only
    gravity, where most markers fall, is never wrong.
    """
    chances = evidence.log_odds(pieces)
    up, other = sorted(chances, key=lambda one: -chances[one])[:2]
    told = [piece for piece in pieces if piece.kind != evidence.HABIT]
    found = tuple(piece.why for piece in told)
    for_it = [piece for piece in told if piece.best == up]
    contrary = _strongest_against(up, told)
    if contrary is not None:
        other = contrary.best
    for_it.sort(key=lambda piece: -piece.margin(up, other))
    reasons = [piece.why for piece in for_it]
    if contrary is not None:
        mine = also(*reasons) if reasons else Message("recordings.up_by_habit")
        values = {"reason": mine, "other": other, "against": contrary.why}
        why = Message("recordings.up_but", values)
    elif reasons and _is_sure(up, other, chances, told):
        return Guess(up, _despite(up, also(*reasons), told), evidence=found)
    elif reasons:
        values = {"reason": also(*reasons), "other": other}
        why = Message("recordings.up_rather", values)
        for_other = [piece.why for piece in pieces if piece.best == other]
        if for_other:
            values["against"] = also(*for_other)
            why = Message("recordings.up_or", values)
    else:
        why = Message("recordings.up_usual", {"other": other})
    return Guess(up, why, is_sure=False, other=other, evidence=found)


def _despite(up: str, reason: Message, told: Sequence[Evidence]) -> Message:
    """Return the reason for a sure direction, and what speaks weakly against it."""
    against = max(told, key=lambda piece: piece.margin(piece.best, up))
    if against.margin(against.best, up) < WEAK:
        return reason
    values = {"reason": reason, "other": against.best, "against": against.why}
    return Message("recordings.up_despite", values)


def _is_sure(
    up: str, other: str, chances: Mapping[str, float], told: Sequence[Evidence]
) -> bool:
    """Tell whether the odds are high, and not by the habit of a format alone."""
    by_data = sum(piece.margin(up, other) for piece in told)
    return bool(chances[up] - chances[other] >= SURE and by_data >= STRONG)


def _strongest_against(up: str, told: Sequence[Evidence]) -> Evidence | None:
    """Return the evidence that speaks strongly for another direction, if any does.

    It is overruled by a fall of most markers, and by two strong pieces of evidence.
    """
    contrary = max(told, key=lambda piece: piece.margin(piece.best, up), default=None)
    if contrary is None or contrary.margin(contrary.best, up) < STRONG:
        return None
    margins = [piece.margin(up, contrary.best) for piece in told]
    is_overruled = sum(margin >= STRONG for margin in margins) > 1
    if is_overruled or max(margins) > -np.log(FALL_DECIDES):
        return None
    return contrary
