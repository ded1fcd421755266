"""Which maps are compared, and the size of the difference between them.

The size is the relative difference of the maps' Jacobians, in Frobenius norm over the
landings of the study. With D the difference between the Jacobians of two orders, J
their mean, and S the covariance of the inputs,

    e^2 = mean over pairs of orders of  1/2 |D S^1/2|^2 / |J S^1/2|^2  of positions
                                      + 1/2 |D S^1/2|^2 / |J S^1/2|^2  of velocities,

both as rms motions of the markers, so |D S^1/2|^2 is the mean over the landings of how
far (or how fast) D moves the markers, squared. e^2 is a quadratic form b'Fb of the
kinks b.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.feet import AND, with_foot_names
from hopdata.landings.schedules import order_names
from hopdata.maps import coordinates
from hopdata.maps.verdict.exchanges import Exchange
from hopdata.maps.verdict.inputs import (
    LEAST_CLASS,
    SectionLandings,
    contact_orders,
    halves,
)
from hopdata.maps.verdict.linear import regular, symmetric_root
from hopdata.maps.verdict.model import KinkFit
from hopdata.messages import Message


@dataclass(frozen=True)
class Comparison:
    """The maps that are compared, in terms of the kinks.

    Attributes
    ----------
    differences
        (C, all kinks, feet) differences of the kinks' derivatives with respect to the
        contact instants.
    mean
        (all kinks, feet) derivatives of the mean map.
    what
        What completes "the maps of".
    names
        C pairs of names of what is compared: contact orders as ``"1>2>3"``, or the
        orders of two feet, ``"1>2"`` and ``"2>1"``.
    """

    differences: FloatArray
    mean: FloatArray
    what: Message
    names: list[tuple[str, str]]


def compared(landings: SectionLandings, foot_names: Sequence[str] = ()) -> Comparison:
    """Return what is compared: contact orders, or pairs of feet if there are many feet.

    Raises
    ------
    AnalysisError
        If no two orders, or no two feet, have `LEAST_CLASS` landings each.
    """
    by_order = landings.expected.shape[1] <= coordinates.ALL_SETS_UP_TO
    least = LEAST_CLASS if by_order else 1
    orders, counts = contact_orders(landings.expected, least)
    differences, mean = contrasts(orders, counts)
    if not len(differences):
        raise AnalysisError(
            _nothing_to_compare(landings, foot_names, by_order=by_order)
        )
    pairs = pairs_compared(orders, counts)
    if by_order:
        what = Message("maps.orders", {"count": len(orders)})
        of_orders = order_names(orders)
        names = [(of_orders[a], of_orders[b]) for a, b in pairs]
    else:
        what = Message("maps.pairs_of_feet", {"count": len(differences)})
        names = [names_of_feet(i, j) for i, j in pairs]
    slopes = np.array(
        [coordinates.kink_slopes(tuple(order)) for order in orders.tolist()]
    )
    return Comparison(
        differences=np.tensordot(differences, slopes, axes=1),
        mean=np.tensordot(mean, slopes, axes=1),
        what=what,
        names=names,
    )


def _nothing_to_compare(
    landings: SectionLandings, foot_names: Sequence[str], *, by_order: bool
) -> Message:
    if not by_order:
        missing = Message("maps.feet_come_first", {"least": LEAST_CLASS})
        return Message("maps.no_two_feet", {"what_is_missing": missing})
    commonest = _commonest(landings, foot_names)
    values = {"least": LEAST_CLASS, "commonest": commonest}
    return Message("maps.too_few_orders", values)


def _commonest(landings: SectionLandings, foot_names: Sequence[str]) -> str:
    """Return the three commonest contact orders and their numbers of landings."""
    orders, counts = contact_orders(landings.expected, 1)
    names = order_names(orders)
    told = []
    for k in np.argsort(-counts, kind="stable")[:3]:
        order = with_foot_names(names[k], foot_names)
        values = {"order": order, "count": int(counts[k])}
        told.append(str(Message("maps.order_has", values)))
    return ", ".join(told)


def contrasts(orders: IntArray, counts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the weights of the comparisons between contact orders.

    Up to three feet, pairs of orders are compared. With more, pairs of feet are: for
    feet i and j, landings with i before j are compared with landings with j before i,
    and the other feet are pooled in the proportions in which their orders occur. A pair
    is used if each of its feet comes first in `LEAST_CLASS` landings or more.

    Parameters
    ----------
    orders
        (S, feet) contact orders: the feet in the order in which they touch.
    counts
        (S,) number of landings of each order.

    Returns
    -------
    tuple of ndarray
        (C, S) weights of the orders in the differences, and (S,) weights in the mean.
    """
    n_orders, n_feet = orders.shape
    pairs = pairs_compared(orders, counts)
    differences = []
    if n_feet <= coordinates.ALL_SETS_UP_TO:
        one = np.eye(n_orders)
        for a, b in pairs:
            differences.append(one[a] - one[b])
        mean = np.full(n_orders, 1.0 / max(n_orders, 1))
    else:
        for i, j in pairs:
            i_first = _with_first(orders, counts, i, j)
            j_first = counts - i_first
            differences.append(i_first / i_first.sum() - j_first / j_first.sum())
        mean = counts / counts.sum()
    return np.reshape(differences, (len(differences), n_orders)), mean


