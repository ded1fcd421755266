"""How different the maps of the contact orders are: size, interval, bound, what could be seen.

The size is the relative difference of the maps' Jacobians, in Frobenius norm over the landings that
the study has: with D the difference of two orders' Jacobians, J their mean, S the covariance of the
inputs,

    e^2 = mean over pairs of orders of  1/2 |D S^1/2|^2 / |J S^1/2|^2  of the positions
                                      + 1/2 |D S^1/2|^2 / |J S^1/2|^2  of the velocities,

both as rms motions of the markers. In the kinks b it is a quadratic form, e^2 = b'Fb. All that is
said follows from the one statistic T = b'Fb and its distribution under b = e u, u the direction
found: each landing's contribution to the error of b is as likely to have the other sign, so random
signs draw that error whatever the scatter of the landings (Hemerik, Goeman and Finos 2020); where
landings that follow each other err alike, `IN_A_ROW` of them have one sign. What
smooth terms leave shifts b alike in every study of a system: so no size that they are `allowed` is
evidence.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray, Shown
from hopdata.errors import AnalysisError
from hopdata.landings.schedules import order_names
from hopdata.maps import coordinates
from hopdata.maps.verdict import inputs
from hopdata.maps.verdict.inputs import LEAST_CLASS, SectionLandings, contact_orders, halves
from hopdata.maps.verdict.model import (
    KinkFit,
    err_alike,
    one_landing,
    symmetric_root,
    upper_ends,
)

#: Landings that get one random sign together where those that follow each other err alike.
IN_A_ROW = 40

_AT_ONCE = 8_000_000  # signs in memory
_BISECTIONS = 50
_LARGEST = 1e3


@dataclass(frozen=True, repr=False)
class EffectSize(Shown):
    """Relative difference between the Jacobians of the contact orders.

    Attributes
    ----------
    estimate
        What noise adds on average taken off.
    low, high
        Ends of the interval; `low` is above zero exactly if the test finds more than
        `allowed`.
    upper_bound
        One-sided bound: no difference larger than this, at the given confidence. Like `high` it
        is never below what the median study without a difference gives.
    detectable
        Difference that the test finds with the given power.
    p_value
        Share of the random signs with a statistic as large though smooth terms left `allowed`,
        the data's own included.
    squared, squared_error
        Square of the size without bias, below zero where noise makes it so, and its standard error
        where there is no difference.
    along_error
        Standard error of the kinks along what was found; with a difference of size e the variance
        of `squared` is `squared_error`^2 + 4 e^2 `along_error`^2.
    allowed, left
        Sizes up to which this study, and the mean of such studies, is no evidence: see `KinkFit`.
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
        """Return the estimate, its interval, the bound and what could have been found."""
        size = f"{self.estimate:.2g}, {self.low:.2g} to {self.high:.2g}"
        return f"{size}; at most {self.upper_bound:.2g}; from {self.detectable:.2g} on found"

    def sizes(self) -> tuple[float, float, float, float]:
        """Return estimate, interval and bound."""
        return self.estimate, self.low, self.high, self.upper_bound


