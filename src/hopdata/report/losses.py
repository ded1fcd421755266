"""Landings that a study lost for how they came down, and what that may do to it.

Frames that are missing, or a mistake in a marker, say nothing about a landing. A foot
that is late does: such landings are tilted, and their order is seldom any one. Which
landings are used then depends on how they came down. If their states before decide
that, a fit to the others is not biased, but it is a fit to less of what was recorded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hopdata.arrays import pd
from hopdata.errors import with_names
from hopdata.feet import foot_names, with_foot_names
from hopdata.messages import Message
from hopdata.report import formatting as show
from hopdata.report.tables import excluded

# Reasons that say how a landing came down, in the words of the table, which are English
# in every language of the page. The first ones name a foot by its number.
NUMBER = "{foot}"
OF_A_FOOT = tuple(
    Message(f"landings.{name}", {"foot": NUMBER}).text()
    for name in ("foot_up", "foot_down_before", "foot_rises", "foot_glides")
)
POST_NEVER_REACHED = Message("landings.post_never_reached").text()

#: Share of the landings that is lost for how they came down, from which the page says
#: so.
#: Unit: 1, of these and the used ones. Origin: chosen: in a simulated study that lost
#: 0.18, the true size was 105 % over those used and 116 % over all, a tenth apart; with
#: 0.05 it would be some 3 %, less than any interval.
WORTH_SAYING = 0.05


def lost_for_how_they_came_down(
    touchdowns: pd.DataFrame | None, verdict: Mapping[str, Any]
) -> Message | None:
    """Return how many landings were lost so, of which order, how far apart; or None.

    Parameters
    ----------
    touchdowns : DataFrame, optional
        The touchdown table.
    verdict : mapping
        Contents of ``verdict.json``. Without a size there is nothing to bias.

    Returns
    -------
    Message or None
        None if there are fewer than `WORTH_SAYING`.
    """
    if touchdowns is None or touchdowns.empty or verdict.get("effect") is None:
        return None
    out = excluded(touchdowns)
    lost = touchdowns[out & touchdowns["reason"].isin(_reasons(touchdowns))]
    used = touchdowns[~out]
    if len(lost) < WORTH_SAYING * (len(lost) + len(used)) or lost.empty:
        return None
    values: dict[str, Any] = {
        "lost": show.count(len(lost)),
        "landings": show.count(len(lost) + len(used)),
        "most": _most_of_one_order(lost, used),
        "apart": _farther_apart(lost, used),
        "foretold": "",
    }
    share = verdict.get("contacts_r2")
    if share is not None:
        words = show.with_unit(show.fixed(100 * share, 1), "%")
        values["foretold"] = Message("report.lost_foretold", {"share": words})
    return Message("report.lost", values)


def _reasons(touchdowns: pd.DataFrame) -> set[str]:
    """Return how a table of touchdowns of these feet puts the reasons in words."""
    words = [POST_NEVER_REACHED]
    for number in range(1, len(foot_names(touchdowns.columns)) + 1):
        words += [reason.replace(NUMBER, str(number)) for reason in OF_A_FOOT]
    return {*words, *(with_names(one, touchdowns) for one in words)}


def _most_of_one_order(lost: pd.DataFrame, used: pd.DataFrame) -> Message | str:
    """Return the order that lost most landings, if the orders of the lost are known."""
    counts = lost["schedule"].replace("", pd.NA).dropna().value_counts()
    if counts.empty:
        return ""
    order = str(counts.index[0])
    of_order = int(counts.iloc[0])
    values = {
        "order": with_foot_names(order, foot_names(lost.columns)),
        "of_order": show.count(of_order),
        "in_order": show.count(of_order + int((used["schedule"] == order).sum())),
    }
    return Message("report.lost_most", values)


def _farther_apart(lost: pd.DataFrame, used: pd.DataFrame) -> Message | str:
    """Return the contact spreads of both, if they are known."""
    medians_s = [part["spread_s"].median() for part in (lost, used)]
    if any(show.is_missing(one) for one in medians_s):
        return ""
    theirs, others = [
        show.with_unit(show.significant(1e3 * one, 2), "ms") for one in medians_s
    ]
    return Message("report.lost_apart", {"theirs": theirs, "used": others})
