"""What a landing map that is not C1 looks like near a simultaneous contact: kinks.

The flow of an event-selected system is continuous, and to first order it is linear on each mode
schedule (Burden et al. 2016; chapter I of the dissertation). Its maps can differ between schedules
only in how they depend on the contact instants, and they must agree where two feet touch at once.
So the difference from one linear map is a continuous function of the contact instants that is
linear on each order of them. The functions "latest contact of a set of feet" span all of these:
2^n - n - 1 for n feet. They vanish from the map exactly if it has one derivative.

A map that is C1 can still have second derivatives that differ between schedules. The differences
begin with the squares of the time between two contacts, ``d |d|``, and go on with ``|d|^3``.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

#: Up to this many feet all sets are used; with more, the pairs.
ALL_SETS_UP_TO = 3

Floats = NDArray[np.float64]
Feet = tuple[int, ...]


def foot_sets(n_feet: int) -> list[Feet]:
    """Return the sets of feet whose latest contacts span the kinks.

    >>> foot_sets(3)
    [(0, 1), (0, 2), (1, 2), (0, 1, 2)]
    """
    largest = n_feet if n_feet <= ALL_SETS_UP_TO else 2
    sizes = range(2, largest + 1)
    return [feet for size in sizes for feet in combinations(range(n_feet), size)]


def kinks(instants: Floats) -> Floats:
    """Return the latest contact of each set of feet, (n, K), relative to the mean of all feet.

    Parameters
    ----------
    instants
        (n, feet) contact instants.
    """
    t = instants - instants.mean(axis=1, keepdims=True)
    return np.column_stack([t[:, feet].max(axis=1) for feet in foot_sets(t.shape[1])])


def kink_slopes(order: Feet) -> Floats:
    """Return the derivatives (K, feet) of the kinks by the contact instants on one schedule.

    Parameters
    ----------
    order
        Feet in the order of their contacts, first one first.
    """
    sets = foot_sets(len(order))
    slopes = np.zeros((len(sets), len(order)))
    for row, feet in enumerate(sets):
        slopes[row, max(feet, key=order.index)] = 1.0
    return slopes - 1.0 / len(order)


def time_differences(instants: Floats) -> Floats:
    """Return the differences of the contact instants of each pair of feet, (n, pairs)."""
    pairs = list(combinations(range(instants.shape[1]), 2))
    return np.column_stack([instants[:, i] - instants[:, j] for i, j in pairs])
