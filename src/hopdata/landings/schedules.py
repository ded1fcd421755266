"""Mode schedules: the order of the contacts, how probable it is, and how far apart they lie."""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray

AMBIGUOUS = "ambiguous"
TREATMENTS = ("keep", "pool", "exclude")  # of ambiguous orders
REACH = 8.5  # standard deviations beyond which a normal is nothing
CELL_NODES = 8
CHUNK = 500  # landings integrated together


def contact_order(instants: FloatArray) -> NDArray[np.int64]:
    """Feet in the order of their contacts, (L, n), counted from 0; ties by foot number.

    Parameters
    ----------
    instants : (L, n) array
        Contact instants, s.
    """
    return np.argsort(instants, axis=1, kind="stable")


def schedule_names(instants: FloatArray) -> list[str]:
    """Name each mode schedule, for instance ``"2>3>1"``; empty where an instant is NaN.

    Parameters
    ----------
    instants : (L, n) array
        Contact instants, s.
    """
    whole = np.asarray(np.isfinite(instants).all(axis=1))
    names = order_names(contact_order(instants))
    return [name if whole[row] else "" for row, name in enumerate(names)]


def order_names(order: NDArray[np.int64]) -> list[str]:
    """Name orders (L, n) of feet counted from 0."""
    return [">".join(str(foot + 1) for foot in row) for row in order]


def spread(instants: FloatArray) -> FloatArray:
    """Return the population standard deviation of the instants of each landing, (L,), s."""
    return instants.std(axis=1)


def order_probability(
    instants: FloatArray, se: FloatArray, order: NDArray[np.int64] | None = None
) -> FloatArray:
    """Probability of an order of the true instants, by default that of the estimates.

    An order that is more probable than a half is that of the estimates.

    The true instants are taken as independent normals about the estimates. The nested integral
    P(T_1 < T_2 < ... < T_n) is done by recursion, F_k(t) = int_{-inf}^t p_k(s) F_{k-1}(s) ds, with
    Gauss-Legendre nodes in cells that follow every normal: good to about 1e-8 for any n.

    Parameters
    ----------
    instants, se : (L, n) array
        Estimates and their standard errors, s; any time scale.
    order : (n,) or (L, n) int array, optional
        Feet, counted from 0, in the order asked about.

    Returns
    -------
    (L,) array
        Probabilities; NaN where an instant or an error is NaN.
    """
    order = contact_order(instants) if order is None else np.broadcast_to(order, instants.shape)
    mean, sd = np.take_along_axis(instants, order, axis=1), np.take_along_axis(se, order, axis=1)
    mean -= mean[:, :1]  # a clock of 1.7e9 s would round the nodes between them
    out = np.full(len(instants), np.nan)
    rows = np.flatnonzero(~(np.isnan(instants) | np.isnan(se)).any(axis=1))
    for chunk in np.split(rows, range(CHUNK, len(rows), CHUNK)) if len(rows) else ():
        out[chunk] = _nested(mean[chunk], sd[chunk])
    return out


def runner_up(instants: FloatArray, se: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the most probable order but that of the estimates, and its probability.

    Sought among the orders in which two contacts that follow each other are exchanged; any other is
    less probable where the standard errors are alike.

    Parameters
    ----------
    instants, se : (L, n) array
        Estimates and their standard errors, s; n is at least 2.

    Returns
    -------
    order : (L, n) int array
        Feet, counted from 0.
    probability : (L,) array
        NaN where an instant or an error is NaN.
    """
    best = contact_order(instants)
    probability = np.full(len(instants), np.nan)
    for place in range(instants.shape[1] - 1):
        order = contact_order(instants)
        order[:, [place, place + 1]] = order[:, [place + 1, place]]
        found = order_probability(instants, se, order)
        better = np.isnan(probability) | (found > probability)
        best = np.where(better[:, None], order, best)
        probability = np.where(better, found, probability)
    return best, probability


def schedule_classes(
    names: Sequence[str], probability: FloatArray, *, ambiguous_below: float
) -> list[str]:
    """Class of each landing: its schedule, or `AMBIGUOUS` where that is not probable enough.

    Parameters
    ----------
    names : sequence of str
        The schedules of L landings, empty for none.
    probability : (L,) array
        How probable each is; NaN where unknown.
    ambiguous_below : float
        The least probability of a class that is sure.
    """
    pairs = zip(names, probability < ambiguous_below, strict=True)
    return [AMBIGUOUS if name and doubt else name for name, doubt in pairs]


def _nested(mean: FloatArray, sd: FloatArray) -> FloatArray:
    """P(T_1 < ... < T_n) for normals in any order of their means, (L,)."""
    nodes, lengths, cumulative, whole = _cells(mean, sd)
    below = np.ones_like(nodes)  # F_{k-1} at the nodes
    for k in range(mean.shape[1]):
        m, s = mean[:, k, None, None], sd[:, k, None, None]
        density = np.exp(-0.5 * ((nodes - m) / s) ** 2) / (s * sqrt(2 * np.pi)) * below
        cell = (density @ whole) * lengths
        before = np.cumsum(cell, axis=1) - cell
        below = before[:, :, None] + (density @ cumulative.T) * lengths[:, :, None]
    return np.clip(cell.sum(axis=1), 0.0, 1.0)


def _cells(
    mean: FloatArray, sd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Nodes (L, C, p), half lengths (L, C), and the weights of partial and whole integrals."""
    marks = np.arange(-REACH, REACH + 0.5, 1.0)
    edges = np.sort((mean[:, :, None] + sd[:, :, None] * marks).reshape(len(mean), -1), axis=1)
    half = 0.5 * np.diff(edges, axis=1)
    centre = 0.5 * (edges[:, 1:] + edges[:, :-1])
    x, whole = np.polynomial.legendre.leggauss(CELL_NODES)
    return centre[:, :, None] + half[:, :, None] * x, half, _partial_weights(x), whole


def _partial_weights(x: FloatArray) -> FloatArray:
    """Weights w[i, j] with sum_j w[i, j] f(x_j) = integral of f from -1 to x_i, for polynomials."""
    powers = np.arange(len(x))
    monomials = x[:, None] ** powers
    integrals = (x[:, None] ** (powers + 1) - (-1.0) ** (powers + 1)) / (powers + 1)
    return np.asarray(np.linalg.solve(monomials.T, integrals.T).T, dtype=np.float64)
