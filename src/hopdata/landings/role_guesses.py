"""Roles of a recording's markers: those of the file, or guessed, on a level floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from hopdata.errors import AnalysisError
from hopdata.messages import Message

if TYPE_CHECKING:
    from hopdata.landings.floor_surface import FloorModel
    from hopdata.recording import Recording
    from hopdata.recordings.quality.guess import Guess
    from hopdata.recordings.quality.inspection import Inspection
    from hopdata.recordings.quality.roles import Roles
    from hopdata.recordings.raw import RawRecording

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


def roles_in_file(raw: RawRecording) -> dict[str, list[str]]:
    """Return the markers of the ``"feet"`` and the ``"body"`` that a file states.

    Empty if it does not state both.
    """
    roles = {}
    for key, role in (("feet", "foot"), ("body", "body")):
        pairs = zip(raw.markers, raw.roles, strict=False)
        roles[key] = [name for name, own in pairs if own == role]
    if not all(roles.values()):
        return {}
    return roles


def open_questions(inspection: Inspection, roles: Roles) -> list[Message]:
    """Ask about what is unsure of roles and axis, each with its two candidates."""
    questions = list(roles.problems)
    for role, other in roles.unsure.items():
        guessed = ", ".join(getattr(roles, role))
        values = {"role": role, "guessed": guessed, "other": other}
        questions.append(Message("landings.which_markers", values))
    if not inspection.up.is_sure:
        questions.append(which_axis(inspection.up))
    return questions


def which_axis(up: Guess) -> Message:
    """Ask which of two directions points up."""
    values = {"value": up.value, "other": up.other, "reason": up.why}
    return Message("landings.which_axis", values)
