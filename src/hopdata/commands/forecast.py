"""Forecast of a study before it runs: landings used, and what its verdict can show.

The study runs in one process, without tables and figures. Of the verdict, only the
smallest difference that it can show is reported, so that no choice depends on its
answer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from hopdata.analysis import Study
from hopdata.arrays import pd
from hopdata.config.consistency import feet_of
from hopdata.errors import AnalysisError
from hopdata.landings.schedules import AMBIGUOUS, order_probability
from hopdata.landings.touchdowns import NO_FOOT_LANDED
from hopdata.maps.verdict.effect import MORE_SPREAD, MOST_LANDINGS, landings_needed
from hopdata.maps.verdict.judge import TWO_KINDS
from hopdata.maps.verdict.model import LEFT
from hopdata.recording import Recording, fraction_seen
from hopdata.recordings.plausibility import MIN_BODY_MARKERS, MIN_FEET
from hopdata.report.formatting import WORDS

FOOT = r"foot (\d+)"  # in a reason of the table, counted from 1
MOST_FRAMES = 60_000  # frames examined; of longer studies, the middle of each recording
LEAST_SHARE = 0.1  # of the landings: least cost of a reason that is worth a change
LEFT_BY_BEST = (
    0.5  # of the landings: a section that holds fewer at any height cannot be improved
)
MOST_ALIKE = (
    0.8  # of the landings in one contact order: beyond it, more of them hardly help
)
MOST_UNSURE = 0.5  # of the orders: beyond it they reveal little
FEW_LANDINGS = 10  # per recording; with fewer, contacts are learned less well
#: Bound of a study without a difference, as a share of the difference it detects (0.75
#: to 1).
BOUND_SHARE = 0.75
#: Advice for each reason that costs landings.
CHANGES: dict[str, str] = WORDS["changes"]


@dataclass(frozen=True)
class Forecast:
    """Results to be expected from a study.

    Attributes
    ----------
    touchdowns
        Table of the touchdowns examined: see `touchdown_table`.
    frames_share
        Share of the study's frames that were examined.
    detectable
        Difference that the verdict detects with its power, given all landings; None if
        it cannot show any.
    allowed
        Largest difference that is no evidence, with any number of landings.
    reason
        Why the verdict cannot show a difference; empty if it can.
    stops
        Whether the study has too few touchdowns to run to its end.
    best
        Share of the landings held by each section that was chosen to hold as many as it
        can.
    kinds
        What divides the landings into two kinds; empty if they are of one.
    """

    touchdowns: pd.DataFrame
    frames_share: float
    detectable: float | None = None
    allowed: float = LEFT
    reason: str = ""
    stops: bool = False
    best: Mapping[str, float] = field(default_factory=dict)
    kinds: str = ""

    @property
    def landings(self) -> int:
        """Return the number of landings of the study's feet."""
        return self._scaled((self.touchdowns["reason"] != NO_FOOT_LANDED).sum())

    @property
    def used(self) -> int:
        """Return the number of landings that will be used."""
        return self._scaled((~self.touchdowns["excluded"]).sum())

    def timed(self, foot: str) -> float:
        """Return the share of landings in which the contact of a foot is found."""
        landed = self.touchdowns[self.touchdowns["reason"] != NO_FOOT_LANDED]
        return float(landed[f"contact_{foot}_s"].notna().mean()) if len(landed) else 0.0

    @property
    def unsure(self) -> float:
        """Return the share of landings used with an order less probable than required."""
        used = self.touchdowns[~self.touchdowns["excluded"]]
        return float((used["class"] == AMBIGUOUS).mean()) if len(used) else 0.0

    def unsure_without(self, foot: str, feet: Sequence[str], below: float) -> float:
        """Return the share of landings used with an order too improbable without a foot."""
        used, others = (
            self.touchdowns[~self.touchdowns["excluded"]],
            [f for f in feet if f != foot],
        )
        of = [
            used[[f"{what}_{f}_s" for f in others]].to_numpy()
            for what in ("contact", "se")
        ]
        return float((order_probability(*of) < below).mean())

    @property
    def vain(self) -> str:
        """Return why little can be learned from the study; empty if much can."""
        if self.unsure > MOST_UNSURE:
            return f"{100 * self.unsure:.0f} % of its contact orders are unsure"
        if self.detectable is None or self.detectable > 1:
            return "its verdict is out of reach"
        return ""

    def left_out(self) -> dict[str, int]:
        """Return how many landings each reason costs, the most costly first."""
        out = self.touchdowns.loc[self.touchdowns["excluded"], "reason"]
        counts = out[out != NO_FOOT_LANDED].value_counts().items()
        return {str(reason): self._scaled(count) for reason, count in counts}

    def _scaled(self, count: float) -> int:
        return round(float(count) / self.frames_share)


