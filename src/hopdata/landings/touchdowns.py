"""The table of touchdowns: every descent with its contacts and schedule, or why it is left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray
from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError, require_choice
from hopdata.landings import schedules
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.find import Contacts, find_contacts
from hopdata.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

# Why a touchdown is left out: what was not seen of the body, or of a foot.

HIDDEN_PRE = "frames missing at the pre section"
NO_FOOT_LANDED = "no foot landed"


def exclusion_reasons(
    transitions: descents.Transitions, contacts: Contacts, *, longest_gap_s: float
) -> list[str]:
    """Say of each touchdown why it is left out, the weightiest reason first; empty if it is used.

    Parameters
    ----------
    transitions : Transitions
        L descents of the body.
    contacts : Contacts
        Their contacts.
    longest_gap_s : float
        Longest time without a frame over a crossing, s.
    """
    t_pre, t_post = transitions.t_pre[:, None], transitions.t_post[:, None]
    status, instant, se = contacts.status, contacts.instant, contacts.se
    timed = status == descents.LANDED
    failures = (
        (status == descents.MISSING, "frames missing at the contact of foot {}"),
        (status == descents.NOT_LANDED, "foot {} not down by the post section"),
        (status == descents.ALREADY_DOWN, "foot {} down before the pre section"),
        (status == descents.POOR_FIT, "poor fit of foot {}"),
        (timed & np.isnan(instant), "no contact found for foot {}"),
        (timed & (instant < t_pre), "foot {} down before the pre section"),
        (timed & (instant > t_post), "foot {} not down by the post section"),
        # Known no better than that it is somewhere in the transition, or beyond: no kink was seen.
        (timed & (se > t_post - t_pre), "contact of foot {} not determined"),
    )
    of_body = (
        (transitions.gap_pre > longest_gap_s, HIDDEN_PRE),
        (transitions.gap_post > longest_gap_s, "frames missing at the post section"),
        (~transitions.complete, "post section never reached"),
        ((status == descents.NOT_LANDED).all(axis=1), NO_FOOT_LANDED),
    )
    reasons = [""] * len(transitions)
    for failed, text in reversed(failures):
        for row in np.flatnonzero(failed.any(axis=1)):
            reasons[row] = text.format(int(np.argmax(failed[row])) + 1)
    for failed, text in reversed(of_body):
        for row in np.flatnonzero(failed):
            reasons[row] = text
    return reasons


# Landings while the body is hidden: seen by the feet alone, so that none is left out unlisted.

CLEARLY_UP = 2.0  # times the height below which a foot is down


def find_hidden_landings(
    time: FloatArray,
    feet: FloatArray,
    body_height: FloatArray,
    found: descents.Transitions,
    *,
    down_height_m: float,
    longest_gap_s: float,
) -> descents.Transitions:
    """Find landings that have no descent of their own, because the body is hidden meanwhile.

    Of several landings in one gap the body's height tells one at most: it is above the sections
    before the gap, and below them after it.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    feet : (N, F) array
        Heights of the feet above the floor, m; NaN where unseen.
    body_height : (N,) array
        Mean height of the body markers, m; NaN where unseen.
    found : Transitions
        The descents of the body that were seen.
    down_height_m : float
        A foot below this height is down, m; at twice the height it is up.
    longest_gap_s : float
        Shorter gaps of the body hide no landing, s.

    Returns
    -------
    Transitions
        Landings from a frame in which all feet that are seen are up, `t_pre`, to the first in which
        all are down, `t_post`. Both gaps are the longest of the body that begins or ends between.
    """
    starts, ends = _all_up_to_all_down(feet, down_height_m)
    t_pre, t_post = time[starts], time[ends]
    gap = _longest_gaps(time[~np.isnan(body_height)], t_pre, t_post)
    hidden = (gap > longest_gap_s) & ~_have_a_descent(t_pre, t_post, found)
    return descents.Transitions(t_pre[hidden], t_post[hidden], gap[hidden], gap[hidden])


def _all_up_to_all_down(
    feet: FloatArray, down_height_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Last frames with all feet up, and first frames with all of them down after these."""
    seen = np.flatnonzero(~np.isnan(feet).all(axis=1))
    lowest, highest = np.nanmin(feet[seen], axis=1), np.nanmax(feet[seen], axis=1)
    up, down = lowest >= CLEARLY_UP * down_height_m, highest <= down_height_m
    ends, _ = descents.schmitt_edges(up.astype(float) - down, high=1.0, low=-1.0)
    if len(ends) == 0:
        return ends, ends
    return seen[descents.last_at_or_before(np.flatnonzero(up), ends)], seen[ends]


