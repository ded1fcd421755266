"""To which mode schedule a landing belongs, and how surely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.verdict.kinks import Feet

#: A half of a schedule's landings needs this many for each input.
_LANDINGS_PER_INPUT = 3

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Memberships:
    """Schedules and the weight of each landing in them.

    Attributes
    ----------
    schedules
        Schedules seen, each as the feet (from 0) in the order of their contacts.
    weights
        (n, schedules), rows add up to one, or to zero for a landing without a schedule.
    """

    schedules: tuple[Feet, ...]
    weights: Floats


def memberships(instants: Floats, errors: Floats, least: int) -> Memberships:
    """Weigh schedules by the probability that the two contacts nearest in time are in this order.

    Parameters
    ----------
    instants, errors
        (n, feet) contact instants and their standard errors, s. A landing without an error counts
        as sure; one without an instant has no schedule.
    least
        Schedules with fewer landings are left out.
    """
    from scipy.special import ndtr

    n, feet = instants.shape
    known = np.asarray(np.isfinite(instants).all(axis=1))
    order = np.argsort(np.where(known[:, None], instants, 0.0), axis=1, kind="stable")
    times = np.take_along_axis(instants, order, axis=1)
    variance = np.take_along_axis(np.nan_to_num(errors) ** 2, order, axis=1)
    gaps = np.diff(times, axis=1)
    doubt = np.sqrt(variance[:, 1:] + variance[:, :-1])
    sure = np.divide(gaps, doubt, out=np.full_like(gaps, np.inf), where=doubt > 0)
    sure[~known] = np.inf
    place = np.argmin(sure, axis=1)
    rows = np.arange(n)
    probability = ndtr(sure[rows, place])
    swapped = order.copy()
    swapped[rows, place], swapped[rows, place + 1] = order[rows, place + 1], order[rows, place]
    own, other = _codes(order, feet), _codes(swapped, feet)
    codes, counts = np.unique(own[known], return_counts=True)
    kept = codes[counts >= least]
    weights = probability[:, None] * (own[:, None] == kept)
    weights += (1.0 - probability)[:, None] * (other[:, None] == kept)
    weights[~known] = 0.0
    first = [tuple(int(f) for f in order[known][np.argmax(own[known] == code)]) for code in kept]
    return Memberships(tuple(first), weights)


def large_classes(weights: Floats, n_inputs: int) -> list[NDArray[np.int64]]:
    """Return the landings of every schedule that has enough for a linear map of two halves each.

    Parameters
    ----------
    weights
        (n, schedules) membership of each landing; each counts where it weighs most.
    n_inputs
        Number of inputs p; a half needs three landings for each.
    """
    belongs = np.where(weights.max(axis=1) > 0.5, weights.argmax(axis=1), -1)
    classes = [np.flatnonzero(belongs == k) for k in range(weights.shape[1])]
    return [rows for rows in classes if len(rows) >= 2 * _LANDINGS_PER_INPUT * n_inputs]


def _codes(order: NDArray[np.int64], feet: int) -> NDArray[np.int64]:
    code: NDArray[np.int64] = order @ (feet ** np.arange(feet)[::-1])
    return code
