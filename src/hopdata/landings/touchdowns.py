"""The table of touchdowns: each descent with its contacts and schedule.

A descent that is not used keeps its row, with the reason why it is excluded. Reasons
are messages; the table holds their English words.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, chosen, require_choice, with_names
from hopdata.landings import exclusion, schedules
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.find import find_landings
from hopdata.landings.contacts.judged import Contacts
from hopdata.landings.contacts.tables import are_by, contacts_of
from hopdata.landings.contacts.timing import METHODS, find_contacts
from hopdata.landings.contacts.where import usual_down_height
from hopdata.landings.filling import mark_filled
from hopdata.messages import Message
from hopdata.recording import Recording

#: Share of the feet that must be seen not to land for a descent to be another leg's.
#: Unit: 1. Origin: chosen.
IDLE_SHARE = 0.5

# Reasons that other code compares with, in words.
HIDDEN_PRE = Message(exclusion.HIDDEN_PRE).text()
NO_FOOT_LANDED = Message(exclusion.NO_FOOT_LANDED).text()
LOW_FLIGHT = Message(exclusion.LOW_FLIGHT).text()


def exclusion_reasons(
    transitions: descents.Transitions,
    contacts: Contacts,
    *,
    longest_gap_s: float,
    continued_s: float = descents.CONTINUED_S,
) -> list[str]:
    """Return the most important reason to exclude each touchdown; empty if it is used.

    Parameters
    ----------
    transitions : Transitions
        L descents of the body.
    contacts : Contacts
        Their contacts.
    longest_gap_s : float
        Longest time without a frame that a crossing may lie in, s.
    continued_s : float
        How long before the pre section a foot may touch, s.
    """
    t_pre = transitions.t_pre[:, None]
    t_post = transitions.t_post[:, None]
    status = contacts.status
    instant = contacts.instant
    timed = status == descents.LANDED
    # The last of these that holds is told. Those of shape (L, n) name the first foot.
    failures = (
        # The error exceeds the whole transition: no kink was seen.
        (exclusion.FOOT_UNDETERMINED, timed & (contacts.se > t_post - t_pre)),
        (exclusion.FOOT_UP, timed & (instant > t_post)),
        (exclusion.FOOT_DOWN_BEFORE, timed & (instant < t_pre - continued_s)),
        (exclusion.FOOT_WITHOUT_CONTACT, timed & np.isnan(instant)),
        (exclusion.FOOT_RISES, status == descents.RISES),
        (exclusion.FOOT_GLIDES, status == descents.GLIDES),
        (exclusion.FOOT_POOR_FIT, status == descents.POOR_FIT),
        (exclusion.FOOT_DOWN_BEFORE, status == descents.ALREADY_DOWN),
        (exclusion.FOOT_UP, status == descents.NOT_LANDED),
        (exclusion.FOOT_THIN, status == descents.THIN),
        (exclusion.FOOT_HIDDEN, status == descents.MISSING),
        (exclusion.POST_NEVER_REACHED, ~transitions.complete[:, None]),
        (exclusion.HIDDEN_POST, transitions.gap_post[:, None] > longest_gap_s),
        (exclusion.HIDDEN_PRE, transitions.gap_pre[:, None] > longest_gap_s),
        (exclusion.NO_FOOT_LANDED, _of_another_leg(status)[:, None]),
    )
    reasons = [""] * len(transitions)
    for code, failed in failures:
        for row in np.flatnonzero(failed.any(axis=1)):
            foot = int(np.argmax(failed[row])) + 1
            reasons[row] = Message(code, {"foot": foot}).text()
    return reasons


def _of_another_leg(status: IntArray) -> BoolArray:
    """Mark the descents (L,) in which another leg landed.

    No foot landed, and at least half of them were seen not to.
    """
    idle = np.isin(status, (descents.NOT_LANDED, descents.ALREADY_DOWN))
    untimed = np.isin(status, (descents.MISSING, descents.THIN))
    none_landed = (idle | untimed).all(axis=1)
    return np.asarray(none_landed & (idle.mean(axis=1) >= IDLE_SHARE))


@one_blas_thread()
def touchdown_table(
    recording: Recording,
    *,
    pre_height_m: float,
    post_height_m: float,
    landings: pd.DataFrame | None = None,
    method: str = "kink",
    ambiguous_below: float = 0.9,
    ambiguous: str = "keep",
    **options: Any,
) -> pd.DataFrame:
    """Tabulate the touchdowns of a levelled recording (Sec. 2.2.2 and 2.2.3).

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    pre_height_m, post_height_m : float
        The sections: mean height of the body markers, m.
    landings : pandas.DataFrame, optional
        Landings of the recording with their contacts, from `find_landings`; by default
        found here. If their contacts are by another method, only the descents of the
        body are used.
    method : str
        See `hopdata.landings.contacts.timing.find_contacts`. Every method but the kink
        fit searches between the sections.
    ambiguous_below : float
        Touchdowns whose schedule is less probable than this are of the class
        ``ambiguous``.
    ambiguous : {"keep", "pool", "exclude"}
        How ambiguous touchdowns are treated: used with their most probable order, used
        only where the order does not matter (see `hopdata.landings.states.assemble`),
        or excluded.
    **options
        Options of `find_landings`.

    Returns
    -------
    pandas.DataFrame
        One row for each descent through the pre section, in order of time: recording,
        touchdown, method, t_pre_s, t_post_s, contact_<foot>_s and se_<foot>_s for each
        foot, common_<foot>_s (the error that all instants of a foot may share, not in
        se), schedule (the most probable one), probability, class (the schedule or
        ``ambiguous``), runner_up and its runner_up_probability, spread_s, excluded,
        reason. Three more kinds of landings have rows and are excluded: landings that
        start from a top below the pre section, where t_pre_s is the instant of the top;
        landings that end above it; and landings seen in the feet alone while the body
        is hidden, where t_pre_s is the last instant with all feet up.

    Raises
    ------
    AnalysisError
        If the sections are out of order, or there are fewer than two feet.
    ConfigError
        If `method`, `gravity` or `ambiguous` is unknown.
    """
    require_choice("touchdowns.ambiguous", ambiguous, schedules.TREATMENTS)
    printed = chosen("touchdowns.method", method, METHODS) is not None
    # The printed methods search again, between the sections, and need the descents
    # alone.
    if landings is None or not (printed or are_by(landings, method)):
        landings = find_landings(recording, method=method, **options)
    spans = landings[["begin_s", "end_s"]].to_numpy(float)
    hidden = landings["hidden"].to_numpy(bool)
    transitions = _transitions(recording, spans, hidden, pre_height_m, post_height_m)
    if printed:
        down_height_m = options.get("down_height_m")
        if not down_height_m:
            down_height_m = usual_down_height(recording, spans)
        contacts = find_contacts(
            recording.time,
            recording.feet[:, :, 2],
            transitions,
            down_height_m=down_height_m,
            method=method,
        )
    else:
        contacts = contacts_of(landings)
    table = _table(recording, transitions, contacts, ambiguous_below, ambiguous)
    table.insert(2, "method", method)

    time, height = _seen(recording)
    tops = np.interp(spans[:, 0], time, height)
    low = (tops < pre_height_m) & (table["reason"] != HIDDEN_PRE)
    table.loc[low, ["reason", "excluded"]] = LOW_FLIGHT, True
    # A sway on feet that stay down is not a landing, nor is a descent that ends above
    # the sections.
    crosses = np.isfinite(transitions.t_pre)
    through = (tops >= pre_height_m) & crosses
    landed = (contacts.status == descents.LANDED).any(axis=1) | hidden
    table["t_pre_s"] = table["t_pre_s"].where(crosses, spans[:, 0])
    table = table[through | landed].reset_index(drop=True)
    return table.assign(touchdown=np.arange(1, len(table) + 1))


def touchdown_tables(
    recordings: Iterable[Recording],
    landings: Mapping[str, pd.DataFrame],
    exclude: Iterable[Sequence[Mapping[str, Any]]],
    *,
    largest_share: float,
    **options: Any,
) -> Iterator[pd.DataFrame]:
    """Yield the table of each recording, without those excluded by hand or filling.

    Parameters
    ----------
    recordings, landings
        Levelled recordings, and their landings by name, from `find_landings`.
    exclude
        Entries for each recording, see `left_out`.
    largest_share
        See `mark_filled`.
    **options
        Sections and other options of `touchdown_table`.
    """
    for recording, entries in zip(recordings, exclude, strict=True):
        table = touchdown_table(recording, landings=landings[recording.name], **options)
        table = mark_filled(recording, table, largest_share=largest_share)
        yield left_out(table, entries)


def left_out(table: pd.DataFrame, entries: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Exclude the touchdowns that the user names, or that overlap a span of time.

    Parameters
    ----------
    table
        See `touchdown_table`.
    entries
        ``recordings[].exclude`` of the configuration: ``from_s`` and ``to_s``, s,
        ``landings``, ``markers`` and the ``reason``. A touchdown that is already
        excluded keeps its own reason, unless the entry removes markers. Entries that
        remove only body markers exclude nothing more here.

    Raises
    ------
    AnalysisError
        If no landing has one of the numbers.
    """
    table = table.copy()
    begins = table["t_pre_s"].to_numpy(float)
    ends = np.fmax(table["t_post_s"].to_numpy(float), begins)
    for entry in entries:
        numbers = set(entry.get("landings") or ())
        markers = entry.get("markers") or ()
        _require_numbers(numbers, table)
        # Comparisons with NaN are false, so a missing end is no limit.
        from_s, to_s = np.array([entry.get("from_s"), entry.get("to_s")], float)
        inside = ~(ends < from_s) & ~(begins > to_s)
        out = table["excluded"].to_numpy(bool)
        is_of_foot = any(f"contact_{name}_s" in table for name in markers)
        if numbers:
            chosen = table["touchdown"].isin(numbers) & ~out
        elif is_of_foot:
            chosen = inside  # a foot was removed by hand, so its contacts do not count
        elif markers:
            chosen = inside & out  # the other body markers did not suffice
        else:
            chosen = inside & ~out
        values = {"reason": entry["reason"]}
        if markers and not numbers:
            values["markers"] = ", ".join(markers)
            told = Message("landings.markers_by_hand", values)
        else:
            told = Message("landings.by_hand", values)
        table.loc[chosen, ["reason", "excluded"]] = told.text(), True
    return table


