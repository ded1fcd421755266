"""Messages about recordings that are made of others: chains, alternatives, counts."""

from collections.abc import Sequence

from hopdata.messages import Message


def also(first: Message, *more: Message) -> Message:
    """Return messages in sequence, separated by semicolons."""
    return _linked([first, *more], "recordings.also")


def chained(
    several: Sequence[Message], link: str = "recordings.also"
) -> Message | None:
    """Return any number of messages as one; None if there are none.

    `link` is the code of a message that puts ``then`` after ``first``.
    """
    if not several:
        return None
    return _linked(several, link)


def _linked(several: Sequence[Message], link: str) -> Message:
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
