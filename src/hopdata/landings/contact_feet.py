"""Feet of recordings whose contacts are timed: as named, as marked, or as guessed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from hopdata.errors import AnalysisError, ArgumentError
from hopdata.messages import Message
from hopdata.recording import Recording, place_of
from hopdata.recordings.quality.part_names import SIDE_NAMES, sides_of_feet
from hopdata.recordings.wording import chained

# What may name feet.
Feet = Sequence[str] | Mapping[str, Iterable[str]] | Sequence[str | Mapping[str, Any]]
FEET_FORMS = (
    'a list of markers, the markers of each foot by its name, as {"left": ["LHEE", '
    '"LTOE"]}, or a list of {"name": ..., "markers": [...]}'
)


def named_feet(
    feet: Any,
) -> Mapping[str, Iterable[str]] | tuple[str, ...] | None:
    """Return feet of any form as `Recording.with_roles` takes them; None without any.

    Raises
    ------
    ArgumentError
        If they have another form.
    """
    if feet is None:
        return None
    if isinstance(feet, Mapping):
        return feet or None
    several = [*feet] if isinstance(feet, Iterable) and feet != "" else [feet]
    if isinstance(feet, str) or not all(
        isinstance(one, str | Mapping) for one in several
    ):
        raise ArgumentError.at("feet", FEET_FORMS, f"{feet!r}"[:60])
    if not several:
        return None
    if all(isinstance(one, str) for one in several):
        return tuple(several)
    found: dict[str, Iterable[str]] = {}
    for one in several:
        if isinstance(one, str):
            one = {"name": one, "markers": [one]}
        if set(one) != {"name", "markers"} or not isinstance(one["name"], str):
            raise ArgumentError.at("feet", FEET_FORMS, f"{one!r}"[:60])
        if one["name"] in found:
            raise ArgumentError.at("feet", "each name once", f"{one['name']!r}")
        found[one["name"]] = one["markers"]
    return found


def with_feet(
    recording: Recording, given: Mapping[str, Iterable[str]] | tuple[str, ...] | None
) -> tuple[Recording, list[Message]]:
    """Return a recording with these feet, or all its own; without any, guess them.

    Markers without a role are left out if roles are guessed. Of a recording without
    roles whose feet are named, the body is guessed, as by ``hopdata contacts --feet``.

    Raises
    ------
    AnalysisError
        If no foot is found.
    """
    if given is not None:
        named = recording.with_roles(feet=given)
        if recording.indices("foot") or recording.indices("body"):
            return named, []
        return _with_body(named), []
    if recording.indices("foot"):
        return recording, []
    from hopdata.landings.role_guesses import guessed_roles
    from hopdata.recordings.quality.every_foot import every_foot
    from hopdata.recordings.quality.inspection import inspect

    if len(recording.time) < 2 or not recording.markers:
        found = f"{len(recording.time)} frames of {len(recording.markers)} markers"
        raise AnalysisError.at(place_of(recording), "two frames or more", found)
    inspection = replace(inspect(recording), place=place_of(recording))
    roles = guessed_roles(inspection)
    every, joined = every_foot(inspection, roles)
    if not every:
        why = "; ".join(str(problem) for problem in roles.problems)
        values = {"place": place_of(recording), "why": why or "by names and motion"}
        raise AnalysisError(Message("landings.no_feet_for_contacts", values))
    foot_of = {marker: foot for foot, own in joined.items() for marker in own}
    body = recording.names("body") or roles.body
    with_roles = recording.with_roles(
        feet=every, body=[name for name in body if name not in every]
    )
    # The markers stay in the order of the file, as for the command.
    groups = tuple((foot, tuple(own)) for foot, own in joined.items())
    with_roles = replace(with_roles, joined=groups)
    kept = [*with_roles.names("body"), *with_roles.names("foot")]
    names = ", ".join(dict.fromkeys(foot_of.get(name, name) for name in every))
    values = {"place": place_of(recording), "role": "feet", "names": names}
    reason = _of_all_feet(roles.reasons.get("feet")) or ""
    remark = Message("landings.role_guessed", {**values, "reason": reason})
    return with_roles[kept], [remark]


def _of_all_feet(reason: Message | None) -> Message | None:
    """Return why feet were taken, without advice to study some on their own.

    A study compares feet that land together; here all of them are timed.
    """
    if reason is None or reason.code == "recordings.feet_in_between":
        return None
    if reason.code != "recordings.also":
        return reason
    parts = [_of_all_feet(reason.values[name]) for name in ("first", "then")]
    return chained([part for part in parts if part is not None])


def _with_body(recording: Recording) -> Recording:
    """Return a recording of named feet with the body that is guessed, if any."""
    from hopdata.landings.role_guesses import guessed_roles
    from hopdata.recordings.quality.inspection import inspect

    if len(recording.time) < 2:
        return recording
    roles = guessed_roles(replace(inspect(recording), place=place_of(recording)))
    feet = recording.names("foot")
    body = [name for name in roles.body if name not in feet]
    if not body:
        return recording
    with_body = recording.with_roles(body=body)
    return with_body[[*with_body.names("body"), *feet]]


def sides_of(feet: Sequence[str]) -> tuple[str, ...]:
    """Return ``"left"`` or ``"right"`` of each foot that the names tell; else empty."""
    sides = sides_of_feet(feet)
    return tuple(
        foot.lower()
        if foot.lower() in SIDE_NAMES.values()
        else SIDE_NAMES.get(side, "")
        for foot, side in zip(feet, sides, strict=True)
    )
