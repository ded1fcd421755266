"""Small linear algebra of the verdict, the same on every machine."""

import numpy as np

from hopdata.arrays import FloatArray

#: Singular values and scatters at or below this share of the largest are rounding.
#: Unit: 1. Origin: rounding.
FLAT = 1e-9

#: Least slack of a landing (one minus its leverage) by which a leave-one-out error is
#: divided.
#: Unit: 1. Origin: chosen.
LEAST_SLACK = 1e-3


def symmetric_root(covariance: FloatArray) -> FloatArray:
    """Return the symmetric root (m, m) of a covariance that may be singular.

    This root is unique, whereas rounding decides the signs and rotations of
    eigenvectors. With it the same seed gives the same draws on every machine, up to the
    square root of rounding errors.
    """
    eigenvalues, vectors = np.linalg.eigh(covariance)
    is_rounding = eigenvalues <= FLAT**1.5 * max(eigenvalues[-1], 0.0)
    kept = np.where(is_rounding, 0.0, eigenvalues)
    return np.asarray(vectors * np.sqrt(kept) @ vectors.T)


def regular(covariance: FloatArray) -> FloatArray:
    """Return a covariance (m, m) with a little more of everything.

    It then has an inverse and a triangular root.
    """
    # The trace is the same in any axes, and so is the result.
    little = FLAT * float(np.trace(covariance))
    return np.asarray(covariance + little * np.eye(len(covariance)))


def positive_part(matrix: FloatArray) -> FloatArray:
    """Return a symmetric matrix (m, m) without its negative directions."""
    eigenvalues, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * eigenvalues.clip(0.0)) @ vectors.T)


def whitened(x: FloatArray) -> FloatArray:
    """Return all uncorrelated combinations of the columns, of mean square one."""
    left, singular, _ = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)
    varies = singular > FLAT * singular[0]
    return np.asarray(left[:, varies] * np.sqrt(len(x)))


def beside(x: FloatArray, more: FloatArray) -> FloatArray:
    """Return what is new in the columns `more` (n, m) beside linear terms of x."""
    design = np.column_stack([np.ones(len(x)), x])
    return whitened(more - design @ np.linalg.lstsq(design, more, rcond=None)[0])


def left_out_errors(design: FloatArray, outcomes: FloatArray) -> FloatArray:
    """Return the errors (n, q) of least squares on all other rows, for each row."""
    basis, _ = np.linalg.qr(design)
    slack = np.maximum(1.0 - np.sum(basis**2, axis=1), LEAST_SLACK)
    missed = outcomes - basis @ (basis.T @ outcomes)
    return np.asarray(missed / slack[:, None])
