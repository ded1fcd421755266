"""Forecast of a study before it runs: landings used, and what its verdict can show.

The study runs in one process, without tables and figures. Of the verdict, only the
smallest difference that it can show is reported, so that no choice depends on its
answer.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hopdata.analysis import Study
from hopdata.arrays import pd
from hopdata.config.consistency import feet_of
from hopdata.errors import AnalysisError, with_names
from hopdata.landings import exclusion
from hopdata.landings.contacts.descents import descents
from hopdata.landings.contacts.remarks import contact_remarks, one_for_all_feet
from hopdata.landings.contacts.where import body_height
from hopdata.landings.schedules import AMBIGUOUS, order_probability
from hopdata.landings.touchdowns import NO_FOOT_LANDED
from hopdata.maps.verdict.effect import MORE_SPREAD, MOST_LANDINGS, landings_needed
from hopdata.maps.verdict.inputs import LEAST_CLASS, least_landings
from hopdata.maps.verdict.limits import TWO_KINDS, TWO_KINDS_CODE
from hopdata.maps.verdict.model import LEFT
from hopdata.messages import Message
from hopdata.recording import Recording, fraction_seen
from hopdata.recordings.plausibility import MIN_BODY_MARKERS, MIN_FEET

# Codes of the errors by which landings are too alike for a comparison: of a study with
# few feet, and of one with many.
TOO_FEW_ORDERS = "maps.too_few_orders"
TOO_FEW_LANDINGS = "maps.too_few_landings"
NO_TWO_FEET = "maps.no_two_feet"
#: Codes of what a part of a study may lack, and the whole of it have.
CURED_BY_MORE = (TOO_FEW_ORDERS, TOO_FEW_LANDINGS, NO_TWO_FEET)

#: Frames that are examined; of longer studies, the middle of each recording. There are
#: twice as many, and again, as long as they hold too few landings for a verdict.
#: Unit: frames. Origin: chosen.
MOST_FRAMES = 60_000

#: Share of the landings that a reason costs from which it is worth a change, and share
#: in which a foot is timed below which it hardly ever lands.
#: Unit: 1. Origin: chosen.
LEAST_SHARE = 0.1

#: Share of the landings below which a section that holds no more at any height cannot
#: be improved.
#: Unit: 1. Origin: chosen.
LEFT_BY_BEST = 0.5

#: Share of the landings in one contact order beyond which more of them hardly help.
#: Unit: 1. Origin: chosen.
MOST_ALIKE = 0.8

#: Share of unsure orders beyond which they reveal little.
#: Unit: 1. Origin: chosen.
MOST_UNSURE = 0.5

#: Landings a recording below which contacts are learned less well.
#: Unit: landings. Origin: chosen.
FEW_LANDINGS = 10

#: Bound of a study without a difference, as a share of the difference it detects.
#: Unit: 1. Origin: measured: 0.75 to 1.
BOUND_SHARE = 0.75

#: Judged landings of a part from which the number for the whole study is foretold, over
#: the least of which there is a size. With fewer, more frames are examined.
#: Unit: 1. Origin: chosen: of 13 simulated studies, parts of 170 to 220 landings asked
#: for 0.45 to 1.9 times as many as the study did, and parts of 300 to 600 still for
#: 0.36 to 3.2 times, half of them for 0.89 to 1.25 times.
ENOUGH = 2.0

#: Factor by which a study may allow for more than a part of it does. It may also allow
#: for as little as `LEFT`.
#: Unit: 1. Origin: chosen: of 14 simulated studies, 11 allowed at least for 0.83 to
#: 1.34 times what their parts did, and three for up to 1.4 or 1.5 times.
ALLOWED_WITHIN = 1.3

#: Factor, up and down, of the number of landings by the noise of a part alone.
#: Unit: 1. Origin: chosen. With `ALLOWED_WITHIN`, the number of the study lay within
#: the range of 12 of 13 parts of simulated studies other than those looked at before;
#: the range has no lower end where the planned landings may be enough.
NOISE_WITHIN = 1.2

# Advice for the reasons that cost landings.
CHANGES: dict[str, str] = {
    exclusion.FOOT_HIDDEN: "commands.foot_hidden_where_it_lands",
    exclusion.FOOT_THIN: "commands.foot_seen_too_briefly",
    exclusion.FOOT_UP: "commands.foot_not_down",
    exclusion.FOOT_DOWN_BEFORE: "commands.foot_down_too_early",
    exclusion.FOOT_RISES: "commands.foot_rises",
    exclusion.FOOT_GLIDES: "commands.foot_glides",
    exclusion.FOOT_POOR_FIT: "commands.foot_falls_oddly",
    exclusion.FOOT_UNDETERMINED: "commands.foot_without_kink",
    exclusion.HIDDEN_PRE: "commands.body_hidden",
    exclusion.HIDDEN_POST: "commands.body_hidden",
    exclusion.POST_NEVER_REACHED: "commands.post_not_reached",
    exclusion.LOW_FLIGHT: "commands.hops_too_low",
    exclusion.TOO_MUCH_FILLED: "commands.much_filled",
    exclusion.STATELESS: "commands.body_seen_too_briefly",
}


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
        Largest difference that is no evidence in it.
    detectable_nearest, allowed_nearest
        The same if only the nearest landings were used, as a larger study would: see
        `hopdata.maps.verdict.effect.EffectSize`.
    reason, code
        Why the verdict cannot show a difference, in words and as the code of a message;
        empty if it can.
    stops
        Whether the study has too few touchdowns to run to its end.
    best
        Share of the landings held by each section that was chosen to hold as many as it
        can.
    kinds
        What divides the landings into two kinds; empty if they are of one.
    contact_remarks
        What to know of how the contacts of these feet were timed.
    landings_share
        Share of the study's landings that the frames examined hold, by the descents of
        the body.
    judged, judged_examined
        Number of landings of which the verdict tells what it can show: in the whole
        study, and in the frames examined. None if it can show nothing.
    n_feet
        Number of feet of the verdict.
    """

    touchdowns: pd.DataFrame
    frames_share: float
    detectable: float | None = None
    allowed: float = LEFT
    detectable_nearest: float | None = None
    allowed_nearest: float | None = None
    reason: str = ""
    code: str = ""
    stops: bool = False
    best: Mapping[str, float] = field(default_factory=dict)
    kinds: str = ""
    contact_remarks: tuple[str, ...] = ()
    landings_share: float = 1.0
    judged: int | None = None
    judged_examined: int | None = None
    n_feet: int = MIN_FEET

    @property
    def is_of_enough(self) -> bool:
        """Return whether landings enough were judged to foretell a number of them."""
        if self.judged_examined is None:
            return True
        return self.judged_examined >= ENOUGH * least_landings(self.n_feet)

    @property
    def least_allowed(self) -> float:
        """Return the largest difference that is no evidence, however many landings."""
        if self.allowed_nearest is None:
            return self.allowed
        return min(self.allowed, self.allowed_nearest)

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
        if not len(landed):
            return 0.0
        return float(landed[f"contact_{foot}_s"].notna().mean())

    @property
    def unsure(self) -> float:
        """Return the share of landings used whose order is unsure."""
        used = self.touchdowns[~self.touchdowns["excluded"]]
        if not len(used):
            return 0.0
        return float((used["order_class"] == AMBIGUOUS).mean())

    def unsure_without(self, foot: str, feet: Sequence[str], below: float) -> float:
        """Return the share of landings used whose order is unsure without a foot.

        Parameters
        ----------
        foot : str
            The foot that is left out.
        feet : sequence of str
            All feet.
        below : float
            Probability below which an order is unsure.
        """
        used = self.touchdowns[~self.touchdowns["excluded"]]
        others = [other for other in feet if other != foot]
        instants = used[[f"contact_{other}_s" for other in others]].to_numpy()
        errors = used[[f"se_{other}_s" for other in others]].to_numpy()
        return float((order_probability(instants, errors) < below).mean())

    @property
    def vain(self) -> str:
        """Return why little can be learned from the study; empty if much can."""
        if self.unsure > MOST_UNSURE:
            percent = 100 * self.unsure
            return str(Message("commands.orders_unsure", {"percent": percent}))
        if self.detectable is None or self.detectable > 1:
            return str(Message("commands.verdict_out_of_reach"))
        return ""

    def left_out(self) -> dict[str, int]:
        """Return how many landings each reason costs, the most costly first."""
        words = self.touchdowns.loc[self.touchdowns["excluded"], "reason"]
        counts = words[words != NO_FOOT_LANDED].value_counts()
        return {str(reason): self._scaled(count) for reason, count in counts.items()}

    def _scaled(self, count: float) -> int:
        """Return a count in the frames examined as that of the whole study."""
        return round(float(count) / self.landings_share)


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
    # Landings that are left out by their number would be others in a part.
    by_number = any(
        entry.get("landings")
        for recording in config["recordings"]
        for entry in recording["exclude"]
    )
    most_frames = math.inf if by_number else MOST_FRAMES
    n_frames = sum(len(recording.time) for recording in recordings)
    while most_frames < n_frames:
        # A part may lack what the whole has.
        with contextlib.suppress(AnalysisError):
            forecast = _of_frames(config, recordings, most_frames)
            if not _may_be_cured_by_more(forecast):
                return forecast
        most_frames *= 2
    return _of_frames(config, recordings, most_frames)


