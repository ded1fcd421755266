"""The kinks and jumps of a landing map near a simultaneous contact, beside all that is smooth.

y = smooth(x) + sum_k b_k h_k(t(x)) + noise. The kinks h are the latest contacts of sets of feet
(`hopdata.maps.coordinates`); all b are zero exactly if the map has one derivative. `smooth` are the
monomials of the inputs up to the third order, by least squares; with two feet, all of whose kinks
are |d|, d the time between their contacts, d^4 as well. Where landings are too few for all terms of
the third order they go up to the second, and if `allowed` says that the third matters, with those
of the third along the contacts: of the two main ways in which these lie apart.

What a C1 map has besides looks like a kink, the less the nearer the feet come down together: so the
landings of most contact spread take no part, and kinks as small as `allowed` are no evidence.

Where impacts do not commute the outcome itself jumps as two feet exchange their order: steps,
sign(t_i - t_j), are fitted as the kinks are, which then count as smooth.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import ALL_SETS_UP_TO, affordable_degree, kinks, monomials
from hopdata.maps.verdict.inputs import LEAST_CLASS, WINDOW, SectionLandings, halves

#: As large a difference, as a share of the map, smooth terms may leave of any C1 landing; or so
#: many times c^1.5, c being what third-order terms along the contacts change its derivative by. It
#: grows as the square of the contacts' spread, and what the fourth order changes as the cube.
LEFT, OF_FOURTH = 0.1, 4.0
#: As large a jump, as a share of what the outcome varies; or this share of `allowed`.
LEFT_OF_JUMPS, OF_ALLOWED = 0.05, 0.1
#: Share of it that they may hide of another.
HIDDEN = 0.5
#: Root mean squares of the landings' derivatives about their mean that one may lie off.
_ONE_LANDING = 2.0

_FLAT = 1e-9
_NEXT = 5  # landings that follow one, with which it is compared
_WAYS = 2  # in which contacts lie apart: tilt has two directions
#: Kinks of which less than this share is left beside the smooth terms are not seen by the data.
_LEAST_KINK = 1e-3
#: The same beside what is seen best, where there are kinks of pairs of feet only, and of steps.
_LEAST_OF_PAIRS = 0.25


@dataclass(frozen=True)
class KinkFit:
    """Kinks, or steps, of a study; K kinks, q outputs, N landings.

    Attributes
    ----------
    coefficients
        (K, q) of the combinations `seen` of the kinks.
    linear
        (p, q) derivative of the outputs by the inputs, but for the kinks.
    scores, null_scores
        (N, K q) contributions of the landings to the error of the coefficients, row by row: with
        the kinks that were found taken off the outputs, and with none.
    seen
        (all kinks, K) orthonormal combinations of the kinks that the data tell from smooth terms.
    rows
        (n,) numbers of the landings in the window.
    allowed
        Size up to which kinks are no evidence in a study: see `LEFT`.
    left
        The same in the mean of such studies, half as much again without terms of the third order.
    jumps
        Steps of the outcome beside the kinks.
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
    x, t = landings.inputs, landings.expected
    rows = np.sort(np.argsort(t.std(axis=1), kind="stable")[: round(WINDOW * len(x))])
    few = affordable_degree(len(rows), x.shape[1], t.shape[1]) < 3
    window = _Smooth(landings, rows, "none" if few else "all")
    seen = window.seen_kinks()
    allowed = max(LEFT, OF_FOURTH * window.third(seen) ** 1.5)
    if few and allowed > LEFT:
        window, few = _Smooth(landings, rows, "along"), False
        seen = window.seen_kinks()
    if not seen.size:
        raise AnalysisError("no two feet exchange their order among these touchdowns")
    coefficients, scores, null_scores = window.fit(seen)
    linear = window.linear(seen @ coefficients)
    left = 1.5 * allowed if few else allowed
    kinks = KinkFit(coefficients, linear, scores, null_scores, seen, rows, allowed, left)
    window.look_for_steps(seen)
    steps = window.seen_kinks(least=_LEAST_OF_PAIRS)
    if not steps.size:
        return kinks
    sizes, scores, null_scores = window.fit(steps)
    allowed = max(LEFT_OF_JUMPS, OF_ALLOWED * allowed)
    jumps = KinkFit(sizes, linear, scores, null_scores, steps, rows, allowed, allowed)
    return replace(kinks, jumps=jumps)


