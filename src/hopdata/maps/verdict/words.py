"""What a verdict says: its sentence, its outlook, and what foretells the contacts.

Nothing is decided here: conclusions and sizes are put into words.
"""

from collections.abc import Sequence
from typing import Any

from hopdata.errors import require_choice
from hopdata.maps.verdict import inputs
from hopdata.maps.verdict.effect import MOST_LANDINGS, EffectSize
from hopdata.messages import (
    Message,
    at_least_in_per_cent,
    at_most_in_per_cent,
    in_per_cent,
)

DIFFERENT = "different"

NO_DIFFERENCE = "no difference"

CANNOT_TELL = "cannot tell"

CONCLUSIONS = (DIFFERENT, NO_DIFFERENCE, CANNOT_TELL)

#: Difference for which every verdict gives the number of landings needed to show it.
#: Unit: share of the map. Origin: chosen.
ASKED = 0.2

# What foretells the contact instants, by what is known of the feet.
FORETOLD_BY = {
    inputs.Posture.USED: "maps.contacts_used",
    inputs.Posture.NOT_NEEDED: "maps.contacts_not_needed",
    inputs.Posture.NOT_SEEN: "maps.contacts_not_seen",
}


def sentence(
    conclusion: str,
    sizes: Sequence[float],
    compared: Message | str,
    confidence: float,
    margin: float,
    *,
    subjects: int | None = None,
    spreads: float | None = None,
    pairs: int | None = None,
) -> Message:
    """Return a conclusion in one sentence.

    Parameters
    ----------
    conclusion
        One of `CONCLUSIONS`.
    sizes
        Estimate, low, high and upper bound.
    compared
        Whose maps were compared.
    confidence, margin
        As for `judge`.
    subjects
        Number of subjects, if it is the conclusion on a group of them.
    spreads
        `Verdict.holds_from` in contact spreads: what the bound does not cover is said
        with it.
    pairs
        Number of pairs of maps, of whose differences over the landings the sizes are
        the rms; None if the sizes are not those over the landings.
    """
    require_choice("conclusion", conclusion, CONCLUSIONS)
    estimate, low, high, bound = sizes
    values: dict[str, Any] = {
        "compared": compared,
        "where": "",
        "rms": "",
        "size": percent(estimate),
        "low": at_least(low),
        "high": at_most(high),
        "bound": at_most(bound),
        "confidence": as_given(confidence),
        "margin": as_given(margin),
    }
    name = conclusion.replace(" ", "_")
    if conclusion == NO_DIFFERENCE and spreads is not None:
        name = "no_difference_at_contact"
        values["spreads"] = in_spreads(spreads)
    if pairs is not None:
        values["where"] = Message("maps.over_landings")
    # No difference is told with the bound of each pair: see `with_no_more`.
    if pairs is not None and pairs > 1:
        values["rms"] = Message("maps.rms_of_pairs")
    if subjects is not None:
        name = f"group_{name}"
        values["subjects"] = subjects
    return Message(f"maps.{name}", values)


def without_upper_end(
    said: Message, conclusion: str, low: float, *, surely: bool = True
) -> Message:
    """Return the sentence on a difference that saturates, with what holds at contact.

    Parameters
    ----------
    said
        The sentence on its size over the landings.
    conclusion
        One of `DIFFERENT` and `CANNOT_TELL`.
    low
        Low end of the size at the simultaneous contact.
    surely
        Whether it saturates whatever the errors of the contact instants are.
    """
    if conclusion == CANNOT_TELL:
        return Message("maps.cannot_tell_at_contact", said.values)
    code = "maps.no_upper_end_unsure"
    if surely:
        code = "maps.no_upper_end"
    at_contact = Message(code, {"low": at_least(low)})
    return with_reservation(said, at_contact)


def may_be_larger(high: float, spreads: float) -> Message:
    """Return what an interval over the landings leaves open at the contact.

    Parameters
    ----------
    high
        High end of the size over the landings.
    spreads
        `Verdict.twice_high_from` in contact spreads.
    """
    values = {"twice": at_least(2.0 * high), "spreads": in_spreads(spreads)}
    return Message("maps.may_be_larger", values)


