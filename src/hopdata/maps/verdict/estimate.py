"""The kinks of a landing map, with what is uncertain about them.

Free terms, kinks and shrunk terms are fitted together to the landings within a window of contact
spread about the simultaneous contact. Two things make the estimate uncertain: the scatter of the
landings, which the sandwich covariance takes as it is (White 1980), and smooth terms beyond the
free ones, whose size the shrinkage has estimated and which count one and a half times. The window
is the widest in which the second is small beside the first, so that the answer rests on noise,
which is known, not on curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.verdict.kinks import ALL_SETS_UP_TO, kinks
from hopdata.maps.verdict.shrinkage import VarianceRatios, variance_ratios
from hopdata.maps.verdict.smooth import (
    free_terms,
    monomials,
    number_of_free_terms,
    shrunk_terms,
)

#: Shares of the landings, nearest to the simultaneous contact, that may be the window.
WINDOWS = (1.0, 0.71, 0.5, 0.35, 0.25)
#: Share of curvature in the variance of the kinks up to which a window is taken.
CURVATURE_SHARE = 0.0375
#: How often the variance of the shrunk terms is counted: orders that are not fitted come on top.
CURVATURE_COUNT = 1.5
#: Landings wanted in a window for each free term.
LANDINGS_PER_TERM = 2.5
#: Kinks of which less than this share is left beside the smooth terms are not seen by the data.
_LEAST_KINK = 1e-3
#: The same beside the kink that is seen best, where there are kinks of pairs of feet only.
_LEAST_OF_PAIRS = 0.25
_OUTLYING = 5.0

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class KinkFit:
    """Kinks of one window; K kinks, q outputs, n landings in the window of N in all.

    Attributes
    ----------
    coefficients
        (K, q) per unit of time.
    linear
        (p, q) derivative of the outputs by the inputs at the middle of the window.
    covariance
        (K q, K q) of the coefficients, row by row, curvature included.
    null_scores
        (n, K q) contributions of the landings to the coefficients if there are no kinks.
    curvature
        (K q, K q) share of the covariance that is due to smooth terms beyond those fitted freely.
    seen
        (all kinks, K) orthonormal combinations of the kinks that the data can tell from smooth
        terms; `coefficients` are those of these combinations.
    rows
        (n,) numbers of the landings in the window.
    window, largest_spread_s
        Share of the landings, and their largest contact spread, s.
    degree
        Order up to which smooth terms are free.
    """

    coefficients: Floats
    linear: Floats
    covariance: Floats
    null_scores: Floats
    curvature: Floats
    seen: Floats
    rows: NDArray[np.int64]
    window: float
    largest_spread_s: float
    degree: int

    @property
    def curvature_share(self) -> float:
        """Share of curvature in the total variance of the coefficients."""
        return float(np.trace(self.curvature) / np.trace(self.covariance))

    @property
    def nearly_straight(self) -> bool:
        """Whether curvature is small beside noise."""
        return self.curvature_share <= CURVATURE_SHARE


def expected_contacts(x: Floats, instants: Floats) -> Floats:
    """Return the contact instants (N, feet) that the inputs lead one to expect, mean removed.

    A polynomial of the inputs fitted to the measured instants, so that errors of these, which the
    outputs may share, move no landing across a kink. Its degree is the one that predicts best with
    each landing left out; landings whose instants lie far off take no part.
    """
    t = instants - instants.mean(axis=1, keepdims=True)
    highest = _affordable_degree(len(x), x.shape[1], t.shape[1])
    fitted, best, least = np.median(t, axis=0), t, np.inf
    for degree in range(1, highest + 1):  # a few terms first: wrong instants stand out more
        miss = np.abs(t - fitted).max(axis=1)
        good = miss <= _OUTLYING * 1.4826 * np.median(miss)
        design = np.column_stack([np.ones(len(x)), monomials(x, tuple(range(1, degree + 1)))])
        if good.sum() <= design.shape[1]:  # of so few landings none can be told to lie off
            good = np.ones(len(x), dtype=bool)
        basis, root = np.linalg.qr(design[good])
        fitted = design @ np.linalg.solve(root, basis.T @ t[good])
        slack = np.maximum(1.0 - np.sum(basis**2, axis=1), 1e-3)
        error = np.mean(((t - fitted)[good] / slack[:, None]) ** 2)
        if error < least:
            best, least = fitted, error
    expected: Floats = best - best.mean(axis=1, keepdims=True)
    return expected


def fit_kinks(x: Floats, y: Floats, instants: Floats, *, all_windows: bool = True) -> list[KinkFit]:
    """Fit the kinks in every window that has enough landings, widest first.

    Parameters
    ----------
    x, y
        (N, p) inputs and (N, q) outputs.
    instants
        (N, feet) expected contact instants, s; see `expected_contacts`.
    all_windows
        Whether to go on where the window to choose is found.
    """
    near = np.argsort(instants.std(axis=1), kind="stable")
    fits = []
    for window in WINDOWS:
        rows = np.sort(near[: round(window * len(x))])
        degree = _affordable_degree(len(rows), x.shape[1], instants.shape[1])
        if degree >= 2:
            fits.append(fit_window(x, y, instants, rows, window, degree))
            if not all_windows and fits[-1].nearly_straight:
                break
    return fits


def choose_window(fits: list[KinkFit]) -> KinkFit:
    """Return the widest window whose curvature is small beside its noise, or else the nearest."""
    return next((fit for fit in fits if fit.nearly_straight), fits[-1])


def _affordable_degree(landings: int, n_inputs: int, n_feet: int) -> int:
    """Return the order up to which so many landings can have free terms: 3, 2 or 1."""
    for degree in (3, 2):
        terms = number_of_free_terms(n_inputs, n_feet, degree)
        if landings >= LANDINGS_PER_TERM * terms:
            return degree
    return 1


def fit_window(
    x: Floats, y: Floats, instants: Floats, rows: NDArray[np.int64], window: float, degree: int
) -> KinkFit:
    """Fit the kinks in one window.

    Parameters
    ----------
    x, y, instants
        As for `fit_kinks`.
    rows
        (n,) numbers of the landings in the window.
    window
        Their share.
    degree
        Order up to which smooth terms are free.
    """
    part = _window(x, y, instants, rows, degree)
    slack = 1.0 - np.sum(part.basis**2, axis=1)
    parts = [_one_output(part, k, slack) for k in range(y.shape[1])]
    coefficients = np.column_stack([found[0] for found in parts])
    null_scores = _interleaved([found[1] for found in parts])
    scores = _interleaved([found[2] for found in parts])
    curvature = _block_diagonal([found[3] for found in parts])
    smooth = y[rows] - part.kinks @ part.seen @ coefficients
    terms = np.linalg.lstsq(part.root, part.basis.T @ smooth, rcond=None)[0]
    slopes = terms[1 : x.shape[1] + 1] / part.scale[:, None]
    unit = part.unit_s
    return KinkFit(
        coefficients / unit,
        slopes,
        (scores.T @ scores + curvature) / unit**2,
        null_scores / unit,
        curvature / unit**2,
        part.seen,
        rows,
        window,
        unit,
        degree,
    )


def window_kinks(
    x: Floats, y: Floats, instants: Floats, rows: NDArray[np.int64], degree: int
) -> tuple[Floats, Floats]:
    """Return `seen` and `coefficients` of the `KinkFit` of a window, without the rest of it."""
    part = _window(x, y, instants, rows, degree)
    found = []
    for k in range(y.shape[1]):
        weighted = _weighted_bends(part, *_shrinker(part, k))
        found.append(np.linalg.solve(part.bends.T @ weighted, weighted.T @ part.outputs[:, k]))
    return part.seen, np.column_stack(found) / part.unit_s


@dataclass(frozen=True)
class _Window:
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
    scale: Floats
    basis: Floats
    root: Floats
    kinks: Floats
    seen: Floats
    bends: Floats
    others: Floats
    gram: Floats
    across: Floats
    sizes: tuple[int, ...]
    outputs: Floats
    variances: VarianceRatios


def _window(
    x: Floats, y: Floats, instants: Floats, rows: NDArray[np.int64], degree: int
) -> _Window:
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
    bend_basis: Floats = np.linalg.qr(bends)[0]
    used = basis.shape[1] + bends.shape[1]
    unseen = np.split(_without(bend_basis, others), np.cumsum(sizes)[:-1], axis=1)
    variances = variance_ratios(unseen, _without(bend_basis, outputs), used)
    gram, across = others.T @ others, others.T @ bends
    return _Window(
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


def _seen_directions(bends: Floats, whole: Floats, least: float) -> Floats:
    """Return the combinations of kinks, (all, K), that smooth terms do not explain.

    Where a rigid body has many feet its tilt alone decides their order, and the kinks of parallel
    pairs of feet are nearly one: of 15 pairs of six feet, 6 can be told apart. What is left of
    the others is noise, and with it the test would have no power.
    """
    _, values, right = np.linalg.svd(bends, full_matrices=False)
    limit = max(_LEAST_KINK * np.linalg.norm(whole, 2), least * values[0])
    return right[values > limit].T


def _shrinker(part: _Window, k: int) -> tuple[Floats, Floats]:
    """Return the spreads (g,) of the shrunk terms of output k, and what inverts their shrinking.

    Terms u with these spreads s in units of the noise are fitted to a rest r as u s M^-1 s u' r.
    """
    spreads = np.sqrt(np.repeat(part.variances.ratios[k], part.sizes))
    return spreads, spreads[:, None] * part.gram * spreads + np.eye(len(spreads))


def _weighted_bends(part: _Window, spreads: Floats, inner: Floats) -> Floats:
    """Return the kinks (n, K) less the fit of the shrunk terms to them."""
    own = spreads[:, None] * np.linalg.solve(inner, spreads[:, None] * part.across)
    weighted: Floats = part.bends - part.others @ own
    return weighted


def _one_output(part: _Window, k: int, slack: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return coefficients (K,), null scores and scores (n, K), and curvature covariance (K, K)."""
    bends, output, noise = part.bends, part.outputs[:, k], float(part.variances.noise[k])
    spreads, inner = _shrinker(part, k)
    weighted = _weighted_bends(part, spreads, inner)
    influence = np.linalg.solve(bends.T @ weighted, weighted.T)
    coefficients = influence @ output
    rest = output - bends @ coefficients
    shrunk = np.linalg.solve(inner, spreads * (part.others.T @ rest))
    rest = rest - part.others @ (spreads * shrunk)
    own = slack - np.einsum("nk,kn->n", bends, influence)
    scores = influence.T * (rest / np.sqrt(np.maximum(own, 0.1)))[:, None]
    null_scores = influence.T * (output / np.sqrt(np.maximum(slack, 0.1)))[:, None]
    missed = (influence @ part.others) * spreads
    return coefficients, null_scores, scores, CURVATURE_COUNT * noise * missed @ missed.T


def _without(basis: Floats, columns: Floats) -> Floats:
    """Return columns with their projection on an orthonormal basis taken off."""
    rest: Floats = columns - basis @ (basis.T @ columns)
    return rest


def _interleaved(parts: list[Floats]) -> Floats:
    """Return (n, K q) of q arrays (n, K), in the order of the flattened coefficients (K, q)."""
    stacked: Floats = np.stack(parts, axis=2).reshape(len(parts[0]), -1)
    return stacked


def _block_diagonal(blocks: list[Floats]) -> Floats:
    """Return (K q, K q) of q covariances (K, K) of outputs that have nothing in common."""
    size, q = len(blocks[0]), len(blocks)
    whole = np.zeros((size, q, size, q))
    for k, block in enumerate(blocks):
        whole[:, k, :, k] = block
    return whole.reshape(size * q, size * q)
