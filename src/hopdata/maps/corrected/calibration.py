"""What inputs are to be expected given those that were measured with noise.

Regression calibration (Carroll, Ruppert, Stefanski and Crainiceanu 2006, ch. 4): least squares on
the expected inputs is the moment estimate of errors in variables (Fuller 1987).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.maps.corrected.marker_noise import InputErrors

#: Share of the variance of the inputs that is taken as more than noise, in every direction: no
#: coefficient is multiplied by more than its inverse.
LEAST_RELIABILITY = 0.3

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """What inputs are to be expected given the measured ones.

    Attributes
    ----------
    slopes
        (p, p), by which deviations from the mean are multiplied from the right.
    doubt
        (p, p) covariance of the inputs about what is expected.
    drift
        (p, q) of the outputs' errors: what is expected of them given the measured inputs.
    removed
        Share of the noise covariance that was taken off.
    """

    slopes: Floats
    doubt: Floats
    drift: Floats
    removed: float


def calibration(x: Floats, errors: InputErrors) -> Calibration:
    """Return what to expect of inputs measured with noise.

    Moments minus those of the noise need not be positive, and where they nearly vanish the estimate
    is wild. As Fuller (1987, sec. 2.2) does, only as much noise is then taken off as leaves enough:
    `LEAST_RELIABILITY` of the variance in every direction.

    Parameters
    ----------
    x
        (n, p) measured inputs.
    errors
        Covariances of their errors.

    Raises
    ------
    AnalysisError
        If the inputs do not vary in some direction.
    ValueError
        If the covariance does not fit the inputs or is not one.
    """
    noise = np.asarray(errors.inputs, float)
    if noise.shape != (x.shape[1],) * 2 or not np.allclose(noise, noise.T):
        raise ValueError(f"errors: expected a symmetric matrix for {x.shape[1]} inputs")
    if not np.isfinite(noise).all() or np.linalg.eigvalsh(noise)[0] < -1e-9 * np.trace(noise):
        raise ValueError("errors: expected a covariance, found one that is not positive")
    moments = np.cov(x, rowvar=False).reshape(noise.shape)
    root = _cholesky(moments)
    # Share of the noise in the variance, direction by direction.
    shares = np.linalg.eigvalsh(np.linalg.solve(root, np.linalg.solve(root, noise).T))
    bearable = 1.0 - LEAST_RELIABILITY
    removed = 1.0 if shares[-1] <= bearable else bearable / float(shares[-1])
    share = np.linalg.solve(moments, removed * noise)
    doubt = removed * noise - removed * noise @ share
    drift = np.linalg.solve(moments, removed * np.asarray(errors.shared, float))
    return Calibration(np.eye(len(noise)) - share, doubt, np.asarray(drift, float), removed)


def _cholesky(moments: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.cholesky(moments), float)
    except np.linalg.LinAlgError as error:
        raise AnalysisError("map: expected inputs that vary in all directions") from error