def with_no_more(
    said: Message, jump: float | None, pair: float | None, *, margin: float
) -> Message:
    """Return the sentence on no difference, with what its bound is of.

    Parameters
    ----------
    said
        The sentence on its size over the landings.
    jump
        Bound that holds for the jump at each exchange; None if it is not known.
    pair
        Bound that holds for each pair of maps; None if there is one pair only.
    margin
        Difference that the study is to exclude: a jump that may be larger is told so.
    """
    values: dict[str, Any] = {}
    code = "maps.over_landings"
    if jump is not None:
        bound = "maps.jump_bound"
        if jump > margin:
            bound = "maps.jump_bound_wide"
        sizes = {"size": at_most(jump), "margin": as_given(margin)}
        values["jump"] = Message(bound, sizes)
        code = "maps.over_landings_no_jump"
    if pair is not None:
        values["pair"] = at_most(pair)
        code = "maps.over_landings_pairs"
        if jump is not None:
            code = "maps.over_landings_no_jump_pairs"
    where = Message(code, values)
    return Message(said.code, {**said.values, "where": where})


def with_reservation(sentence: Message, reservation: Message) -> Message:
    """Return what is said of a difference, and what it leaves open."""
    values = {"different": sentence, "reservation": reservation}
    return Message("maps.different_reserved", values)


def outlook(
    effect: EffectSize, needed: int | None, landings: int, power: float
) -> Message:
    """Return what these data could have shown, and what would show more.

    Parameters
    ----------
    effect
        Size of the difference.
    needed
        Number of landings that show a difference of `ASKED`; None if no number does.
    landings
        Number of landings that these data have.
    power
        Power with which the detectable difference would have been found.
    """
    seen = Message("maps.nothing_seen")
    if effect.detectable <= 1.0:
        shown = {"detectable": percent(effect.detectable), "power": as_given(power)}
        seen = Message("maps.seen", shown)
    values: dict[str, Any] = {"seen": seen, "asked": percent(ASKED)}
    if needed is None:
        return Message("maps.outlook_never", values)
    values["number"] = f"{asked_for(needed, landings):,}"
    if needed <= landings:
        return Message("maps.outlook_enough", values)
    if needed > MOST_LANDINGS:
        values["more_spread"] = Message("maps.more_spread")
        return Message("maps.outlook_spread", values)
    return Message("maps.outlook_more", values)


def two_digits(number: float) -> int:
    """Return a number rounded to two digits, since more of a plan mean nothing."""
    return int(float(f"{number:.1e}"))


def asked_for(needed: int, landings: int) -> int:
    """Return how many landings to ask for, to two digits.

    A study that lacks some is never told a number that it has.
    """
    told = two_digits(needed)
    if told <= landings < needed:
        step = 10 ** (len(str(needed)) - 2)
        told = -(-needed // step) * step
    return told


def jump_said(jump: EffectSize, confidence: float, exchanges: int = 1) -> Message:
    """Return the size of a jump, the rms over all exchanges, as part of a sentence."""
    rms: Message | str = ""
    if exchanges > 1:
        rms = Message("maps.rms_of_exchanges")
    values: dict[str, Any] = {
        "rms": rms,
        "size": percent(jump.estimate),
        "low": at_least(jump.low),
        "high": at_most(jump.high),
        "confidence": as_given(confidence),
    }
    return Message("maps.jump", values)


def contacts_said(landings: inputs.SectionLandings) -> Message:
    """Return what share of the contact instants is foretold, and by what."""
    said = FORETOLD_BY[landings.posture]
    return Message(said, {"share": f"{100 * landings.foretold:.1f} %"})


def percent(share: float) -> str:
    """Return a share in per cent, to two digits or whole: see `in_per_cent`."""
    return f"{in_per_cent(share):g} %"


def at_least(share: float) -> str:
    """Return the low end of an interval in per cent, rounded down."""
    return f"{at_least_in_per_cent(share):g} %"


def at_most(share: float) -> str:
    """Return the high end of an interval, or a bound, in per cent, rounded up."""
    return f"{at_most_in_per_cent(share):g} %"


def in_spreads(time_constant: float) -> str:
    """Return a time constant in contact spreads, to two digits."""
    return f"{float(f'{time_constant:.2g}'):g}"


def as_given(share: float) -> str:
    """Return a share that a user gave in per cent, as it was given."""
    return f"{100 * share:g} %"