def foretell(config: dict[str, Any], recordings: Sequence[Recording]) -> Forecast:
    """Forecast the study of these recordings.

    Parameters
    ----------
    config
        Configuration, complete and valid.
    recordings
        All its recordings, as imported.

    Raises
    ------
    AnalysisError
        If the study stops before it has touchdowns.
    """
    numbered = any(
        e.get("landings") for r in config["recordings"] for e in r["exclude"]
    )
    parts, share = _parts(recordings, math.inf if numbered else MOST_FRAMES)
    study = Study(config, tuple(parts))
    looked_at, made = study.candidates, study.sections
    best = dict[str, float]()
    for side, held in made.held.items():
        by_landings = (
            made.rule == "landings" and made.decided[f"{side}_height_m"] == "data"
        )
        if by_landings and held is not None:
            best[side] = held
    some = partial(Forecast, frames_share=share, best=best)
    try:
        touchdowns = study.touchdowns
    except AnalysisError as error:
        return some(looked_at, reason=str(error), stops=True)
    verdict = study.verdict
    if verdict.effect is None:
        return some(touchdowns, reason=verdict.notes[-1]["reason"])
    allowed = verdict.effect.allowed
    seen = allowed + max(0.0, verdict.effect.detectable - allowed) * float(
        np.sqrt(share)
    )
    kinds = "".join(
        note["reason"] for note in verdict.notes if note["what"] == TWO_KINDS
    )
    return some(touchdowns, detectable=seen, allowed=allowed, kinds=kinds)


def _parts(
    recordings: Sequence[Recording], most: float
) -> tuple[list[Recording], float]:
    """Return the recordings, or their middles with at most `most` frames, and that share."""
    total = sum(len(one.time) for one in recordings)
    share, parts = min(1.0, most / total), []
    for one in recordings:
        few = math.ceil(share * len(one.time))
        first = (len(one.time) - few) // 2
        parts.append(one.part(slice(first, first + few)))
    return parts, sum(len(one.time) for one in parts) / total


def told(
    forecast: Forecast, config: Mapping[str, Any], recordings: Sequence[Recording]
) -> list[str]:
    """Describe a forecast in lines: landings and feet, losses, the verdict, what to change."""
    feet, about = feet_of(config), "about " * (forecast.frames_share < 1)
    timed = ", ".join(f"{foot} {100 * forecast.timed(foot):.0f} %" for foot in feet)
    out = [
        f"{re.sub(FOOT, lambda number: feet[int(number[1]) - 1], reason)}: {count}"
        for reason, count in forecast.left_out().items()
    ]
    lines = [
        "forecast",
        f"  landings  {about}{forecast.used} of {forecast.landings} will be used, "
        f"{100 * forecast.unsure:.0f} % of their orders unsure; contacts timed: {timed}",
        *([f"  left out  {'; '.join(out)}"] if out else []),
        *([f"  note      {TWO_KINDS} {forecast.kinds}"] if forecast.kinds else []),
        f"  verdict   {_reach(forecast, config)}",
    ]
    return lines + [
        f"  change    {change}" for change in _changes(forecast, config, recordings)
    ]


def _reach(forecast: Forecast, config: Mapping[str, Any]) -> str:
    """Report whether the verdict can be reached."""
    seen, margin = forecast.detectable, config["verdict"]["margin"]
    if seen is None:
        return f"out of reach: {forecast.reason}"
    if seen > 1:
        return (
            "out of reach: a difference would have to be larger than the map to be seen"
        )
    shows = f"a difference of {100 * seen:.2g} % of the map shows in "
    shows += f"{100 * config['verdict']['power']:g} % of such studies"
    reach = (
        "in reach"
        if seen <= margin
        else "in doubt"
        if BOUND_SHARE * seen <= margin
        else ""
    )
    asked = f"verdict.margin is {100 * margin:g} %"
    return f"{reach or 'in reach only if the difference is large'}: {shows}, {asked}"