def _require_numbers(numbers: set[int], table: pd.DataFrame) -> None:
    """Raise an error if a landing that is named does not exist."""
    for number in sorted(numbers - set(table["touchdown"])):
        name = ""
        if len(table):
            name = table["recording"].iloc[0]
        wanted = f"numbers of the {len(table)} landings of '{name}'"
        raise AnalysisError.at("recordings[].exclude: landings", wanted, number)


def _transitions(
    recording: Recording,
    spans: FloatArray,
    hidden: BoolArray,
    pre_height_m: float,
    post_height_m: float,
) -> descents.Transitions:
    """Find where landings cross the sections.

    A hidden landing crosses at the ends of its span.
    """
    time, height = _seen(recording)
    found = descents.find_transitions(
        time,
        height,
        pre_height_m=pre_height_m,
        post_height_m=post_height_m,
        spans=spans,
    )
    gap = descents.longest_gaps(time, spans)
    return descents.Transitions(
        t_pre=np.where(hidden, spans[:, 0], found.t_pre),
        t_post=np.where(hidden, spans[:, 1], found.t_post),
        gap_pre=np.where(hidden, gap, found.gap_pre),
        gap_post=np.where(hidden, gap, found.gap_post),
    )


def _seen(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return times, s, and heights, m, of the frames that show the body."""
    seen = np.isfinite(recording.body_height)
    return recording.time[seen], recording.body_height[seen]


def _table(
    recording: Recording,
    transitions: descents.Transitions,
    contacts: Contacts,
    ambiguous_below: float,
    ambiguous: str,
) -> pd.DataFrame:
    """Tabulate descents, contacts and schedules: see `touchdown_table`."""
    feet = recording.names("foot")
    common = contacts.common
    if not common.size:
        common = np.full(len(feet), np.nan)
    names = schedules.schedule_names(contacts.instant)
    probability = schedules.order_probability(contacts.instant, contacts.se)
    classes = schedules.schedule_classes(
        names, probability, ambiguous_below=ambiguous_below
    )
    second, second_probability = schedules.runner_up(contacts.instant, contacts.se)
    seconds = schedules.order_names(second)
    reasons = exclusion_reasons(
        transitions,
        contacts,
        longest_gap_s=descents.longest_gap_s(recording.time, recording.time_scale),
        continued_s=descents.CONTINUED_S * recording.time_scale,
    )
    if ambiguous == "exclude":
        order_is_ambiguous = Message(exclusion.ORDER_AMBIGUOUS).text()
        for row, name in enumerate(classes):
            if name == schedules.AMBIGUOUS and not reasons[row]:
                reasons[row] = order_is_ambiguous
    columns: dict[str, Any] = {
        "recording": recording.name,
        "touchdown": np.arange(1, len(transitions) + 1),
        "t_pre_s": transitions.t_pre,
        "t_post_s": transitions.t_post,
    }
    for i, foot in enumerate(feet):
        columns[f"contact_{foot}_s"] = contacts.instant[:, i]
    for i, foot in enumerate(feet):
        columns[f"se_{foot}_s"] = contacts.se[:, i]
    for i, foot in enumerate(feet):
        columns[f"common_{foot}_s"] = common[i]
    columns["schedule"] = names
    columns["probability"] = probability
    columns["order_class"] = classes
    columns["runner_up"] = [
        other if name else "" for name, other in zip(names, seconds, strict=True)
    ]
    columns["runner_up_probability"] = second_probability
    columns["spread_s"] = schedules.spread(contacts.instant)
    columns["excluded"] = [bool(reason) for reason in reasons]
    # Numbers of feet are those of orders; readers of the table know the names.
    columns["reason"] = [with_names(reason, columns) for reason in reasons]
    return pd.DataFrame(columns)