class _Smooth:
    """Smooth terms of some of the landings, and what is left of kinks and outputs beside them."""

    def __init__(self, landings: SectionLandings, rows: IntArray, third: str) -> None:
        self.landings, self.rows = landings, rows
        t, self.outputs = landings.expected[rows], landings.outputs[rows]
        self.kinks, self.inputs = kinks(t), _whitened(landings.inputs[rows])
        self.along = monomials(_whitened(t)[:, :_WAYS], (3,))
        self.lower = np.column_stack([np.ones(len(rows)), monomials(self.inputs, (1, 2))])
        terms = {"none": [], "along": [self.along], "all": [monomials(self.inputs, (3,))]}[third]
        fourth = [t[:, :1] ** 4] * (t.shape[1] == 2)
        self.basis, self.root = np.linalg.qr(np.column_stack([self.lower, *terms, *fourth]))
        self.rest = self._without(self.outputs)
        left = np.abs(np.diag(np.linalg.qr(self.rest, mode="r")))
        if not left.min() > _FLAT * np.abs(self.outputs - self.outputs.mean(axis=0)).max():
            raise AnalysisError("an outcome of the landing does not vary, or has no noise at all")

    def _without(self, columns: FloatArray) -> FloatArray:
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def look_for_steps(self, seen: FloatArray) -> None:
        """Take the kinks that are `seen` for smooth, and steps of pairs of feet for kinks."""
        t, found = self.landings.expected[self.rows].T, self._without(self.kinks) @ seen
        self.basis = np.linalg.qr(np.column_stack([self.basis, found]))[0]
        self.rest = self._without(self.outputs)
        signs = (np.sign(t[i] - t[j]) for i, j in combinations(range(len(t)), 2))
        often = [one for one in signs if len(one) - np.abs(one.sum()) >= 2 * LEAST_CLASS]
        self.kinks = np.column_stack(often or [np.zeros(len(self.rows))])

    def seen_kinks(self, least: float = 0.0) -> FloatArray:
        """Return the combinations of kinks, (all, K), that smooth terms do not explain.

        They have more than `least` of what is left of the one that is seen best.

        Where a rigid body has many feet its tilt alone decides their order, and the kinks of
        parallel pairs of feet are nearly one: of 15 pairs of six feet, 6 can be told apart. What
        is left of the others is noise, and with it the test would have no power.
        """
        _, values, right = np.linalg.svd(self._without(self.kinks), full_matrices=False)
        limit = _LEAST_KINK * np.linalg.norm(self.kinks, 2)
        if self.landings.expected.shape[1] > ALL_SETS_UP_TO:
            least = _LEAST_OF_PAIRS
        return np.asarray(right[values > max(limit, least * values[0])].T)

    def fit(self, seen: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return kinks (K, q), and the scores and null scores (N, K q) of all landings."""
        bends = self._without(self.kinks) @ seen
        influence = np.asarray(np.linalg.solve(bends.T @ bends, bends.T), float)
        found = influence @ self.rest
        slack = 1.0 - np.sum(self.basis**2, axis=1)
        own = slack - np.einsum("nk,kn->n", bends, influence)
        with_kinks = self._scores(influence, self.rest - bends @ found, own)
        return found, with_kinks, self._scores(influence, self.rest, slack)

    def third(self, seen: FloatArray) -> float:
        """Return what third-order terms along the contacts change the derivative by, as a share.

        Root of the mean square over the landings, less what noise adds to it.
        """
        basis, root = np.linalg.qr(np.column_stack([self.lower, self.kinks @ seen, self.along]))
        slopes = np.linalg.inv(root)[-self.along.shape[1] :]
        found = slopes @ basis.T @ self.outputs
        errors = self.outputs - basis @ (basis.T @ self.outputs)
        noise = np.sum(errors**2, axis=0) / (len(basis) - basis.shape[1])
        # Of normal u and v the derivative of u^3, but for its mean, has mean square 18, of u^2 v 6.
        weights = np.where(np.isin(np.arange(len(slopes)), (0, len(slopes) - 1)), 18.0, 6.0)
        squares = weights @ (found**2 - np.sum(slopes**2, axis=1)[:, None] * noise)
        return float(np.sqrt(max(0.0, squares @ halves(np.var(self.outputs, axis=0)))))

    def _scores(self, influence: FloatArray, errors: FloatArray, slack: FloatArray) -> FloatArray:
        errors = errors / np.sqrt(np.maximum(slack, 0.1))[:, None]
        scores = np.zeros((len(self.landings.inputs), influence.shape[0] * errors.shape[1]))
        scores[self.rows] = (influence.T[:, :, None] * errors[:, None, :]).reshape(len(errors), -1)
        return scores

    def linear(self, coefficients: FloatArray) -> FloatArray:
        """Return the derivative (p, q) of the outputs without these kinks by the inputs."""
        smooth = self.outputs - self.kinks @ coefficients
        inputs = self.landings.inputs[self.rows]
        slopes = np.linalg.solve(self.root, self.basis.T @ smooth)[1 : self.inputs.shape[1] + 1]
        scale = np.linalg.lstsq(inputs - inputs.mean(axis=0), self.inputs, rcond=None)[0]
        return np.asarray(scale @ slopes)


def err_alike(scores: FloatArray) -> bool:
    """Tell whether scores (N, m) are like the next few ones, by more than chance.

    By chance is what random signs bring about: up to three standard errors.
    """
    pairs = [np.sum(scores[k:] * scores[:-k], axis=1) for k in range(1, _NEXT + 1)]
    products = np.concatenate(pairs)
    return bool(products.sum() > 3.0 * np.linalg.norm(products))


def one_landing(allowed: float) -> float:
    """Return the share by which a difference at one landing may lie off the mean, which shows.

    As the derivative does, it changes over the landings by the share c.
    """
    return float(_ONE_LANDING * (allowed / OF_FOURTH) ** (2 / 3))


def upper_ends(sizes: list[float], allowed: float) -> list[float]:
    """Return how large differences may be at the simultaneous contact that show as these `sizes`.

    Smooth terms hide some of them, and that contact is one landing.
    """
    off = one_landing(allowed)
    return [size + float(np.hypot(HIDDEN * allowed, off * size)) for size in sizes]


def symmetric_root(covariance: FloatArray) -> FloatArray:
    """Return the symmetric root (m, m) of a covariance that may be singular.

    It is the only one, whereas signs and turns of eigenvectors are left to rounding: with it the
    same seed gives the same draws wherever the code runs, but for the root of rounding.
    """
    values, vectors = np.linalg.eigh(covariance)
    kept = np.where(values > _FLAT**1.5 * values[-1], values, 0.0)
    return np.asarray(vectors * np.sqrt(kept) @ vectors.T)


def _whitened(x: FloatArray) -> FloatArray:
    """Return as many uncorrelated combinations of columns, of mean square one, as there are."""
    left, values, _ = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)
    return np.asarray(left[:, values > _FLAT * values[0]] * np.sqrt(len(x)))
