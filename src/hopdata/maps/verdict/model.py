"""Fit of the kinks and jumps of a landing map near a simultaneous contact.

They are fitted beside smooth terms. The model is

    y = smooth(x) + sum_k b_k h_k(t(x)) + noise.

The kinks h are the latest contacts of sets of feet (`hopdata.maps.coordinates`); all b
are zero exactly if the map has one derivative. The smooth terms are monomials of the
inputs up to third order, fitted by least squares. With two feet, whose only kink is |d|
with d the time between the contacts, d^4 is added. If there are too few landings for
all third-order terms, the monomials stop at second order. If `allowed` then shows that
the third order matters, third-order terms along the contacts are added, in the two main
directions in which the contacts separate.

Other terms of a C1 map look like kinks; they shrink as the contacts come closer
together. The landings with the largest contact spread are therefore left out, and kinks
up to `allowed` are not evidence.

If impacts do not commute, the outcome itself jumps where two feet exchange their order.
Steps, sign(t_i - t_j), are then fitted like the kinks, and the kinks count as smooth
terms.
"""

from dataclasses import dataclass, replace
from enum import Enum
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import ALL_SETS_UP_TO, affordable_degree, kinks, monomials
from hopdata.maps.verdict.inputs import LEAST_CLASS, WINDOW, SectionLandings, halves
from hopdata.messages import Message

#: Apparent difference that residual smooth terms may cause in any C1 landing.
#: Unit: share of the map. Origin: measured: a C1 hopper without noise has kinks of up
#: to 0.08 (decisions.md, "A tenth of the map is allowed for").
LEFT = 0.1

#: The same where contacts lie far apart: this times c^1.5. Here c is the relative
#: change of the derivative by third-order terms along the contacts. It grows as the
#: square of the contacts' spread, while the change by the fourth order grows as the
#: cube, hence as c^1.5.
#: Unit: 1. Origin: measured: of 1.5 c, 2 c and 4 c^1.5 the last covers C1 hoppers of
#: other shapes (decisions.md, "Where contacts lie far apart").
OF_FOURTH = 4.0

#: Apparent jump that residual smooth terms may cause.
#: Unit: share of the outcome's sd. Origin: measured: in other bodies smooth terms leave
#: about as much (verdict.md).
LEFT_OF_JUMPS = 0.05

#: The same where contacts lie far apart, as a share of `KinkFit.allowed`.
#: Unit: 1. Origin: measured: as for `LEFT_OF_JUMPS`.
OF_ALLOWED = 0.1

#: Part of a true difference that smooth terms may hide, as a share of `allowed`.
#: Unit: 1. Origin: chosen.
HIDDEN = 0.5

#: Largest deviation of one landing's derivative from the mean, in rms deviations of all
#: landings.
#: Unit: 1. Origin: chosen.
ONE_LANDING = 2.0

#: How much more the mean of many studies may have left if third-order terms were not
#: fitted, as a multiple of `allowed`.
#: Unit: 1. Origin: chosen.
WITHOUT_THIRD = 1.5

#: Singular values and scatters at or below this share of the largest are rounding.
#: Unit: 1. Origin: rounding.
FLAT = 1e-9

#: Number of following landings with which each is compared, to find whether they err
#: alike.
#: Unit: landings. Origin: chosen.
NEXT = 5

#: Standard errors by which successive landings resemble each other by chance.
#: Unit: 1. Origin: convention: three standard errors.
BY_CHANCE = 3.0

#: Main directions in which contacts separate.
#: Unit: 1. Origin: derived: tilt has two.
WAYS = 2

#: Kinks are invisible if less than this fraction of them remains beside the smooth
#: terms.
#: Unit: 1. Origin: chosen.
LEAST_KINK = 1e-3

#: The same relative to the most visible kink, for kinks of pairs of feet only and for
#: steps.
#: Unit: 1. Origin: chosen.
LEAST_OF_PAIRS = 0.25