def _changes(
    forecast: Forecast, config: Mapping[str, Any], recordings: Sequence[Recording]
) -> list[str]:
    """List what to change, the most costly reason first."""
    feet, body = feet_of(config), config["markers"]["body"]
    idle = [foot for foot in feet if forecast.timed(foot) < LEAST_SHARE]
    if idle and len(feet) - len(idle) >= MIN_FEET:
        return [
            f"{foot} is hardly ever seen to land: take it off markers.feet"
            for foot in idle
        ]
    if not forecast.landings and len(forecast.touchdowns):
        raise_it = "raise touchdowns.down_height_m above where they stand"
        return [f"no foot comes down to z = 0: {raise_it}"]
    seen = {
        x: sum(fraction_seen(r)[r.markers.index(x)] for r in recordings) for x in body
    }
    hidden = min(seen, default="", key=seen.__getitem__)
    by_landings = ""
    if config["sections"]["rule"] == "printed":
        by_landings = ", or sections.rule to landings"
    sections, changes = {}, []
    for side, state, last in (("pre", "up", "first"), ("post", "down", "last")):
        sections[side] = f"set sections.{side}_height_m{by_landings}"
        if (share := forecast.best.get(side, 1.0)) < LEFT_BY_BEST:
            most = f"in more than {100 * share:.0f} % of the landings: drop from markers.feet those"
            sections[side] = (
                f"at no height are all feet {state} {most} that touch {last}"
            )
    for reason, count in forecast.left_out().items():
        foot = "".join(feet[int(number) - 1] for number in re.findall(FOOT, reason))
        texts = [text for key, text in CHANGES.items() if key in reason]
        if texts and count >= LEAST_SHARE * forecast.landings:
            or_else = ", or take it off markers.body" * (len(body) > MIN_BODY_MARKERS)
            changes.append(
                texts[0].format(foot=foot, body=hidden, or_else=or_else, **sections)
            )
    if len(feet) > MIN_FEET and forecast.unsure > MOST_UNSURE:
        below = config["touchdowns"]["ambiguous_below"]
        share, foot = min(
            (forecast.unsure_without(foot, feet, below), foot) for foot in feet
        )
        if share < forecast.unsure / 2:
            left = f"of the others' orders {100 * share:.0f} % are unsure"
            changes.append(f"take {foot} off markers.feet: {left}")
    few = forecast.landings < FEW_LANDINGS * len(recordings)
    if forecast.unsure > MOST_UNSURE and few and len(recordings) > 1:
        joined = "give the files of one day as one recording (file: a list, in the order of time)"
        changes.append(f"{joined}: with few landings each, contacts are less sure")
    margin = config["verdict"]["margin"]
    enough = forecast.detectable is not None and forecast.detectable <= margin
    known = (
        forecast.used,
        forecast.detectable or 0.0,
        forecast.allowed,
        margin,
        len(feet),
    )
    if margin <= forecast.allowed < 1:
        changes.append(
            f"ask verdict.margin for more than {forecast.allowed:.2g}: see its notes"
        )
    elif (needed := landings_needed(*known)) > forecast.used and not enough:
        more = f"record some {float(f'{needed:.2g}'):,.0f} landings in all for verdict.margin"
        more += MORE_SPREAD * (needed > MOST_LANDINGS)
        if forecast.detectable is None:
            more = f"record more: at least {needed} landings before anything can be compared; "
            more += "verdict.margin typically takes more than 1000"
        changes.append(more)
    orders = forecast.touchdowns.loc[~forecast.touchdowns["excluded"], "schedule"]
    alike = orders.value_counts(normalize=True).max() > MOST_ALIKE
    if (
        "contact order" in forecast.reason and alike
    ) or "no two feet" in forecast.reason:
        vary = "vary how the body lands (push, tilt, speed) until other feet come first"
        single = "maps of one contact order cannot be compared"
        changes.append(f"{vary}, or name feet that do: {single}")
    return list(dict.fromkeys(changes))
