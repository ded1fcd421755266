"""Mode schedules: the order of contacts, its probability, and their spread."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import permutations, product
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray
from hopdata.feet import order_name

AMBIGUOUS = "ambiguous"
TREATMENTS = ("keep", "pool", "exclude")  # how ambiguous orders may be treated

#: Reach of a normal density, beyond which it is negligible.
#: Unit: standard deviations. Origin: rounding: the tail is 1e-17.
REACH = 8.5

#: Gauss-Legendre nodes in a cell of one standard deviation.
#: Unit: nodes. Origin: chosen.
CELL_NODES = 8

CHUNK = 500  # landings integrated together, to bound memory


Order = tuple[int, ...]


def mode_schedules(n_feet: int, n_hops: int = 1) -> Iterator[tuple[Order, ...]]:
    """Yield every mode schedule of some hops, with no feet at the same instant.

    A hop has an order in which the feet land and one in which they lift off. The feet
    are counted from 0.

    Parameters
    ----------
    n_feet : int
        Number of feet.
    n_hops : int
        Number of hops. A schedule of n hops has 2 n orders: landing, lift-off, landing,
        ...
    """
    orders = list(permutations(range(n_feet)))
    yield from product(orders, repeat=2 * n_hops)


def count_mode_schedules(n_feet: int, n_hops: int = 1) -> int:
    """Return the number of mode schedules of some hops, by going through them.

    For three feet it is 36 a hop, 1,296 over two hops and 46,656 over three.
    """
    return sum(1 for _ in mode_schedules(n_feet, n_hops))


def contact_order(instants: FloatArray) -> NDArray[np.int64]:
    """Sort the feet by their contacts, (L, n), counted from 0; ties go by foot number.

    Parameters
    ----------
    instants : (L, n) array
        Contact instants, s.
    """
    return np.argsort(instants, axis=1, kind="stable")


def schedule_names(instants: FloatArray) -> list[str]:
    """Name each mode schedule, such as ``"2>3>1"``; empty where an instant is NaN.

    Parameters
    ----------
    instants : (L, n) array
        Contact instants, s.
    """
    whole = np.asarray(np.isfinite(instants).all(axis=1))
    names = order_names(contact_order(instants))
    return [
        name if is_known else "" for name, is_known in zip(names, whole, strict=True)
    ]


def order_names(order: NDArray[np.int64]) -> list[str]:
    """Name orders (L, n) of feet counted from 0."""
    return [order_name(feet) for feet in order.tolist()]


def spread(instants: FloatArray) -> FloatArray:
    """Return the standard deviation of the instants of each landing, (L,), s."""
    return instants.std(axis=1)


def order_probability(
    instants: FloatArray, se: FloatArray, order: NDArray[np.int64] | None = None
) -> FloatArray:
    """Return the probability of an order of the true instants.

    By default it is the order of the estimates. Only this one can be more probable than
    one half.

    The true instants are modelled as independent normals about the estimates. The
    nested integral P(T_1 < T_2 < ... < T_n) is evaluated by the recursion F_k(t) =
    int_{-inf}^t p_k(s) F_{k-1}(s) ds, with Gauss-Legendre nodes in cells that follow
    every normal. It is accurate to about 1e-8 for any n.

    Parameters
    ----------
    instants, se : (L, n) array
        Estimates and their standard errors, s; any time scale.
    order : (n,) or (L, n) int array, optional
        Feet, counted from 0, in the order in question.

    Returns
    -------
    (L,) array
        Probabilities; NaN where an instant or an error is NaN.
    """
    if order is None:
        order = contact_order(instants)
    else:
        order = np.broadcast_to(order, instants.shape)
    mean = np.take_along_axis(instants, order, axis=1)
    sd = np.take_along_axis(se, order, axis=1)
    mean -= mean[:, :1]  # at a clock time of 1.7e9 s, rounding would merge nodes
    return _of_known(_nested, mean, sd)


def first_probability(instants: FloatArray, se: FloatArray) -> FloatArray:
    """Return the probability that the earliest of some estimates is the first.

    The true instants are modelled as by `order_probability`.

    Parameters
    ----------
    instants, se : (L, n) array
        Estimates and their standard errors, s. An estimate is infinite where nothing
        touches; at least one is finite.

    Returns
    -------
    (L,) array
        Probabilities; NaN where an instant or an error is NaN.
    """
    # Products round by their order, which must not be that of the feet.
    order = np.lexsort((se, instants), axis=1)
    mean = np.take_along_axis(instants, order, axis=1)
    sd = np.take_along_axis(se, order, axis=1)
    return _of_known(_first, mean, sd)


def _of_known(
    integral: Callable[[FloatArray, FloatArray], FloatArray],
    mean: FloatArray,
    sd: FloatArray,
) -> FloatArray:
    """Return an integral (L,) for rows (L, n) of normals; NaN where one is unknown."""
    probability = np.full(len(mean), np.nan)
    rows = np.flatnonzero(~(np.isnan(mean) | np.isnan(sd)).any(axis=1))
    for first in range(0, len(rows), CHUNK):
        chunk = rows[first : first + CHUNK]
        probability[chunk] = integral(mean[chunk], sd[chunk])
    return probability


def runner_up(
    instants: FloatArray, se: FloatArray
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the most probable other order than that of the estimates.

    The search covers the orders that exchange two consecutive contacts. Any other order
    is less probable if the standard errors are similar.

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
    """Classify each landing by its schedule, or as `AMBIGUOUS` if that is not sure.

    Parameters
    ----------
    names : sequence of str
        The schedules of L landings, empty for none.
    probability : (L,) array
        Probability of each schedule; NaN where unknown.
    ambiguous_below : float
        Lowest probability at which a schedule counts as sure.
    """
    classes = []
    for name, is_doubtful in zip(names, probability < ambiguous_below, strict=True):
        if name and is_doubtful:
            classes.append(AMBIGUOUS)
        else:
            classes.append(name)
    return classes


def _nested(mean: FloatArray, sd: FloatArray) -> FloatArray:
    """Return P(T_1 < ... < T_n) for normals with means in any order, (L,)."""
    nodes, lengths, cumulative, whole = _cells(mean, sd)
    below = np.ones_like(nodes)  # F_{k-1} at the nodes
    for k in range(mean.shape[1]):
        m = mean[:, k, None, None]
        s = sd[:, k, None, None]
        normal = np.exp(-0.5 * ((nodes - m) / s) ** 2) / (s * sqrt(2 * np.pi))
        density = normal * below
        cell = (density @ whole) * lengths
        before = np.cumsum(cell, axis=1) - cell
        below = before[:, :, None] + (density @ cumulative.T) * lengths[:, :, None]
    return np.clip(cell.sum(axis=1), 0.0, 1.0)


def _first(mean: FloatArray, sd: FloatArray) -> FloatArray:
    """Return P(T_1 < T_2, ..., T_1 < T_n) for normals in order of their means, (L,)."""
    from scipy.special import ndtr

    touches = np.isfinite(mean)
    # At a clock time of 1.7e9 s, rounding would merge nodes.
    mean = np.where(touches, mean - mean[:, :1], 0.0)
    sd = np.where(touches, sd, sd[:, :1])
    nodes, lengths, _, whole = _cells(mean, sd)
    own_sd = sd[:, 0, None, None]
    density = np.exp(-0.5 * (nodes / own_sd) ** 2) / (own_sd * sqrt(2 * np.pi))
    for k in range(1, mean.shape[1]):
        is_later = ndtr((mean[:, k, None, None] - nodes) / sd[:, k, None, None])
        density *= np.where(touches[:, k, None, None], is_later, 1.0)
    cells = (density @ whole) * lengths
    return np.clip(cells.sum(axis=1), 0.0, 1.0)


def _cells(
    mean: FloatArray, sd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return nodes (L, C, p) and half lengths (L, C) of cells, and weights.

    The weights are those of the integrals up to each node, and of the whole cell.
    """
    marks = np.arange(-REACH, REACH + 0.5, 1.0)
    edges = (mean[:, :, None] + sd[:, :, None] * marks).reshape(len(mean), -1)
    edges = np.sort(edges, axis=1)
    half = 0.5 * np.diff(edges, axis=1)
    centre = 0.5 * (edges[:, 1:] + edges[:, :-1])
    x, whole = np.polynomial.legendre.leggauss(CELL_NODES)
    nodes = centre[:, :, None] + half[:, :, None] * x
    return nodes, half, _partial_weights(x), whole


def _partial_weights(x: FloatArray) -> FloatArray:
    """Return w with sum_j w[i, j] f(x_j) = integral of f from -1 to x_i.

    It holds for polynomials f.
    """
    powers = np.arange(len(x))
    monomials = x[:, None] ** powers
    integrals = (x[:, None] ** (powers + 1) - (-1.0) ** (powers + 1)) / (powers + 1)
    return np.asarray(np.linalg.solve(monomials.T, integrals.T).T, dtype=np.float64)
