"""The verdict on the page: its card, its tables, and what each number can and cannot show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hopdata.report import formatting as show

Verdict = Mapping[str, Any]

MEANING = (
    "A jump of the derivative at the simultaneous contact, curvature allowed for. It cannot see a "
    "difference in second derivatives, which a C1 map may have."
)


def verdict_facts(verdict: Verdict | None) -> dict[str, Any]:
    """Return texts on the verdict: all keys are always there, None where it is not known.

    Returns
    -------
    dict
        ``sentence``; ``difference``, the effect with its interval; ``remark``, its p-value and the
        bound that decides; ``confidence``, ``power``; ``found``, whether there is an effect at all.
    """
    known: Verdict = verdict or {}
    effect = known.get("effect")
    facts: dict[str, Any] = {
        "sentence": known.get("sentence"),
        "found": effect is not None,
        "difference": None,
        "remark": "",
        "confidence": _share(known.get("confidence")),
        "power": _share(known.get("power")),
    }
    if effect is None:
        return facts | {"remark": str(known.get("conclusion", ""))}
    low, high = _number(effect["low"]), _number(effect["high"])
    p = _p_value(known.get("test") or {})
    return facts | {
        "difference": f"{_number(effect['estimate'])} ({low} to {high})",
        "remark": f"of the map, {facts['confidence']} interval; {p}{_bound(known)}",
    }


def _p_value(test: Mapping[str, Any]) -> str:
    """Return the p-value: a bound where no random sign pattern came as far as the data."""
    p_value, flips = test.get("p_value"), test.get("flips")
    is_least = p_value is not None and flips is not None and p_value * (1 + flips) < 1.5
    return show.NO_BREAK_SPACE.join(("p", "≤" if is_least else "=", _number(p_value)))


def _bound(verdict: Verdict) -> str:
    """Say what is excluded and what was wanted; nothing where a difference was found."""
    if verdict.get("conclusion") == "different":
        return ""
    excluded = _number(verdict["effect"]["upper_bound"])
    return f"; larger than {excluded} excluded (one-sided), {_number(verdict.get('margin'))} wanted"


def notes(verdict: Verdict | None) -> Sequence[Mapping[str, Any]]:
    """Return what limits the verdict, each with ``what`` and ``reason``."""
    found: Sequence[Mapping[str, Any]] = (verdict or {}).get("notes", ())
    return found


def table_of_test(verdict: Verdict | None) -> show.Table | None:
    """Say what the test is about, what it found, and what no difference would give."""
    test = (verdict or {}).get("test")
    if test is None:
        return None
    expected = f"{show.count(test['degrees_of_freedom'])} expected"
    row = (MEANING, show.significant(test["statistic"]), expected, _number(test["p_value"]))
    head = ("what it can and cannot show", "found", "without a difference", "p")
    return show.Table("Test of the kinks, which decides", head, (row,))


def windows_table(verdict: Verdict | None) -> show.Table | None:
    """One row a window of contact spread; the one that the verdict rests on is marked."""
    if not verdict or not verdict.get("windows"):
        return None
    columns: show.Columns = {
        "nearest touchdowns (%)": lambda row: (
            f"{100 * row['window']:.0f}" + (" (the verdict's)" if row["chosen"] else "")
        ),
        "touchdowns used": show.counted("landings"),
        "free terms to order": show.counted("degree"),
        "mean spread (ms)": show.decimals("mean_spread_ms", 1),
        "largest spread (ms)": show.decimals("largest_spread_ms", 1),
        "curvature in the variance (%)": show.decimals("curvature_share", 1, 100),
        "jump at zero spread": show.decimals("kinks", 3),
        "interval from": show.decimals("kinks_low", 3),
        "interval to": show.decimals("kinks_high", 3),
    }
    title = "The difference in windows of contact spread"
    return show.table_of(title, verdict["windows"], columns, note=_windows_note(verdict))


def _windows_note(verdict: Verdict) -> str:
    """Say what the columns are, and which window is the verdict's."""
    limit = _share(verdict.get("curvature_limit"))
    little = "little" if limit is None else f"at most {limit}"
    return (
        f"Differences as shares of the map, with {_share(verdict.get('confidence'))} intervals. "
        f"The verdict rests on the widest window in which curvature is {little} of the variance, "
        "or else on the narrowest."
    )


def _number(value: Any) -> str:
    return show.MISSING if show.is_missing(value) else show.significant(value, 2)


def _share(value: Any) -> str | None:
    return None if show.is_missing(value) else show.with_unit(f"{100 * float(value):g}", "%")