def _may_be_cured_by_more(forecast: Forecast) -> bool:
    """Return whether the verdict lacks what more frames may hold."""
    lacks = forecast.stops or forecast.code in CURED_BY_MORE
    return lacks or not forecast.is_of_enough


def _of_frames(
    config: dict[str, Any], recordings: Sequence[Recording], most_frames: float
) -> Forecast:
    """Forecast the study of these recordings from `most_frames` of them."""
    examined = _middles(recordings, most_frames)
    parts = [one.part(frames) for one, frames in zip(recordings, examined, strict=True)]
    n_frames = sum(len(one.time) for one in recordings)
    share = sum(len(part.time) for part in parts) / n_frames
    landings_share = 1.0
    if share < 1:
        landings_share = _landings_share(recordings, examined, otherwise=share)
    study = Study(config, tuple(parts))
    candidates = study.mode_schedules().schedules
    best = _best_sections(study)
    try:
        touchdowns = study.touchdowns
    except AnalysisError as error:
        return Forecast(
            candidates,
            share,
            reason=str(error),
            code=error.code,
            stops=True,
            best=best,
            landings_share=landings_share,
        )
    remarks = contact_remarks(study.recordings, [*study.contacts.values()])
    told = tuple(str(remark) for remark in one_for_all_feet(remarks))
    verdict = study.verdict
    if verdict.effect is None:
        note = verdict.notes[-1]
        return Forecast(
            touchdowns,
            share,
            reason=note.reason,
            code=note.code,
            best=best,
            contact_remarks=told,
            landings_share=landings_share,
        )
    judged = round(verdict.n_landings / landings_share)
    effect = verdict.effect.in_landings(verdict.n_landings, judged, verdict.n_feet)
    kinds = [note.reason for note in verdict.notes if note.code == TWO_KINDS_CODE]
    return Forecast(
        touchdowns,
        share,
        detectable=effect.detectable,
        allowed=effect.allowed,
        detectable_nearest=effect.detectable_nearest,
        allowed_nearest=effect.allowed_nearest,
        judged=judged,
        judged_examined=verdict.n_landings,
        n_feet=verdict.n_feet,
        best=best,
        kinds="".join(kinds),
        contact_remarks=told,
        landings_share=landings_share,
    )


