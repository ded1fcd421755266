"""The smooth terms of a landing map, and what they leave of kinks and outcomes.

They are monomials of the inputs: the first order in all, the second in the state and
the heights of the feet, and the third in the eight inputs that matter most. The eight
are the directions in which contacts separate, and what the state of the body says
beside them. The third order is shrunk as far as the landings ask for (`shrunk`). Terms
of the session join where they help.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, permutations
from math import comb

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import LANDINGS_PER_TERM, monomials
from hopdata.maps.verdict.inputs import STATE, SectionLandings, halves
from hopdata.maps.verdict.linear import FLAT, beside, whitened
from hopdata.maps.verdict.session import session_terms
from hopdata.maps.verdict.shrunk import Whitening, whitening
from hopdata.messages import Message

#: Main directions in which contacts separate.
#: Unit: 1. Origin: derived: tilt has two.
WAYS = 2

#: Directions in which contacts separate whose cubes count if legs have a posture.
#: Unit: 1. Origin: derived: three legs that move on their own have two, four have
#: three; the cubes of more would be too many terms.
WAYS_OF_POSTURE = 3

#: Kinks are invisible if less than this fraction of them remains beside the smooth
#: terms.
#: Unit: 1. Origin: chosen.
LEAST_KINK = 1e-3

#: Least slack of a landing (one minus its leverage) by which a residual is divided.
#: Unit: 1. Origin: chosen.
LEAST_SLACK = 0.1


@dataclass(frozen=True)
class Curvature:
    """How strongly a map bends over the landings.

    Attributes
    ----------
    share
        Of the variance of the outcomes, what terms of first and second order leave and
        those of third order explain.
    error
        Standard error of `share` that noise alone would give, if all outcomes err
        alike.
    by_mean_slope
        By what factor sizes would be larger as shares of the mean slope over the
        landings, which is the slope without terms of third order.
    """

    share: float
    error: float
    by_mean_slope: float


@dataclass(frozen=True)
class Smooth:
    """Smooth terms for n landings of a study, with p inputs and q outcomes.

    Attributes
    ----------
    raw
        (n, p) inputs as they are.
    inputs
        (n, p) uncorrelated combinations of them.
    outputs
        (n, q) outcomes.
    lower
        (n, terms) terms of first and second order, and of the session.
    along
        (n, 4) third-order terms along the contacts.
    whitening
        What the shrunk terms of third order do to the rows of all others.
    basis, root
        QR decomposition of all other terms, so whitened.
    session
        What the terms of the session depend on: see `session.SessionTerms`.
    """

    raw: FloatArray
    inputs: FloatArray
    outputs: FloatArray
    lower: FloatArray
    along: FloatArray
    whitening: Whitening
    basis: FloatArray
    root: FloatArray
    session: tuple[str, ...]

    def without(self, columns: FloatArray) -> FloatArray:
        """Return what the smooth terms leave of the columns (n, m), whitened."""
        white = self.whitening.of(columns)
        return np.asarray(white - self.basis @ (self.basis.T @ white))

    def and_also(self, columns: FloatArray) -> Smooth:
        """Return the smooth terms with further columns (n, m) among them."""
        rest = self.without(columns)
        basis, _ = np.linalg.qr(np.column_stack([self.basis, rest]))
        return replace(self, basis=basis)

    def linear(self, kinks: FloatArray) -> FloatArray:
        """Return the derivative (p, q) of the outputs by the raw inputs.

        `kinks` (n, q) is the part of the outputs that is not smooth.
        """
        white = self.whitening.of(self.outputs - kinks)
        terms = np.linalg.solve(self.root, self.basis.T @ white)
        by_whitened = terms[1 : self.inputs.shape[1] + 1]  # after the constant
        centred = self.raw - self.raw.mean(axis=0)
        whitening = np.linalg.lstsq(centred, self.inputs, rcond=None)[0]
        return np.asarray(whitening @ by_whitened)

    def curvature(self, kinks: FloatArray, linear: FloatArray) -> Curvature:
        """Return how strongly the map bends over the landings.

        Parameters
        ----------
        kinks
            (n, q) part of the outputs that is not smooth.
        linear
            (p, q) derivative of the outputs by the raw inputs, beside `kinks`: see
            `linear`.
        """
        smooth = self.outputs - kinks
        coefficients = np.linalg.lstsq(self.lower, smooth, rcond=None)[0]
        freedom = len(smooth) - self.lower.shape[1]
        left = np.sum((smooth - self.lower @ coefficients) ** 2, axis=0) / freedom
        noise = np.sum(self.without(smooth) ** 2, axis=0) / freedom
        of_outputs = halves(np.var(self.outputs, axis=0))

        mean_slope = coefficients[1 : self.inputs.shape[1] + 1]
        by_mean_slope = np.mean((self.inputs @ mean_slope) ** 2, axis=0)
        centred = self.raw - self.raw.mean(axis=0)
        by_linear = np.mean((centred @ linear) ** 2, axis=0)
        larger = by_linear @ halves(by_mean_slope)
        return Curvature(
            share=float((left - noise) @ of_outputs),
            error=float(np.sqrt(2.0 / freedom) * noise @ of_outputs),
            by_mean_slope=float(np.sqrt(larger)),
        )

    def change_by_third(self, shapes: FloatArray) -> Change:
        """Return by how much third-order terms change the derivative.

        The terms are those along the contacts. `shapes` (n, K), kinks and steps, are
        fitted, too: a step looks much like a cube.
        """
        design = np.column_stack([self.lower, shapes, self.along])
        basis, root = np.linalg.qr(design)
        n_along = self.along.shape[1]
        # The last block of the inverse of a triangle; steps may be alike.
        to_coefficients = np.linalg.inv(root[-n_along:, -n_along:])
        coefficients = to_coefficients @ basis[:, -n_along:].T @ self.outputs

        residuals = self.outputs - basis @ (basis.T @ self.outputs)
        scatter = residuals.T @ residuals / (len(basis) - basis.shape[1])
        noise = np.diag(scatter)
        variances = np.sum(to_coefficients**2, axis=1)[:, None] * noise

        # For normal u and v the derivative of u^3, less its mean, has mean square 18;
        # of u^2 v, 6. The first and the last term are the cubes of u and of v.
        mean_squares = np.full(len(coefficients), 6.0)
        mean_squares[0] = 18.0
        mean_squares[-1] = 18.0
        changes = mean_squares @ (coefficients**2 - variances)
        of_outputs = halves(np.var(self.outputs, axis=0))
        relative = float(changes @ of_outputs)

        # A quadratic form of normal coefficients whose covariance is a product.
        of_terms = mean_squares[:, None] * (to_coefficients @ to_coefficients.T)
        of_noise = scatter * of_outputs
        variance = 2.0 * np.trace(of_terms @ of_terms) * np.trace(of_noise @ of_noise)
        return Change(squared=relative, error=float(np.sqrt(variance)))


@dataclass(frozen=True)
class Change:
    """By how much third-order terms along the contacts change the derivative.

    Attributes
    ----------
    squared
        Mean square over the landings, relative to the derivative and without the
        contribution of noise, which may leave less than zero.
    error
        Its standard error if there are no such terms.
    """

    squared: float
    error: float

    @property
    def size(self) -> float:
        """Return c, the rms over the landings."""
        return float(np.sqrt(max(0.0, self.squared)))


def affords_third(landings: SectionLandings, n_rows: int) -> bool:
    """Return whether this many landings allow all third-order terms."""
    n_inputs = landings.inputs.shape[1]
    n_bent = landings.n_bent
    n_third = comb(STATE + 2, 3)
    second = comb(n_bent + 2, 2) + n_inputs - n_bent
    terms = second + n_third + _of_pairs(landings)
    return n_rows >= LANDINGS_PER_TERM * terms


def _of_pairs(landings: SectionLandings) -> int:
    """Return the number of kinks and steps for which landings are kept back."""
    n_feet = landings.expected.shape[1]
    return n_feet * (n_feet - 1)


def smooth_terms(
    landings: SectionLandings, rows: IntArray, shapes: FloatArray
) -> Smooth:
    """Return the smooth terms for the given landings of a study.

    `shapes` (n, K) are the kinks and steps, which the third order leaves alone.

    Raises
    ------
    AnalysisError
        If an outcome is constant, or has no noise at all.
    """
    instants = landings.expected[rows]
    outputs = landings.outputs[rows]
    raw = landings.inputs[rows]
    contacts = whitened(instants)
    bent = whitened(raw[:, : landings.n_bent])
    inputs = bent
    if landings.n_bent < raw.shape[1]:
        inputs = np.column_stack([bent, beside(bent, raw[:, landings.n_bent :])])
    n_ways = WAYS
    if landings.n_bent > STATE:
        n_ways = WAYS_OF_POSTURE
    core = _core(whitened(raw[:, :STATE]), contacts[:, :n_ways])
    if landings.n_bent > STATE:
        terms = comb(landings.n_bent + 2, 2) + _of_pairs(landings)
        if len(rows) < LANDINGS_PER_TERM * terms:
            bent = core
    along = monomials(contacts[:, :WAYS], (3,))
    second = monomials(bent, (2,))
    lower = np.column_stack([np.ones(len(rows)), inputs, second])
    weighted = outputs * np.sqrt(halves(np.var(outputs, axis=0)))
    states = whitened(raw[:, :STATE])
    session = session_terms(landings.session.rows(rows), lower, weighted, states=states)
    lower = np.column_stack([lower, session.columns])
    fixed = lower
    if instants.shape[1] == 2:
        # Of two feet, d^4 looks most like their only kink, |d|.
        fixed = np.column_stack([lower, instants[:, :1] ** 4])

    _require_scatter(fixed, outputs)
    third = monomials(core, (3,)) * np.sqrt(_multiplicities(core.shape[1]))
    kinds = _factors_among_first(core.shape[1], min(WAYS, contacts.shape[1]))
    unshrunk = np.column_stack([fixed, shapes])
    white = whitening(third, kinds, unshrunk, outputs)
    basis, root = np.linalg.qr(white.of(fixed))
    return Smooth(raw, inputs, outputs, lower, along, white, basis, root, session.used)


def _require_scatter(terms: FloatArray, outputs: FloatArray) -> None:
    """Raise an `AnalysisError` if the terms explain an outcome but for rounding."""
    basis, _ = np.linalg.qr(terms)
    rest = outputs - basis @ (basis.T @ outputs)
    scatter = np.abs(np.diag(np.linalg.qr(rest, mode="r")))
    largest = np.abs(outputs - outputs.mean(axis=0)).max()
    if not scatter.min() > FLAT * largest:
        raise AnalysisError(Message("maps.outcome_constant"))


def _multiplicities(n_inputs: int) -> FloatArray:
    """Return how often each third-order monomial occurs in (u1 + u2 + ...)^3.

    Terms times the root of it, with random coefficients of one variance, are the same
    function of the inputs however these are turned.
    """
    factors = combinations_with_replacement(range(n_inputs), 3)
    times = []
    for three in factors:
        different = set(permutations(three))
        times.append(len(different))
    return np.array(times, float)


def _factors_among_first(n_inputs: int, n_first: int) -> IntArray:
    """Return how many factors of each third-order monomial are among the first inputs.

    These are the directions in which contacts separate. They vary most, and the map
    bends most along them.
    """
    factors = combinations_with_replacement(range(n_inputs), 3)
    counts = []
    for three in factors:
        among_first = [factor for factor in three if factor < n_first]
        counts.append(len(among_first))
    return np.array(counts)


def _core(states: FloatArray, ways: FloatArray) -> FloatArray:
    """Return the eight directions (n, 8) of state and feet that matter most.

    The directions in which contacts separate, `ways` (n, m), come first, then what the
    whitened state (n, 8) says beside them.
    """
    n = len(states)
    rest = states - ways @ (ways.T @ states) / n
    left, _, _ = np.linalg.svd(rest, full_matrices=False)
    return np.column_stack([ways, np.sqrt(n) * left[:, : STATE - ways.shape[1]]])


@dataclass(frozen=True)
class Shapes:
    """Kinks, or steps, of n landings.

    Attributes
    ----------
    shown
        (n, K) as the outcomes show them: averaged over what is not foretold.
    sharp
        (n, K) as they are at the expected instants.
    """

    shown: FloatArray
    sharp: FloatArray

    def visible(self, smooth: Smooth, least: float) -> FloatArray:
        """Return the combinations of kinks (K, seen) that smooth terms do not explain.

        The remainder of each beside the smooth terms is more than `least` times the
        largest one.

        If a rigid body has many feet, its tilt alone determines their order, and the
        kinks of parallel pairs of feet are nearly equal: of 15 pairs of six feet, 6 can
        be distinguished. The remainders of the others are noise, with which the test
        would have no power.
        """
        rest = smooth.without(self.shown)
        _, singular, right = np.linalg.svd(rest, full_matrices=False)
        visible = LEAST_KINK * np.linalg.norm(self.shown, 2)
        limit = max(visible, least * singular[0])
        return np.asarray(right[singular > limit].T)

    def faded(self, smooth: Smooth, seen: FloatArray) -> float:
        """Return by how much averaging makes the seen kinks fainter, 1 or more."""
        sharp = float(np.linalg.norm(smooth.without(self.sharp) @ seen))
        shown = float(np.linalg.norm(smooth.without(self.shown) @ seen))
        return max(1.0, sharp / shown)


@dataclass(frozen=True)
class Fit:
    """Coefficients of K shapes for q outcomes, and their errors by n landings.

    Attributes
    ----------
    coefficients
        (K, q).
    scores, null_scores
        (n, K q) contributions of the landings to the error of the coefficients: after
        the shapes found have been subtracted, and without them.
    """

    coefficients: FloatArray
    scores: FloatArray
    null_scores: FloatArray


def fit_beside(smooth: Smooth, shapes: FloatArray) -> Fit:
    """Fit shapes (n, K) beside the smooth terms by least squares."""
    bends = smooth.without(shapes)
    rest = smooth.without(smooth.outputs)
    influence = np.asarray(np.linalg.solve(bends.T @ bends, bends.T), float)
    found = influence @ rest
    slack = 1.0 - np.sum(smooth.basis**2, axis=1)
    slack_with_shapes = slack - np.einsum("nk,kn->n", bends, influence)
    residuals = rest - bends @ found
    return Fit(
        coefficients=found,
        scores=_scores(influence, residuals, slack_with_shapes),
        null_scores=_scores(influence, rest, slack),
    )


def _scores(
    influence: FloatArray, residuals: FloatArray, slack: FloatArray
) -> FloatArray:
    """Return each landing's contribution to the error of the shapes, (n, K q)."""
    errors = residuals / np.sqrt(np.maximum(slack, LEAST_SLACK))[:, None]
    contributions = influence.T[:, :, None] * errors[:, None, :]
    return np.asarray(contributions.reshape(len(errors), -1))
