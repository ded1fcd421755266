"""Size of the difference between the maps of the contact orders, with its interval and bounds.

The size is the relative difference of the maps' Jacobians, in Frobenius norm over the
landings of the study. With D the difference between the Jacobians of two orders, J
their mean, and S the covariance of the inputs,

    e^2 = mean over pairs of orders of  1/2 |D S^1/2|^2 / |J S^1/2|^2  of the positions
                                      + 1/2 |D S^1/2|^2 / |J S^1/2|^2  of the velocities,

both as rms motions of the markers. It is a quadratic form of the kinks b, e^2 = b'Fb.

All results follow from the statistic T = b'Fb and its distribution for b = e u, where u
is the direction found. Each landing's contribution to the error of b is equally likely
to have either sign, so random signs simulate that error whatever the scatter of the
landings (Hemerik, Goeman and Finos 2020). If successive landings have similar errors,
`IN_A_ROW` of them get the same sign. Residual smooth terms shift b equally in every
study of a system, so a size up to `allowed` is not evidence.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray, Shown
from hopdata.errors import AnalysisError
from hopdata.landings.schedules import order_names
from hopdata.maps import coordinates
from hopdata.maps.verdict import inputs, model
from hopdata.maps.verdict.inputs import (
    LEAST_CLASS,
    SectionLandings,
    contact_orders,
    halves,
)
from hopdata.maps.verdict.model import KinkFit, symmetric_root

#: Number of successive landings that share a random sign if successive landings err
#: alike.
IN_A_ROW = 40

_AT_ONCE = 8_000_000  # signs in memory
_BISECTIONS = 50
_LARGEST = 1e3  # size at which the search for a crossing stops


@dataclass(frozen=True, repr=False)
class EffectSize(Shown):
    """Relative difference between the Jacobians of the contact orders.

    Attributes
    ----------
    estimate
        Size, after the mean contribution of noise to its square has been subtracted.
    low, high
        Ends of the interval; `low` is above zero exactly if the test finds more than
        `allowed`.
    upper_bound
        One-sided bound: at the given confidence the difference is not larger than this.
        Like `high`, it is never below the value that the median study without a
        difference gives.
    detectable
        Size of a difference that the test finds with the given power.
    p_value
        Share of the sign patterns, including the data's own, that give at least this
        statistic if smooth terms left `allowed`.
    squared, squared_error
        Unbiased estimate of the squared size, which noise can make negative, and its
        standard error if there is no difference.
    along_error
        Standard error of the kinks along the direction found. For a difference of size
        e the variance of `squared` is `squared_error`^2 + 4 e^2 `along_error`^2.
    allowed, left
        Sizes up to which one study, and the mean of such studies, is not evidence: see
        `KinkFit`.
    """

    estimate: float
    low: float
    high: float
    upper_bound: float
    detectable: float
    p_value: float
    squared: float
    squared_error: float
    along_error: float
    allowed: float
    left: float

    def told(self) -> str:
        """Return the estimate, its interval, the bound and the detectable size."""
        size = f"{self.estimate:.2g}, {self.low:.2g} to {self.high:.2g}"
        return f"{size}; at most {self.upper_bound:.2g}; detectable from {self.detectable:.2g}"

    def sizes(self) -> tuple[float, float, float, float]:
        """Return estimate, low, high and upper bound."""
        return self.estimate, self.low, self.high, self.upper_bound


def contrasts(orders: IntArray, counts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the weights of the comparisons: pairs of orders, or of feet if more than three.

    For a pair of feet i and j, landings with i before j are compared with landings with
    j before i; the other feet are pooled in the proportions in which their orders
    occur. A pair is used if each of its feet comes first in `LEAST_CLASS` landings or
    more.

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
    number, feet = orders.shape
    if feet <= coordinates.ALL_SETS_UP_TO:
        one = np.eye(number)
        pairs = [one[a] - one[b] for a, b in combinations(range(number), 2)]
        return np.reshape(pairs, (len(pairs), number)), np.full(
            number, 1.0 / max(number, 1)
        )
    place = np.argsort(orders, axis=1)
    differences = []
    for i, j in combinations(range(feet), 2):
        first = counts * (place[:, i] < place[:, j])
        last = counts - first
        if min(first.sum(), last.sum()) >= LEAST_CLASS:
            differences.append(first / first.sum() - last / last.sum())
    return np.reshape(differences, (len(differences), number)), counts / counts.sum()


def compared(landings: SectionLandings) -> tuple[FloatArray, FloatArray, str]:
    """Return the comparisons in terms of kinks and in words.

    Returns
    -------
    tuple
        (C, all kinks, feet) differences of the kinks' derivatives with respect to the
        contact instants, (all kinks, feet) derivatives of the mean map, and words that
        complete "the maps of".

    Raises
    ------
    AnalysisError
        If no two orders, or no two feet, have `LEAST_CLASS` landings each.
    """
    by_order = landings.expected.shape[1] <= coordinates.ALL_SETS_UP_TO
    orders, counts = contact_orders(landings.expected, LEAST_CLASS if by_order else 1)
    differences, mean = contrasts(orders, counts)
    what = (
        f"landings with either foot of a pair first ({len(differences)} pairs of feet)"
    )
    missing = f"no two feet each come first in {LEAST_CLASS} touchdowns"
    if by_order:
        missing = f"at least two contact orders need {LEAST_CLASS} touchdowns each: "
        what, missing = f"{len(orders)} contact orders", missing + _commonest(landings)
    if not len(differences):
        raise AnalysisError(missing)
    slopes = np.array(
        [coordinates.kink_slopes(tuple(order)) for order in orders.tolist()]
    )
    return (
        np.tensordot(differences, slopes, axes=1),
        np.tensordot(mean, slopes, axes=1),
        what,
    )


def _commonest(landings: SectionLandings) -> str:
    """Return the three commonest contact orders and their numbers of landings, in words."""
    orders, counts = contact_orders(landings.expected, 1)
    names, common = order_names(orders), np.argsort(-counts, kind="stable")[:3]
    return ", ".join(f"{names[k].replace('>', ' → ')} has {counts[k]}" for k in common)


def squared_size(
    fit: KinkFit, landings: SectionLandings, differences: FloatArray, mean: FloatArray
) -> FloatArray:
    """Return a root R (K q, K q) of the squared size of the kinks, |R b|^2 = b'Fb.

    `differences` and `mean` are from `compared`.
    """
    t = landings.expected
    changes = np.einsum(
        "aK,caf,fg->cKg", fit.seen, differences, symmetric_root(np.cov(t.T))
    )
    form = np.einsum("cKg,cLg->KL", changes, changes) / len(changes)
    outcome = landings.inputs @ fit.linear + t @ mean.T @ fit.seen @ fit.coefficients
    weights = np.diag(np.sqrt(halves(np.var(outcome, axis=0, ddof=1))))
    return np.asarray(np.kron(symmetric_root(form), weights), float)


def squared_jump(fit: KinkFit, landings: SectionLandings) -> FloatArray:
    """Return a root of the squared size of the steps, as `squared_size` does for kinks.

    The squared size is the mean over the pairs of feet of the squared jump from one
    order to the other, relative to the variance of the outcome.
    """
    weights = np.diag(np.sqrt(halves(np.var(landings.outputs, axis=0, ddof=1))))
    pairs, seen = fit.seen.shape
    return np.asarray(np.kron(2.0 / np.sqrt(pairs) * np.eye(seen), weights), float)


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
    differences, mean = (np.tensordot(one, maps, axes=1) for one in weights)
    changes = np.mean(np.sum(differences**2, axis=2), axis=0)
    return float(np.sqrt(changes @ halves(np.sum(mean**2, axis=1))))


def effect_size(
    fit: KinkFit,
    root: FloatArray,
    *,
    generator: np.random.Generator,
    confidence: float,
    power: float,
    flips: int,
) -> EffectSize:
    """Return the size of the kinks, with interval, bounds and p-value.

    The interval contains the sizes for which the T found is not a rare draw. Its low
    end is then reduced by `allowed` and its high end raised by `upper_ends`, for two
    reasons: residual smooth terms may add to a difference or hide part of it, and the
    simultaneous contact is a single landing, which may differ from the observed mean
    (`one_landing`).

    Below the size at which a statistic as small as the median under `allowed` becomes
    rare, only large draws count as rare. The interval therefore starts above zero
    exactly if the test, of level 1 - confidence, finds more than `allowed`. For `high`
    and the bound, a statistic below the median without kinks is replaced by that
    median: an estimate smaller than noise alone gives is luck, not knowledge.

    Parameters
    ----------
    fit, root
        Kinks, and the root of their squared size: see `squared_size`.
    generator
        Source of the random signs.
    confidence, power
        Confidence of the interval and the bound, and power for the detectable
        difference.
    flips
        Number of random sign patterns.
    """
    if model.err_alike(fit.scores @ root.T):
        first = np.arange(0, len(fit.scores), IN_A_ROW)
        runs = [np.add.reduceat(part, first) for part in (fit.scores, fit.null_scores)]
        fit = replace(fit, scores=runs[0], null_scores=runs[1])
    root = _axes(fit, root) @ root
    found = root @ fit.coefficients.ravel()
    statistic = float(found @ found)
    size = float(np.sqrt(statistic))
    along = found / size
    null, full = _draws(fit, root, flips, generator)
    for_none, for_found = (
        np.ascontiguousarray(draws.T) for draws in (null, full)
    )  # quick to add

    def drawn(true: float) -> FloatArray:
        """Return draws of T for kinks of this size along those found."""
        share = min(1.0, true / size)
        errors = (
            for_found if share == 1.0 else (1.0 - share) * for_none + share * for_found
        )
        return np.asarray(((errors + true * along[:, None]) ** 2).sum(axis=0))

    def below(least: float, share: float) -> float:
        """Return the size at which only this share of the draws is at most `least`."""
        return _crossing(lambda e: _share(drawn(e) <= least) - share)

    none, left = np.sum(null**2, axis=1), drawn(fit.allowed)
    typical = max(statistic, float(np.median(none)))
    level = round(1.0 - confidence, 12)  # 0.05, not slightly more
    p_value = (1 + int(np.sum(left >= statistic))) / (1 + flips)
    floor = below(float(np.median(left)), level / 2.0)
    low = min(
        below(statistic, 1.0 - level), max(floor, below(statistic, 1.0 - level / 2.0))
    )
    reach = [below(typical, one) for one in (level / 2.0, level)]
    high, bound = model.upper_ends(reach, fit.allowed)
    off = model.one_landing(fit.allowed)
    squared = statistic - float(np.sum((fit.scores @ root.T) ** 2))
    return EffectSize(
        estimate=float(np.sqrt(max(0.0, squared))),
        low=max(0.0, low - fit.allowed) / (1.0 + off) * (p_value < level),
        high=high,
        upper_bound=bound,
        detectable=_detectable(null, fit.allowed, level, power),
        p_value=p_value,
        squared=squared,
        squared_error=float(np.std(none)),
        along_error=float(np.std(full @ found) / size),
        allowed=fit.allowed,
        left=fit.left,
    )


MOST_LANDINGS = 20_000  # the most that anybody records
MORE_SPREAD = (
    ", or far fewer with contacts further apart: vary push, tilt and speed of the hops"
)


def landings_needed(
    landings: int, detectable: float, allowed: float, difference: float, feet: int
) -> int:
    """Return the number of landings that shows a difference with the power of the detectable one.

    The detectable size beyond `allowed` falls with the root of the number of landings.
    The result is at least the number that second-order terms need.

    Raises
    ------
    AnalysisError
        If the difference is not larger than `allowed`, so that no number of landings
        shows it.
    """
    if not difference > allowed:
        least = f"numbers above {allowed:.2g}, as much as smooth terms may leave"
        raise AnalysisError(f"differences: expected {least}, found {difference}")
    beyond = max(0.0, detectable - allowed) / (difference - allowed)
    return max(inputs.least_landings(feet), int(np.ceil(landings * beyond**2)))


def _axes(fit: KinkFit, root: FloatArray) -> FloatArray:
    """Return the principal axes of the error of the size, pointing along the kinks found.

    In these axes the same random numbers give the same draws, whatever the axes of the
    data.
    """
    scores = fit.null_scores @ root.T
    axes = np.linalg.eigh(scores.T @ scores)[1].T
    return np.asarray(axes * np.sign(axes @ root @ fit.coefficients.ravel())[:, None])


def _draws(
    fit: KinkFit, root: FloatArray, count: int, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return random errors of the kinks, in axes in which their size is their Euclidean length.

    Both (draws, m) are randomly signed sums of the landings' contributions: for no
    kinks, and for the kinks found. For an assumed size in between, they are mixed in
    proportion to it.
    """
    both = np.hstack([fit.null_scores @ root.T, fit.scores @ root.T])
    sums = np.empty((count, both.shape[1]))
    at_once = max(1, _AT_ONCE // len(both))
    for first in range(0, count, at_once):
        some = sums[first : first + at_once]
        some[:] = (
            2.0 * generator.integers(0, 2, size=(len(some), len(both))) - 1.0
        ) @ both
    null, full = np.split(sums, 2, axis=1)
    return null, full


def _detectable(
    errors: FloatArray, allowed: float, level: float, power: float
) -> float:
    """Return the size of kinks that the test finds with this power.

    The kinks are along the axis of the largest error.
    """
    along, across = errors[:, -1], np.sum(errors[:, :-1] ** 2, axis=1)
    threshold = float(np.quantile((along + allowed) ** 2 + across, 1.0 - level))

    return _crossing(
        lambda e: _share((along + e) ** 2 + across <= threshold) - (1.0 - power)
    )


def _share(holds: BoolArray) -> float:
    return np.count_nonzero(holds) / len(holds)  # the mean, in a third of the time


def _crossing(decreasing: Callable[[float], float]) -> float:
    """Return the size at which a decreasing function crosses zero; 0 if it starts below zero."""
    low, high = 0.0, 1e-3
    if decreasing(0.0) <= 0.0:
        return 0.0
    while decreasing(high) > 0.0 and high < _LARGEST:
        low, high = high, 2.0 * high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if decreasing(middle) > 0.0 else (low, middle)
    return high
