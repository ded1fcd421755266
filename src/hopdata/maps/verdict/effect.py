"""Size of the difference between the maps of the contact orders, and its interval.

The size is the relative difference of the maps' Jacobians, in Frobenius norm over the
landings of the study. With D the difference between the Jacobians of two orders, J
their mean, and S the covariance of the inputs,

    e^2 = mean over pairs of orders of  1/2 |D S^1/2|^2 / |J S^1/2|^2  of positions
                                      + 1/2 |D S^1/2|^2 / |J S^1/2|^2  of velocities,

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
from hopdata.maps.verdict.linear import regular, symmetric_root
from hopdata.maps.verdict.model import KinkFit
from hopdata.maps.verdict.saturation import LEVEL, saturation
from hopdata.messages import Message

#: Number of successive landings that share a random sign if successive landings err
#: alike.
#: Unit: landings. Origin: chosen.
IN_A_ROW = 40

#: Size at which the search for a crossing stops: whatever is larger is unbounded.
#: Unit: share of the map. Origin: chosen.
LARGEST = 1e3

#: Directions of kinks over which the power for the detectable size is averaged.
#: Unit: 1. Origin: chosen.
DIRECTIONS = 64

#: Scatter of the logarithm of how large a difference shows, relative to its exact size.
#: Unit: 1. Origin: measured: on hoppers eps shows as 1.4 to 1.6 times its exact size,
#: kappa as 0.85 and tau as 0.6 to 0.75, since smooth terms add to kinks or hide them
#: (verdict.md).
SHOWN_SCATTER = 0.3

# Signs in memory at once. It changes no result.
SIGNS_AT_ONCE = 8_000_000

# Halvings of the interval that holds a crossing: more than a double has digits.
BISECTIONS = 50


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
        Exact size of a difference that the test finds with the given power, over
        directions and what smooth terms add or hide.
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
        bound = f"at most {self.upper_bound:.2g}"
        return f"{size}; {bound}; detectable from {self.detectable:.2g}"

    def sizes(self) -> tuple[float, float, float, float]:
        """Return estimate, low, high and upper bound."""
        return self.estimate, self.low, self.high, self.upper_bound


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
    differences = []
    if n_feet <= coordinates.ALL_SETS_UP_TO:
        one = np.eye(n_orders)
        for a, b in combinations(range(n_orders), 2):
            differences.append(one[a] - one[b])
        mean = np.full(n_orders, 1.0 / max(n_orders, 1))
    else:
        rank = np.argsort(orders, axis=1)
        for i, j in combinations(range(n_feet), 2):
            i_first = counts * (rank[:, i] < rank[:, j])
            j_first = counts - i_first
            if min(i_first.sum(), j_first.sum()) >= LEAST_CLASS:
                difference = i_first / i_first.sum() - j_first / j_first.sum()
                differences.append(difference)
        mean = counts / counts.sum()
    return np.reshape(differences, (len(differences), n_orders)), mean


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
    """

    differences: FloatArray
    mean: FloatArray
    what: Message


def compared(landings: SectionLandings) -> Comparison:
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
        raise AnalysisError(_nothing_to_compare(landings, by_order=by_order))
    if by_order:
        what = Message("maps.orders", {"count": len(orders)})
    else:
        what = Message("maps.pairs_of_feet", {"count": len(differences)})
    of_orders = [coordinates.kink_slopes(tuple(order)) for order in orders.tolist()]
    slopes = np.array(of_orders)
    return Comparison(
        differences=np.tensordot(differences, slopes, axes=1),
        mean=np.tensordot(mean, slopes, axes=1),
        what=what,
    )


def _nothing_to_compare(landings: SectionLandings, *, by_order: bool) -> Message:
    if not by_order:
        missing = Message("maps.feet_come_first", {"least": LEAST_CLASS})
        return Message("maps.no_two_feet", {"what_is_missing": missing})
    commonest = _commonest(landings)
    values = {"least": LEAST_CLASS, "commonest": commonest}
    return Message("maps.too_few_orders", values)


def _commonest(landings: SectionLandings) -> str:
    """Return the three commonest contact orders and their numbers of landings."""
    orders, counts = contact_orders(landings.expected, 1)
    names = order_names(orders)
    told = []
    for k in np.argsort(-counts, kind="stable")[:3]:
        values = {"order": names[k].replace(">", " → "), "count": int(counts[k])}
        told.append(str(Message("maps.order_has", values)))
    return ", ".join(told)


def squared_size(
    fit: KinkFit, landings: SectionLandings, comparison: Comparison
) -> FloatArray:
    """Return a root R (K q, K q) of the squared size of the kinks, |R b|^2 = b'Fb."""
    instants = landings.expected
    covariance = np.cov(instants.T) + landings.unforetold.total
    changes = np.einsum(
        "aK,caf,fg->cKg", fit.seen, comparison.differences, symmetric_root(covariance)
    )
    form = np.einsum("cKg,cLg->KL", changes, changes) / len(changes)

    by_inputs = landings.inputs @ fit.linear
    slopes = comparison.mean.T @ fit.seen @ fit.coefficients
    by_kinks = instants @ slopes
    weights = _weights(_true_power(landings, by_inputs + by_kinks, slopes))
    return np.asarray(np.kron(symmetric_root(form), weights), float)


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


