"""Fit of the kinks and jumps of a landing map near a simultaneous contact, beside smooth terms.

The model is y = smooth(x) + sum_k b_k h_k(t(x)) + noise. The kinks h are the latest
contacts of sets of feet (`hopdata.maps.coordinates`); all b are zero exactly if the map
has one derivative. The smooth terms are monomials of the inputs up to third order,
fitted by least squares. With two feet, whose only kink is |d| with d the time between
the contacts, d^4 is added. If there are too few landings for all third-order terms, the
monomials stop at second order. If `allowed` then shows that the third order matters,
third-order terms along the contacts are added, in the two main directions in which the
contacts separate.

Other terms of a C1 map look like kinks; they shrink as the contacts come closer
together. The landings with the largest contact spread are therefore left out, and kinks
up to `allowed` are not evidence.

If impacts do not commute, the outcome itself jumps where two feet exchange their order.
Steps, sign(t_i - t_j), are then fitted like the kinks, and the kinks count as smooth
terms.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import ALL_SETS_UP_TO, affordable_degree, kinks, monomials
from hopdata.maps.verdict.inputs import LEAST_CLASS, WINDOW, SectionLandings, halves

#: Apparent difference, as a share of the map, that residual smooth terms may cause in
#: any C1 landing: the larger of `LEFT` and `OF_FOURTH` c^1.5. Here c is the relative
#: change of the derivative by third-order terms along the contacts. It grows as the
#: square of the contacts' spread, while the change by the fourth order grows as the
#: cube, hence as c^1.5.
LEFT, OF_FOURTH = 0.1, 4.0
#: Apparent jump that residual smooth terms may cause, as a share of the outcome's sd:
#: the larger of `LEFT_OF_JUMPS` and `OF_ALLOWED` times `allowed`.
LEFT_OF_JUMPS, OF_ALLOWED = 0.05, 0.1
#: Part of a true difference that smooth terms may hide, as a share of `allowed`.
HIDDEN = 0.5
#: Largest deviation of one landing's derivative from the mean, in rms deviations of all
#: landings.
_ONE_LANDING = 2.0

_FLAT = 1e-9  # relative rounding limit
_NEXT = 5  # number of following landings with which each is compared
_WAYS = 2  # main directions in which contacts separate: tilt has two
#: Kinks are invisible if less than this fraction of them remains beside the smooth
#: terms.
_LEAST_KINK = 1e-3
#: The same relative to the most visible kink, for kinks of pairs of feet only and for
#: steps.
_LEAST_OF_PAIRS = 0.25


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
    kinks = KinkFit(
        coefficients, linear, scores, null_scores, seen, rows, allowed, left
    )
    window.look_for_steps(seen)
    steps = window.seen_kinks(least=_LEAST_OF_PAIRS)
    if not steps.size:
        return kinks
    sizes, scores, null_scores = window.fit(steps)
    allowed = max(LEFT_OF_JUMPS, OF_ALLOWED * allowed)
    jumps = KinkFit(sizes, linear, scores, null_scores, steps, rows, allowed, allowed)
    return replace(kinks, jumps=jumps)


class _Smooth:
    """Smooth terms for a set of landings, and the parts of kinks and outputs outside them."""

    def __init__(self, landings: SectionLandings, rows: IntArray, third: str) -> None:
        self.landings, self.rows = landings, rows
        t, self.outputs = landings.expected[rows], landings.outputs[rows]
        self.kinks, self.inputs = kinks(t), _whitened(landings.inputs[rows])
        self.along = monomials(_whitened(t)[:, :_WAYS], (3,))
        self.lower = np.column_stack(
            [np.ones(len(rows)), monomials(self.inputs, (1, 2))]
        )
        terms = {
            "none": [],
            "along": [self.along],
            "all": [monomials(self.inputs, (3,))],
        }[third]
        fourth = [t[:, :1] ** 4] * (t.shape[1] == 2)
        self.basis, self.root = np.linalg.qr(
            np.column_stack([self.lower, *terms, *fourth])
        )
        self.rest = self._without(self.outputs)
        left = np.abs(np.diag(np.linalg.qr(self.rest, mode="r")))
        if (
            not left.min()
            > _FLAT * np.abs(self.outputs - self.outputs.mean(axis=0)).max()
        ):
            raise AnalysisError(
                "an outcome of the landing does not vary, or has no noise at all"
            )

    def _without(self, columns: FloatArray) -> FloatArray:
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def look_for_steps(self, seen: FloatArray) -> None:
        """Add the `seen` kinks to the smooth terms, and replace them by steps of pairs of feet."""
        t, found = self.landings.expected[self.rows].T, self._without(self.kinks) @ seen
        self.basis = np.linalg.qr(np.column_stack([self.basis, found]))[0]
        self.rest = self._without(self.outputs)
        signs = (np.sign(t[i] - t[j]) for i, j in combinations(range(len(t)), 2))
        often = [
            one for one in signs if len(one) - np.abs(one.sum()) >= 2 * LEAST_CLASS
        ]
        self.kinks = np.column_stack(often or [np.zeros(len(self.rows))])

    def seen_kinks(self, least: float = 0.0) -> FloatArray:
        """Return the combinations of kinks, (all, K), that smooth terms do not explain.

        The remainder of each beside the smooth terms is more than `least` times the
        largest one.

        If a rigid body has many feet, its tilt alone determines their order, and the
        kinks of parallel pairs of feet are nearly equal: of 15 pairs of six feet, 6 can
        be distinguished. The remainders of the others are noise, with which the test
        would have no power.
        """
        _, values, right = np.linalg.svd(self._without(self.kinks), full_matrices=False)
        limit = _LEAST_KINK * np.linalg.norm(self.kinks, 2)
        if self.landings.expected.shape[1] > ALL_SETS_UP_TO:
            least = _LEAST_OF_PAIRS
        return np.asarray(right[values > max(limit, least * values[0])].T)

    def fit(self, seen: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the kinks (K, q), and the scores and null scores (N, K q) of all landings."""
        bends = self._without(self.kinks) @ seen
        influence = np.asarray(np.linalg.solve(bends.T @ bends, bends.T), float)
        found = influence @ self.rest
        slack = 1.0 - np.sum(self.basis**2, axis=1)
        own = slack - np.einsum("nk,kn->n", bends, influence)
        with_kinks = self._scores(influence, self.rest - bends @ found, own)
        return found, with_kinks, self._scores(influence, self.rest, slack)

    def third(self, seen: FloatArray) -> float:
        """Return the relative change of the derivative by third-order terms along the contacts.

        It is the rms over the landings, without the contribution of noise.
        """
        basis, root = np.linalg.qr(
            np.column_stack([self.lower, self.kinks @ seen, self.along])
        )
        slopes = np.linalg.inv(root)[-self.along.shape[1] :]
        found = slopes @ basis.T @ self.outputs
        errors = self.outputs - basis @ (basis.T @ self.outputs)
        noise = np.sum(errors**2, axis=0) / (len(basis) - basis.shape[1])
        # For normal u and v the derivative of u^3, less its mean, has mean square 18;
        # of u^2 v, 6.
        weights = np.where(
            np.isin(np.arange(len(slopes)), (0, len(slopes) - 1)), 18.0, 6.0
        )
        squares = weights @ (found**2 - np.sum(slopes**2, axis=1)[:, None] * noise)
        return float(np.sqrt(max(0.0, squares @ halves(np.var(self.outputs, axis=0)))))

    def _scores(
        self, influence: FloatArray, errors: FloatArray, slack: FloatArray
    ) -> FloatArray:
        errors = errors / np.sqrt(np.maximum(slack, 0.1))[:, None]
        scores = np.zeros(
            (len(self.landings.inputs), influence.shape[0] * errors.shape[1])
        )
        scores[self.rows] = (influence.T[:, :, None] * errors[:, None, :]).reshape(
            len(errors), -1
        )
        return scores

    def linear(self, coefficients: FloatArray) -> FloatArray:
        """Return the derivative (p, q), by the inputs, of the outputs without these kinks."""
        smooth = self.outputs - self.kinks @ coefficients
        inputs = self.landings.inputs[self.rows]
        slopes = np.linalg.solve(self.root, self.basis.T @ smooth)[
            1 : self.inputs.shape[1] + 1
        ]
        scale = np.linalg.lstsq(inputs - inputs.mean(axis=0), self.inputs, rcond=None)[
            0
        ]
        return np.asarray(scale @ slopes)


