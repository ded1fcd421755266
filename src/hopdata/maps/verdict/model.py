"""The kinks of a landing map near a simultaneous contact, fitted beside all that is smooth.

y = smooth(x) + sum_k b_k h_k(t(x)) + noise. The kinks h are the latest contacts of sets of feet
(`hopdata.maps.coordinates`); all b are zero exactly if the map has one derivative. Monomials of the
inputs up to the third order are free. What a C1 map may have besides, and what looks like a kink if
it is left free (d|d|, |d|^3 of the time d between two contacts, their products, fourth order), is
shrunk by as much as each output says: restricted maximum likelihood, one variance for each group of
terms (Patterson and Thompson 1971).

Nothing depends on axes: inputs and tilts are whitened, products of them weighed so that a turn of
the axes is a turn of the products, and outputs taken in the combinations in which signal and noise
are uncorrelated.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import factorial, prod

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import (
    ALL_SETS_UP_TO,
    affordable_degree,
    kinks,
    monomials,
    time_differences,
)
from hopdata.maps.verdict.inputs import SectionLandings

#: Share of the landings, those of least contact spread, that the fit takes; of more than three
#: feet, whose kinks are not all fitted, fewer.
WINDOW, WINDOW_OF_PAIRS = 0.71, 0.5
#: How often the variance of the shrunk terms is counted: orders that are not fitted come on top.
CURVATURE_COUNT = 2.5

_STEPS = 40  # of the fixed-point iteration for the variances
_NONE = 1e-7  # ratio of variances that counts as zero
_FLAT = 1e-9
#: Kinks of which less than this share is left beside the smooth terms are not seen by the data.
_LEAST_KINK = 1e-3
#: The same beside the kink that is seen best, where there are kinks of pairs of feet only.
_LEAST_OF_PAIRS = 0.25


@dataclass(frozen=True)
class KinkFit:
    """Kinks of a study; K kinks, q outputs, n landings in the window of N in all.

    Attributes
    ----------
    coefficients
        (K, q) of the combinations `seen` of the kinks.
    linear
        (p, q) derivative of the outputs by the inputs, but for the kinks.
    scores, null_scores
        (n, K q) contributions of the landings to the error of the coefficients, row by row: with
        the kinks that were found taken off the outputs, and with none.
    curvature
        (K q, K q) variance that smooth terms beyond the free ones add, `CURVATURE_COUNT` times.
    seen
        (all kinks, K) orthonormal combinations of the kinks that the data tell from smooth terms.
    rows
        (n,) numbers of the landings in the window.
    """

    coefficients: FloatArray
    linear: FloatArray
    scores: FloatArray
    null_scores: FloatArray
    curvature: FloatArray
    seen: FloatArray
    rows: NDArray[np.int64]

    @property
    def covariance(self) -> FloatArray:
        """Covariance (K q, K q) of the coefficients: as the landings scatter (White 1980)."""
        return self.scores.T @ self.scores + self.curvature


def window_share(feet: int) -> float:
    """Return the share of the landings that a fit takes."""
    return WINDOW if feet <= ALL_SETS_UP_TO else WINDOW_OF_PAIRS


def fit_kinks(landings: SectionLandings) -> KinkFit:
    """Fit the kinks to the landings of the window.

    Raises
    ------
    AnalysisError
        If there are too few landings, or none in which two feet exchange their order.
    """
    x, t = landings.inputs, landings.expected
    near = np.argsort(t.std(axis=1), kind="stable")
    rows = np.sort(near[: round(window_share(t.shape[1]) * len(x))])
    degree = affordable_degree(len(rows), x.shape[1], t.shape[1])
    if degree < 2:
        raise AnalysisError(f"{len(x)} touchdowns are too few for second-order terms")
    terms = _terms(x[rows], t[rows], degree)
    if not terms.seen.size:
        raise AnalysisError("no two feet exchange their order among these touchdowns")
    return _fitted(terms, landings.outputs[rows], rows, x[rows])


@dataclass(frozen=True)
class _Terms:
    """Terms of n landings, with the free ones projected out of all but themselves.

    `basis` (n, f) and `root` are the free terms: an orthonormal basis, and what takes it to them;
    `heights` (n, K) kinks in the combinations `seen` (all, K); `bends` and `others` (n, g) kinks
    and shrunk terms, projected; `gram` (g, g) products of these; `groups` (g,) their groups.
    """

    basis: FloatArray
    root: FloatArray
    heights: FloatArray
    seen: FloatArray
    bends: FloatArray
    others: FloatArray
    gram: FloatArray
    groups: NDArray[np.int64]

    def rest(self, columns: FloatArray) -> FloatArray:
        """Return columns (n, any) with the free terms projected out."""
        return _without(self.basis, columns)

    def influence(self, ratios: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what takes an output to its kinks, (K, n), and shrunk terms of unit noise, (K, g).

        `ratios` (groups,) are the variances of the shrunk terms over that of the noise.
        """
        spreads = np.sqrt(ratios)[self.groups]
        inner = spreads[:, None] * self.gram * spreads + np.eye(len(spreads))
        across = spreads[:, None] * (self.others.T @ self.bends)
        weighted = self.bends - self.others @ (spreads[:, None] * np.linalg.solve(inner, across))
        influence = np.linalg.solve(self.bends.T @ weighted, weighted.T)
        return influence, (influence @ self.others) * spreads

    def without_shrunk(self, output: FloatArray, ratios: FloatArray) -> FloatArray:
        """Return an output (n,) without the fit of the shrunk terms to it."""
        spreads = np.sqrt(ratios)[self.groups]
        inner = spreads[:, None] * self.gram * spreads + np.eye(len(spreads))
        fitted = np.linalg.solve(inner, spreads * (self.others.T @ output))
        return output - self.others @ (spreads * fitted)


