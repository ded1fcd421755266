"""Why a touchdown is excluded: the reasons, and which of them the words of a table say.

The table of touchdowns holds a reason in words, for its readers. Code that has to know
the reason asks `reason_of`, and compares codes.
"""

from __future__ import annotations

from collections.abc import Sequence

from hopdata.errors import with_names
from hopdata.messages import Message

FOOT_HIDDEN = "landings.foot_hidden"
FOOT_THIN = "landings.foot_thin"
FOOT_UP = "landings.foot_up"
FOOT_DOWN_BEFORE = "landings.foot_down_before"
FOOT_POOR_FIT = "landings.foot_poor_fit"
FOOT_RISES = "landings.foot_rises"
FOOT_GLIDES = "landings.foot_glides"
FOOT_WITHOUT_CONTACT = "landings.foot_without_contact"
FOOT_UNDETERMINED = "landings.foot_undetermined"

HIDDEN_PRE = "landings.hidden_pre"
HIDDEN_POST = "landings.hidden_post"
NO_FOOT_LANDED = "landings.no_foot_landed"
LOW_FLIGHT = "landings.low_flight"
POST_NEVER_REACHED = "landings.post_never_reached"
ORDER_AMBIGUOUS = "landings.order_ambiguous"
TOO_MUCH_FILLED = "landings.too_much_filled"
STATELESS = "landings.stateless"

# These name a foot by its number, from 1 in the order of the recording.
OF_A_FOOT = (
    FOOT_HIDDEN,
    FOOT_THIN,
    FOOT_UP,
    FOOT_DOWN_BEFORE,
    FOOT_POOR_FIT,
    FOOT_RISES,
    FOOT_GLIDES,
    FOOT_WITHOUT_CONTACT,
    FOOT_UNDETERMINED,
)
OF_ALL_FEET = (
    HIDDEN_PRE,
    HIDDEN_POST,
    NO_FOOT_LANDED,
    LOW_FLIGHT,
    POST_NEVER_REACHED,
    ORDER_AMBIGUOUS,
    TOO_MUCH_FILLED,
    STATELESS,
)


def reason_of(words: str, feet: Sequence[str]) -> Message | None:
    """Return the reason that a table of touchdowns of these feet puts in words.

    Its foot is a number, from 1 in the order of the feet. None for a reason by hand,
    whose words are the user's.
    """
    possible = [Message(code) for code in OF_ALL_FEET]
    for code in OF_A_FOOT:
        for number in range(1, len(feet) + 1):
            possible.append(Message(code, {"foot": number}))
    columns = [f"contact_{foot}_s" for foot in feet]
    for reason in possible:
        if words in (reason.text(), with_names(reason.text(), columns)):
            return reason
    return None
