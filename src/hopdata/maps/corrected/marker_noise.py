"""Noise of a rigid body's markers, and the errors it causes in section coordinates.

Three or more markers on a rigid body contain more information than its motion needs.
The part that no rigid motion explains is noise in the positions and velocities. The two
are correlated: a velocity fitted to frames that end at a contact errs together with the
position from the same fit.

States are taken at the instant at which the measured mean height of the markers passes
the section. An error in that height is therefore an error of the instant, and shifts
all else along the motion. Both effects are propagated to first order to the coordinates
and to the errors that inputs and outputs share: steps and turns begin at the pre
section, and the heading there turns velocities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, FloatArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import rigid_states, section_coordinates, split_states
from hopdata.rigid import INPUT_NAMES

#: Largest number of landings at which the propagation is linearised; they are evenly
#: spaced.
#: Unit: landings. Origin: chosen.
LINEARISED = 100

#: Step of the central differences by a position.
#: Unit: m. Origin: chosen.
POSITION_STEP_M = 1e-5

#: Step of the central differences by a velocity.
#: Unit: m/s. Origin: chosen.
VELOCITY_STEP_M_S = 1e-4


@dataclass(frozen=True)
class MarkerNoise:
    """Covariance of the errors of one marker coordinate; coordinates err independently.

    Attributes
    ----------
    position
        Variance of positions, m^2.
    shared
        Covariance of the position and the velocity of the same coordinate, m^2/s.
    velocity
        Variance of velocities, m^2/s^2.
    """

    position: float
    shared: float
    velocity: float

    def covariance(self, n_markers: int) -> FloatArray:
        """Return the covariance (6B, 6B) of the state of `n_markers` markers."""
        one = np.array([[self.position, self.shared], [self.shared, self.velocity]])
        return np.asarray(np.kron(one, np.eye(3 * n_markers)))


@dataclass(frozen=True)
class InputErrors:
    """Covariances of the errors of inputs, and of errors that inputs and outputs share.

    Attributes
    ----------
    inputs
        (p, p) covariance of the errors of the inputs.
    shared
        (p, q) covariance between the errors of inputs and outputs.
    """

    inputs: FloatArray
    shared: FloatArray

    @classmethod
    def none(cls, n_inputs: int, n_outputs: int) -> InputErrors:
        """Return the covariances of inputs that are known exactly: zero."""
        return cls(np.zeros((n_inputs, n_inputs)), np.zeros((n_inputs, n_outputs)))


def marker_noise(states: FloatArray, shape: FloatArray) -> MarkerNoise:
    """Estimate the noise of markers from the residuals of a rigid-body fit.

    Parameters
    ----------
    states
        (n, 6B) positions, m, and velocities, m/s.
    shape
        (B, 3) markers in the body, m; see `hopdata.rigid.body_shape`.

    Raises
    ------
    AnalysisError
        If there are no landings.
    """
    if not len(states):
        raise AnalysisError.at("marker noise", "at least one landing", "none")
    positions, velocities = split_states(states)
    fit = rigid_states(states, shape)
    arms = np.einsum("nij,bj->nbi", fit.rotation, shape)
    turning = np.einsum("nij,nj->ni", fit.rotation, fit.spin)
    misses = positions - fit.centre[:, None] - arms
    slips = velocities - fit.velocity[:, None] - np.cross(turning[:, None], arms)
    free = (3 * len(shape) - 6) * len(states)
    return MarkerNoise(
        position=float(np.sum(misses * misses) / free),
        shared=float(np.sum(misses * slips) / free),
        velocity=float(np.sum(slips * slips) / free),
    )


def input_errors(
    before: FloatArray, after: FloatArray, shape: FloatArray, noise: MarkerNoise
) -> InputErrors:
    """Propagate the noise of the states at the pre section to inputs and outputs.

    Noise at the post section comes from other frames and is ignored: it adds scatter to
    the outputs but does not bias a map.

    Parameters
    ----------
    before, after
        (n, 6B) states at the two sections, m and m/s; the body is in free flight at the
        first.
    shape
        (B, 3) markers in the body, m.
    noise
        Noise of the states at the pre section.

    Raises
    ------
    AnalysisError
        If the body does not move down through the pre section in every landing.
    """
    every = -(-len(before) // LINEARISED)  # rounded up
    some_before = before[::every]
    some_after = after[::every]
    slopes = _slopes(some_before, some_after, shape) @ _at_noisy_instant(some_before)
    covariances = slopes @ noise.covariance(len(shape)) @ slopes.swapaxes(1, 2)
    mean = covariances.mean(axis=0)
    n_inputs = len(INPUT_NAMES)
    return InputErrors(mean[:n_inputs, :n_inputs], mean[:n_inputs, n_inputs:])


def _slopes(before: FloatArray, after: FloatArray, shape: FloatArray) -> FloatArray:
    """Return the derivatives (n, 19, 6B) of all coordinates by `before`."""
    post = rigid_states(after, shape)

    def coordinates(states: FloatArray) -> FloatArray:
        return np.hstack(section_coordinates(rigid_states(states, shape), post))

    half = before.shape[1] // 2
    steps = np.repeat([POSITION_STEP_M, VELOCITY_STEP_M_S], half)
    columns = []
    for step in np.diag(steps):
        change = coordinates(before + step) - coordinates(before - step)
        columns.append(change / (2 * step.max()))
    return np.stack(columns, axis=2)


def _at_noisy_instant(states: FloatArray) -> FloatArray:
    """Return matrices (n, 6B, 6B) from errors at an instant to those at the section."""
    _, velocities = split_states(states)
    n, markers, _ = velocities.shape
    sinking = velocities[..., 2].mean(axis=1)
    if not (sinking < 0).all():
        raise AnalysisError(
            "input errors: expected bodies that sink through the pre section"
        )
    height = np.tile([0.0, 0.0, 1.0 / markers], markers)
    falling = np.tile([0.0, 0.0, -GRAVITY_M_S2], (n, markers, 1))
    motion = np.concatenate([velocities, falling], axis=1).reshape(n, -1)
    late = np.concatenate([height, np.zeros_like(height)]) / sinking[:, None]
    return np.asarray(np.eye(motion.shape[1]) - motion[:, :, None] * late[:, None, :])


# Expected true inputs, given inputs measured with noise.
#
# This is regression calibration (Carroll, Ruppert, Stefanski and Crainiceanu 2006, ch.
# 4): least squares on the expected inputs is the moment estimate of errors in variables
# (Fuller 1987).

#: Least share of the inputs' variance, in every direction, that is not attributed to
#: noise. The correction multiplies no coefficient by more than its inverse.
#: Unit: 1. Origin: chosen.
LEAST_RELIABILITY = 0.3


@dataclass(frozen=True)
class Calibration:
    """Linear regression of the true inputs on the measured ones.

    Attributes
    ----------
    slopes
        (p, p) slopes; deviations of measured inputs from the mean are multiplied by
        them from the right.
    doubt
        (p, p) covariance of the true inputs about their expected values.
    drift
        (p, q) slopes of the outputs' errors on the measured inputs.
    removed
        Share of the noise covariance that was subtracted.
    """

    slopes: FloatArray
    doubt: FloatArray
    drift: FloatArray
    removed: float


def calibration(x: FloatArray, errors: InputErrors) -> Calibration:
    """Return the regression of the true inputs on inputs measured with noise.

    The measured covariance minus that of the noise need not be positive, and where it
    nearly vanishes the estimate becomes erratic. As in Fuller (1987, sec. 2.2), the
    noise is then subtracted only in part, such that `LEAST_RELIABILITY` of the variance
    is left in every direction.

    Parameters
    ----------
    x
        (n, p) measured inputs.
    errors
        Covariances of the errors of inputs and outputs.

    Raises
    ------
    AnalysisError
        If the inputs do not vary in some direction.
    """
    noise = errors.inputs
    moments = np.cov(x, rowvar=False).reshape(noise.shape)
    try:
        root = np.linalg.cholesky(moments)
    except np.linalg.LinAlgError as error:
        raise AnalysisError(
            "map: expected inputs that vary in all directions"
        ) from error
    # Share of noise in the variance along each principal direction, increasing.
    whitened_noise = np.linalg.solve(root, np.linalg.solve(root, noise).T)
    noise_shares = np.linalg.eigvalsh(whitened_noise)
    bearable = 1.0 - LEAST_RELIABILITY
    removed = 1.0
    if noise_shares[-1] > bearable:
        removed = bearable / float(noise_shares[-1])
    error_slopes = np.linalg.solve(moments, removed * noise)
    drift = np.linalg.solve(moments, removed * errors.shared)
    return Calibration(
        slopes=np.eye(len(noise)) - error_slopes,
        doubt=removed * noise - removed * noise @ error_slopes,
        drift=np.asarray(drift, float),
        removed=removed,
    )
