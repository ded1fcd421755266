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

from collections.abc import Callable, Sequence
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
#: Unit: 1. Origin: chosen: smooth terms add to kinks or hide them. On hoppers that were
#: seen before, eps shows as 1.4 to 1.6 times its exact size, kappa as 0.85 and tau as
#: 0.6 to 0.75.
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


def names_of_feet(i: int, j: int) -> tuple[str, str]:
    """Return the names of "foot i before foot j" and the reverse; i and j from 0."""
    return f"{i + 1}>{j + 1}", f"{j + 1}>{i + 1}"


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
    return _weights(_true_power(landings, outcome, slopes))


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
    return np.asarray(np.kron(mean_of_pairs, weights_of_jumps(landings)), float)


def weights_of_jumps(landings: SectionLandings) -> FloatArray:
    """Return the matrix (q, q) that makes jumps shares of what the outcome varies."""
    return _weights(np.var(landings.outputs, axis=0, ddof=1))


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
    """Return the size of the kinks, if no other test shares the level of theirs.

    Parameters
    ----------
    fit, root
        Kinks, and the root of their squared size: see `squared_size`.
    generator
        Source of the random signs.
    confidence, power
        See `size_drawn`.
    flips
        Number of random sign patterns.
    """
    alike = model.err_alike(fit.scores @ root.T)
    (errors,) = signed_errors([fit], flips, generator, alike=alike)
    draws = Draws(fit, root, errors, alike=alike)
    level = round(1.0 - confidence, 12)
    return size_drawn(draws, fit, level_found=level, confidence=confidence, power=power)


def size_drawn(
    draws: "Draws",
    fit: KinkFit,
    *,
    level_found: float,
    confidence: float,
    power: float,
) -> EffectSize:
    """Return the size of the kinks, with interval, bounds and p-value.

    The interval contains the sizes for which the T found is not a rare draw: see
    `interval`.

    Parameters
    ----------
    draws
        Draws of T.
    fit
        The kinks.
    level_found
        Level of the test that finds a difference: see `hopdata.maps.verdict.orders`.
    confidence, power
        Confidence of the interval and the bound, and power for the detectable
        difference.
    """
    level = round(1.0 - confidence, 12)  # 0.05, not slightly more
    p_value = draws.p_value(fit.allowed)
    ends = interval(
        draws,
        fit.allowed,
        is_found=p_value < level_found,
        level_found=level_found,
        level=level,
    )
    squared = draws.statistic - draws.of_noise
    return EffectSize(
        estimate=float(np.sqrt(max(0.0, squared))),
        low=ends.low,
        high=ends.high,
        upper_bound=ends.upper_bound,
        detectable=_detectable(draws, fit.allowed, level_found, power),
        p_value=p_value,
        squared=squared,
        squared_error=float(np.std(draws.statistics(0.0))),
        along_error=draws.along_error,
        allowed=fit.allowed,
        left=fit.left,
    )


@dataclass(frozen=True)
class Ends:
    """Ends of an interval, and the bound from one side: see `EffectSize`."""

    low: float
    high: float
    upper_bound: float


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


def interval(
    draws: "Draws",
    allowed: float,
    *,
    is_found: bool,
    level_found: float,
    level: float,
) -> Ends:
    """Return the sizes for which the T found is not a rare draw.

    The low end is then reduced by `allowed` and the high end raised by `upper_ends`,
    for two reasons: residual smooth terms may add to a difference or hide part of it,
    and the simultaneous contact is a single landing, which may differ from the observed
    mean (`one_landing`).

    Below the size at which a statistic as small as the median under `allowed` becomes
    rare, only large draws count as rare. The interval therefore starts above zero
    exactly if the test, of level `level_found`, finds more than `allowed`, as
    `is_found` says. For the high end and the bound, a statistic below the median
    without kinks is replaced by that median: an estimate smaller than noise alone gives
    is luck, not knowledge.
    """
    low = 0.0
    if is_found:
        of_allowed = float(np.median(draws.statistics(allowed)))
        floor = draws.size_below(of_allowed, level_found / 2.0)
        one_sided = draws.size_below(draws.statistic, 1.0 - level_found)
        two_sided = draws.size_below(draws.statistic, 1.0 - level_found / 2.0)
        found_low = min(one_sided, max(floor, two_sided))
        deviation = model.one_landing(allowed)
        low = max(0.0, found_low - allowed) / (1.0 + deviation)

    typical = max(draws.statistic, float(np.median(draws.statistics(0.0))))
    ends = [draws.size_below(typical, level / 2.0), draws.size_below(typical, level)]
    high, bound = model.upper_ends(ends, allowed)
    return Ends(low, high, bound)


