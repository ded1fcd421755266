"""The table of touchdowns: every descent with its contacts and schedule, or why it is left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError, require_choice
from hopdata.landings.approach import LANDED, height_noise
from hopdata.landings.contacts import Contacts, find_contacts
from hopdata.landings.exclusions import HIDDEN_PRE, exclusion_reasons
from hopdata.landings.hidden_landings import find_hidden_landings
from hopdata.landings.schedules import (
    AMBIGUOUS,
    TREATMENTS,
    order_names,
    order_probability,
    runner_up,
    schedule_classes,
    schedule_names,
    spread,
)
from hopdata.landings.transitions import (
    Transitions,
    find_low_flights,
    find_transitions,
    together,
)
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

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
        See `hopdata.landings.contacts.find_contacts`.
    down_height_m : float, optional
        A foot that never sinks below this height has not landed, m. By default 15 % of the distance
        between the sections, and at least four times the noise.
    ambiguous_below : float
        Touchdowns whose schedule is less probable are of the class ``ambiguous``.
    ambiguous : {"keep", "pool", "exclude"}
        What becomes of these: they are used by their most probable order, or only where the order
        does not matter (see `hopdata.landings.pair_assembly`), or left out.

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
    require_choice("touchdowns.ambiguous", ambiguous, TREATMENTS)
    if len(recording.names("foot")) < 2:
        raise AnalysisError(
            f"{recording.name}: expected at least 2 foot markers, found "
            f"{len(recording.names('foot'))}"
        )
    heights = recording.feet[:, :, 2]
    sections = {"pre_height_m": pre_height_m, "post_height_m": post_height_m}
    down = down_height_m or max(
        LEAST_DOWN_SHARE * (pre_height_m - post_height_m), LEAST_DOWN_SIGMAS * height_noise(heights)
    )
    transitions, kind = _all_landings(recording, down, **sections)
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
    landed = (contacts.status == LANDED).any(axis=1)
    return _with_low_flights(table, kind == LOW, landed=landed)


def _all_landings(
    recording: Recording, down_height_m: float, *, pre_height_m: float, post_height_m: float
) -> tuple[Transitions, NDArray[np.int64]]:
    """Descents of the body, flights below the pre section, and landings with the body hidden."""
    seen = [
        find(
            recording.time,
            recording.body_height,
            pre_height_m=pre_height_m,
            post_height_m=post_height_m,
        )
        for find in (find_transitions, find_low_flights)
    ]
    hidden = find_hidden_landings(
        recording.time,
        recording.feet[:, :, 2],
        recording.body_height,
        together(*seen)[0],
        down_height_m=down_height_m,
        longest_gap_s=_longest_gap_s(recording),
    )
    return together(*seen, hidden)


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
    transitions: Transitions,
    contacts: Contacts,
    ambiguous_below: float,
    ambiguous: str,
) -> pd.DataFrame:
    import pandas as pd

    feet = recording.names("foot")
    names = schedule_names(contacts.instant)
    probability = order_probability(contacts.instant, contacts.se)
    classes = schedule_classes(names, probability, ambiguous_below=ambiguous_below)
    second, second_probability = runner_up(contacts.instant, contacts.se)
    reasons = exclusion_reasons(transitions, contacts, longest_gap_s=_longest_gap_s(recording))
    left_out = {AMBIGUOUS: "order ambiguous"} if ambiguous == "exclude" else {}
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
            name if first else "" for first, name in zip(names, order_names(second), strict=True)
        ],
        "runner_up_probability": second_probability,
        "spread_s": spread(contacts.instant),
        "excluded": [bool(reason) for reason in reasons],
        "reason": reasons,
    }
    return pd.DataFrame(columns)
