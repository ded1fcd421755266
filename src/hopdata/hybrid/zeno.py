"""Where events that pile up end: the limit of their instants and of the state.

The gaps between the bounces of a ball shrink by the same factor each time, so their sum
is a geometric series. Aitken's formula gives its limit from three instants, also where
the factor is only nearly constant. The limits from successive triples differ by what
the formula errs, which is the estimate of the error. The last gaps are no longer than
rounding; the triple whose limit has the smallest error is taken.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hopdata.arrays import FloatArray

if TYPE_CHECKING:
    from hopdata.hybrid.solution import EventLog

#: Fewest instants from which a limit is computed: two triples that differ by one.
#: Unit: 1. Origin: derived: an error takes two limits, and these four instants.
FEWEST = 4

#: Largest ratio of a gap to the one before it for a series that converges: above it,
#: the sum exceeds a thousand of the last gaps.
#: Unit: 1. Origin: chosen.
SLOWEST = 0.999

#: Rounding of a time or a coordinate, of its own size, times the root of the number of
#: instants: errors add up at random.
#: Unit: 1. Origin: rounding: four units in the last place of a double.
ROUNDING = 2.0**-50


class Limit(NamedTuple):
    """Where events pile up.

    Parameters
    ----------
    time : float
        Limit of their instants, s.
    state : (n,) array
        Limit of the states after them.
    time_error, state_error : float, (n,) array
        Estimates of the errors.
    """

    time: float
    state: FloatArray
    time_error: float
    state_error: FloatArray


def limit_of(log: EventLog, guard: int) -> Limit | None:
    """Return where the events of a guard pile up, or None if they do not converge.

    Parameters
    ----------
    log : EventLog
        Events of the whole run.
    guard : int
        The guard.
    """
    chosen = np.flatnonzero(log.guard == guard)
    times, first = np.unique(log.time[chosen], return_index=True)
    if len(times) < FEWEST:
        return None
    # After the last event of each instant.
    last = np.append(first[1:], len(chosen)) - 1
    states = log.after[chosen[last]]
    gaps = np.diff(times)
    converges = gaps[1:] < SLOWEST * gaps[:-1]
    # Only the end counts: what was before may have been anything. The very last gaps
    # are rounding.
    per_size = ROUNDING * np.sqrt(len(times))
    rounding = per_size * np.abs(times[-1])
    clear = gaps[1:] > rounding
    good = converges & clear
    pairs = np.flatnonzero(good[1:] & good[:-1]) + 1
    if len(pairs) == 0:
        return None
    limits = aitken(times[:, None])[:, 0]
    errors = np.abs(np.diff(limits))[pairs - 1] + rounding
    best = pairs[np.argmin(errors)]
    if not converges[best:][clear[best:]].all():
        return None
    state_limits = aitken(states)
    state_rounding = per_size * np.abs(states).max(axis=0)
    state_error = np.abs(state_limits[best] - state_limits[best - 1]) + state_rounding
    return Limit(
        float(limits[best]), state_limits[best], float(errors.min()), state_error
    )


def aitken(values: FloatArray) -> FloatArray:
    """Return Aitken's limits (N - 2, n) of the triples of a sequence (N, n).

    Where a triple shows no change of its differences, the limit is its last value.
    """
    first = np.diff(values, axis=0)
    second = np.diff(first, axis=0)
    known = second != 0.0
    step = np.divide(first[1:] ** 2, second, out=np.zeros_like(second), where=known)
    return values[2:] - step