def _terms(inputs: FloatArray, instants: FloatArray, degree: int) -> _Terms:
    """Return the terms of landings with these inputs (n, p) and expected instants (n, feet)."""
    x, t = _whitened(inputs), instants / instants.std(axis=1).max()
    tilts, d = _whitened(t)[:, :2], time_differences(t)
    orders = tuple(range(1, degree + 1))
    basis, root = np.linalg.qr(np.column_stack([np.ones(len(x)), monomials(x, orders)]))
    squares = d * np.abs(d)
    blocks = [
        [squares, _products(squares, x)],
        [np.abs(d) ** 3, _products(squares, _powers(tilts, 2)), _powers(tilts, 4)],
        [_products(_powers(tilts, 2), _powers(x, 2))],
        [_powers(tilts, 2), _powers(tilts, 3)],
        [_products(tilts, x), _products(_powers(tilts, 2), x)],
        [_powers(tilts, 5), _powers(tilts, 6)],
        *([[_powers(x, 3)]] if degree < 3 else []),
    ]
    groups = [np.hstack([part / np.sqrt(np.mean(part**2)) for part in block]) for block in blocks]
    others = _without(basis, np.hstack(groups))
    whole = kinks(instants)
    bends = _without(basis, whole)
    seen = _seen_directions(bends, whole, t.shape[1])
    numbers = np.repeat(np.arange(len(groups)), [group.shape[1] for group in groups])
    return _Terms(basis, root, whole @ seen, seen, bends @ seen, others, others.T @ others, numbers)


def _fitted(
    terms: _Terms, outputs: FloatArray, rows: NDArray[np.int64], inputs: FloatArray
) -> KinkFit:
    canonical = _canonical(terms.basis, outputs - outputs.mean(axis=0))
    projected = terms.rest(outputs @ canonical)
    ratios, noise = _variance_ratios(terms, projected)
    n, (kinds, q) = len(rows), (terms.bends.shape[1], outputs.shape[1])
    slack = 1.0 - np.sum(terms.basis**2, axis=1)
    found, curvature = np.empty((kinds, q)), np.empty((q, kinds, kinds))
    scores, null_scores = np.empty((n, kinds, q)), np.empty((n, kinds, q))
    for k in range(q):
        output = projected[:, k]
        influence, missed = terms.influence(ratios[k])
        found[:, k] = influence @ output
        rest = terms.without_shrunk(output - terms.bends @ found[:, k], ratios[k])
        own = slack - np.einsum("nk,kn->n", terms.bends, influence)
        scores[:, :, k] = influence.T * (rest / np.sqrt(np.maximum(own, 0.1)))[:, None]
        null_scores[:, :, k] = influence.T * (output / np.sqrt(np.maximum(slack, 0.1)))[:, None]
        curvature[k] = CURVATURE_COUNT * noise[k] * missed @ missed.T
    back = np.linalg.inv(canonical)
    smooth = outputs - terms.heights @ found @ back
    slopes = np.linalg.solve(terms.root, terms.basis.T @ smooth)[1 : inputs.shape[1] + 1]
    scale = np.linalg.lstsq(inputs - inputs.mean(axis=0), _whitened(inputs), rcond=None)[0]
    size = kinds * q
    return KinkFit(
        found @ back,
        scale @ slopes,
        (scores @ back).reshape(n, size),
        (null_scores @ back).reshape(n, size),
        np.einsum("kab,ki,kj->aibj", curvature, back, back).reshape(size, size),
        terms.seen,
        rows,
    )


def _canonical(basis: FloatArray, outputs: FloatArray) -> FloatArray:
    """Return combinations (q, q) of outputs with noise of variance one and signals uncorrelated."""
    signal = basis.T @ outputs
    rest = outputs - basis @ signal
    root = np.linalg.qr(rest, mode="r") / np.sqrt(len(rest) - basis.shape[1])
    if not np.abs(np.diag(root)).min() > _FLAT * np.abs(root).max():
        raise AnalysisError("an outcome of the landing does not vary, or without any noise")
    vectors = np.linalg.svd(np.linalg.solve(root.T, signal.T), full_matrices=False)[0]
    return np.asarray(np.linalg.solve(root, vectors))