def contrasts(orders: IntArray, counts: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return what is compared: the pairs of orders, or of more than three feet the pairs of feet.

    Of the latter the difference between i before j and j before i, all else pooled as it occurs;
    two feet count if each comes first in `LEAST_CLASS` landings or more.

    Parameters
    ----------
    orders
        (S, feet) orders of contact: their feet, first one first.
    counts
        (S,) number of landings of each.

    Returns
    -------
    tuple of ndarray
        (C, S) weights of the orders in the differences, and (S,) in the mean.
    """
    number, feet = orders.shape
    if feet <= coordinates.ALL_SETS_UP_TO:
        one = np.eye(number)
        pairs = [one[a] - one[b] for a, b in combinations(range(number), 2)]
        return np.reshape(pairs, (len(pairs), number)), np.full(number, 1.0 / max(number, 1))
    place = np.argsort(orders, axis=1)
    differences = []
    for i, j in combinations(range(feet), 2):
        first = counts * (place[:, i] < place[:, j])
        last = counts - first
        if min(first.sum(), last.sum()) >= LEAST_CLASS:
            differences.append(first / first.sum() - last / last.sum())
    return np.reshape(differences, (len(differences), number)), counts / counts.sum()


def compared(landings: SectionLandings) -> tuple[FloatArray, FloatArray, str]:
    """Return what is compared in terms of kinks, and in words.

    Returns
    -------
    tuple
        (C, all kinks, feet) differences of the kinks' derivatives by the contact instants, (all
        kinks, feet) derivatives of the mean map, and words to follow "the maps of".

    Raises
    ------
    AnalysisError
        If no two orders, or feet, have `LEAST_CLASS` landings each.
    """
    by_order = landings.expected.shape[1] <= coordinates.ALL_SETS_UP_TO
    orders, counts = contact_orders(landings.expected, LEAST_CLASS if by_order else 1)
    differences, mean = contrasts(orders, counts)
    what = f"landings with either foot of a pair first ({len(differences)} pairs of feet)"
    missing = f"no two feet each come first in {LEAST_CLASS} touchdowns"
    if by_order:
        missing = f"at least two contact orders need {LEAST_CLASS} touchdowns each: "
        what, missing = f"{len(orders)} contact orders", missing + _commonest(landings)
    if not len(differences):
        raise AnalysisError(missing)
    slopes = np.array([coordinates.kink_slopes(tuple(order)) for order in orders.tolist()])
    return (np.tensordot(differences, slopes, axes=1), np.tensordot(mean, slopes, axes=1), what)


def _commonest(landings: SectionLandings) -> str:
    """Say how many landings the three commonest contact orders have."""
    orders, counts = contact_orders(landings.expected, 1)
    names, common = order_names(orders), np.argsort(-counts, kind="stable")[:3]
    return ", ".join(f"{names[k].replace('>', ' → ')} has {counts[k]}" for k in common)


def squared_size(
    fit: KinkFit, landings: SectionLandings, differences: FloatArray, mean: FloatArray
) -> FloatArray:
    """Return a root R (K q, K q) of the squared size of the kinks, |R b|^2 = b'Fb.

    `differences` and `mean` are those of `compared`.
    """
    t = landings.expected
    changes = np.einsum("aK,caf,fg->cKg", fit.seen, differences, symmetric_root(np.cov(t.T)))
    form = np.einsum("cKg,cLg->KL", changes, changes) / len(changes)
    outcome = landings.inputs @ fit.linear + t @ mean.T @ fit.seen @ fit.coefficients
    weights = np.diag(np.sqrt(halves(np.var(outcome, axis=0, ddof=1))))
    return np.asarray(np.kron(symmetric_root(form), weights), float)


def squared_jump(fit: KinkFit, landings: SectionLandings) -> FloatArray:
    """Return a root of the squared size of the steps, as `squared_size` of kinks.

    It is the mean over the pairs of feet of the squared jump from one order to the other, as a
    share of what the outcome varies.
    """
    weights = np.diag(np.sqrt(halves(np.var(landings.outputs, axis=0, ddof=1))))
    pairs, seen = fit.seen.shape
    return np.asarray(np.kron(2.0 / np.sqrt(pairs) * np.eye(seen), weights), float)


def relative_size(maps: FloatArray, weights: tuple[FloatArray, FloatArray]) -> float:
    """Return the size of the difference of known maps, as the verdict measures it.

    Parameters
    ----------
    maps
        (S, 11, p) of each order: from inputs of covariance one to motions of the markers, see
        `SectionLandings.outputs`.
    weights
        See `contrasts`.
    """
    differences, mean = (np.tensordot(one, maps, axes=1) for one in weights)
    changes = np.mean(np.sum(differences**2, axis=2), axis=0)
    return float(np.sqrt(changes @ halves(np.sum(mean**2, axis=1))))


@dataclass(frozen=True)
class _Draws:
    """Random errors of the kinks, in axes in which their size is a length.

    `null` and `full` (draws, m) are signed sums of the contributions without any kinks, and with
    those found; between them they are mixed in proportion to the size that is assumed.
    """

    null: FloatArray
    full: FloatArray

    def statistic(self, direction: FloatArray, size: float, found: float) -> FloatArray:
        """Return draws of T for kinks of this size in a direction (m,), where `found` is theirs."""
        share = min(1.0, size / found)
        errors = (1.0 - share) * self.null + share * self.full
        return np.asarray(((errors + size * direction) ** 2).sum(axis=1))


def effect_size(
    fit: KinkFit,
    root: FloatArray,
    *,
    generator: np.random.Generator,
    confidence: float,
    power: float,
    flips: int,
) -> EffectSize:
    """Return the size of the kinks and all that follows from its distribution.

    The interval holds the sizes from which T as found is not a rare draw, less `allowed` at its low
    end and with `upper_ends`: what smooth terms leave lies along a difference or against it, and
    the simultaneous contact is `one_landing` of all that show. Below
    the size at which a statistic as small as the median with `allowed` becomes rare, only large
    draws count as rare: so the interval begins above zero exactly if the test, of level
    1 - confidence, finds more than `allowed`. For `high` and the bound a statistic below the
    median without kinks counts as the median: an estimate smaller than noise alone gives is luck,
    not knowledge.

    Parameters
    ----------
    fit, root
        Kinks, and the root of their squared size: see `squared_size`.
    generator
        Source of the random signs.
    confidence, power
        Of the interval and bound, and of the detectable difference.
    flips
        Number of random sign patterns.
    """
    if err_alike(fit.scores @ root.T):
        first = np.arange(0, len(fit.scores), IN_A_ROW)
        runs = [np.add.reduceat(part, first) for part in (fit.scores, fit.null_scores)]
        fit = replace(fit, scores=runs[0], null_scores=runs[1])
    root = _axes(fit, root) @ root
    found = root @ fit.coefficients.ravel()
    statistic = float(found @ found)
    size = float(np.sqrt(statistic))
    along = found / size
    draws = _draws(fit, root, flips, generator)
    none = np.sum(draws.null**2, axis=1)
    left = draws.statistic(along, fit.allowed, size)
    typical = max(statistic, float(np.median(none)))
    level = round(1.0 - confidence, 12)  # 0.05, not a little more

    def below(least: float, share: float) -> float:
        """Return the size from which this share of the draws is at most `least`."""
        return _crossing(lambda e: _share(draws.statistic(along, e, size) <= least) - share)

    p_value = (1 + int(np.sum(left >= statistic))) / (1 + flips)
    floor = below(float(np.median(left)), level / 2.0)
    low = min(below(statistic, 1.0 - level), max(floor, below(statistic, 1.0 - level / 2.0)))
    high, bound = upper_ends([below(typical, one) for one in (level / 2.0, level)], fit.allowed)
    squared = statistic - float(np.sum((fit.scores @ root.T) ** 2))
    return EffectSize(
        estimate=float(np.sqrt(max(0.0, squared))),
        low=max(0.0, low - fit.allowed) / (1.0 + one_landing(fit.allowed)) * (p_value < level),
        high=high,
        upper_bound=bound,
        detectable=_detectable(draws.null, fit.allowed, level, power),
        p_value=p_value,
        squared=squared,
        squared_error=float(np.std(none)),
        along_error=float(np.std(draws.full @ found) / size),
        allowed=fit.allowed,
        left=fit.left,
    )


MOST_LANDINGS = 20_000  # that anybody records
MORE_SPREAD = ", or far fewer with contacts further apart: vary push, tilt and speed of the hops"


def landings_needed(
    landings: int, detectable: float, allowed: float, difference: float, feet: int
) -> int:
    """Return how many landings show a difference as surely as these do the detectable one.

    What is seen beyond `allowed` falls with the root of the number of landings; but it takes so
    many as second-order terms.

    Raises
    ------
    AnalysisError
        If the difference is not larger than `allowed`: no number of landings shows it.
    """
    if not difference > allowed:
        least = f"numbers above {allowed:.2g}, as much as smooth terms may leave"
        raise AnalysisError(f"differences: expected {least}, found {difference}")
    beyond = max(0.0, detectable - allowed) / (difference - allowed)
    return max(inputs.least_landings(feet), int(np.ceil(landings * beyond**2)))


def _axes(fit: KinkFit, root: FloatArray) -> FloatArray:
    """Return the principal axes of the error of the size, turned to the side of what was found.

    In them the same random numbers give the same draws, whatever axes the data came in.
    """
    scores = fit.null_scores @ root.T
    axes = np.linalg.eigh(scores.T @ scores)[1].T
    return np.asarray(axes * np.sign(axes @ root @ fit.coefficients.ravel())[:, None])


def _draws(fit: KinkFit, root: FloatArray, count: int, generator: np.random.Generator) -> _Draws:
    both = np.hstack([fit.null_scores @ root.T, fit.scores @ root.T])
    sums = np.empty((count, both.shape[1]))
    at_once = max(1, _AT_ONCE // len(both))
    for first in range(0, count, at_once):
        some = sums[first : first + at_once]
        some[:] = (2.0 * generator.integers(0, 2, size=(len(some), len(both))) - 1.0) @ both
    return _Draws(*np.split(sums, 2, axis=1))


def _detectable(errors: FloatArray, allowed: float, level: float, power: float) -> float:
    """Return the size at which the test finds kinks along the largest error with this power."""
    along, across = errors[:, -1], np.sum(errors[:, :-1] ** 2, axis=1)
    threshold = float(np.quantile((along + allowed) ** 2 + across, 1.0 - level))

    def too_small(size: float) -> float:
        return _share((along + size) ** 2 + across <= threshold) - (1.0 - power)

    return _crossing(too_small)


def _share(holds: BoolArray) -> float:
    return np.count_nonzero(holds) / len(holds)  # mean's, in a third of the time


def _crossing(decreasing: Callable[[float], float]) -> float:
    """Return where a decreasing function of the size falls through zero; 0 if it starts below."""
    low, high = 0.0, 1e-3
    if decreasing(0.0) <= 0.0:
        return 0.0
    while decreasing(high) > 0.0 and high < _LARGEST:
        low, high = high, 2.0 * high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if decreasing(middle) > 0.0 else (low, middle)
    return high
