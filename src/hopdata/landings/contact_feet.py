"""Feet of recordings whose contacts are timed: as named, as marked, or as guessed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from hopdata.errors import AnalysisError, ArgumentError
from hopdata.messages import Message
from hopdata.recording import Recording, place_of
from hopdata.recordings.quality.part_names import SIDE_NAMES, sides_of_feet
from hopdata.recordings.wording import chained

if TYPE_CHECKING:
    from hopdata.recordings.quality.every_foot import GuessedFeet

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
    recordings: Sequence[Recording],
    given: Mapping[str, Iterable[str]] | tuple[str, ...] | None,
) -> list[tuple[Recording, list[Message]]]:
    """Return recordings with these feet, or all their own; without any, guess them.

    Markers without a role are left out if roles are guessed. Of a recording without
    roles whose feet are named, the body is guessed, as by ``hopdata contacts --feet``.
    Guesses are alike for recordings with the same markers.

    Returns
    -------
    list of (Recording, list of Message)
        Each with what is to be told of its feet.

    Raises
    ------
    AnalysisError
        If no foot is found.
    """
    ready: list[tuple[Recording, list[Message]]] = []
    unknown: dict[int, _Guess] = {}
    for number, recording in enumerate(recordings):
        known = recording
        if given is not None:
            known = recording.with_roles(feet=given)
            if not recording.indices("foot") and not recording.indices("body"):
                known = _with_body(known)
        elif not recording.indices("foot"):
            unknown[number] = _guess(recording)
        ready.append((known, []))
    if not unknown:
        return ready
    from hopdata.recordings.quality.every_foot import shared_feet

    shared = shared_feet([guess.feet for guess in unknown.values()])
    for (number, guess), feet in zip(unknown.items(), shared, strict=True):
        ready[number] = _with_guess(recordings[number], guess, feet)
    return ready


@dataclass(frozen=True)
class _Guess:
    """Feet and body of a recording, as guessed, and why these are its feet."""

    feet: GuessedFeet
    body: Sequence[str]
    reason: Message | str


def _guess(recording: Recording) -> _Guess:
    """Guess the roles of a recording's markers."""
    from hopdata.landings.role_guesses import guessed_roles
    from hopdata.recordings.quality.every_foot import GuessedFeet, every_foot
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
    return _Guess(
        GuessedFeet.of(recording.markers, every, joined),
        recording.names("body") or roles.body,
        _of_all_feet(roles.reasons.get("feet")) or "",
    )


def _with_guess(
    recording: Recording, guess: _Guess, feet: GuessedFeet
) -> tuple[Recording, list[Message]]:
    """Return a recording with guessed feet and the body of its own guess."""
    body = [name for name in guess.body if name not in feet.feet]
    with_roles = recording.with_roles(feet=feet.feet, body=body)
    # The markers stay in the order of the file, as for the command.
    with_roles = replace(with_roles, joined=feet.joined)
    kept = [*with_roles.names("body"), *with_roles.names("foot")]
    foot_of = {marker: foot for foot, own in feet.joined for marker in own}
    names = ", ".join(dict.fromkeys(foot_of.get(name, name) for name in feet.feet))
    values = {"place": place_of(recording), "role": "feet", "names": names}
    remark = Message("landings.role_guessed", {**values, "reason": guess.reason})
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
