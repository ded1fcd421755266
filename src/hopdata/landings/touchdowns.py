"""The table of touchdowns: each descent with its contacts and schedule, or why it is excluded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, chosen, require_choice
from hopdata.landings import schedules
from hopdata.landings.contacts import descents, find
from hopdata.landings.filling import mark_filled
from hopdata.recording import Recording

# Why a touchdown is excluded: the body or a foot was not seen, or a foot did not land.

HIDDEN_PRE = "frames missing at the pre section"
NO_FOOT_LANDED = "no foot landed"


def exclusion_reasons(
    transitions: descents.Transitions, contacts: find.Contacts, *, longest_gap_s: float,
    continued_s: float = descents.CONTINUED_S,
) -> list[str]:  # fmt: skip
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
    t_pre, t_post = transitions.t_pre[:, None], transitions.t_post[:, None]
    status, instant, se = contacts.status, contacts.instant, contacts.se
    timed = status == descents.LANDED
    # No foot landed, and at least half of them were seen not to: another leg landed.
    idle = np.isin(status, (descents.NOT_LANDED, descents.ALREADY_DOWN))
    untimed = np.isin(status, (descents.MISSING, descents.THIN))
    none = (idle | untimed).all(axis=1) & (idle.mean(axis=1) >= 0.5)
    failures = (
        (none[:, None], NO_FOOT_LANDED),
        (transitions.gap_pre[:, None] > longest_gap_s, HIDDEN_PRE),
        (
            transitions.gap_post[:, None] > longest_gap_s,
            "frames missing at the post section",
        ),
        (~transitions.complete[:, None], "post section never reached"),
        (status == descents.MISSING, "frames missing at the contact of foot {}"),
        (status == descents.THIN, "too few frames to time foot {}"),
        (status == descents.NOT_LANDED, "foot {} not down by the post section"),
        (status == descents.ALREADY_DOWN, "foot {} down before the pre section"),
        (status == descents.POOR_FIT, "poor fit of foot {}"),
        (status == descents.RISES, "foot {} rises where it should touch"),
        (timed & np.isnan(instant), "no contact found for foot {}"),
        (
            timed & (instant < t_pre - continued_s),
            "foot {} down before the pre section",
        ),
        (timed & (instant > t_post), "foot {} not down by the post section"),
        # The error exceeds the whole transition: no kink was seen.
        (timed & (se > t_post - t_pre), "contact of foot {} not determined"),
    )
    reasons = [""] * len(transitions)
    for failed, text in reversed(failures):
        for row in np.flatnonzero(failed.any(axis=1)):
            reasons[row] = text.format(int(np.argmax(failed[row])) + 1)
    return reasons


LOW_FLIGHT = "body stayed below the pre section"


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
    """Tabulate the touchdowns of a levelled recording (Sec. 2.2.2 and 2.2.3 of the dissertation).

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
        See `hopdata.landings.contacts.find.find_contacts`. Every method but the kink
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
        index, method, t_pre_s, t_post_s, contact_<foot>_s and se_<foot>_s for each
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
    printed = chosen("touchdowns.method", method, find.METHODS) is not None
    # The printed methods search again, between the sections, and need the descents
    # alone.
    if landings is None or not (printed or find.are_by(landings, method)):
        landings = find.find_landings(recording, method=method, **options)
    spans = landings[["begin_s", "end_s"]].to_numpy(float)
    hidden = landings["hidden"].to_numpy(bool)
    transitions = _transitions(recording, spans, hidden, (pre_height_m, post_height_m))
    contacts = find.contacts_of(landings)
    if printed:
        down_m = options.get("down_height_m") or find.usual_down_height(
            recording, spans
        )
        of = recording.time, recording.feet[:, :, 2], transitions
        contacts = find.find_contacts(*of, down_height_m=down_m, method=method)
    table = _table(recording, transitions, contacts, ambiguous_below, ambiguous)
    table.insert(2, "method", method)
    tops = np.interp(spans[:, 0], *_seen(recording))
    low = (tops < pre_height_m) & (table["reason"] != HIDDEN_PRE)
    table.loc[low, ["reason", "excluded"]] = LOW_FLIGHT, True
    # A sway on feet that stay down is not a landing, nor is a descent that ends above
    # the sections.
    through = (tops >= pre_height_m) & np.isfinite(transitions.t_pre)
    landed = (contacts.status == descents.LANDED).any(axis=1) | hidden
    table["t_pre_s"] = table["t_pre_s"].where(
        np.isfinite(transitions.t_pre), spans[:, 0]
    )
    table = table[through | landed].reset_index(drop=True)
    return table.assign(index=np.arange(len(table)))