def _variance_ratios(terms: _Terms, outputs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ratios (q, groups) of variances to the noise, and the noise (q,), by REML.

    Fixed-point steps (MacKay 1992), overrelaxed, for what free terms and kinks leave over.
    """
    bends = np.asarray(np.linalg.qr(terms.bends)[0])
    n, g = terms.others.shape
    count = int(terms.groups[-1]) + 1
    both = _without(bends, np.hstack([terms.others, outputs]))
    triangle = np.asarray(np.linalg.qr(both, mode="r"))
    gram = triangle[:g, :g].T @ triangle[:g, :g]
    loads = (triangle[:g, :g].T @ triangle[:g, g:]).T
    power = np.sum(triangle[:, g:] ** 2, axis=0)
    free = n - terms.basis.shape[1] - bends.shape[1]
    member = np.eye(count)[terms.groups]
    noise = power / free
    variances = np.repeat(1e-3 * noise[:, None], count, axis=1)
    for _ in range(_STEPS):
        shrinkage = noise[:, None] / variances[:, terms.groups]
        sizes, spread = _posterior(gram, shrinkage, loads)
        known = 1.0 - shrinkage * spread
        steps = (sizes**2 @ member) / np.maximum(known @ member, _FLAT) / variances
        least = _FLAT * noise[:, None]
        variances = np.maximum(variances * np.maximum(steps, least / variances) ** 1.5, least)
        rest = power - np.einsum("qi,qi->q", sizes, 2.0 * loads - sizes @ gram)
        noise = rest / np.maximum(free - known.sum(axis=1), 1.0)
    ratios = variances / noise[:, None]
    return np.where(ratios < _NONE, 0.0, ratios), noise


def _posterior(
    gram: FloatArray, shrinkage: FloatArray, loads: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return means (q, g) of the shrunk terms and the diagonals (q, g) of their covariances.

    By triangles, which take a third of the time of whole inverses.
    """
    from scipy.linalg.lapack import dpotrf, dtrtri

    sizes, spread = np.empty_like(loads), np.empty_like(loads)
    for k, (own, load) in enumerate(zip(shrinkage, loads, strict=True)):
        root, _ = dpotrf(gram + np.diag(own), lower=1)
        inverse, _ = dtrtri(root, lower=1)
        sizes[k], spread[k] = inverse.T @ (inverse @ load), np.sum(inverse**2, axis=0)
    return sizes, spread


def _seen_directions(bends: FloatArray, whole: FloatArray, feet: int) -> FloatArray:
    """Return the combinations of kinks, (all, K), that smooth terms do not explain.

    Where a rigid body has many feet its tilt alone decides their order, and the kinks of parallel
    pairs of feet are nearly one: of 15 pairs of six feet, 6 can be told apart. What is left of
    the others is noise, and with it the test would have no power.
    """
    _, values, right = np.linalg.svd(bends, full_matrices=False)
    limit = _LEAST_KINK * np.linalg.norm(whole, 2)
    if feet > ALL_SETS_UP_TO:
        limit = max(limit, _LEAST_OF_PAIRS * values[0])
    return np.asarray(right[values > limit].T)


def symmetric_root(covariance: FloatArray) -> FloatArray:
    """Return the symmetric root (m, m) of a covariance that may be singular.

    It is the only one, whereas signs and turns of eigenvectors are left to rounding: with it the
    same seed gives the same draws wherever the code runs, but for the root of rounding.
    """
    values, vectors = np.linalg.eigh(covariance)
    kept = np.where(values > _FLAT**1.5 * values[-1], values, 0.0)
    root: FloatArray = vectors * np.sqrt(kept) @ vectors.T
    return root


def _whitened(x: FloatArray) -> FloatArray:
    """Return as many uncorrelated combinations of columns, of mean square one, as there are."""
    left, values, _ = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)
    return np.asarray(left[:, values > _FLAT * values[0]] * np.sqrt(len(x)))


def _powers(x: FloatArray, degree: int) -> FloatArray:
    """Return the products of `degree` columns, which turn with the axes of `x` (n, p)."""
    chosen = list(combinations_with_replacement(range(x.shape[1]), degree))
    often = [factorial(degree) / prod(map(factorial, Counter(c).values())) for c in chosen]
    return monomials(x, (degree,)) * np.sqrt(often)


def _products(a: FloatArray, b: FloatArray) -> FloatArray:
    products: FloatArray = (a[:, :, None] * b[:, None, :]).reshape(len(a), -1)
    return products


def _without(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return columns with their projection on an orthonormal basis taken off."""
    rest: FloatArray = columns - basis @ (basis.T @ columns)
    return rest
