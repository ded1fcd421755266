"""The verdict on the page: its card, its tables, and what each number can and cannot show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hopdata.report.formatting import (
    MISSING,
    NO_BREAK_SPACE,
    Table,
    count,
    fixed,
    is_missing,
    scaled,
    significant,
    with_unit,
)

Verdict = Mapping[str, Any]

# Key in verdict.json: name, what it can show, what it cannot.
TESTS = {
    "test": (
        "kinks (decides)",
        "A jump of the derivative at the simultaneous contact, curvature allowed for. It cannot "
        "see a difference in second derivatives, which a C1 map may have.",
    ),
    "specialised": (
        "one map or one per order",
        "Whether maps of their own explain more than one smooth map. It cannot say how much they "
        "differ, nor tell a kink from curvature of high order.",
    ),
    "subspaces": (
        "constraint subspaces",
        "Whether the directions with most signal differ more across orders than between halves of "
        "one. It has little power: a large p-value does not show that the maps agree.",
    ),
}


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
    return NO_BREAK_SPACE.join(("p", "≤" if is_least else "=", _number(p_value)))


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


def table_of_tests(verdict: Verdict | None) -> Table | None:
    """One row a test: what it is about, what was found, and what no difference would give."""
    if not verdict or verdict.get("test") is None:
        return None
    rows = tuple(
        (name, meaning, *_found(key, verdict.get(key))) for key, (name, meaning) in TESTS.items()
    )
    head = ("test", "what it can and cannot show", "found", "without a difference", "p")
    note = "A dash: the orders have too few landings for this test."
    return Table(
        "Tests of one map for all contact orders",
        head,
        rows,
        text_columns=2,
        note=note if any(row[-1] == MISSING for row in rows) else "",
    )


def _found(key: str, result: Mapping[str, Any] | None) -> tuple[str, str, str]:
    """Return the statistic, what it is without a difference, and the p-value."""
    if result is None:
        return MISSING, MISSING, MISSING
    if key == "test":
        expected = f"{count(result['degrees_of_freedom'])} expected"
        cells = (significant(result["statistic"]), expected)
    elif key == "specialised":
        cells = (fixed(result["error_ratio"], 4), f"95 % below {fixed(result['null_high'], 4)}")
    else:
        cells = (
            with_unit(fixed(result["excess_rad"], 3), "rad"),
            f"95 % below {fixed(result['null_high_rad'], 3)}",
        )
    return *cells, _number(result["p_value"])


def windows_table(verdict: Verdict | None) -> Table | None:
    """One row a window of contact spread; the one that the verdict rests on is marked."""
    if not verdict or not verdict.get("windows"):
        return None
    rows = tuple(
        (
            f"{100 * row['window']:.0f}" + (" (the verdict's)" if row["chosen"] else ""),
            count(row["landings"]),
            count(row["degree"]),
            fixed(row["mean_spread_ms"], 1),
            fixed(row["largest_spread_ms"], 1),
            fixed(scaled(row["curvature_share"], 100), 1),
            *(fixed(row[key], 3) for key in ("kinks", "kinks_low", "kinks_high", "separate")),
        )
        for row in verdict["windows"]
    )
    head = (
        "nearest landings (%)",
        "landings",
        "free terms to order",
        "mean spread (ms)",
        "largest spread (ms)",
        "curvature in the variance (%)",
        "jump at zero spread",
        "interval from",
        "interval to",
        "separate maps differ by",
    )
    return Table(
        "The difference in windows of contact spread", head, rows, note=_windows_note(verdict)
    )


def _windows_note(verdict: Verdict) -> str:
    """Say what the columns are, which window is the verdict's, and what a dash means."""
    limit = _share(verdict.get("curvature_limit"))
    little = "little" if limit is None else f"at most {limit}"
    note = (
        f"Differences as shares of the map, with {_share(verdict.get('confidence'))} intervals. "
        f"The verdict rests on the widest window in which curvature is {little} of the variance, "
        "or else on the narrowest. The separate maps differ by curvature too, a part that falls "
        "with the spread."
    )
    lacking = any(is_missing(row["separate"]) for row in verdict["windows"])
    return note + (" A dash there: too few landings for them." if lacking else "")


def _number(value: Any) -> str:
    return MISSING if is_missing(value) else significant(value, 2)


def _share(value: Any) -> str | None:
    return None if is_missing(value) else with_unit(f"{100 * float(value):g}", "%")
