"""The verdict on the page: its card, and what it can and cannot show."""

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
        ``sentence``; ``outlook``, what these data could have shown; ``difference``, the effect with
        its interval; ``remark``, the bound that decides; ``confidence``, ``power``; ``found``,
        whether there is an effect at all.
    """
    known: Verdict = verdict or {}
    effect = known.get("effect")
    facts: dict[str, Any] = {
        "sentence": known.get("sentence"),
        "outlook": known.get("outlook"),
        "found": effect is not None,
        "difference": None,
        "remark": "",
        "confidence": _share(known.get("confidence")),
        "power": _share(known.get("power")),
    }
    if effect is None:
        return facts | {"remark": str(known.get("conclusion", ""))}
    keys = ("estimate", "low", "high", "upper_bound")
    estimate, low, high, bound = (show.significant(100 * effect[key], 2) for key in keys)
    excluded = f"; larger than {bound} % excluded (one-sided), {100 * known['margin']:g} % wanted"
    return facts | {
        "difference": show.with_unit(f"{estimate} ({low} to {high})", "%"),
        "remark": f"of the map, {facts['confidence']} interval"
        + ("" if known["conclusion"] == "different" else excluded),
    }


def notes(verdict: Verdict | None) -> Sequence[Mapping[str, Any]]:
    """Return what limits the verdict, each with ``what`` and ``reason``."""
    found: Sequence[Mapping[str, Any]] = (verdict or {}).get("notes", ())
    return found


def _share(value: Any) -> str | None:
    return None if show.is_missing(value) else show.with_unit(f"{100 * float(value):g}", "%")