def err_alike(scores: FloatArray) -> bool:
    """Return whether scores (N, m) resemble the next few more than by chance.

    Random signs give a resemblance of up to three standard errors by chance.
    """
    pairs = [np.sum(scores[k:] * scores[:-k], axis=1) for k in range(1, _NEXT + 1)]
    products = np.concatenate(pairs)
    return bool(products.sum() > 3.0 * np.linalg.norm(products))


def one_landing(allowed: float) -> float:
    """Return the relative deviation of a difference at one landing from the observed mean.

    Like the derivative itself, the difference changes over the landings by the share c
    (see `LEFT`).
    """
    return float(_ONE_LANDING * (allowed / OF_FOURTH) ** (2 / 3))


def upper_ends(sizes: list[float], allowed: float) -> list[float]:
    """Return upper ends for differences at the simultaneous contact that appear as these `sizes`.

    They are larger because smooth terms may hide part of a difference, and because that
    contact is a single landing, which may deviate from the mean.
    """
    off = one_landing(allowed)
    return [size + float(np.hypot(HIDDEN * allowed, off * size)) for size in sizes]


def symmetric_root(covariance: FloatArray) -> FloatArray:
    """Return the symmetric root (m, m) of a covariance that may be singular.

    This root is unique, whereas rounding decides the signs and rotations of
    eigenvectors. With it the same seed gives the same draws on every machine, up to the
    square root of rounding errors.
    """
    values, vectors = np.linalg.eigh(covariance)
    kept = np.where(values > _FLAT**1.5 * values[-1], values, 0.0)
    return np.asarray(vectors * np.sqrt(kept) @ vectors.T)


def _whitened(x: FloatArray) -> FloatArray:
    """Return all uncorrelated combinations of the columns, scaled to mean square one."""
    left, values, _ = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)
    return np.asarray(left[:, values > _FLAT * values[0]] * np.sqrt(len(x)))