#: Least slack of a landing (one minus its leverage) by which a residual is divided.
#: Unit: 1. Origin: chosen.
LEAST_SLACK = 0.1


class Third(Enum):
    """The third-order terms of the smooth part."""

    NONE = "none"
    ALONG = "along the contacts"
    ALL = "of all inputs"


@dataclass(frozen=True)
class KinkFit:
    """Kinks, or steps, of a study with K kinks, q outputs and N landings.

    Attributes
    ----------
    coefficients
        (K, q) coefficients of the combinations `seen` of the kinks.
    linear
        (p, q) derivative of the outputs with respect to the inputs, without the kinks.
    scores, null_scores
        (N, K q) contributions of the landings to the error of the coefficients, row by
        row: after the kinks found have been subtracted from the outputs, and under the
        assumption of no kinks.
    seen
        (all kinks, K) orthonormal combinations of the kinks that are distinct from
        smooth terms.
    rows
        (n,) numbers of the landings in the window.
    allowed
        Size up to which kinks are not evidence in one study: see `LEFT`.
    left
        The same for the mean of such studies; 1.5 times `allowed` without third-order
        terms.
    jumps
        Steps of the outcome beside the kinks; None if no steps can be fitted.
    """

    coefficients: FloatArray
    linear: FloatArray
    scores: FloatArray
    null_scores: FloatArray
    seen: FloatArray
    rows: IntArray
    allowed: float
    left: float
    jumps: "KinkFit | None" = None


def fit_kinks(landings: SectionLandings) -> KinkFit:
    """Fit the kinks to the landings of the window.

    Raises
    ------
    AnalysisError
        If there are no landings in which two feet exchange their order.
    """
    n_inputs = landings.inputs.shape[1]
    n_feet = landings.expected.shape[1]
    rows = _window(landings.expected)
    affords_third = affordable_degree(len(rows), n_inputs, n_feet) >= 3
    third = Third.ALL if affords_third else Third.NONE
    window = _Smooth(landings, rows, third)
    seen = window.seen_kinks()
    allowed = max(LEFT, OF_FOURTH * window.change_by_third(seen) ** 1.5)
    if third is Third.NONE and allowed > LEFT:
        third = Third.ALONG
        window = _Smooth(landings, rows, third)
        seen = window.seen_kinks()
    if not seen.size:
        missing = Message("maps.feet_exchange")
        raise AnalysisError(Message("maps.no_two_feet", {"what_is_missing": missing}))

    left = allowed
    if third is Third.NONE:
        left = WITHOUT_THIRD * allowed
    coefficients, scores, null_scores = window.fit(seen)
    linear = window.linear(seen @ coefficients)
    kinks = KinkFit(
        coefficients, linear, scores, null_scores, seen, rows, allowed, left
    )

    window.look_for_steps(seen)
    steps = window.seen_kinks(least=LEAST_OF_PAIRS)
    if not steps.size:
        return kinks
    sizes, scores, null_scores = window.fit(steps)
    of_jumps = max(LEFT_OF_JUMPS, OF_ALLOWED * allowed)
    jumps = KinkFit(sizes, linear, scores, null_scores, steps, rows, of_jumps, of_jumps)
    return replace(kinks, jumps=jumps)


def _window(instants: FloatArray) -> IntArray:
    """Return the numbers of the landings with the least contact spread, increasing."""
    by_spread = np.argsort(instants.std(axis=1), kind="stable")
    nearest = by_spread[: round(WINDOW * len(instants))]
    return np.sort(nearest)