def _longest_gaps(seen: FloatArray, first: FloatArray, last: FloatArray) -> FloatArray:
    """Longest time without a frame, s, that overlaps each interval; infinite at either end."""
    edges = np.concatenate([[-np.inf], seen, [np.inf]])
    gaps = np.diff(edges)
    begin = np.searchsorted(edges, first, side="right") - 1
    end = np.searchsorted(edges, last, side="left")
    return np.array([gaps[a:b].max(initial=0.0) for a, b in zip(begin, end, strict=True)])


def _have_a_descent(
    t_pre: FloatArray, t_post: FloatArray, found: descents.Transitions
) -> BoolArray:
    """Tell which landings have a descent: each descent has one, the nearest that it may be of.

    Its crossings may lie anywhere in the gaps about them.
    """
    have = np.zeros(len(t_pre), dtype=bool)
    middle = 0.5 * (t_pre + t_post)
    until = np.where(found.complete, found.t_post, found.t_pre)
    gap_post = np.maximum(found.gap_pre, found.gap_post)
    for begin, end, before, after in zip(found.t_pre, until, found.gap_pre, gap_post, strict=True):
        may_be = (t_pre <= end + after) & (t_post >= begin - before) & ~have
        near = np.flatnonzero(may_be)
        if len(near) > 0:
            have[near[np.argmin(np.abs(middle[near] - 0.5 * (begin + end)))]] = True
    return have


LONGEST_GAP_FRAMES = 2.5  # between the frames about a crossing: one of them may be missing
LONGEST_GAP_S = 0.025  # the same, where frames are many: the body moves no further for them
LEAST_DOWN_SHARE = 0.15  # of the distance between the sections
LEAST_DOWN_SIGMAS = 4.0
LOW_FLIGHT = "body stayed below the pre section"
LOW = 1  # place of the low flights among all landings


@one_blas_thread()
def touchdown_table(
    recording: Recording,
    *,
    pre_height_m: float,
    post_height_m: float,
    method: str = "kink",
    gravity: str = "learned",
    window_before_s: float | None = None,
    window_after_s: float | None = None,
    down_height_m: float | None = None,
    maximum_misfit: float = 5.0,
    ambiguous_below: float = 0.9,
    ambiguous: str = "keep",
) -> pd.DataFrame:
    """Tabulate the touchdowns of a levelled recording (Sec. 2.2.2 and 2.2.3 of the dissertation).

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    pre_height_m, post_height_m : float
        The sections: mean height of the body markers, m.
    method, gravity, window_before_s, window_after_s, maximum_misfit
        See `hopdata.landings.contacts.find.find_contacts`.
    down_height_m : float, optional
        A foot that never sinks below this height has not landed, m. By default 15 % of the distance
        between the sections, and at least four times the noise.
    ambiguous_below : float
        Touchdowns whose schedule is less probable are of the class ``ambiguous``.
    ambiguous : {"keep", "pool", "exclude"}
        What becomes of these: they are used by their most probable order, or only where the order
        does not matter (see `hopdata.landings.states.assemble`), or left out.

    Returns
    -------
    pandas.DataFrame
        One row for each descent through the pre section, in order of time: recording, index,
        t_pre_s, t_post_s, contact_<foot>_s and se_<foot>_s for each foot, schedule (the most
        probable one), probability, class (the schedule or ``ambiguous``), runner_up and its
        runner_up_probability, spread_s, excluded, reason. Two more kinds of landings have rows, and
        are excluded: from a top below the pre section, with t_pre_s the instant of the top; and
        those that only the feet show, as the body is hidden, with t_pre_s the last instant with
        all feet up.

    Raises
    ------
    AnalysisError
        If the sections are out of order, or there are fewer than two feet.
    ConfigError
        If `method`, `gravity` or `ambiguous` is unknown.
    """
    require_choice("touchdowns.ambiguous", ambiguous, schedules.TREATMENTS)
    if len(recording.names("foot")) < 2:
        raise AnalysisError(
            f"{recording.name}: expected at least 2 foot markers, found "
            f"{len(recording.names('foot'))}"
        )
    heights = recording.feet[:, :, 2]
    down = down_height_m or max(
        LEAST_DOWN_SHARE * (pre_height_m - post_height_m),
        LEAST_DOWN_SIGMAS * descents.height_noise(heights),
    )
    transitions, kind = _all_landings(
        recording, down, pre_height_m=pre_height_m, post_height_m=post_height_m
    )
    contacts = find_contacts(
        recording.time,
        heights,
        transitions,
        down_height_m=down,
        method=method,
        gravity=gravity,
        window_before_s=window_before_s,
        window_after_s=window_after_s,
        maximum_misfit=maximum_misfit,
    )
    table = _table(recording, transitions, contacts, ambiguous_below, ambiguous)
    idle = _no_foot_near(recording, transitions, down)
    table.loc[idle & table["excluded"], "reason"] = NO_FOOT_LANDED
    landed = (contacts.status == descents.LANDED).any(axis=1)
    return _with_low_flights(table, kind == LOW, landed=landed)


