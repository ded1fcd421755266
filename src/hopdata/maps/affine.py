"""Affine least-squares maps and mean predictors, with many fits at once.

All fits use an orthonormal basis of the pooled inputs, and each replicate fits only the residuals
of the pooled fit. In that basis the normal equations of a replicate are close to a multiple of the
identity, so they cost one small matrix product and lose no digits.
"""

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.maps.draws import chunks

#: Singular values of the scaled, centred inputs below this fraction of the largest count as zero.
RANK_TOLERANCE = 1e-11


def pooled_basis(x: FloatArray) -> FloatArray:
    """Return the whitened design of a population: a column of ones, then the input directions.

    Parameters
    ----------
    x
        (n, p) inputs.

    Returns
    -------
    ndarray
        (n, 1 + rank) design with orthogonal columns, each of mean square one.
    """
    x = np.asarray(x, float)
    rounding = 8 * np.finfo(float).eps * np.abs(x).max(axis=0)
    scale = np.where(np.ptp(x, axis=0) > rounding, x.std(axis=0), np.inf)  # inf where constant
    _, values, right = np.linalg.svd((x - x.mean(0)) / scale, full_matrices=False)
    kept = values > RANK_TOLERANCE * values.max(initial=0.0)
    spread = (x - x.mean(0)) @ (right[kept].T / values[kept] / scale[:, None])
    spread = np.linalg.qr(spread - spread.mean(0))[0]
    return np.column_stack([np.ones(len(x)), np.sqrt(len(x)) * spread])


#: Replicates with a smaller ratio of least to largest eigenvalue are fitted by pseudo-inverse.
_LEAST_SPREAD = 1e-6


def affine_predictions(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the fitted values of an affine map by ordinary least squares.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs; all finite.

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    """
    x, y = checked(x, y)
    design = pooled_basis(x) / np.sqrt(len(x))
    return np.asarray(design @ (design.T @ y))


def leave_one_out_residuals(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the (n, q) errors of predicting each row from an affine fit to all the others.

    The leverages of the full fit give them without refitting (Allen's PRESS residuals).

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    AnalysisError
        If one row alone determines a direction of the fit, so the others cannot predict it.
    """
    x, y = checked(x, y)
    design = pooled_basis(x) / np.sqrt(len(x))
    slack = 1.0 - np.sum(design**2, axis=1)
    if slack.min() < 1e-10:
        fit = f"a fit with {design.shape[1]} coefficients per output"
        raise AnalysisError(
            f"affine map: {len(x)} landings do not suffice to leave one out of {fit}"
        )
    return (y - design @ (design.T @ y)) / slack[:, None]


def affine_test_errors(x: FloatArray, y: FloatArray, train: IntArray, test: IntArray) -> FloatArray:
    """Fit an affine map to each training set and return its mean squared test errors.

    Parameters
    ----------
    x, y
        (n, p) inputs and (n, q) outputs of the population; all finite.
    train, test
        (R, m) and (R, t) row numbers of each replicate. A direction in which the whole population
        does not vary is ignored; one in which only a training set does not vary gets the
        minimum-norm solution in the units of `x`.

    Returns
    -------
    ndarray
        (R, q) mean squared error of each output coordinate over the test rows.

    Raises
    ------
    ValueError
        If the arrays do not match or hold values that are not finite.
    """
    x, y = checked(x, y)
    design = pooled_basis(x)
    # Every replicate reproduces the pooled fit exactly, so only its residuals need fitting.
    centred = y - y.mean(0)
    residual = centred - design @ (design.T @ centred / len(x))
    errors, spread = _whitened_errors(design, residual, train, test)
    again = np.flatnonzero(spread <= _LEAST_SPREAD)
    for rows in chunks(len(again), train.shape[1] * (x.shape[1] + y.shape[1])):
        chosen = again[rows]
        errors[chosen] = _minimum_norm_errors(x, y, train[chosen], test[chosen])
    return errors


def mean_test_errors(y: FloatArray, train: IntArray, test: IntArray) -> FloatArray:
    """Return the (R, q) mean squared test errors of predicting the mean of each training set.

    Parameters
    ----------
    y
        (n, q) outputs of the population.
    train, test
        (R, m) and (R, t) row numbers of each replicate.
    """
    y = np.asarray(y, float)
    return _whitened_errors(np.ones((len(y), 1)), y - y.mean(0), train, test)[0]


def _whitened_errors(
    design: FloatArray, residual: FloatArray, train: IntArray, test: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return (R, q) test errors and the (R,) ratios of least to largest eigenvalue."""
    inputs, rows = design.shape[1], np.concatenate([design, residual], axis=1)
    errors, spread = np.empty((len(train), residual.shape[1])), np.empty(len(train))
    for chunk in chunks(len(train), train.shape[1] * rows.shape[1]):
        drawn, tested = rows[train[chunk]], rows[test[chunk]]
        normal = drawn[..., :inputs].swapaxes(1, 2) @ drawn
        values = np.linalg.eigvalsh(normal[..., :inputs])
        spread[chunk] = np.maximum(values[:, 0], 0.0) / values[:, -1]
        normal[spread[chunk] <= _LEAST_SPREAD, :, :inputs] = np.eye(inputs)  # refitted later
        slopes = np.linalg.solve(normal[..., :inputs], normal[..., inputs:])
        errors[chunk] = np.mean((tested[..., inputs:] - tested[..., :inputs] @ slopes) ** 2, axis=1)
    return errors, spread


def _minimum_norm_errors(
    x: FloatArray, y: FloatArray, train: IntArray, test: IntArray
) -> FloatArray:
    """Return the (R, q) test errors of fits by pseudo-inverse in the units of `x`."""
    inputs, outputs = x[train], y[train]
    centre, level = inputs.mean(1, keepdims=True), outputs.mean(1, keepdims=True)
    slopes = np.linalg.pinv(inputs - centre, rcond=RANK_TOLERANCE) @ (outputs - level)
    return np.mean((y[test] - level - (x[test] - centre) @ slopes) ** 2, axis=1)


def checked(x: FloatArray, y: FloatArray, *beside: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return inputs (n, p) and outputs (n, q) as arrays of floats.

    Raises
    ------
    ValueError
        If the shapes do not match, if `beside` has another length, or if a value is not finite.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    if x.ndim != 2 or y.ndim != 2 or {len(x)} != {*map(np.size, beside), len(y)}:
        found = ", ".join(map(str, map(np.shape, (x, y, *beside))))
        raise ValueError(f"expected (n, p) and (n, q) arrays and all of one length, found {found}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError("inputs and outputs must be finite")
    return x, y
