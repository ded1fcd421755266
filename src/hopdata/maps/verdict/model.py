"""The terms of a landing map in a window about the simultaneous contact, ready to be fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import ALL_SETS_UP_TO, free_terms, kinks, shrunk_terms

# How strongly to shrink the terms beyond the third order: restricted maximum likelihood.
#
# Per output the coefficients of each of two groups of shrunk terms are taken as normal with one
# variance for the group. Their ratios to the variance of the noise are found from what the free
# terms and the kinks leave over (Patterson and Thompson 1971). Where the data show no such terms
# the ratio is zero, and they cost nothing; where they show them, they count as one more source of
# uncertainty.

_RATIOS = np.concatenate([[0.0], np.logspace(-5, 1.5, 80)])
#: Shares of the second group in the sum of the two ratios.
_SHARES = (0.0, 1e-3, 1e-2, 0.1, 0.5, 1.0)


@dataclass(frozen=True)
class VarianceRatios:
    """Variances of q outputs.

    Attributes
    ----------
    ratios
        (q, 2) variance of a shrunk coefficient of each group over that of the noise.
    noise
        (q,) variance of the noise.
    """

    ratios: FloatArray
    noise: FloatArray


def variance_ratios(groups: Sequence[FloatArray], outputs: FloatArray, used: int) -> VarianceRatios:
    """Estimate the variances of each output.

    Parameters
    ----------
    groups
        (n, g) shrunk terms of each group, with all that is fitted freely projected out.
    outputs
        (n, q), likewise.
    used
        Degrees of freedom that the projection took.
    """
    sizes = [group.shape[1] for group in groups]
    terms = sum(sizes)
    triangle = np.asarray(np.linalg.qr(np.hstack([*groups, outputs]), mode="r"), np.float64)
    root, loads = triangle[:terms, :terms], triangle[:terms, terms:]
    rest = np.sum(triangle[terms:, terms:] ** 2, axis=0)
    free = len(outputs) - used
    likelihood, power = np.stack(
        [
            _profile(root * np.sqrt(np.repeat([1.0 - share, share], sizes)), loads, rest, free)
            for share in _SHARES
        ],
        axis=1,
    )
    columns = np.arange(outputs.shape[1])
    best = np.argmax(likelihood.reshape(-1, len(columns)), axis=0)
    share, ratio = np.unravel_index(best, likelihood.shape[:2])
    of_second = np.asarray(_SHARES)[share]
    ratios = _RATIOS[ratio, None] * np.column_stack([1.0 - of_second, of_second])
    return VarianceRatios(ratios, power[share, ratio, columns] / free)


def _profile(
    terms: FloatArray, loads: FloatArray, rest: FloatArray, free: int
) -> tuple[FloatArray, FloatArray]:
    """Return log likelihoods and sums of squares (ratios, q), for terms of one common variance."""
    values, vectors = np.linalg.eigh(terms @ terms.T)
    own = (vectors.T @ loads) ** 2
    spread = 1.0 + _RATIOS[:, None] * np.maximum(values, 0.0)
    power = np.einsum("rg,gq->rq", 1.0 / spread, own) + rest
    with np.errstate(divide="ignore"):  # an output without any noise
        likelihood = -0.5 * (np.log(spread).sum(axis=1)[:, None] + free * np.log(power))
    return likelihood, power


#: Kinks of which less than this share is left beside the smooth terms are not seen by the data.
_LEAST_KINK = 1e-3
#: The same beside the kink that is seen best, where there are kinks of pairs of feet only.
_LEAST_OF_PAIRS = 0.25


@dataclass(frozen=True)
class Window:
    """Terms of the n landings of a window, with the free ones projected out of all but themselves.

    Attributes
    ----------
    unit_s, scale
        Largest contact spread, s, and (p,) standard deviations of the inputs.
    basis, root
        The free terms: an orthonormal basis (n, terms), and what takes it to them.
    kinks, seen, bends
        (n, all) kinks as they are, the combinations that are seen, and (n, K) those projected.
    others, gram, across
        (n, g) shrunk terms, their products with each other and, (g, K), with the kinks.
    sizes
        Number of shrunk terms in each group.
    outputs
        (n, q), projected.
    variances
        Of noise and of the shrunk terms.
    """

    unit_s: float
    scale: FloatArray
    basis: FloatArray
    root: FloatArray
    kinks: FloatArray
    seen: FloatArray
    bends: FloatArray
    others: FloatArray
    gram: FloatArray
    across: FloatArray
    sizes: tuple[int, ...]
    outputs: FloatArray
    variances: VarianceRatios


def landing_window(
    x: FloatArray, y: FloatArray, instants: FloatArray, rows: NDArray[np.int64], degree: int
) -> Window:
    """Return the terms of the landings `rows` (n,), smooth ones up to `degree` free.

    Parameters are those of `hopdata.maps.verdict.estimate.fit_window`.
    """
    times = instants[rows]
    unit = float(times.std(axis=1).max())
    inputs = x[rows] - x[rows].mean(axis=0)
    scale = inputs.std(axis=0)
    free = free_terms(inputs / scale, times / unit, degree)
    basis, root = np.linalg.qr(free)
    whole = kinks(times / unit)
    bends, outputs = _without(basis, whole), _without(basis, y[rows])
    groups = shrunk_terms(inputs / scale, times / unit, degree)
    sizes = tuple(group.shape[1] for group in groups)
    others = _without(basis, np.hstack(groups))
    least = _LEAST_OF_PAIRS if times.shape[1] > ALL_SETS_UP_TO else 0.0
    seen = _seen_directions(bends, whole, least)
    bends = np.matmul(bends, seen)
    bend_basis: FloatArray = np.linalg.qr(bends)[0]
    used = basis.shape[1] + bends.shape[1]
    unseen = np.split(_without(bend_basis, others), np.cumsum(sizes)[:-1], axis=1)
    variances = variance_ratios(unseen, _without(bend_basis, outputs), used)
    gram, across = others.T @ others, others.T @ bends
    return Window(
        unit,
        scale,
        basis,
        root,
        whole,
        seen,
        bends,
        others,
        gram,
        across,
        sizes,
        outputs,
        variances,
    )


def _seen_directions(bends: FloatArray, whole: FloatArray, least: float) -> FloatArray:
    """Return the combinations of kinks, (all, K), that smooth terms do not explain.

    Where a rigid body has many feet its tilt alone decides their order, and the kinks of parallel
    pairs of feet are nearly one: of 15 pairs of six feet, 6 can be told apart. What is left of
    the others is noise, and with it the test would have no power.
    """
    _, values, right = np.linalg.svd(bends, full_matrices=False)
    limit = max(_LEAST_KINK * np.linalg.norm(whole, 2), least * values[0])
    return right[values > limit].T


def shrinker(part: Window, k: int) -> tuple[FloatArray, FloatArray]:
    """Return the spreads (g,) of the shrunk terms of output k, and what inverts their shrinking.

    Terms u with these spreads s in units of the noise are fitted to a rest r as u s M^-1 s u' r.
    """
    spreads = np.sqrt(np.repeat(part.variances.ratios[k], part.sizes))
    return spreads, spreads[:, None] * part.gram * spreads + np.eye(len(spreads))


def weighted_bends(part: Window, spreads: FloatArray, inner: FloatArray) -> FloatArray:
    """Return the kinks (n, K) less the fit of the shrunk terms to them."""
    own = spreads[:, None] * np.linalg.solve(inner, spreads[:, None] * part.across)
    weighted: FloatArray = part.bends - part.others @ own
    return weighted


def _without(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """Return columns with their projection on an orthonormal basis taken off."""
    rest: FloatArray = columns - basis @ (basis.T @ columns)
    return rest
