"""Why a touchdown is left out: what was not seen of the body, or of a foot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.approach import ALREADY_DOWN, LANDED, MISSING, NOT_LANDED, POOR_FIT
from hopdata.landings.contacts import Contacts
from hopdata.landings.transitions import Transitions

FloatArray = NDArray[np.float64]

HIDDEN_PRE = "frames missing at the pre section"
NO_FOOT_LANDED = "no foot landed"


def exclusion_reasons(
    transitions: Transitions, contacts: Contacts, *, longest_gap_s: float
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
    return [
        _transition_reason(transitions, row, longest_gap_s)
        or _contact_reason(
            contacts.status[row],
            contacts.instant[row],
            contacts.se[row],
            float(transitions.t_pre[row]),
            float(transitions.t_post[row]),
        )
        for row in range(len(transitions))
    ]


def _transition_reason(transitions: Transitions, row: int, longest_gap_s: float) -> str:
    if transitions.gap_pre[row] > longest_gap_s:
        return HIDDEN_PRE
    if transitions.gap_post[row] > longest_gap_s:
        return "frames missing at the post section"
    return "post section never reached" if np.isnan(transitions.t_post[row]) else ""


def _contact_reason(
    status: NDArray[np.int64], instant: FloatArray, se: FloatArray, t_pre: float, t_post: float
) -> str:
    if (status == NOT_LANDED).all():
        return NO_FOOT_LANDED
    timed = status == LANDED
    failures = (
        (status == MISSING, "frames missing at the contact of foot {}"),
        (status == NOT_LANDED, "foot {} not down by the post section"),
        (status == ALREADY_DOWN, "foot {} down before the pre section"),
        (status == POOR_FIT, "poor fit of foot {}"),
        (timed & np.isnan(instant), "no contact found for foot {}"),
        (timed & (instant < t_pre), "foot {} down before the pre section"),
        (timed & (instant > t_post), "foot {} not down by the post section"),
        # Known no better than that it is somewhere in the transition, or beyond: no kink was seen.
        (timed & (se > t_post - t_pre), "contact of foot {} not determined"),
    )
    for failed, text in failures:
        if failed.any():
            return text.format(int(np.argmax(failed)) + 1)
    return ""