def squared_jump(fit: KinkFit, landings: SectionLandings) -> FloatArray:
    """Return a root of the squared size of the steps, as `squared_size` does for kinks.

    The squared size is the mean over the pairs of feet of the squared jump from one
    order to the other, relative to the variance of the outcome.
    """
    n_pairs, n_seen = fit.seen.shape
    # A step from -1 to 1 changes the outcome by twice its coefficient.
    mean_of_pairs = 2.0 / np.sqrt(n_pairs) * np.eye(n_seen)
    variance = np.var(landings.outputs, axis=0, ddof=1)
    return np.asarray(np.kron(mean_of_pairs, _weights(variance)), float)


def _weights(variance: FloatArray) -> FloatArray:
    """Return the matrix (q, q) that weighs positions and velocities one half each."""
    return np.diag(np.sqrt(halves(variance)))


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
        fit = _with_signs_in_a_row(fit)
    root = _axes(fit, root) @ root
    found = root @ fit.coefficients.ravel()
    statistic = float(found @ found)
    null_errors, full_errors = _draws(fit, root, flips, generator)
    draws = _Draws(found, null_errors, full_errors)

    null_statistics = np.sum(null_errors**2, axis=1)
    allowed_statistics = draws.statistics(fit.allowed)
    level = round(1.0 - confidence, 12)  # 0.05, not slightly more
    p_value = (1 + int(np.sum(allowed_statistics >= statistic))) / (1 + flips)

    low = 0.0
    if p_value < level:
        floor = draws.size_below(float(np.median(allowed_statistics)), level / 2.0)
        one_sided = draws.size_below(statistic, 1.0 - level)
        two_sided = draws.size_below(statistic, 1.0 - level / 2.0)
        found_low = min(one_sided, max(floor, two_sided))
        deviation = model.one_landing(fit.allowed)
        low = max(0.0, found_low - fit.allowed) / (1.0 + deviation)

    typical = max(statistic, float(np.median(null_statistics)))
    ends = [draws.size_below(typical, level / 2.0), draws.size_below(typical, level)]
    high, bound = model.upper_ends(ends, fit.allowed)

    of_noise = float(np.sum((fit.scores @ root.T) ** 2))
    squared = statistic - of_noise
    return EffectSize(
        estimate=float(np.sqrt(max(0.0, squared))),
        low=low,
        high=high,
        upper_bound=bound,
        detectable=_detectable(null_errors, fit.allowed, level, power),
        p_value=p_value,
        squared=squared,
        squared_error=float(np.std(null_statistics)),
        along_error=float(np.std(full_errors @ found) / draws.size),
        allowed=fit.allowed,
        left=fit.left,
    )


@dataclass(frozen=True)
class AtContact:
    """What saturation changes of a size over the landings.

    Attributes
    ----------
    size
        Size at the simultaneous contact.
    saturates
        Whether the kinks are found to saturate.
    p_value
        Share of the sign patterns, including the data's own, that show as much
        saturation as found.
    """

    size: EffectSize
    saturates: bool
    p_value: float


def at_the_contact(
    fit: KinkFit,
    landings: SectionLandings,
    over_landings: EffectSize,
    size: Callable[[KinkFit], EffectSize],
    *,
    generator: np.random.Generator,
    flips: int,
) -> AtContact:
    """Return the size at the simultaneous contact.

    It is that over the landings unless the kinks are found to saturate. Then the
    estimate is that for the slowest time constant in doubt, and the upper ends are the
    largest of all of them. `low` remains: kinks that saturate are
    smaller over the landings than at the contact.

    Parameters
    ----------
    fit, landings
        Kinks over the landings.
    over_landings
        Their size.
    size
        Function that returns the size of kinks.
    generator, flips
        Source and number of random sign patterns.
    """
    in_a_row = 1
    if model.err_alike(fit.scores):
        in_a_row = IN_A_ROW
    p_value, in_doubt = saturation(
        fit.at_contact(landings), flips=flips, in_a_row=in_a_row, rng=generator
    )
    if not p_value < LEVEL:
        return AtContact(over_landings, saturates=False, p_value=p_value)
    sizes = [size(fit.with_slopes(of_constant)) for of_constant in in_doubt]
    if sizes[0].estimate <= fit.allowed:
        # Smooth terms may leave as much.
        return AtContact(over_landings, saturates=False, p_value=p_value)
    every = [over_landings, *sizes]
    found = replace(
        over_landings,
        estimate=sizes[0].estimate,
        high=max(one.high for one in every),
        upper_bound=max(one.upper_bound for one in every),
    )
    return AtContact(found, saturates=True, p_value=p_value)


def _with_signs_in_a_row(fit: KinkFit) -> KinkFit:
    """Return the fit with the scores of `IN_A_ROW` successive landings summed."""
    first = np.arange(0, len(fit.scores), IN_A_ROW)
    scores = np.add.reduceat(fit.scores, first)
    null_scores = np.add.reduceat(fit.null_scores, first)
    return replace(fit, scores=scores, null_scores=null_scores)


