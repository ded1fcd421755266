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

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import affordable_degree
from hopdata.maps.verdict.model import Window, landing_window, shrinker, weighted_bends

#: Shares of the landings, nearest to the simultaneous contact, that may be the window.
WINDOWS = (1.0, 0.71, 0.5, 0.35, 0.25)
#: Share of curvature in the variance of the kinks up to which a window is taken.
CURVATURE_SHARE = 0.0375
#: How often the variance of the shrunk terms is counted: orders that are not fitted come on top.
CURVATURE_COUNT = 1.5


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

    coefficients: FloatArray
    linear: FloatArray
    covariance: FloatArray
    null_scores: FloatArray
    curvature: FloatArray
    seen: FloatArray
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


def fit_kinks(
    x: FloatArray, y: FloatArray, instants: FloatArray, *, all_windows: bool = True
) -> list[KinkFit]:
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
        degree = affordable_degree(len(rows), x.shape[1], instants.shape[1])
        if degree >= 2:
            fits.append(fit_window(x, y, instants, rows, window, degree))
            if not all_windows and fits[-1].nearly_straight:
                break
    return fits


def choose_window(fits: list[KinkFit]) -> KinkFit:
    """Return the widest window whose curvature is small beside its noise, or else the nearest."""
    return next((fit for fit in fits if fit.nearly_straight), fits[-1])


def fit_window(
    x: FloatArray,
    y: FloatArray,
    instants: FloatArray,
    rows: NDArray[np.int64],
    window: float,
    degree: int,
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
    part = landing_window(x, y, instants, rows, degree)
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
    x: FloatArray, y: FloatArray, instants: FloatArray, rows: NDArray[np.int64], degree: int
) -> tuple[FloatArray, FloatArray]:
    """Return `seen` and `coefficients` of the `KinkFit` of a window, without the rest of it."""
    part = landing_window(x, y, instants, rows, degree)
    found = []
    for k in range(y.shape[1]):
        weighted = weighted_bends(part, *shrinker(part, k))
        found.append(np.linalg.solve(part.bends.T @ weighted, weighted.T @ part.outputs[:, k]))
    return part.seen, np.column_stack(found) / part.unit_s


def _one_output(
    part: Window, k: int, slack: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return coefficients (K,), null scores and scores (n, K), and curvature covariance (K, K)."""
    bends, output, noise = part.bends, part.outputs[:, k], float(part.variances.noise[k])
    spreads, inner = shrinker(part, k)
    weighted = weighted_bends(part, spreads, inner)
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


def _interleaved(parts: list[FloatArray]) -> FloatArray:
    """Return (n, K q) of q arrays (n, K), in the order of the flattened coefficients (K, q)."""
    stacked: FloatArray = np.stack(parts, axis=2).reshape(len(parts[0]), -1)
    return stacked


def _block_diagonal(blocks: list[FloatArray]) -> FloatArray:
    """Return (K q, K q) of q covariances (K, K) of outputs that have nothing in common."""
    size, q = len(blocks[0]), len(blocks)
    whole = np.zeros((size, q, size, q))
    for k, block in enumerate(blocks):
        whole[:, k, :, k] = block
    return whole.reshape(size * q, size * q)