def left_out(table: pd.DataFrame, spans: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Exclude by hand the touchdowns of which any part lies in a span of time.

    Parameters
    ----------
    table
        See `touchdown_table`.
    spans
        Each ``from_s`` and ``to_s``, s, and its ``reason``. One that is excluded already keeps its
        own reason.
    """
    table = table.copy()
    begins = table["t_pre_s"].to_numpy(float)
    ends = np.fmax(table["t_post_s"].to_numpy(float), begins)
    for span in spans:
        inside = (begins <= span["to_s"]) & (ends >= span["from_s"]) & ~table["excluded"]
        table.loc[inside, "reason"] = f"by hand: {span['reason']}"
        table.loc[inside, "excluded"] = True
    return table


def _all_landings(
    recording: Recording, down_height_m: float, *, pre_height_m: float, post_height_m: float
) -> tuple[descents.Transitions, NDArray[np.int64]]:
    """Descents of the body, flights below the pre section, and landings with the body hidden."""
    time, height = recording.time, recording.body_height
    sections = {"pre_height_m": pre_height_m, "post_height_m": post_height_m}
    seen = [
        find(time, height, **sections)
        for find in (descents.find_transitions, descents.find_low_flights)
    ]
    hidden = find_hidden_landings(
        time,
        recording.feet[:, :, 2],
        height,
        descents.together(*seen)[0],
        down_height_m=down_height_m,
        longest_gap_s=_longest_gap_s(recording),
    )
    return descents.together(*seen, hidden)


def _no_foot_near(
    recording: Recording, transitions: descents.Transitions, down_height_m: float
) -> BoolArray:
    """Tell of the descents that end above the post section in which no foot comes down, (L,).

    They are watched for as long as the others take: a runner's other leg stops the body earlier.
    """
    until = transitions.t_pre + np.nanmax(transitions.t_post - transitions.t_pre, initial=0.0)
    spans = zip(*np.searchsorted(recording.time, [transitions.t_pre, until]), strict=True)
    lowest = [np.min(recording.feet[a:b, :, 2], initial=np.inf) for a, b in spans]  # NaN: unseen
    return ~transitions.complete & (np.array(lowest) > down_height_m)


def _longest_gap_s(recording: Recording) -> float:
    """Longest gap of the body about a crossing that is still seen, s."""
    frame_s = float(np.median(np.diff(recording.time)))
    return max(LONGEST_GAP_FRAMES * frame_s, LONGEST_GAP_S)


def _with_low_flights(
    table: pd.DataFrame, low: NDArray[np.bool_], *, landed: NDArray[np.bool_]
) -> pd.DataFrame:
    """Exclude landings from below the pre section; a sway on feet that stay down is no landing."""
    table.loc[low & (table["reason"] != HIDDEN_PRE), "reason"] = LOW_FLIGHT
    table.loc[low, "excluded"] = True
    table = table[~low | landed].reset_index(drop=True)
    return table.assign(index=np.arange(len(table)))


def _table(
    recording: Recording,
    transitions: descents.Transitions,
    contacts: Contacts,
    ambiguous_below: float,
    ambiguous: str,
) -> pd.DataFrame:
    import pandas as pd

    feet = recording.names("foot")
    names = schedules.schedule_names(contacts.instant)
    probability = schedules.order_probability(contacts.instant, contacts.se)
    classes = schedules.schedule_classes(names, probability, ambiguous_below=ambiguous_below)
    second, second_probability = schedules.runner_up(contacts.instant, contacts.se)
    reasons = exclusion_reasons(transitions, contacts, longest_gap_s=_longest_gap_s(recording))
    left_out = {schedules.AMBIGUOUS: "order ambiguous"} if ambiguous == "exclude" else {}
    reasons = [r or left_out.get(name, "") for r, name in zip(reasons, classes, strict=True)]
    columns = {
        "recording": recording.name,
        "index": np.arange(len(transitions)),
        "t_pre_s": transitions.t_pre,
        "t_post_s": transitions.t_post,
        **{f"contact_{foot}_s": contacts.instant[:, i] for i, foot in enumerate(feet)},
        **{f"se_{foot}_s": contacts.se[:, i] for i, foot in enumerate(feet)},
        "schedule": names,
        "probability": probability,
        "class": classes,
        "runner_up": [
            name if first else ""
            for first, name in zip(names, schedules.order_names(second), strict=True)
        ],
        "runner_up_probability": second_probability,
        "spread_s": schedules.spread(contacts.instant),
        "excluded": [bool(reason) for reason in reasons],
        "reason": reasons,
    }
    return pd.DataFrame(columns)