def touchdown_tables(
    recordings: Iterable[Recording],
    landings: Mapping[str, pd.DataFrame],
    exclude: Iterable[Sequence[Mapping[str, Any]]],
    *,
    largest_share: float,
    **options: Any,
) -> Iterator[pd.DataFrame]:
    """Yield the table of each recording, excluding touchdowns by hand or for too much filling.

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
        yield left_out(
            mark_filled(recording, table, largest_share=largest_share), entries
        )


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
        named = set(entry.get("landings") or ())
        for number in sorted(named - set(table["index"])):
            of = table["recording"].iloc[0] if len(table) else ""
            wanted = f"numbers of the {len(table)} landings of '{of}'"
            raise AnalysisError.at("recordings[].exclude: landings", wanted, number)
        begin, end = np.array(
            [entry.get("from_s"), entry.get("to_s")], float
        )  # NaN: no limit
        inside = ~(ends < begin) & ~(begins > end)
        out, markers = table["excluded"].to_numpy(bool), entry.get("markers") or ()
        told = f"by hand: {', '.join(markers)}: {entry['reason']}"
        if named:
            chosen, told = (
                table["index"].isin(named) & ~out,
                f"by hand: {entry['reason']}",
            )
        elif any(f"contact_{name}_s" in table for name in markers):
            chosen = inside  # a foot was removed by hand, so its contacts do not count
        elif markers:
            chosen = inside & out  # the other body markers did not suffice
        else:
            chosen, told = inside & ~out, f"by hand: {entry['reason']}"
        table.loc[chosen, ["reason", "excluded"]] = told, True
    return table


def _transitions(
    recording: Recording,
    spans: FloatArray,
    hidden: BoolArray,
    sections: tuple[float, float],
) -> descents.Transitions:
    """Find where landings cross the sections; a hidden landing crosses at the ends of its span."""
    seen = _seen(recording)
    found = descents.find_transitions(
        *seen, pre_height_m=sections[0], post_height_m=sections[1], spans=spans
    )
    gap = descents.longest_gaps(seen[0], spans)
    theirs = (spans[:, 0], spans[:, 1], gap, gap)
    both = zip(vars(found).values(), theirs, strict=True)
    return descents.Transitions(*(np.where(hidden, own, other) for other, own in both))


def _seen(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Return times, s, and heights, m, of the frames that show the body."""
    seen = np.isfinite(recording.body_height)
    return recording.time[seen], recording.body_height[seen]


def _table(
    recording: Recording,
    transitions: descents.Transitions,
    contacts: find.Contacts,
    ambiguous_below: float,
    ambiguous: str,
) -> pd.DataFrame:
    feet = recording.names("foot")
    common = contacts.common if contacts.common.size else np.full(len(feet), np.nan)
    names = schedules.schedule_names(contacts.instant)
    probability = schedules.order_probability(contacts.instant, contacts.se)
    classes = schedules.schedule_classes(
        names, probability, ambiguous_below=ambiguous_below
    )
    second, second_probability = schedules.runner_up(contacts.instant, contacts.se)
    seconds = zip(names, schedules.order_names(second), strict=True)
    by = {"longest_gap_s": descents.longest_gap_s(recording.time, recording.pace)}
    by["continued_s"] = descents.CONTINUED_S * recording.pace
    reasons = exclusion_reasons(transitions, contacts, **by)
    left_out = (
        {schedules.AMBIGUOUS: "order ambiguous"} if ambiguous == "exclude" else {}
    )
    reasons = [
        r or left_out.get(name, "") for r, name in zip(reasons, classes, strict=True)
    ]
    columns = {
        "recording": recording.name,
        "index": np.arange(len(transitions)),
        "t_pre_s": transitions.t_pre,
        "t_post_s": transitions.t_post,
        **{f"contact_{foot}_s": contacts.instant[:, i] for i, foot in enumerate(feet)},
        **{f"se_{foot}_s": contacts.se[:, i] for i, foot in enumerate(feet)},
        **{f"common_{foot}_s": common[i] for i, foot in enumerate(feet)},
        "schedule": names,
        "probability": probability,
        "class": classes,
        "runner_up": [name if first else "" for first, name in seconds],
        "runner_up_probability": second_probability,
        "spread_s": schedules.spread(contacts.instant),
        "excluded": [bool(reason) for reason in reasons],
        "reason": reasons,
    }
    return pd.DataFrame(columns)
