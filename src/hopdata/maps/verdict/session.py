"""Slow change over a session, and blocks of landings, as smooth terms.

Legs tire, surfaces change, cameras move. Such a change is no difference between contact
orders, but it is scatter until it is fitted. Its terms are session time s (s, s^2) and
a factor of the blocks (recordings, surfaces, subjects), alone and multiplied with the
state before the landing. They are used where they foretell landings that were left out
better.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.maps.coordinates import LANDINGS_PER_TERM
from hopdata.maps.verdict.linear import left_out_errors

#: Least decrease of the squared error of left-out landings for which terms are used.
#: Unit: 1. Origin: chosen: noise alone brings less, and eight steady studies used terms
#: of time in one.
GAIN = 0.03

#: Blocks with fewer landings have no level of their own.
#: Unit: landings. Origin: chosen: as many as a contact order needs.
LEAST_BLOCK = 20


@dataclass(frozen=True)
class Session:
    """When and where each of n landings was recorded.

    Attributes
    ----------
    time
        (n,) session time, from -1 to 1.
    block
        (n,) number of the block of each landing.
    """

    time: FloatArray
    block: IntArray

    @classmethod
    def of(cls, time: FloatArray, labels: IntArray) -> "Session":
        """Return the session of these instants, and labels of blocks."""
        scaled = np.zeros(len(time))
        if len(time) and np.ptp(time) > 0.0:
            scaled = 2.0 * (time - time.min()) / np.ptp(time) - 1.0
        return cls(scaled, labels)

    def rows(self, rows: IntArray) -> "Session":
        """Return the session of these landings alone."""
        return Session(self.time[rows], self.block[rows])

    def drift(self) -> FloatArray:
        """Return s and s^2 (n, 2), or no column if all landings share an instant."""
        if not np.any(self.time):
            return np.empty((len(self.time), 0))
        return np.column_stack([self.time, self.time**2 - np.mean(self.time**2)])

    def levels(self) -> FloatArray:
        """Return a column for each block but the first, about its mean, (n, blocks)."""
        blocks, counts = np.unique(self.block, return_counts=True)
        common = blocks[counts >= LEAST_BLOCK]
        levels = (self.block[:, None] == common[1:]).astype(float)
        return np.asarray(levels - levels.mean(axis=0))


@dataclass(frozen=True)
class SessionTerms:
    """The terms of a session that are used.

    Attributes
    ----------
    columns
        (n, m) terms.
    used
        What they depend on: ``"time"``, ``"block"``, both or neither.
    """

    columns: FloatArray
    used: tuple[str, ...]


def session_terms(
    session: Session,
    design: FloatArray,
    outcomes: FloatArray,
    *,
    states: FloatArray | None = None,
) -> SessionTerms:
    """Return the terms that foretell left-out landings better than the design alone.

    Parameters
    ----------
    session
        Of the n landings.
    design
        (n, terms) terms that are fitted in any case.
    outcomes
        (n, q) outcomes, weighted as their errors are to count.
    states
        (n, p) states with which the terms are multiplied, too; none if they are not.
    """
    used: tuple[str, ...] = ()
    columns = np.empty((len(design), 0))
    least = float(np.mean(left_out_errors(design, outcomes) ** 2))
    shapes: list[tuple[str, Callable[[], FloatArray]]] = [
        ("time", session.drift),
        ("block", session.levels),
    ]
    for name, shape in shapes:
        alone = shape()
        if not alone.shape[1]:
            continue
        candidates = [alone]
        if states is not None:
            candidates.append(np.column_stack([alone, _products(alone, states)]))
        best = columns
        for more in candidates:
            tried = np.column_stack([columns, more])
            n_terms = design.shape[1] + tried.shape[1]
            if len(design) < LANDINGS_PER_TERM * n_terms:
                continue
            whole = np.column_stack([design, tried])
            error = float(np.mean(left_out_errors(whole, outcomes) ** 2))
            if error < (1.0 - GAIN) * least:
                best = tried
                least = error
        if best is not columns:
            columns = best
            used = (*used, name)
    return SessionTerms(columns, used)


def _products(columns: FloatArray, states: FloatArray) -> FloatArray:
    """Return all products of a column and a state, (n, columns x states)."""
    products = columns[:, :, None] * states[:, None, :]
    return np.asarray(products.reshape(len(columns), -1))
