"""Messages of this room that are made of others: chains, alternatives and counts."""

from collections.abc import Sequence

from hopdata.messages import Message


def also(first: Message, *more: Message) -> Message:
    """Return messages in sequence, separated by semicolons."""
    whole = first
    for then in more:
        whole = Message("recordings.also", {"first": whole, "then": then})
    return whole


def chained(
    several: Sequence[Message], link: str = "recordings.also"
) -> Message | None:
    """Return messages as one, linked by a template of two; None if there are none."""
    if not several:
        return None
    whole = several[0]
    for then in several[1:]:
        whole = Message(link, {"first": whole, "then": then})
    return whole


def frames(number: int) -> Message:
    """Return ``1 frame``, ``2 frames``."""
    if number == 1:
        return Message("recordings.one_frame")
    return Message("recordings.frames", {"number": number})


def listed(markers: Sequence[str]) -> Message:
    """Return the names of markers."""
    return Message("recordings.markers", {"markers": ", ".join(markers)})