@dataclass(frozen=True)
class SignedErrors:
    """Random errors of the kinks of a fit, (draws, K q) each.

    Both are randomly signed sums of the landings' contributions: for no kinks, and for
    the kinks found. For an assumed size in between, they are mixed in proportion to it.
    """

    null: FloatArray
    full: FloatArray


def signed_errors(
    fits: Sequence[KinkFit], count: int, generator: np.random.Generator, *, alike: bool
) -> list[SignedErrors]:
    """Return random errors of fits to the same landings, with the same random signs.

    Parameters
    ----------
    fits
        Kinks, and steps.
    count
        Number of random sign patterns.
    generator
        Source of the random signs.
    alike
        Whether successive landings err alike; `IN_A_ROW` of them then get one sign.
    """
    both = np.hstack([part for fit in fits for part in (fit.null_scores, fit.scores)])
    if alike:
        both = np.add.reduceat(both, np.arange(0, len(both), IN_A_ROW))
    sums = np.empty((count, both.shape[1]))
    draws_at_once = max(1, SIGNS_AT_ONCE // len(both))
    for first in range(0, count, draws_at_once):
        chunk = sums[first : first + draws_at_once]
        zeros_and_ones = generator.integers(0, 2, size=(len(chunk), len(both)))
        chunk[:] = (2.0 * zeros_and_ones - 1.0) @ both
    widths = [part.shape[1] for fit in fits for part in (fit.null_scores, fit.scores)]
    parts = np.split(sums, np.cumsum(widths)[:-1], axis=1)
    nulls = parts[::2]
    fulls = parts[1::2]
    return [SignedErrors(*pair) for pair in zip(nulls, fulls, strict=True)]


class Draws:
    """Draws of the statistic T for kinks of any size along those found.

    Parameters
    ----------
    fit
        The kinks found.
    root
        (m, K q) root of their squared size: see `squared_size`.
    errors
        Random errors of the kinks.
    alike
        Whether successive landings err alike: see `signed_errors`.
    """

    def __init__(
        self, fit: KinkFit, root: FloatArray, errors: SignedErrors, *, alike: bool
    ) -> None:
        self.found = root @ fit.coefficients.ravel()
        self.statistic = float(self.found @ self.found)
        self.size = float(np.sqrt(self.statistic))
        scores = fit.scores @ root.T
        if alike:
            scores = np.add.reduceat(scores, np.arange(0, len(scores), IN_A_ROW))
        self.of_noise = float(np.sum(scores**2))

        along = self.found / self.size
        self.null_errors = errors.null @ root.T
        full_errors = errors.full @ root.T
        self.along_error = float(np.std(full_errors @ along))
        # T is a polynomial of the size and of the share of the errors that are mixed.
        self._null_null = np.sum(self.null_errors**2, axis=1)
        self._null_full = np.sum(self.null_errors * full_errors, axis=1)
        self._full_full = np.sum(full_errors**2, axis=1)
        self._along_null = self.null_errors @ along
        self._along_full = full_errors @ along

    def statistics(self, true: float) -> FloatArray:
        """Return the draws (draws,) of T for kinks of this size."""
        full = min(1.0, true / self.size)
        null = 1.0 - full
        of_errors = (
            null * null * self._null_null
            + 2.0 * null * full * self._null_full
            + full * full * self._full_full
        )
        along = null * self._along_null + full * self._along_full
        return np.asarray(of_errors + 2.0 * true * along + true * true)

    def p_value(self, true: float) -> float:
        """Return the share of draws, and the data, with a T as large at this size."""
        as_large = int(np.sum(self.statistics(true) >= self.statistic))
        return (1 + as_large) / (1 + len(self._null_null))

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


def _detectable(draws: Draws, allowed: float, level: float, power: float) -> float:
    """Return the size of kinks that the test finds with this power.

    The power is the mean over `DIRECTIONS` in which kinks may lie and over the sizes as
    which they may show: see `SHOWN_SCATTER`. Directions are those of random errors,
    since kinks and errors both are largest in the outcomes that vary most.

    Parameters
    ----------
    draws
        Random errors of the kinks.
    allowed
        Size that is no evidence.
    level, power
        Level of the test, and share of the studies that it is to find.
    """
    from scipy.special import ndtri

    errors = draws.null_errors
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