class _Draws:
    """Draws of the statistic T for kinks of any size along those found.

    Parameters
    ----------
    found
        (m,) kinks found, in the axes of the errors.
    null_errors, full_errors
        (draws, m) random errors for no kinks, and for the kinks found.
    """

    def __init__(
        self, found: FloatArray, null_errors: FloatArray, full_errors: FloatArray
    ) -> None:
        self.size = float(np.sqrt(float(found @ found)))
        self._along = found / self.size
        # Rows of axes are quicker to add than rows of draws.
        self._null_errors = np.ascontiguousarray(null_errors.T)
        self._full_errors = np.ascontiguousarray(full_errors.T)

    def statistics(self, true: float) -> FloatArray:
        """Return the draws (draws,) of T for kinks of this size."""
        share = min(1.0, true / self.size)
        errors = self._full_errors
        if share < 1.0:
            errors = (1.0 - share) * self._null_errors + share * self._full_errors
        return np.asarray(((errors + true * self._along[:, None]) ** 2).sum(axis=0))

    def size_below(self, least: float, share: float) -> float:
        """Return the size at which only this share of the draws is at most `least`."""
        return _crossing(lambda true: _share(self.statistics(true) <= least) - share)


#: More landings than this are not asked for without a word on the contacts' spread.
#: Unit: landings. Origin: chosen: the most that anybody records.
MOST_LANDINGS = 20_000

#: What is said then.
MORE_SPREAD = str(Message("maps.more_spread"))


def landings_needed(
    landings: int, detectable: float, allowed: float, difference: float, feet: int
) -> int:
    """Return the number of landings that shows a difference as well as the detectable.

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
    needed = int(np.ceil(landings * beyond**2))
    return max(inputs.least_landings(feet), needed)


def _axes(fit: KinkFit, root: FloatArray) -> FloatArray:
    """Return the principal axes of the size's error, pointing along the kinks found.

    In these axes the same random numbers give the same draws, whatever the axes of the
    data.
    """
    scores = fit.null_scores @ root.T
    _, vectors = np.linalg.eigh(scores.T @ scores)
    axes = vectors.T
    signs = np.sign(axes @ root @ fit.coefficients.ravel())
    return np.asarray(axes * signs[:, None])


def _draws(
    fit: KinkFit, root: FloatArray, count: int, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return random errors of the kinks, in axes in which their length is their size.

    Both (draws, m) are randomly signed sums of the landings' contributions: for no
    kinks, and for the kinks found. For an assumed size in between, they are mixed in
    proportion to it.
    """
    both = np.hstack([fit.null_scores @ root.T, fit.scores @ root.T])
    sums = np.empty((count, both.shape[1]))
    draws_at_once = max(1, SIGNS_AT_ONCE // len(both))
    for first in range(0, count, draws_at_once):
        chunk = sums[first : first + draws_at_once]
        zeros_and_ones = generator.integers(0, 2, size=(len(chunk), len(both)))
        chunk[:] = (2.0 * zeros_and_ones - 1.0) @ both
    null, full = np.split(sums, 2, axis=1)
    return null, full


def _detectable(
    errors: FloatArray, allowed: float, level: float, power: float
) -> float:
    """Return the size of kinks that the test finds with this power.

    The power is the mean over `DIRECTIONS` in which kinks may lie and over the sizes as
    which they may show: see `SHOWN_SCATTER`. Directions are those of random errors,
    since kinks and errors both are largest in the outcomes that vary most.

    Parameters
    ----------
    errors
        (draws, m) random errors of the kinks.
    """
    from scipy.special import ndtri

    squares = np.sum(errors**2, axis=1)
    directions = errors[:DIRECTIONS] / np.sqrt(squares[:DIRECTIONS, None])
    along = directions @ errors.T
    under_allowed = allowed**2 + 2.0 * allowed * along + squares
    thresholds = np.quantile(under_allowed, 1.0 - level, axis=1)[:, None]

    shares = (np.arange(len(directions)) + 0.5) / len(directions)
    shown = np.exp(SHOWN_SCATTER * ndtri(shares))[:, None]

    def missed(true: float) -> float:
        """Return the share of draws that the test misses, beyond what power allows."""
        seen = true * shown
        statistics = seen**2 + 2.0 * seen * along + squares
        return float(np.mean(statistics <= thresholds)) - (1.0 - power)

    return _crossing(missed)


def _share(holds: BoolArray) -> float:
    return np.count_nonzero(holds) / len(holds)  # the mean, in a third of the time


def _crossing(decreasing: Callable[[float], float]) -> float:
    """Return where a decreasing function crosses zero; 0 if it starts below zero."""
    if decreasing(0.0) <= 0.0:
        return 0.0
    low = 0.0
    high = 1e-3
    while decreasing(high) > 0.0 and high < LARGEST:
        low = high
        high = 2.0 * high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if decreasing(middle) > 0.0:
            low = middle
        else:
            high = middle
    return high