class _Smooth:
    """Smooth terms for a set of landings, and what they leave of kinks and outputs."""

    def __init__(self, landings: SectionLandings, rows: IntArray, third: Third) -> None:
        self.landings = landings
        self.rows = rows
        instants = landings.expected[rows]
        self.outputs = landings.outputs[rows]
        self.kinks = kinks(instants)
        self.inputs = _whitened(landings.inputs[rows])
        self.along = monomials(_whitened(instants)[:, :WAYS], (3,))
        ones = np.ones(len(rows))
        self.lower = np.column_stack([ones, monomials(self.inputs, (1, 2))])

        terms = [self.lower]
        if third is Third.ALONG:
            terms.append(self.along)
        if third is Third.ALL:
            terms.append(monomials(self.inputs, (3,)))
        if instants.shape[1] == 2:
            # Of two feet, d^4 looks most like their only kink, |d|.
            terms.append(instants[:, :1] ** 4)
        self.basis, self.root = np.linalg.qr(np.column_stack(terms))

        self.rest = self._without(self.outputs)
        scatter = np.abs(np.diag(np.linalg.qr(self.rest, mode="r")))
        largest = np.abs(self.outputs - self.outputs.mean(axis=0)).max()
        if not scatter.min() > FLAT * largest:
            raise AnalysisError(Message("maps.outcome_constant"))

    def _without(self, columns: FloatArray) -> FloatArray:
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def look_for_steps(self, seen: FloatArray) -> None:
        """Count the `seen` kinks among the smooth terms, and look for steps instead."""
        found = self._without(self.kinks) @ seen
        self.basis, _ = np.linalg.qr(np.column_stack([self.basis, found]))
        self.rest = self._without(self.outputs)

        instants = self.landings.expected[self.rows].T
        steps = []
        for i, j in pairs_that_exchange(instants.T):
            steps.append(np.sign(instants[i] - instants[j]))
        if not steps:
            steps = [np.zeros(len(self.rows))]
        self.kinks = np.column_stack(steps)

    def seen_kinks(self, least: float = 0.0) -> FloatArray:
        """Return the combinations of kinks, (all, K), that smooth terms do not explain.

        The remainder of each beside the smooth terms is more than `least` times the
        largest one.

        If a rigid body has many feet, its tilt alone determines their order, and the
        kinks of parallel pairs of feet are nearly equal: of 15 pairs of six feet, 6 can
        be distinguished. The remainders of the others are noise, with which the test
        would have no power.
        """
        rest = self._without(self.kinks)
        _, singular, right = np.linalg.svd(rest, full_matrices=False)
        if self.landings.expected.shape[1] > ALL_SETS_UP_TO:
            least = LEAST_OF_PAIRS
        visible = LEAST_KINK * np.linalg.norm(self.kinks, 2)
        limit = max(visible, least * singular[0])
        return np.asarray(right[singular > limit].T)

    def fit(self, seen: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the kinks (K, q), scores and null scores (N, K q) of all landings."""
        bends = self._without(self.kinks) @ seen
        influence = np.asarray(np.linalg.solve(bends.T @ bends, bends.T), float)
        found = influence @ self.rest
        slack = 1.0 - np.sum(self.basis**2, axis=1)
        slack_with_kinks = slack - np.einsum("nk,kn->n", bends, influence)
        residuals = self.rest - bends @ found
        scores = self._scores(influence, residuals, slack_with_kinks)
        null_scores = self._scores(influence, self.rest, slack)
        return found, scores, null_scores

    def change_by_third(self, seen: FloatArray) -> float:
        """Return c, by how much third-order terms change the derivative.

        The terms are those along the contacts. It is the rms over the landings,
        relative to the derivative and without the
        contribution of noise.
        """
        design = np.column_stack([self.lower, self.kinks @ seen, self.along])
        basis, root = np.linalg.qr(design)
        to_coefficients = np.linalg.inv(root)[-self.along.shape[1] :]
        coefficients = to_coefficients @ basis.T @ self.outputs

        residuals = self.outputs - basis @ (basis.T @ self.outputs)
        noise = np.sum(residuals**2, axis=0) / (len(basis) - basis.shape[1])
        variances = np.sum(to_coefficients**2, axis=1)[:, None] * noise

        # For normal u and v the derivative of u^3, less its mean, has mean square 18;
        # of u^2 v, 6. The first and the last term are the cubes of u and of v.
        mean_squares = np.full(len(coefficients), 6.0)
        mean_squares[0] = 18.0
        mean_squares[-1] = 18.0
        changes = mean_squares @ (coefficients**2 - variances)
        relative = changes @ halves(np.var(self.outputs, axis=0))
        return float(np.sqrt(max(0.0, relative)))

    def _scores(
        self, influence: FloatArray, residuals: FloatArray, slack: FloatArray
    ) -> FloatArray:
        """Return each landing's contribution to the error of the kinks, (N, K q)."""
        errors = residuals / np.sqrt(np.maximum(slack, LEAST_SLACK))[:, None]
        contributions = influence.T[:, :, None] * errors[:, None, :]
        scores = np.zeros((len(self.landings.inputs), contributions[0].size))
        scores[self.rows] = contributions.reshape(len(errors), -1)
        return scores

    def linear(self, coefficients: FloatArray) -> FloatArray:
        """Return the derivative (p, q) of the outputs without these kinks."""
        smooth = self.outputs - self.kinks @ coefficients
        terms = np.linalg.solve(self.root, self.basis.T @ smooth)
        by_whitened = terms[1 : self.inputs.shape[1] + 1]  # after the constant
        inputs = self.landings.inputs[self.rows]
        centred = inputs - inputs.mean(axis=0)
        whitening = np.linalg.lstsq(centred, self.inputs, rcond=None)[0]
        return np.asarray(whitening @ by_whitened)


def pairs_that_exchange(instants: FloatArray) -> list[tuple[int, int]]:
    """Return the pairs of feet of which each comes first in `LEAST_CLASS` landings."""
    pairs = []
    for i, j in combinations(range(instants.shape[1]), 2):
        step = np.sign(instants[:, i] - instants[:, j])
        # Twice the number of landings in the rarer of the two orders.
        twice_rarer = len(step) - np.abs(step.sum())
        if twice_rarer >= 2 * LEAST_CLASS:
            pairs.append((i, j))
    return pairs


def err_alike(scores: FloatArray) -> bool:
    """Return whether scores (N, m) resemble the next few more than by chance.

    Random signs give a resemblance of up to three standard errors by chance.
    """
    products = [np.sum(scores[k:] * scores[:-k], axis=1) for k in range(1, NEXT + 1)]
    resemblance = np.concatenate(products)
    by_chance = BY_CHANCE * np.linalg.norm(resemblance)
    return bool(resemblance.sum() > by_chance)


def one_landing(allowed: float) -> float:
    """Return the relative deviation of a difference at one landing from the mean.

    Like the derivative itself, the difference changes over the landings by the share c
    (see `LEFT`).
    """
    change = (allowed / OF_FOURTH) ** (2 / 3)
    return float(ONE_LANDING * change)


def upper_ends(sizes: list[float], allowed: float) -> list[float]:
    """Return upper ends for differences that appear as these `sizes`.

    At the simultaneous contact they are larger, because smooth terms may hide part of a
    difference, and because that contact is a single landing, which may deviate from the
    mean.
    """
    hidden = HIDDEN * allowed
    deviation = one_landing(allowed)
    return [size + float(np.hypot(hidden, deviation * size)) for size in sizes]


def symmetric_root(covariance: FloatArray) -> FloatArray:
    """Return the symmetric root (m, m) of a covariance that may be singular.

    This root is unique, whereas rounding decides the signs and rotations of
    eigenvectors. With it the same seed gives the same draws on every machine, up to the
    square root of rounding errors.
    """
    eigenvalues, vectors = np.linalg.eigh(covariance)
    is_rounding = eigenvalues <= FLAT**1.5 * eigenvalues[-1]
    kept = np.where(is_rounding, 0.0, eigenvalues)
    return np.asarray(vectors * np.sqrt(kept) @ vectors.T)


def _whitened(x: FloatArray) -> FloatArray:
    """Return all uncorrelated combinations of the columns, of mean square one."""
    left, singular, _ = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)
    varies = singular > FLAT * singular[0]
    return np.asarray(left[:, varies] * np.sqrt(len(x)))
