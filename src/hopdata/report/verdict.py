"""The verdict on the page, and what it can and cannot show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from hopdata.arrays import pd
from hopdata.feet import AND, with_foot_names
from hopdata.messages import (
    Message,
    at_least_in_per_cent,
    at_most_in_per_cent,
    in_per_cent,
)
from hopdata.notes import Note
from hopdata.report import formatting as show

Verdict = Mapping[str, Any]

# Of what the deciding size is a share.
OF_WHAT = {"effect": "report.of_the_map", "jump": "report.of_the_outcome"}

# An answer of no difference that does not hold of what fades fast.
AT_CONTACT = "maps.no_difference_at_contact"

# An answer with what it leaves open, and one of the things that it may leave open.
RESERVED = "maps.different_reserved"
MAY_BE_LARGER = "maps.may_be_larger"

# A note that a difference is smaller the closer together the contacts are.
FADES_TOWARDS_CONTACT = "maps.grows"

# Facts on how far an answer reaches towards the simultaneous contact.
REACH = ("margin", "holds_from", "contact_spread")

# Facts on a difference that is another at the simultaneous contact.
TWO_SIZES = ("over_landings", "at_contact", "low")

# Feet up to which whole orders are compared; of more, the order of each two.
ALL_ORDERS_UP_TO = 3

# Feet whose spread is half of how far apart they touch.
TWO = 2

#: A difference may saturate if the p-value of that is below this.
#: Unit: 1. Origin: chosen: that of the verdict (`hopdata.maps.verdict.saturation`).
SATURATES_BELOW = 0.01

#: Size below which a true difference is none.
#: Unit: 1. Origin: chosen: far above rounding, and far below what a study can find.
NO_DIFFERENCE = 1e-9

#: Smooth steps that are wider are named jumps only beside a note that says so.
#: Unit: contact spreads. Origin: measured: of 18 steps 0.15 wide, 8 were named without
#: the note, and none of 18 that were 0.2 wide (verdict_jumps.py, seeds 7000 to 7005).
STEP_LIKE_JUMP = 0.2

# A note that bends of the width of the contact spread look like the jump that is named.
JUMP_OR_BEND = "maps.jump_or_bend"


def meaning(verdict: Verdict | None) -> Message:
    """Return what the quantity that decided a verdict is, and what it cannot show."""
    decided_by = (verdict or {}).get("decided_by", "effect")
    return Message(f"report.meaning_of_{decided_by}")


def reach(verdict: Verdict | None) -> list[Message]:
    """Return how the bound can be below what is found, and where the answer holds.

    What holds at the simultaneous contact and what over the landings are two things if
    the difference is found to saturate, or if it might without being found: see
    `hopdata.maps.verdict.saturation`.
    """
    facts = verdict_facts(verdict)
    said = []
    if facts["bound_below"]:
        values = {"bound": facts["bound_below"], "detectable": facts["detectable"]}
        said.append(Message("report.bound_below", values))
    if facts["bound_within"]:
        values = {"bound": facts["bound_within"], "allowed": facts["allowed"]}
        said.append(Message("report.bound_within", values))
    if facts["allowed"] and not facts["jumps"]:
        values = {"confidence": facts["confidence"], "allowed": facts["allowed"]}
        said.append(Message("report.at_least", values))
    if facts["over_landings"]:
        name = "report.may_be_spent"
        if facts["conclusion"] == "different":
            name = "report.spent"
        said.append(Message(name, {key: facts[key] for key in TWO_SIZES}))
    if facts["holds_from"]:
        values = {name: facts[name] for name in REACH}
        said.append(Message("report.unless_spent", values))
    said += _not_saturating(verdict or {}, facts)
    said += _jump_seen(verdict or {}, facts)
    return said


def measured() -> Message:
    """Return how often verdicts on simulated bodies err."""
    return Message("report.measured")


def _jump_seen(verdict: Verdict, facts: Mapping[str, Any]) -> list[Message]:
    """Say what jump would be found, and how large one at a single exchange has to be.

    The size of jumps is an rms over all exchanges. If a jump decides, the outlook has
    that one already.
    """
    jump = verdict.get("jump") or {}
    exchanges = sum(row["of"] == "jump" for row in verdict.get("orders") or [])
    if not exchanges or not 0.0 < jump.get("detectable", 0.0) <= 1.0:
        return []
    values = {
        "detectable": percent(jump["detectable"]),
        "exchanges": exchanges,
        "power": facts["power"],
        "alone": percent(math.sqrt(exchanges) * jump["detectable"]),
    }
    if exchanges == 1:
        if facts["jumps"]:
            return []
        return [Message("report.jump_seen_of_one", values)]
    if facts["jumps"]:
        return [Message("report.jump_alone", values)]
    return [Message("report.jump_seen", values)]


def _not_saturating(verdict: Verdict, facts: Mapping[str, Any]) -> list[Message]:
    """Say why a difference does not saturate although the p-value is small.

    Where it is said to fade towards the simultaneous contact, that is why, and a second
    reading of the same landings would only seem to contradict it.
    """
    p_value = verdict.get("saturation_p_value")
    is_small = p_value is not None and p_value < SATURATES_BELOW
    if not is_small or verdict.get("saturates") or facts["jumps"]:
        return []
    codes = {note.code for note in notes_of(verdict)}
    if not facts["allowed"] or FADES_TOWARDS_CONTACT in codes:
        return []
    values = {"p": show.significant(p_value, 2), "allowed": facts["allowed"]}
    return [Message("report.not_saturating", values)]


def answer(verdict: Verdict) -> list[Message | str]:
    """Return the answer, and apart from it what it leaves open."""
    message = verdict.get("messages", {}).get("sentence") or {}
    if message.get("code") == RESERVED:
        parts = [message["values"][name] for name in ("different", "reservation")]
        worded_parts = [told(part, "") for part in parts]
        if parts[1].get("code") == MAY_BE_LARGER:
            worded_parts[1] = _may_be_larger(verdict, parts[1]["values"])
        if all(worded_parts):
            return worded_parts + _scale(verdict)
    facts = verdict_facts(verdict)
    if verdict.get("conclusion") == "different":
        return [worded(verdict, "sentence"), *_scale(verdict)]
    if message.get("code") != AT_CONTACT or not facts["holds_from"]:
        return [worded(verdict, "sentence")]
    bounded = {**message, "code": "maps.no_difference"}
    values = {name: facts[name] for name in REACH}
    reservation = Message("report.reservation", values)
    return [told(bounded, str(verdict.get("sentence"))), reservation]


def _may_be_larger(verdict: Verdict, values: Mapping[str, Any]) -> Message:
    """Return what an interval over the landings leaves open, in units of time."""
    within = _milliseconds(verdict["twice_high_from"])
    return Message("report.may_be_larger", {"twice": values["twice"], "within": within})


def _scale(verdict: Verdict) -> list[Message | str]:
    """Return down to which scale kinks and jumps are told from a smooth map."""
    if verdict.get("contact_spread") is None:
        return []
    said: list[Message | str] = []
    if verdict.get("decided_by") != "jump":
        said.append(Message("report.scale", {"contact_spread": _spread(verdict)}))
    like_jump = looks_like_jump(verdict)
    if like_jump is not None:
        said.append(like_jump)
    return said


def looks_like_jump(verdict: Verdict) -> Message | None:
    """Return which smooth maps look like the jump that is named; None if none is."""
    jump = verdict.get("jump") or {}
    if not jump.get("low"):
        return None
    codes = {note.code for note in notes_of(verdict)}
    if JUMP_OR_BEND in codes:
        return _within_spread("report.bend_like_jump", verdict, 1.0)
    return step_like_jump(verdict)


def step_like_jump(verdict: Verdict) -> Message | None:
    """Return which smooth maps look like any jump; None without a contact spread."""
    return _within_spread("report.step_like_jump", verdict, STEP_LIKE_JUMP)


def _within_spread(code: str, verdict: Verdict, share: float) -> Message | None:
    """Return a message with this share of the contact spread, if that is known."""
    spread_s = verdict.get("contact_spread")
    if spread_s is None:
        return None
    return Message(code, {"within": _milliseconds(share * spread_s)})


def _spread(verdict: Verdict) -> Message:
    """Return the spread of the contacts, and of two feet how far apart they are."""
    spread_s = verdict["contact_spread"]
    values = {"spread": _milliseconds(spread_s)}
    if verdict.get("n_feet") != TWO:
        return Message("report.spread_of_landing", values)
    # The standard deviation of two instants is half of their difference.
    values["apart"] = _milliseconds(2.0 * spread_s)
    return Message("report.spread_of_two_feet", values)


def notes_of(verdict: Verdict) -> list[Note]:
    """Return the notes of a ``verdict.json``."""
    return [Note.from_dict(one) for one in verdict.get("notes") or ()]


def further_notes(verdict: Verdict) -> list[Note]:
    """Return the notes that the answer does not say already."""
    sentence = verdict.get("messages", {}).get("sentence") or {}
    reason = sentence.get("values", {}).get("reason")
    said = reason.get("code") if isinstance(reason, Mapping) else reason
    notes = []
    for note in notes_of(verdict):
        if said is None or said not in (note.code, note.reason):
            notes.append(note)
    return notes


def worded(verdict: Verdict, name: str) -> Message | str:
    """Return the sentence or the outlook of a verdict, by its code if it has one."""
    as_written = verdict.get(name) or ""
    message = verdict.get("messages", {}).get(name)
    if message:
        return told(message, as_written)
    return as_written


# Messages on what foretells the contacts if the maps were not compared, and the same
# without the orders, which they list with their landings.
WITHOUT_ORDERS = {
    "maps.so_far_few": "report.so_far_few",
    "maps.so_far_errors": "report.so_far_errors",
    "maps.so_far_foretold": "report.so_far_foretold",
}
ORDERS_ALONE = "maps.so_far_states"


def contacts_told(verdict: Verdict) -> Message | str:
    """Return what foretells the contacts, without the orders that a figure shows.

    If the maps were not compared, the sentence lists all orders with their landings,
    for readers of the file alone.
    """
    message = verdict.get("messages", {}).get("contacts", {})
    code = message.get("code")
    if code == ORDERS_ALONE:
        return ""
    if code in WITHOUT_ORDERS:
        return Message(WITHOUT_ORDERS[code], message.get("values", {}))
    return worded(verdict, "contacts")


def told(message: Mapping[str, Any], as_written: str) -> Message | str:
    """Return a message with code and values from a file, to be put into words.

    Files of earlier versions may lack a value that its template asks for, or have a
    code without a template. Their own English text, `as_written`, is then all there is.
    """
    return _if_it_has_words(Message.from_dict(message), as_written)


def subject_of(note: Note) -> Message | str:
    """Return what a note is about; reasons for no answer have no name of their own."""
    return _if_it_has_words(note.about, note.what)


def reason_of(note: Note) -> Message | str:
    """Return what a note says."""
    return _if_it_has_words(note.said, note.reason)


def _if_it_has_words(message: Message, as_written: str) -> Message | str:
    """Return a message or, if this version has no words for it, those of its file."""
    if not message.code:
        return as_written
    try:
        message.text()
    except KeyError:
        return as_written
    return message


def verdict_facts(
    verdict: Verdict | None, truth: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, Any]:
    """Return texts on the verdict; all keys are always present, None if unknown.

    Returns
    -------
    dict
        ``sentence``; ``outlook``, what these data could have shown; ``contacts``, what
        foretells when the feet touch; ``difference``, the
        effect with its interval; ``true``, the true effect in a simulation; ``remark``,
        the deciding bound; ``confidence``, ``power``; ``conclusion``; ``found``,
        whether an effect was estimated at all; ``jumps``, whether a jump of the outcome
        decided; ``allowed``, by how much orders of one smooth map may seem to differ;
        ``detectable``, None if nothing could have been seen; ``bound_below``, the bound
        of a study that found nothing, if it is below that; ``bound_within``, the same
        bound, if it is below what is allowed for; ``margin``, below which
        a difference counts as none; ``over_landings``, the effect over the landings
        with its interval, if the effect saturates, and ``at_contact`` and ``low``, its
        estimate and lower end at the simultaneous contact; ``holds_from``, the time
        constant in ms from which on a verdict of no difference holds at the
        simultaneous contact, and ``contact_spread``, the spread of the contacts with
        what it is; ``like_jump``, which smooth maps look like the jump that is named;
        ``compared``, what was compared; ``landings``, how many were judged, ``fitted``,
        how many of these were fitted, and ``left_out``, how many are like none of
        these; ``foretold``, the share of their order that is;
        ``differ``, which maps differ if any do; ``mainly``, what differs most;
        ``needed``, the landings with which ``asked`` could be seen; ``kinds`` of sizes
        of the orders, as the panels of their figure are lettered.
    """
    known: Verdict = verdict or {}
    effect = _deciding(known)
    facts: dict[str, Any] = {
        "sentence": known.get("sentence"),
        "outlook": known.get("outlook"),
        "contacts": str(contacts_told(known)) or None,
        "conclusion": known.get("conclusion"),
        "found": effect is not None,
        "jumps": known.get("decided_by") == "jump",
        "allowed": None,
        "detectable": None,
        "bound_below": None,
        "bound_within": None,
        "difference": None,
        "true": None,
        "remark": str(remark(verdict, truth)),
        "confidence": None,
        "power": None,
        "margin": None,
        "over_landings": None,
        "at_contact": None,
        "low": None,
        "holds_from": None,
        "contact_spread": None,
        "like_jump": None,
        "kinds": _kinds_of_sizes(known),
        **_compared_facts(known),
    }
    if known:
        facts["confidence"] = show.percent(100 * known["confidence"])
        facts["power"] = show.percent(100 * known["power"])
        facts["margin"] = _margin(known)
    if effect is None:
        return facts
    if not facts["jumps"]:
        facts |= _reach_facts(known)
    facts["true"] = _true_effect(truth)
    found = known["conclusion"] == "different"
    bound = math.inf if effect["upper_bound"] is None else effect["upper_bound"]
    if effect.get("allowed") is not None:
        facts["allowed"] = percent(effect["allowed"])
        if not found and bound < effect["allowed"]:
            facts["bound_within"] = at_most(effect["upper_bound"])
    if effect["detectable"] <= 1.0:
        facts["detectable"] = percent(effect["detectable"])
        if not found and bound < effect["detectable"]:
            facts["bound_below"] = at_most(effect["upper_bound"])
    facts["difference"] = _with_interval(effect)
    like_jump = looks_like_jump(known)
    if like_jump is not None:
        facts["like_jump"] = str(like_jump)
    return facts


def _compared_facts(verdict: Verdict) -> dict[str, str | None]:
    """Return what was compared, of how many landings, and how many would be needed."""
    left_out: set[int] = set().union(*(verdict.get("gross_errors") or {}).values())
    outlook = verdict.get("messages", {}).get("outlook", {}).get("values", {})
    facts: dict[str, str | None] = {
        "compared": verdict.get("compared") or None,
        "landings": None,
        "fitted": None,
        "left_out": None,
        "foretold": None,
        "differ": str(_which_differ(verdict)),
        "mainly": verdict.get("main_contrast") or None,
        "asked": None,
        "needed": None,
    }
    if verdict.get("n_landings") is not None:
        facts["landings"] = show.count(verdict["n_landings"])
        facts["fitted"] = show.count(verdict.get("n_window"))
    if left_out:
        facts["left_out"] = show.count(len(left_out))
    if verdict.get("contacts_r2") is not None:
        share = show.fixed(100 * verdict["contacts_r2"], 1)
        facts["foretold"] = show.with_unit(share, "%")
    if "number" in outlook:
        facts["asked"] = str(outlook["asked"])
        facts["needed"] = str(outlook["number"])
    return facts


def _which_differ(verdict: Verdict) -> Message:
    """Return which maps are different if a difference was found."""
    if (verdict.get("n_feet") or 0) > ALL_ORDERS_UP_TO:
        return Message("report.maps_of_pairs_differ")
    return Message("report.maps_of_orders_differ")


def _kinds_of_sizes(verdict: Verdict) -> list[str]:
    found = {row["of"] for row in verdict.get("orders") or []}
    return [kind for kind in OF_PAIR if kind in found]


def _reach_facts(verdict: Verdict) -> dict[str, str]:
    """Return the facts on what holds over the landings, and what at the contact."""
    facts = {}
    if verdict.get("saturates"):
        facts["over_landings"] = _with_interval(verdict["effect_over_landings"])
        facts["at_contact"] = percent(verdict["effect"]["estimate"])
        facts["low"] = at_least(verdict["effect"]["low"])
    holds_from = verdict.get("holds_from")
    if verdict["conclusion"] == "no difference" and holds_from is not None:
        facts["holds_from"] = _milliseconds(holds_from)
        facts["contact_spread"] = str(_spread(verdict))
    return facts


def _with_interval(effect: Mapping[str, Any]) -> str:
    if effect["high"] is None:
        values = {"low": at_least(effect["low"])}
        return str(Message("report.at_least_size", values))
    estimate = _in_hundredths(effect["estimate"])
    low = show.significant(at_least_in_per_cent(effect["low"]), 2)
    high = show.significant(at_most_in_per_cent(effect["high"]), 2)
    return show.with_unit(f"{estimate} ({low} to {high})", "%")


def _milliseconds(duration_s: float) -> str:
    return show.with_unit(show.significant(1000 * duration_s, 2), "ms")


def _margin(verdict: Verdict) -> str:
    return show.with_unit(f"{100 * verdict['margin']:g}", "%")


def remark(
    verdict: Verdict | None, truth: Mapping[str, Mapping[str, Any]] | None = None
) -> Message | str:
    """Say what the deciding size is a share of, with the bound and the true size."""
    known: Verdict = verdict or {}
    effect = _deciding(known)
    if effect is None:
        return str(known.get("conclusion", ""))
    values: dict[str, Any] = {
        "what": Message(OF_WHAT[known.get("decided_by", "effect")]),
        "confidence": show.percent(100 * known["confidence"]),
    }
    said = Message("report.difference_remark", values)
    if effect["high"] is None:
        values["margin"] = _margin(known)
        said = Message("report.difference_unbounded", values)
    elif known["conclusion"] != "different":
        values["bound"] = at_most(effect["upper_bound"])
        values["margin"] = _margin(known)
        said = Message("report.difference_bounded", values)
    true = _true_effect(truth)
    if true:
        return Message("report.with_truth_at", {"remark": said, "true": true})
    recorded = _true_effect(truth, "recorded_true_effect")
    if recorded:  # at a state that is not known
        return Message("report.with_truth", {"remark": said, "true": recorded})
    return said


def _deciding(verdict: Verdict) -> Mapping[str, Any] | None:
    """Return the size that decided a verdict; None if it has no answer."""
    effect: Mapping[str, Any] | None = verdict.get(verdict.get("decided_by", "effect"))
    return effect


def _true_effect(
    truth: Mapping[str, Mapping[str, Any]] | None, name: str = "verdict_true_effect"
) -> str | None:
    """Return the true size in a simulation; None if it is not known."""
    true: Any = (truth or {}).get(name, {}).get("value")
    if show.is_missing(true):
        return None
    # Rounding leaves some 1e-16 of a difference that does not exist.
    return percent(0.0 if abs(true) < NO_DIFFERENCE else float(true))


# What a size of a pair is of, in words.
OF_PAIR = {
    "map": Message("report.pair_of_maps"),
    "order": Message("report.order_of_all"),
    "jump": Message("report.pair_of_feet"),
}


def orders_table(
    verdict: Verdict | None, feet: Sequence[str] = ()
) -> show.Table | None:
    """Return one row for each two contact orders, or feet, and for each order.

    Parameters
    ----------
    verdict : mapping, optional
        Contents of ``verdict.json``.
    feet : sequence of str
        Names of the feet; without them their numbers stay.
    """
    rows = (verdict or {}).get("orders") or []
    if not rows:
        return None
    n_feet = (verdict or {}).get("n_feet") or 0
    columns: show.Columns = {
        "compared": lambda row: str(OF_PAIR[row["of"]]),
        "orders or feet": lambda row: _compared(row, feet, n_feet),
        "landings": _landings_of_pair,
        "size (%)": show.decimals("estimate", 1, 100.0),
        "from (%)": show.decimals("low", 1, 100.0),
        "to (%)": show.decimals("high", 1, 100.0),
        "p": lambda row: show.p_value(row["p_value"]),
    }
    return show.table_of(
        "Which contact orders differ",
        rows,
        columns,
        text_columns=3,
        note=_orders_note(verdict or {}),
    )


def _orders_note(verdict: Verdict) -> Message:
    """Say how intervals and p-values were made, and what was assumed."""
    rows = verdict["orders"]
    values: dict[str, Any] = {
        "confidence": show.percent(100 * verdict["confidence"]),
        "flips": show.count(verdict.get("flips")),
        "said": _of_all_orders(verdict),
        "at_contact": _pairs_at_contact(verdict),
        "of_one": "",
        "with_one": "",
        "shared": "",
        "p_least": show.significant(1.0 / (1.0 + (verdict.get("flips") or 0)), 2),
    }
    if any(row["of"] == "order" for row in rows):
        values["of_one"] = Message("report.orders_of_one")
        values["with_one"] = Message("report.orders_with_one")
    else:
        # Landings with one foot before another are compared, not whole orders.
        values["shared"] = Message("report.orders_shared")
    allowed = [row.get("allowed") for row in rows if row["of"] != "jump"]
    known = [size for size in allowed if size is not None]
    if not known:
        return Message("report.orders_note", values)
    values["allowed"] = percent(max(known))
    return Message("report.orders_note_allowed", values)


def _pairs_at_contact(verdict: Verdict) -> Message | str:
    """Say that two maps may differ more at the contact, if that is found.

    Pairs are never extrapolated: their sizes are those over the landings.
    """
    if not verdict.get("saturates") or verdict["conclusion"] != "different":
        return ""
    if verdict.get("decided_by") == "jump":
        return ""
    low = at_least(verdict["effect"]["low"])
    return Message("report.orders_at_contact", {"low": low})


def _of_all_orders(verdict: Verdict) -> Message | str:
    """Say which landings rows are of, and why they may exceed the bound."""
    known = verdict.get("n_landings")
    fitted = verdict.get("n_window")
    if not known or not fitted:
        return ""
    counts = {"fitted": show.count(fitted), "landings": show.count(known)}
    counted = Message("report.orders_landings_nearest", counts)
    if fitted == known:
        counted = Message("report.orders_landings_all", counts)
    effect = _deciding(verdict)
    if (
        effect is None
        or effect["upper_bound"] is None
        or verdict["conclusion"] == "different"
    ):
        return counted
    values = {
        "landings": counted,
        "bound": at_most(effect["upper_bound"]),
        "margin": _margin(verdict),
    }
    return Message("report.orders_landings_bound", values)


def _compared(row: Mapping[str, Any], feet: Sequence[str], n_feet: int) -> str:
    """Return what a row compares.

    Either order of two feet of more is no whole order, and is not written like one.
    """
    first = with_foot_names(row["first"], feet)
    if row["of"] == "order":
        return first
    exchanged = [one.split(">") for one in row["first"].split(AND)]
    if n_feet > TWO and all(len(pair) == TWO for pair in exchanged):
        befores = [_before(pair, feet) for pair in exchanged]
        return str(Message("report.either_first", {"befores": AND.join(befores)}))
    second = with_foot_names(row["second"], feet)
    return str(Message("report.pair", {"first": first, "second": second}))


def _before(pair: Sequence[str], feet: Sequence[str]) -> str:
    """Return in words that the first of two feet touches before the second."""
    first, second = [with_foot_names(foot, feet) for foot in pair]
    return str(Message("report.foot_before", {"first": first, "second": second}))


def _landings_of_pair(row: Mapping[str, Any]) -> str:
    """Return the number of landings of either; verdicts of before do not tell it."""
    if row.get("n_first") is None:
        return show.MISSING
    return f"{show.count(row['n_first'])}, {show.count(row['n_second'])}"


ONE_OR_OWN: show.Columns = {
    "outcome": lambda row: show.with_unit(str(row["outcome"]), f"({row['unit']})"),
    "example: happened": show.decimals("happened", 2),
    "example: by one map": show.decimals("one_map", 2),
    "example: by its order's map": show.decimals("own_map", 2),
    "median: predictions apart": show.decimals("apart", 2),
    "median: one map misses by": show.decimals("missed_by_one", 2),
    "median: own maps miss by": show.decimals("missed_by_own", 2),
    "median gain": show.decimals("gain", 2),
    "gain from": show.decimals("gain_low", 2),
    "gain to": show.decimals("gain_high", 2),
}


def one_or_own_facts(
    table: pd.DataFrame | None, feet: Sequence[str] = ()
) -> dict[str, str]:
    """Return the ``order`` of the example, and how many ``landings`` and ``orders``.

    Without a prediction, nothing is returned.
    """
    if table is None or table.empty:
        return {}
    first = table.iloc[0]
    return {
        "order": with_foot_names(str(first["order"]), feet),
        "landings": show.count(int(first["n_landings"])),
        "orders": show.count(int(first["n_orders"])),
    }


def one_or_own_table(
    table: pd.DataFrame | None,
    feet: Sequence[str] = (),
    verdict: Verdict | None = None,
) -> show.Table | None:
    """Return what one map and own maps foretell of landings, in mm and degrees.

    Parameters
    ----------
    table : DataFrame, optional
        ``one_or_own.csv``; nothing is shown of an empty one.
    feet : sequence of str
        Names of the feet; without them their numbers stay.
    verdict : mapping, optional
        Contents of ``verdict.json``, which gains may seem to contradict.
    """
    if table is None or table.empty:
        return None
    values: dict[str, Any] = {
        **one_or_own_facts(table, feet),
        "short": _in_short(table, verdict or {}),
    }
    note = Message("report.one_or_own_note", values)
    title = str(Message("report.so_what"))
    return show.table_of(title, table.to_dict("records"), ONE_OR_OWN, note=note)


def _in_short(table: pd.DataFrame, verdict: Verdict) -> Message:
    """Return in short what own maps gain beyond chance, and what that means.

    Where no difference was found, own maps can gain all the same: in the bundled C1
    sample, third-order terms of all landings together take three quarters of what own
    maps gain for the turn.
    """
    better = table[table["gain_low"] > 0.0]
    differs = verdict.get("conclusion") == "different"
    if better.empty and differs:
        return Message("report.so_what_nothing_yet")
    if better.empty:
        return Message("report.so_what_nothing")
    share = better["gain"] / better["missed_by_one"]
    most = better.iloc[int(share.to_numpy().argmax())]
    values = {
        "better": len(better),
        "outcomes": len(table),
        "most": str(most["outcome"]),
        "gain": show.with_unit(show.significant(most["gain"], 2), str(most["unit"])),
        "missed": show.with_unit(
            show.significant(most["missed_by_one"], 2), str(most["unit"])
        ),
    }
    effect = verdict.get("effect") or {}
    if effect.get("allowed") is None or verdict["conclusion"] == "different":
        return Message("report.so_what_gains", values)
    values["allowed"] = percent(effect["allowed"])
    if verdict["conclusion"] == "no difference":
        values["bound"] = at_most(effect["upper_bound"])
        return Message("report.so_what_small", values)
    return Message("report.so_what_open", values)


def percent(share: float) -> str:
    """Return a share in per cent, to two digits or whole: see `in_per_cent`."""
    return show.with_unit(_in_hundredths(share), "%")


def at_least(share: float) -> str:
    """Return the low end of an interval in per cent, rounded down."""
    return show.with_unit(show.significant(at_least_in_per_cent(share), 2), "%")


def at_most(share: float) -> str:
    """Return the high end of an interval, or a bound, in per cent, rounded up."""
    return show.with_unit(show.significant(at_most_in_per_cent(share), 2), "%")


def _in_hundredths(share: float) -> str:
    """Return a share in per cent without its sign, as in the verdict's sentence."""
    if not math.isfinite(share):
        return show.significant(share, 2)
    return show.significant(in_per_cent(share), 2)
