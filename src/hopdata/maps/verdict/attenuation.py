"""By how much noise in the inputs and instants rounds the kinks off, and its correction.

A kink stands where two feet are expected at once. Noise moves landings across it, so that a fit
finds it weaker than it is. How much is seen by adding the same noise once more: kinks of known
height, as the landings would show them, are fitted to landings with noisier inputs and instants
(simulation-extrapolation, Cook and Stefanski 1994, to first order).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.verdict.estimate import KinkFit, window_kinks
from hopdata.maps.verdict.expected_contacts import expected_contacts
from hopdata.maps.verdict.kinks import kinks
from hopdata.maps.verdict.significance import draws

#: Times that noise is added.
_REPEATS = 4
#: Where less than this is left of some kink, noise hides it, and nothing is to be restored.
_LEAST_LEFT = 0.3

Floats = NDArray[np.float64]


def attenuation(
    fit: KinkFit,
    inputs: Floats,
    expected: Floats,
    input_errors: Floats,
    instant_noise_s: Floats,
    *,
    generator: np.random.Generator,
) -> Floats:
    """Return the matrix (K, K) that takes the true kinks to those that a fit finds.

    Parameters
    ----------
    fit
        Kinks of the chosen window.
    inputs, expected
        (N, p) inputs and (N, feet) expected contact instants, s.
    input_errors
        (p, p) covariance of the errors of the inputs.
    instant_noise_s
        (feet,) standard deviations of the noise in the measured instants, s.
    generator
        Source of the noise.
    """
    heights = kinks(expected) @ fit.seen
    total = np.zeros((fit.seen.shape[1],) * 2)
    for _ in range(_REPEATS):
        noisier = inputs + draws(input_errors, len(inputs), generator)
        instants = expected + instant_noise_s * generator.standard_normal(expected.shape)
        contacts = expected_contacts(noisier, instants)
        seen, coefficients = window_kinks(noisier, heights, contacts, fit.rows, fit.degree)
        total += fit.seen.T @ seen @ coefficients
    return total / _REPEATS


def calibrated(fit: KinkFit, attenuated: Floats) -> KinkFit:
    """Return the fit with the kinks as they would be without noise, and their covariance.

    Where noise leaves too little of some kink the fit is returned as it is.
    """
    if np.linalg.svd(attenuated, compute_uv=False).min() < _LEAST_LEFT:
        return fit
    restore = np.linalg.inv(attenuated)
    both = np.kron(restore, np.eye(fit.coefficients.shape[1]))
    return replace(
        fit,
        coefficients=restore @ fit.coefficients,
        covariance=both @ fit.covariance @ both.T,
        curvature=both @ fit.curvature @ both.T,
    )