def _best_sections(study: Study) -> dict[str, float]:
    """Return the share of the landings held by each section that was chosen for it."""
    sections = study.sections
    best: dict[str, float] = {}
    if sections.rule != "landings":
        return best
    for side, share in sections.landing_shares.items():
        is_chosen = sections.chosen_by[f"{side}_height_m"] == "data"
        if is_chosen and share is not None:
            best[side] = share
    return best


def _middles(recordings: Sequence[Recording], most: float) -> list[slice]:
    """Return the frames of each recording's middle, `most` together, or all frames."""
    total = sum(len(one.time) for one in recordings)
    share = min(1.0, most / total)
    middles = []
    for one in recordings:
        n_frames = math.ceil(share * len(one.time))
        first = (len(one.time) - n_frames) // 2
        middles.append(slice(first, first + n_frames))
    return middles


def _landings_share(
    recordings: Sequence[Recording], examined: Sequence[slice], *, otherwise: float
) -> float:
    """Return the share of the body's descents that end in the frames examined.

    A recording may begin and end at rest, so that its middle holds more of them than of
    the time. Without any descent there, return `otherwise`.
    """
    n_all = 0
    n_examined = 0
    for one, frames in zip(recordings, examined, strict=True):
        for _, nadir in descents(body_height(one)):
            n_all += 1
            n_examined += frames.start <= nadir < frames.stop
    if not n_examined:
        return otherwise
    return n_examined / n_all


# A forecast in lines.


