"""Slow change over a session, and blocks of landings, as smooth terms.

Legs tire, surfaces change, cameras move. Such a change is no difference between contact
orders, but it is scatter until it is fitted. Its terms are session time s (s, s^2), a
change at one instant of the session, and a factor of the blocks (recordings, surfaces,
subjects), alone and multiplied with the state before the landing. They are used where
they foretell landings that were left out better.
"""

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.maps.coordinates import LANDINGS_PER_TERM
from hopdata.maps.verdict.linear import left_out_errors

#: Least decrease of the squared error of left-out landings for which terms are used.
#: Unit: 1. Origin: chosen: noise alone brings less, and eight steady studies used terms
#: of time in one.
GAIN = 0.03

#: Number of parts of the session between which a change is looked for; then as many
#: around the best of these instants.
#: Unit: parts. Origin: chosen: a change is then found to 0.5 % of the session.
PARTS = 20

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

    def after(self, instant: float) -> FloatArray:
        """Return a step (n, 1) at this session time, about its mean.

        There is no column if it leaves less than a block on either side.
        """
        step = (self.time > instant).astype(float)
        if min(step.sum(), len(step) - step.sum()) < LEAST_BLOCK:
            return np.empty((len(step), 0))
        return np.asarray(step - step.mean())[:, None]

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
        What they depend on: some of ``"block"``, ``"time"`` and ``"change"``.
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
    shapes = {
        "block": session.levels(),
        "time": session.drift(),
        "change": _change(session, design, outcomes, states),
    }
    while shapes:
        found = None
        for name, alone in shapes.items():
            for more in _with_states(alone, states):
                tried = np.column_stack([columns, more])
                error = _error_with(design, tried, outcomes)
                if error < (1.0 - GAIN) * least and (
                    found is None or error < found.error
                ):
                    found = _Found(name, tried, error)
        if found is None:
            break
        columns = found.columns
        least = found.error
        used = (*used, found.name)
        shapes.pop(found.name)
    return SessionTerms(columns, used)


@dataclass(frozen=True)
class _Found:
    """Terms that were tried, and the squared error of left-out landings with them."""

    name: str
    columns: FloatArray
    error: float


def _with_states(alone: FloatArray, states: FloatArray | None) -> list[FloatArray]:
    """Return the terms alone, and together with their products with the states."""
    if not alone.shape[1]:
        return []
    if states is None:
        return [alone]
    return [alone, np.column_stack([alone, _products(alone, states)])]


def _error_with(design: FloatArray, columns: FloatArray, outcomes: FloatArray) -> float:
    """Return the squared error of left-out landings; infinite with too many terms."""
    n_terms = design.shape[1] + columns.shape[1]
    if len(design) < LANDINGS_PER_TERM * n_terms:
        return np.inf
    whole = np.column_stack([design, columns])
    return float(np.mean(left_out_errors(whole, outcomes) ** 2))


def _change(
    session: Session,
    design: FloatArray,
    outcomes: FloatArray,
    states: FloatArray | None,
) -> FloatArray:
    """Return a step (n, 1) at the instant at which a change would explain most.

    There is no column if the landings share an instant.
    """
    basis, _ = np.linalg.qr(design)
    rest = outcomes - basis @ (basis.T @ outcomes)

    def explained(limit: float) -> float:
        step = session.after(limit)
        if not step.shape[1]:
            return 0.0
        terms = _with_states(step, states)[-1]
        beside, _ = np.linalg.qr(terms - basis @ (basis.T @ terms))
        return float(np.sum((beside.T @ rest) ** 2))

    coarse = np.linspace(-1.0, 1.0, PARTS + 1)
    near = max(coarse.tolist(), key=explained)
    width = 2.0 / PARTS
    fine = np.linspace(near - width, near + width, PARTS + 1)
    return session.after(max(fine.tolist(), key=explained))


def _products(columns: FloatArray, states: FloatArray) -> FloatArray:
    """Return all products of a column and a state, (n, columns x states)."""
    products = columns[:, :, None] * states[:, None, :]
    return np.asarray(products.reshape(len(columns), -1))