def pairs_compared(orders: IntArray, counts: IntArray) -> list[tuple[int, int]]:
    """Return the pairs that are compared: numbers of orders or, of many feet, of feet.

    Parameters
    ----------
    orders, counts
        As for `contrasts`.
    """
    n_orders, n_feet = orders.shape
    if n_feet <= coordinates.ALL_SETS_UP_TO:
        return list(combinations(range(n_orders), 2))
    pairs = []
    for i, j in combinations(range(n_feet), 2):
        i_first = _with_first(orders, counts, i, j).sum()
        if min(i_first, counts.sum() - i_first) >= LEAST_CLASS:
            pairs.append((i, j))
    return pairs


def _with_first(orders: IntArray, counts: IntArray, i: int, j: int) -> IntArray:
    """Return the number of landings of each order in which foot i is before foot j."""
    rank = np.argsort(orders, axis=1)
    return np.asarray(counts * (rank[:, i] < rank[:, j]))


def names_of_feet(i: int, j: int) -> tuple[str, str]:
    """Return the names of "foot i before foot j" and the reverse; i and j from 0."""
    return f"{i + 1}>{j + 1}", f"{j + 1}>{i + 1}"


def names_of_exchange(exchange: Exchange) -> tuple[str, str]:
    """Return the names of either order of the pairs that exchange it together."""
    first, second = zip(*[names_of_feet(i, j) for i, j in exchange], strict=True)
    return AND.join(first), AND.join(second)


def squared_size(
    fit: KinkFit, landings: SectionLandings, comparison: Comparison
) -> FloatArray:
    """Return a root R (K q, K q) of the squared size of the kinks, |R b|^2 = b'Fb."""
    changes = changes_of_map(fit, landings, comparison)
    form = np.einsum("cKg,cLg->KL", changes, changes) / len(changes)
    weights = weights_of_map(fit, landings, comparison)
    return np.asarray(np.kron(symmetric_root(form), weights), float)


def changes_of_map(
    fit: KinkFit, landings: SectionLandings, comparison: Comparison
) -> FloatArray:
    """Return by how much each kink changes each map compared, (C, K, feet)."""
    covariance = np.cov(landings.expected.T) + landings.unforetold.total
    changes = np.einsum(
        "aK,caf,fg->cKg", fit.seen, comparison.differences, symmetric_root(covariance)
    )
    return np.asarray(changes)


def weights_of_map(
    fit: KinkFit, landings: SectionLandings, comparison: Comparison
) -> FloatArray:
    """Return the matrix (q, q) that makes shares of the mean map of changes."""
    by_inputs = landings.inputs @ fit.linear
    slopes = comparison.mean.T @ fit.seen @ fit.coefficients
    outcome = by_inputs + landings.expected @ slopes
    power = _true_power(landings, outcome, slopes)
    return np.diag(np.sqrt(halves(power)))


def _true_power(
    landings: SectionLandings, outcome: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Return the mean squares (q,) of a linear outcome (n, q) for the true inputs.

    Noise of the inputs weakens what they explain: the slopes by the true inputs are
    those by the measured ones times S (S - U)^-1, where S is the covariance of the
    measured inputs and U that of their errors. What the inputs do not foretell of the
    contact instants adds its own part, by the `slopes` (feet, q).
    """
    rest = landings.unforetold.by_posture
    measured = regular(np.cov(landings.inputs.T))
    by_measured = np.linalg.lstsq(landings.inputs, outcome, rcond=None)[0]
    explained = measured @ by_measured
    by_true = np.linalg.solve(measured - landings.noise, explained)
    of_inputs = np.sum(explained * by_true, axis=0)
    of_rest = np.einsum("fq,fg,gq->q", slopes, rest, slopes)
    return np.asarray(of_inputs + of_rest)


def squared_jump(
    fit: KinkFit, landings: SectionLandings, comparison: Comparison
) -> FloatArray:
    """Return a root of the squared size of the steps, as `squared_size` does for kinks.

    The squared size is the mean over the exchanges of the squared jump from one order
    to the other, relative to what the mean map makes of the inputs. What is seen
    of the outcome would not do: the noise of cameras is no variation of it. `fit` is
    that of the kinks, whose `jumps` the steps are.

    Raises
    ------
    AnalysisError
        If no steps were fitted.
    """
    if fit.jumps is None:
        raise AnalysisError.at("jumps", "steps beside the kinks", "none")
    n_exchanges, n_seen = fit.jumps.seen.shape
    # A step from -1 to 1 changes the outcome by twice its coefficient.
    mean_of_all = 2.0 / np.sqrt(n_exchanges) * np.eye(n_seen)
    weights = weights_of_map(fit, landings, comparison)
    return np.asarray(np.kron(mean_of_all, weights), float)


def relative_size(maps: FloatArray, weights: tuple[FloatArray, FloatArray]) -> float:
    """Return the size of the difference between known maps, as the verdict measures it.

    Parameters
    ----------
    maps
        (S, 11, p) map of each order, from inputs with unit covariance to motions of the
        markers; see `SectionLandings.outputs`.
    weights
        Weights from `contrasts`.
    """
    of_differences, of_mean = weights
    differences = np.tensordot(of_differences, maps, axes=1)
    mean = np.tensordot(of_mean, maps, axes=1)
    changes = np.mean(np.sum(differences**2, axis=2), axis=0)
    return float(np.sqrt(changes @ halves(np.sum(mean**2, axis=1))))