def describe(
    forecast: Forecast, config: Mapping[str, Any], recordings: Sequence[Recording]
) -> list[str]:
    """Return lines on landings and feet, losses, the verdict, and what to change."""
    feet = feet_of(config)
    used = f"{forecast.used} of {forecast.landings} will be used"
    if forecast.frames_share < 1:
        share = f"{100 * forecast.frames_share:.0f} %"
        used = f"about {used} (by the middle {share} of each recording)"
    unsure = f"{100 * forecast.unsure:.0f} % of their orders unsure"
    timed = [f"{foot} {100 * forecast.timed(foot):.0f} %" for foot in feet]
    lines = [
        "forecast",
        f"  landings  {used}, {unsure}; contacts timed: {', '.join(timed)}",
    ]
    left_out = [
        f"{with_names(reason, forecast.touchdowns)}: {count}"
        for reason, count in forecast.left_out().items()
    ]
    if left_out:
        lines.append(f"  left out  {'; '.join(left_out)}")
    lines += [f"  note      {remark}" for remark in forecast.contact_remarks]
    if forecast.kinds:
        lines.append(f"  note      {TWO_KINDS} {forecast.kinds}")
    # Where the forecast itself tells what shows, that counts.
    is_told = forecast.detectable is not None and forecast.detectable <= 1
    if len(feet) == MIN_FEET and not is_told:
        lines.append(f"  note      {Message('maps.little_power')}")
        n_markers = len(config["markers"]["feet"])
        if n_markers > len(feet):
            joined = {"markers": n_markers, "feet": len(feet)}
            of_markers = Message("commands.feet_are_joined", joined)
            lines.append(f"  note      {of_markers}")
    lines.append(f"  verdict   {reach(forecast, config)}")
    for change in changes(forecast, config, recordings):
        lines.append(f"  change    {change}")
    return lines


def reach(forecast: Forecast, config: Mapping[str, Any]) -> Message:
    """Tell whether the verdict can be reached."""
    detectable = forecast.detectable
    margin = config["verdict"]["margin"]
    if detectable is None:
        return Message("commands.out_of_reach", {"reason": forecast.reason})
    if detectable > 1:
        return Message("commands.beyond_the_map")
    values = {
        "percent": 100 * detectable,
        "power": 100 * config["verdict"]["power"],
        "margin": 100 * margin,
    }
    shown = {"shown": Message("commands.shown_difference", values)}
    if detectable <= margin:
        return Message("commands.in_reach", shown)
    # A study without a difference may still bound it below the margin.
    if BOUND_SHARE * detectable <= margin:
        return Message("commands.in_doubt", shown)
    return Message("commands.in_reach_if_large", shown)


# What to change.


def changes(
    forecast: Forecast, config: Mapping[str, Any], recordings: Sequence[Recording]
) -> list[Message]:
    """List what to change, the most costly reason first."""
    feet = feet_of(config)
    idle = [foot for foot in feet if forecast.timed(foot) < LEAST_SHARE]
    if idle and len(feet) - len(idle) >= MIN_FEET:
        return [Message("commands.foot_hardly_lands", {"foot": foot}) for foot in idle]
    if not forecast.landings and len(forecast.touchdowns):
        return [Message("commands.no_foot_down")]
    found = [
        *_for_lost_landings(forecast, config, recordings),
        *_for_unsure_orders(forecast, config, recordings),
        # More of the same would not help where one order occurs.
        *_for_one_order(forecast),
        *_for_few_landings(forecast, config),
    ]
    # Two reasons may have the same advice.
    by_text: dict[str, Message] = {}
    for change in found:
        by_text.setdefault(str(change), change)
    return list(by_text.values())


def _for_lost_landings(
    forecast: Forecast, config: Mapping[str, Any], recordings: Sequence[Recording]
) -> Iterator[Message]:
    """Yield advice on each reason that costs many landings."""
    feet = feet_of(config)
    body = config["markers"]["body"]
    values: dict[str, object] = {
        "body": _most_hidden(body, recordings),
        "or_else": "",
        "pre": _section_advice("pre", forecast, config),
        "post": _section_advice("post", forecast, config),
    }
    if len(body) > MIN_BODY_MARKERS:
        values["or_else"] = ", or take it off markers.body"
    for words, count in forecast.left_out().items():
        reason = exclusion.reason_of(words, feet)
        if reason is None or reason.code not in CHANGES:
            continue
        if count >= LEAST_SHARE * forecast.landings:
            foot = ""
            if reason.code in exclusion.OF_A_FOOT:
                foot = feet[reason.values["foot"] - 1]
            yield Message(CHANGES[reason.code], {"foot": foot, **values})


def _most_hidden(body: Sequence[str], recordings: Sequence[Recording]) -> str:
    """Return the body marker that is seen least; empty without body markers."""
    seen = {}
    for marker in body:
        shares = [fraction_seen(one)[one.markers.index(marker)] for one in recordings]
        seen[marker] = sum(shares)
    return min(seen, default="", key=seen.__getitem__)


def _section_advice(
    side: str, forecast: Forecast, config: Mapping[str, Any]
) -> Message:
    """Return what to do about a section that few landings reach."""
    share = forecast.best.get(side, 1.0)
    if share < LEFT_BY_BEST:
        return Message(f"commands.no_{side}_section", {"percent": 100 * share})
    if config["sections"]["rule"] == "printed":
        return Message("commands.set_section_or_rule", {"side": side})
    return Message("commands.set_section", {"side": side})


