"""Affine least-squares maps and mean predictors, many fits at once.

The inputs of a landing are nearly or exactly rank-deficient (three rigid markers on a section
have 18 coordinates and at most 11 degrees of freedom), so every fit goes through an orthonormal
basis of the pooled, centred inputs. In that basis the normal equations of each replicate are
close to a multiple of the identity: they cost one small matrix product and lose accuracy with
the condition number of the data, not with its square.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError

#: Singular values of the scaled, centred inputs below this share of the largest count as zero.
RANK_TOLERANCE = 1e-11
#: A replicate whose squared Cholesky pivots spread wider than this is fitted by pseudo-inverse.
_PIVOT_SPREAD = 1e-6
#: Working set of one chunk of replicates: larger ones leave the cache and are slower.
_CHUNK_BYTES = 2 * 2**20

Floats = NDArray[np.float64]
Indices = NDArray[np.integer]


@dataclass(frozen=True)
class AffineMap:
    """The map ``y = x @ coefficients + intercept``.

    Where the data do not decide it, the coefficients are those of minimum norm.

    Attributes
    ----------
    coefficients
        (p, q).
    intercept
        (q,).
    rank
        Number of independent directions found in the centred inputs.
    """

    coefficients: Floats
    intercept: Floats
    rank: int

    def predict(self, x: Floats) -> Floats:
        """Return the (n, q) predictions for (n, p) inputs."""
        return np.asarray(x, float) @ self.coefficients + self.intercept


def fit_affine(x: Floats, y: Floats, *, rank_tolerance: float = RANK_TOLERANCE) -> AffineMap:
    """Fit one affine map by ordinary least squares.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs; all finite.
    rank_tolerance
        See `RANK_TOLERANCE`.

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    """
    x, y = _checked(x, y)
    scale = _scales(x)
    left, values, right = _truncated_svd((x - x.mean(0)) / scale, rank_tolerance)
    scaled = right.T @ ((left.T @ (y - y.mean(0))) / values[:, None])
    # Of the maps that agree on the data, the one without a part that the inputs never excite.
    excited = np.linalg.qr(right.T * np.where(np.isfinite(scale), scale, 0.0)[:, None])[0]
    coefficients = excited @ (excited.T @ (scaled / scale[:, None]))
    return AffineMap(coefficients, y.mean(0) - x.mean(0) @ coefficients, len(values))


def pooled_basis(x: Floats, *, rank_tolerance: float = RANK_TOLERANCE) -> Floats:
    """Return the whitened design of a population: a column of ones, then the input directions.

    Parameters
    ----------
    x
        (n, p) inputs.
    rank_tolerance
        See `RANK_TOLERANCE`.

    Returns
    -------
    ndarray
        (n, 1 + rank), columns orthogonal, each of mean square one.
    """
    x = np.asarray(x, float)
    left, _, _ = _truncated_svd((x - x.mean(0)) / _scales(x), rank_tolerance)
    return np.column_stack([np.ones(len(x)), left * np.sqrt(len(x))])


def leave_one_out_residuals(
    x: Floats, y: Floats, *, rank_tolerance: float = RANK_TOLERANCE
) -> Floats:
    """Return the (n, q) errors of predicting each row from an affine fit to all the others.

    Uses the leverages of the full fit, so nothing is refitted (Allen's PRESS residuals).

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    AnalysisError
        If some row alone decides a direction of the fit, so that the others cannot predict it.
    """
    x, y = _checked(x, y)
    design = pooled_basis(x, rank_tolerance=rank_tolerance) / np.sqrt(len(x))
    slack = 1.0 - np.sum(design**2, axis=1)
    if slack.min() < 1e-10:
        raise AnalysisError(
            f"affine map: {len(x)} landings do not suffice to leave one out of a fit with "
            f"{design.shape[1]} coefficients per output"
        )
    return (y - design @ (design.T @ y)) / slack[:, None]


def affine_test_errors(
    x: Floats,
    y: Floats,
    train: Indices,
    test: Indices,
    *,
    rank_tolerance: float = RANK_TOLERANCE,
) -> Floats:
    """Fit an affine map to each training set and return its mean squared test errors.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs of the population; all finite.
    train, test
        (R, m) and (R, t) row numbers of each replicate.
    rank_tolerance
        See `RANK_TOLERANCE`. A direction that the whole population lacks plays no part; one
        that only a training set lacks gets the minimum-norm solution in the units of `x`.

    Returns
    -------
    ndarray
        (R, q) mean squared error of each output coordinate over the test rows.

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    """
    x, y = _checked(x, y)
    design = pooled_basis(x, rank_tolerance=rank_tolerance)
    # What the pooled fit explains is exact in every replicate; fit only what it leaves.
    residual = y - design @ (design.T @ y / len(x))
    errors = np.empty((len(train), y.shape[1]))
    for rows in _chunks(len(train), train.shape[1] * (design.shape[1] + y.shape[1])):
        errors[rows], sound = _whitened_errors(design, residual, train[rows], test[rows])
        again = rows.start + np.flatnonzero(~sound)
        if again.size:
            errors[again] = _minimum_norm_errors(x, y, train[again], test[again])
    return errors


def mean_test_errors(y: Floats, train: Indices, test: Indices) -> Floats:
    """Return the (R, q) mean squared test errors of predicting the mean of each training set.

    Parameters
    ----------
    y
        (n, q) outputs of the population.
    train, test
        (R, m) and (R, t) row numbers of each replicate.
    """
    y = np.asarray(y, float)
    centred = y - y.mean(0)
    errors = np.empty((len(train), y.shape[1]))
    for rows in _chunks(len(train), train.shape[1] * y.shape[1]):
        means = centred[train[rows]].mean(axis=1, keepdims=True)
        errors[rows] = np.mean((centred[test[rows]] - means) ** 2, axis=1)
    return errors


def _whitened_errors(
    design: Floats, residual: Floats, train: Indices, test: Indices
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return (R, q) errors of whitened normal equations, and which replicates can be trusted."""
    columns = design.shape[1]
    both = np.hstack([design, residual])
    rows = both[train]
    moments = rows[..., :columns].swapaxes(1, 2) @ rows
    gram = moments[..., :columns]
    sound = _well_posed(gram)
    gram[~sound] = np.eye(columns)
    solution = np.linalg.solve(gram, moments[..., columns:])
    rows = both[test]
    misses = rows[..., columns:] - rows[..., :columns] @ solution
    return np.einsum("rtq,rtq->rq", misses, misses) / test.shape[1], sound


def _well_posed(gram: Floats) -> NDArray[np.bool_]:
    """Return which of the (R, k, k) Gram matrices have a safe Cholesky factor."""
    try:
        pivots = np.diagonal(np.linalg.cholesky(gram), axis1=1, axis2=2) ** 2
    except np.linalg.LinAlgError:  # raised for the whole batch: look at each
        pivots = np.linalg.eigvalsh(gram)
    return pivots.min(axis=1) > _PIVOT_SPREAD * pivots.max(axis=1)


def _minimum_norm_errors(x: Floats, y: Floats, train: Indices, test: Indices) -> Floats:
    """Return (R, q) errors of replicates fitted by pseudo-inverse in the units of `x`."""
    inputs, outputs = x[train], y[train]
    centre, level = inputs.mean(1, keepdims=True), outputs.mean(1, keepdims=True)
    slopes = np.linalg.pinv(inputs - centre, rcond=RANK_TOLERANCE) @ (outputs - level)
    misses = y[test] - level - (x[test] - centre) @ slopes
    return np.mean(misses**2, axis=1)


def _truncated_svd(matrix: Floats, rank_tolerance: float) -> tuple[Floats, Floats, Floats]:
    """Return U, s, Vt without the singular values that count as zero."""
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    rank = int(np.sum(values > rank_tolerance * values[0])) if values.size else 0
    return left[:, :rank], values[:rank], right[:rank]


def _scales(x: Floats) -> Floats:
    """Return the sd of each column; infinite where it is constant up to rounding."""
    rounding = 8 * np.finfo(float).eps * np.abs(x).max(axis=0)
    return np.where(np.ptp(x, axis=0) > rounding, x.std(axis=0), np.inf)


def _chunks(count: int, floats_each: int) -> list[slice]:
    step = max(1, _CHUNK_BYTES // (8 * max(1, floats_each)))
    return [slice(start, min(start + step, count)) for start in range(0, count, step)]


def _checked(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    x, y = np.asarray(x, float), np.asarray(y, float)
    if x.ndim != 2 or y.ndim != 2 or len(x) != len(y):
        raise ValueError(f"expected (n, p) and (n, q) arrays, found {x.shape} and {y.shape}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError("inputs and outputs must be finite")
    return x, y
