"""The terms of a landing map in a window about the simultaneous contact, ready to be fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.verdict.kinks import ALL_SETS_UP_TO, kinks
from hopdata.maps.verdict.shrinkage import VarianceRatios, variance_ratios
from hopdata.maps.verdict.smooth import free_terms, shrunk_terms

#: Kinks of which less than this share is left beside the smooth terms are not seen by the data.
_LEAST_KINK = 1e-3
#: The same beside the kink that is seen best, where there are kinks of pairs of feet only.
_LEAST_OF_PAIRS = 0.25

Floats = NDArray[np.float64]


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


def landing_window(
    x: Floats, y: Floats, instants: Floats, rows: NDArray[np.int64], degree: int
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
    bend_basis: Floats = np.linalg.qr(bends)[0]
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


def _seen_directions(bends: Floats, whole: Floats, least: float) -> Floats:
    """Return the combinations of kinks, (all, K), that smooth terms do not explain.

    Where a rigid body has many feet its tilt alone decides their order, and the kinks of parallel
    pairs of feet are nearly one: of 15 pairs of six feet, 6 can be told apart. What is left of
    the others is noise, and with it the test would have no power.
    """
    _, values, right = np.linalg.svd(bends, full_matrices=False)
    limit = max(_LEAST_KINK * np.linalg.norm(whole, 2), least * values[0])
    return right[values > limit].T


def shrinker(part: Window, k: int) -> tuple[Floats, Floats]:
    """Return the spreads (g,) of the shrunk terms of output k, and what inverts their shrinking.

    Terms u with these spreads s in units of the noise are fitted to a rest r as u s M^-1 s u' r.
    """
    spreads = np.sqrt(np.repeat(part.variances.ratios[k], part.sizes))
    return spreads, spreads[:, None] * part.gram * spreads + np.eye(len(spreads))


def weighted_bends(part: Window, spreads: Floats, inner: Floats) -> Floats:
    """Return the kinks (n, K) less the fit of the shrunk terms to them."""
    own = spreads[:, None] * np.linalg.solve(inner, spreads[:, None] * part.across)
    weighted: Floats = part.bends - part.others @ own
    return weighted


def _without(basis: Floats, columns: Floats) -> Floats:
    """Return columns with their projection on an orthonormal basis taken off."""
    rest: Floats = columns - basis @ (basis.T @ columns)
    return rest
