"""Kinks that saturate: differences between orders that are soon spent.

A kink grows with the time between contacts, and so does what it does to the outcome. It
saturates if its cause is spent after a while, such as friction under a foot that stands
alone: it acts only until the foot has stopped. Over the landings such a kink looks
smaller than at the simultaneous contact.

So each phase between contacts, "foot i stands alone" and "all but foot i stand", gets a
term that saturates, tau tanh(d / tau) of its duration d, beside the kinks. Random
signs decide whether these terms are needed. If so, kinks and terms together have the
slope at the simultaneous contact.

Jumps, and kinks too faint to be fitted, look like saturation of the kinks that are
fitted. Both stand beside these terms, so that they are not taken for it.

What saturates looks like a jump, too: an effect that a foot has only while it is late
is half a kink and half a bend, tau tanh(d / tau), whose ends are as far apart as those
of a step. Where kinks saturate, a jump therefore has to stand beside such bends
(`mean_bends`).

A kink that is spent much faster than the contacts lie apart looks like nothing. `lasts`
says from which time constant on a bound over the landings is one at the simultaneous
contact, too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import ALL_SETS_UP_TO, Feet, foot_sets, kinks
from hopdata.maps.verdict.averaged import NOTHING
from hopdata.maps.verdict.linear import symmetric_root
from hopdata.maps.verdict.smooth import Fit, Shapes, Smooth, fit_beside

#: Time constants of the terms that saturate.
#: Unit: contact spreads. Origin: chosen: slower ones differ little from kinks over the
#: landings, faster ones from nothing at all.
TIME_CONSTANTS = (1.0, 0.5, 0.25)

#: Kinks saturate if the random signs show as much saturation with less than this
#: probability.
#: Unit: 1. Origin: chosen: false findings cost a C1 study its bound, so at most one in
#: a hundred.
LEVEL = 0.01

#: A time constant is in doubt if it fits nearly as well as the best one: twice the
#: log-likelihood of normal residuals is less by at most this.
#: Unit: 1. Origin: table: 95 % quantile of chi-squared with one degree of freedom.
NEARLY = 3.84

#: Saturating terms that remain beside kinks and smooth terms with less than this share
#: of the most visible one are left out.
#: Unit: 1. Origin: chosen.
LEAST_TERM = 0.01

#: Slowest time constant that `lasts` considers.
#: Unit: contact spreads. Origin: chosen: far beyond all landings.
SLOWEST = 100.0

#: Fastest time constant that `lasts` considers.
#: Unit: contact spreads. Origin: chosen: far within.
FASTEST = 0.01

# Time constants between these for which `lasts` computes the share that is shown.
CONSIDERED = 24

# Normal nodes over which the terms are averaged.
NODES = 32


@dataclass(frozen=True)
class AtContact:
    """Kinks at the simultaneous contact, if they saturate with one time constant.

    Attributes
    ----------
    time_constant
        In contact spreads.
    slopes
        Coefficients of the kinks at the simultaneous contact, and their errors.
    beyond
        The terms that saturate, fitted beside the kinks.
    misfit
        Minus twice the log-likelihood of normal residuals, but for a constant.
    """

    time_constant: float
    slopes: Fit
    beyond: Fit
    misfit: float


def durations(instants: FloatArray) -> FloatArray:
    """Return the durations (n, D) of the phases between contacts, zero if not passed.

    Up to three feet they are, for each foot, that during which it stands alone, and
    that during which all others stand and it does not. For more feet they are the times
    between the contacts of each pair.
    """
    n_feet = instants.shape[1]
    if n_feet > ALL_SETS_UP_TO:
        pairs = combinations(instants.T, 2)
        return np.column_stack([np.abs(a - b) for a, b in pairs])
    alone = []
    last = []
    for foot in range(n_feet):
        others = np.delete(instants, foot, axis=1)
        own = instants[:, foot]
        alone.append(np.maximum(0.0, others.min(axis=1) - own))
        last.append(np.maximum(0.0, own - others.max(axis=1)))
    if n_feet == 2:
        return np.column_stack(alone)  # of two feet, one is alone or the other is last
    return np.column_stack(alone + last)


def kinks_of_durations(n_feet: int) -> FloatArray:
    """Return the kinks (D, K) that each duration is, but for terms linear in time."""
    sets = foot_sets(n_feet)

    def latest(feet: Feet) -> FloatArray:
        """Return which kink is the latest contact of these feet; none of one foot."""
        return np.array([float(feet == other) for other in sets])

    def first(feet: Feet) -> FloatArray:
        """Return the kinks of the first contact: latest ones by inclusion-exclusion."""
        total = np.zeros(len(sets))
        for size in range(2, len(feet) + 1):
            for some in combinations(feet, size):
                total -= (-1.0) ** size * latest(some)
        return total

    if n_feet > ALL_SETS_UP_TO:
        return 2.0 * np.eye(len(sets))
    everyone = tuple(range(n_feet))
    alone = []
    last = []
    for foot in everyone:
        others = tuple(other for other in everyone if other != foot)
        alone.append(first(others) - first(everyone))
        last.append(latest(everyone) - latest(others))
    if n_feet == 2:
        return np.array(alone)
    return np.array(alone + last)


def saturated(duration: FloatArray, time_constant: float) -> FloatArray:
    """Return what a kink makes of durations: as long at first, then constant."""
    return np.asarray(time_constant * np.tanh(duration / time_constant))


def differences(instants: FloatArray) -> FloatArray:
    """Return how much later the first foot of each pair touches, (n, pairs)."""
    pairs = combinations(instants.T, 2)
    return np.column_stack([a - b for a, b in pairs])


def mean_saturated(
    instants: FloatArray,
    rest: FloatArray,
    times: Callable[[FloatArray], FloatArray] = durations,
) -> list[FloatArray]:
    """Return the saturated durations (n, D) for each of `TIME_CONSTANTS`.

    They are averaged over what is not foretold of the contact instants.

    Parameters
    ----------
    instants
        (n, feet) expected contact instants, in contact spreads.
    rest
        (feet, feet) covariance of what is not foretold of them.
    times
        Function of the instants that returns what saturates.
    """
    moved = moved_instants(instants, rest)
    lengths = times(moved.reshape(-1, len(rest)))
    means = []
    for time_constant in TIME_CONSTANTS:
        terms = saturated(lengths, time_constant)
        means.append(terms.reshape(*moved.shape[:2], -1).mean(axis=1))
    return means


def beside_bends(
    smooth: Smooth, steps: FloatArray, instants: FloatArray, rest: FloatArray
) -> tuple[Fit, ...]:
    """Return steps (n, K) fitted beside bends of each of `TIME_CONSTANTS`.

    The likeliest comes first. A bend is the saturated difference of the instants of two
    feet: it is smooth where they exchange their order, and constant where they are far
    apart.

    Parameters
    ----------
    smooth
        Smooth terms, with the kinks among them.
    steps
        Steps as the outcomes show them.
    instants, rest
        As for `mean_saturated`.
    """
    fits = []
    misfits = []
    for columns in mean_saturated(instants, rest, differences):
        distinct = Shapes(columns, columns).visible(smooth, LEAST_TERM)
        with_bends = smooth.and_also(columns @ distinct)
        fit = fit_beside(with_bends, steps)
        explained = with_bends.without(steps) @ fit.coefficients
        misfits.append(misfit(with_bends.without(smooth.outputs) - explained))
        fits.append(fit)
    return tuple(fits[k] for k in np.argsort(misfits, kind="stable"))


def moved_instants(instants: FloatArray, rest: FloatArray) -> FloatArray:
    """Return instants (n, nodes, feet) moved by what is not foretold of them.

    There is one node, which moves nothing, if all is foretold.
    """
    moves = np.zeros((1, len(rest)))
    if np.trace(rest) > NOTHING**2 * np.mean(instants**2):
        moves = _normal_nodes(len(rest)) @ symmetric_root(rest)
    return np.asarray(instants[:, None, :] + moves)


def _normal_nodes(dimensions: int) -> FloatArray:
    """Return nodes (`NODES`, dimensions) that stand for a normal distribution."""
    from scipy.special import ndtri
    from scipy.stats.qmc import Sobol

    uniform = Sobol(dimensions, scramble=False).random(NODES)
    nodes = ndtri(uniform + 0.5 / NODES)
    nodes -= nodes.mean(axis=0)
    return np.asarray(nodes / nodes.std(axis=0))


def at_contact(
    smooth: Smooth,
    shown: FloatArray,
    seen: FloatArray,
    instants: FloatArray,
    rest: FloatArray,
) -> tuple[AtContact, ...]:
    """Return the kinks at the simultaneous contact for each time constant.

    Parameters
    ----------
    smooth
        Smooth terms of n landings.
    shown
        (n, K) kinks as the outcomes show them.
    seen
        (all kinks, K) which combinations of the kinks these are.
    instants, rest
        As for `mean_saturated`.
    """
    # Terms that saturate look much like cubes along the contacts, so these are free.
    smooth = smooth.and_also(smooth.along)
    n_outputs = smooth.outputs.shape[1]
    n_kinks = shown.shape[1]
    beside_kinks = smooth.and_also(shown)
    kinks_of_terms = kinks_of_durations(instants.shape[1])
    found = []
    averaged = mean_saturated(instants, rest)
    for time_constant, columns in zip(TIME_CONSTANTS, averaged, strict=True):
        distinct = Shapes(columns, columns).visible(beside_kinks, LEAST_TERM)
        terms = columns @ distinct
        both = fit_beside(smooth, np.column_stack([shown, terms]))
        to_slopes = np.hstack([np.eye(n_kinks), seen.T @ kinks_of_terms.T @ distinct])
        of_scores = np.kron(to_slopes, np.eye(n_outputs)).T
        slopes = Fit(
            coefficients=to_slopes @ both.coefficients,
            scores=both.scores @ of_scores,
            null_scores=both.null_scores @ of_scores,
        )
        beyond = fit_beside(beside_kinks, terms)
        explained = beside_kinks.without(terms) @ beyond.coefficients
        residuals = beside_kinks.without(smooth.outputs) - explained
        found.append(AtContact(time_constant, slopes, beyond, misfit(residuals)))
    return tuple(found)


def misfit(residuals: FloatArray) -> float:
    """Return minus twice the log-likelihood of residuals (n, q), but for a constant."""
    _, log_determinant = np.linalg.slogdet(residuals.T @ residuals)
    return float(len(residuals) * log_determinant)


def saturation(
    fits: Sequence[AtContact], *, flips: int, in_a_row: int, rng: np.random.Generator
) -> tuple[float, AtContact]:
    """Return the p-value of kinks that do not saturate, and the likely fit.

    The statistic of a time constant is the squared length of its terms in units of
    their errors; the test takes the largest of all. The likely fit is the slowest of
    those that are nearly as likely as the best.

    Parameters
    ----------
    fits
        From `at_contact`, slow ones first.
    flips, rng
        Number of random sign patterns, and their source.
    in_a_row
        Number of successive landings with the same sign.
    """
    statistics = []
    blocks = []
    for fit in fits:
        scores = fit.beyond.null_scores
        # Random signs do not change this covariance.
        whitening = np.linalg.pinv(symmetric_root(scores.T @ scores))
        statistics.append(np.sum((whitening @ fit.beyond.coefficients.ravel()) ** 2))
        first = np.arange(0, len(scores), in_a_row)
        blocks.append(np.add.reduceat(scores @ whitening, first))
    signs = 2.0 * rng.integers(0, 2, size=(flips, len(blocks[0]))) - 1.0
    draws = [np.sum((signs @ block) ** 2, axis=1) for block in blocks]
    best = max(statistics)
    as_large = int(np.sum(np.max(draws, axis=0) >= best))
    least = min(fit.misfit for fit in fits)
    likely = next(fit for fit in fits if fit.misfit <= least + NEARLY)
    return (1 + as_large) / (1 + flips), likely


def share_shown(
    smooth: Smooth, seen: FloatArray, instants: FloatArray, time_constant: float
) -> float:
    """Return the share of kinks at the contact that shows over the landings.

    It is the rms over the kinks of the slope that least squares gives for kinks that
    saturate with this time constant, relative to their slope at the contact.
    """
    bends = smooth.without(kinks(instants) @ seen)
    of_kinks = np.linalg.pinv(kinks_of_durations(instants.shape[1]).T) @ seen
    columns = smooth.without(saturated(durations(instants), time_constant) @ of_kinks)
    gram = bends.T @ bends
    root = symmetric_root(gram)
    slopes = np.linalg.solve(gram, bends.T @ columns)
    relative = root @ slopes @ np.linalg.inv(root)
    return float(np.linalg.norm(relative) / np.sqrt(len(relative)))


@dataclass(frozen=True)
class Lasting:
    """What shows over the landings of kinks that saturate.

    Attributes
    ----------
    time_constants
        In contact spreads, slow ones first.
    shares
        Of the slope at the contact that shows, decreasing.
    """

    time_constants: FloatArray
    shares: FloatArray

    def least_time_constant(self, share: float) -> float | None:
        """Return the least time constant of which at least this share shows.

        No time constant has a share of 1 or more, so there may be none.
        """
        constants = self.time_constants
        enough = self.shares >= share
        if not enough[0]:
            return None
        last = int(np.argmin(enough)) - 1
        if enough.all():
            return float(constants[-1])
        around = [last + 1, last]
        between = np.interp(share, self.shares[around], np.log(constants[around]))
        return float(np.exp(between))


def lasts(smooth: Smooth, seen: FloatArray, instants: FloatArray) -> Lasting:
    """Return which share of kinks shows over the landings, by their time constant."""
    constants = np.geomspace(SLOWEST, FASTEST, CONSIDERED)
    shares = [share_shown(smooth, seen, instants, tau) for tau in constants]
    return Lasting(constants, np.minimum.accumulate(shares))