def _for_unsure_orders(
    forecast: Forecast, config: Mapping[str, Any], recordings: Sequence[Recording]
) -> Iterator[Message]:
    if not forecast.unsure > MOST_UNSURE:
        return
    feet = feet_of(config)
    if len(feet) > MIN_FEET:
        below = config["touchdowns"]["ambiguous_below"]
        unsure_without = [
            (forecast.unsure_without(foot, feet, below), foot) for foot in feet
        ]
        share, foot = min(unsure_without)
        if share < forecast.unsure / 2:
            values = {"foot": foot, "percent": 100 * share}
            yield Message("commands.foot_makes_unsure", values)
    are_few = forecast.landings < FEW_LANDINGS * len(recordings)
    if are_few and len(recordings) > 1:
        yield Message("commands.join_files")


def _for_few_landings(
    forecast: Forecast, config: Mapping[str, Any]
) -> Iterator[Message]:
    margin = config["verdict"]["margin"]
    detectable = forecast.detectable
    least_allowed = forecast.least_allowed
    if margin <= least_allowed < 1:
        yield Message("commands.larger_margin", {"allowed": least_allowed})
        return
    n_feet = len(feet_of(config))
    judged = forecast.used if forecast.judged is None else forecast.judged
    needed = landings_needed(
        judged,
        detectable or 0.0,
        forecast.allowed,
        margin,
        n_feet,
        detectable_nearest=forecast.detectable_nearest,
        allowed_nearest=forecast.allowed_nearest,
    )
    is_enough = detectable is not None and detectable <= margin
    if needed <= judged or is_enough:
        return
    if detectable is None:
        yield Message("commands.record_to_compare", {"landings": needed})
        return
    or_spread = MORE_SPREAD if needed > MOST_LANDINGS else ""
    least, most = _range_of_needed(forecast, judged, margin)
    if least <= judged:
        so_far = {
            "judged": judged,
            "most": _most_words(most),
            "examined": forecast.judged_examined or judged,
        }
        yield Message("commands.landings_may_do", so_far)
        return
    values = {
        "landings": _two_digits(needed),
        "least": _two_digits(least),
        "most": _most_words(most),
        "examined": forecast.judged_examined or judged,
        "or_spread": or_spread,
    }
    yield Message("commands.record_landings", values)


def _range_of_needed(
    forecast: Forecast, judged: int, margin: float
) -> tuple[float, float]:
    """Return the fewest and the most landings that the study may ask for.

    The noise of the size is known well; what smooth terms leave is less so, and counts
    much where it is near the margin. The most are infinite if it may reach it.
    """
    least: list[float] = []
    most: list[float] = []
    windows: list[tuple[float | None, float | None]] = [
        (forecast.detectable, forecast.allowed),
        (forecast.detectable_nearest, forecast.allowed_nearest),
    ]
    for detectable, allowed in windows:
        if detectable is None or allowed is None:
            continue
        for allowed_then, found in (
            (min(allowed, LEFT), least),
            (ALLOWED_WITHIN * allowed, most),
        ):
            needed: float = math.inf
            if allowed_then < margin:
                # Noise stays as it is.
                shown = detectable - allowed + allowed_then
                needed = landings_needed(
                    judged, shown, allowed_then, margin, forecast.n_feet
                )
            found.append(needed)
    return min(least) / NOISE_WITHIN, min(most) * NOISE_WITHIN


def _most_words(most: float) -> str:
    """Return the upper end of a range, to two digits, or that there may be none."""
    if not math.isfinite(most):
        return str(Message("commands.no_number_may_do"))
    return f"{_two_digits(most):,.0f}"


def _two_digits(number: float) -> float:
    return float(f"{number:.2g}")


def _for_one_order(forecast: Forecast) -> Iterator[Message]:
    """Yield advice if the landings have one contact order, or nearly so."""
    used = forecast.touchdowns[~forecast.touchdowns["excluded"]]
    counts = used["schedule"].value_counts()
    are_alike = counts.max() > MOST_ALIKE * counts.sum()
    few_of_one = forecast.code in (TOO_FEW_ORDERS, TOO_FEW_LANDINGS) and are_alike
    if few_of_one or forecast.code == NO_TWO_FEET:
        most = int(counts.max()) if len(counts) else 0
        values = {"most": most, "used": len(used), "least": LEAST_CLASS}
        yield Message("commands.vary_the_order", values)
