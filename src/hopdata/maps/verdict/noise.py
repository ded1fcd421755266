"""Noise of the states before the landing, as errors of the verdict's inputs.

Three or more markers on a rigid body tell their own noise: what no rigid motion
explains. Propagated to the inputs, it says how uncertain the expected contact instants
are. A state that is taken where the measured height of the body passes the section errs
in its instant as well, which shifts all else along the motion.
"""

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import rigid_states, split_states
from hopdata.maps.corrected.marker_noise import LINEARISED, MarkerNoise
from hopdata.maps.verdict.coordinates import state_inputs
from hopdata.maps.verdict.linear import regular
from hopdata.rigid import turned, twists

#: Least share of the variance of the inputs, in any direction, that is not attributed
#: to noise.
#: Unit: 1. Origin: convention: as for the corrected maps (`LEAST_RELIABILITY`).
LEAST_RELIABLE = 0.3

#: States lie on a section if their mean height varies by less than this share of the
#: noise of a marker. Heights that a section did not fix vary by about as much.
#: Unit: 1. Origin: chosen.
ON_SECTION = 1e-3

#: Step of the central differences.
#: Unit: the body's size and its speed. Origin: rounding.
STEP = 1e-5


def state_noise(
    states: FloatArray, shape: FloatArray, noise: MarkerNoise
) -> FloatArray:
    """Return the covariance (8, 8) of the errors of tilt, velocity and spin.

    Parameters
    ----------
    states
        (n, 6B) states at the pre section, in units of the body's size and speed.
    shape
        (B, 3) markers in the body, in the same unit of length.
    noise
        Noise of a marker's coordinate, in the same units.
    """
    every = -(-len(states) // LINEARISED)  # rounded up
    some = _along_heading(states[::every], shape)
    slopes = _slopes(some, shape)
    heights = split_states(states)[0][..., 2].mean(axis=1)
    if heights.std() < ON_SECTION * np.sqrt(noise.position):
        slopes = slopes @ _at_noisy_instant(some)
    covariances = slopes @ noise.covariance(len(shape)) @ slopes.swapaxes(1, 2)
    return np.asarray(covariances.mean(axis=0))


def _along_heading(states: FloatArray, shape: FloatArray) -> FloatArray:
    """Return states (n, 6B) in axes of which the first points along the heading.

    The frame of the states then changes nothing, to rounding.
    """
    heading = twists(rigid_states(states, shape).rotation)
    vectors = states.reshape(len(states), -1, 3)
    markers = range(vectors.shape[1])
    along = [turned(vectors[:, one], heading) for one in markers]
    return np.stack(along, axis=1).reshape(states.shape)


def _slopes(states: FloatArray, shape: FloatArray) -> FloatArray:
    """Return the derivatives (n, 8, 6B) of the inputs by the states."""
    columns = []
    for step in STEP * np.eye(states.shape[1]):
        ahead = state_inputs(rigid_states(states + step, shape))
        behind = state_inputs(rigid_states(states - step, shape))
        columns.append((ahead - behind) / (2.0 * STEP))
    return np.stack(columns, axis=2)


def _at_noisy_instant(states: FloatArray) -> FloatArray:
    """Return matrices (n, 6B, 6B) from errors at an instant to those at the section.

    An error of the mean height moves the instant, and so the positions along their
    velocities. That gravity meanwhile changes the velocities is left out: it is a
    fortieth of their own errors (0.1 ms of fall beside 0.04 m/s).
    """
    positions, velocities = split_states(states)
    n, markers, _ = positions.shape
    sinking = velocities[..., 2].mean(axis=1)
    moves_on = np.abs(sinking) > ON_SECTION
    rate = np.where(moves_on, 1.0 / np.where(moves_on, sinking, 1.0), 0.0)
    height = np.tile([0.0, 0.0, 1.0 / markers], markers)
    late = np.concatenate([height, np.zeros_like(height)]) * rate[:, None]
    motion = np.concatenate([velocities, np.zeros_like(velocities)], axis=1)
    motion = motion.reshape(n, -1)
    return np.asarray(np.eye(motion.shape[1]) - motion[:, :, None] * late[:, None, :])


def believable(noise: FloatArray, measured: FloatArray) -> FloatArray:
    """Return as much of a noise covariance as leaves `LEAST_RELIABLE` of the measured.

    Parameters
    ----------
    noise, measured
        (p, p) covariances of the errors of the inputs, and of the measured inputs.
    """
    root = np.linalg.cholesky(regular(measured))
    whitened = np.linalg.solve(root, np.linalg.solve(root, noise).T)
    shares, directions = np.linalg.eigh(whitened)
    shares = np.clip(shares, 0.0, 1.0 - LEAST_RELIABLE)
    turned = root @ directions
    return np.asarray((turned * shares) @ turned.T)


def unforetold_by_noise(
    inputs: FloatArray, expected: FloatArray, noise: FloatArray
) -> FloatArray:
    """Return the covariance of what noise of the inputs hides of the instants.

    It is that of the true expected instants given the measured inputs: B' C B, where C
    is the covariance of the true inputs given the measured ones, and B the slopes of
    the instants by the true inputs. This is regression calibration (Carroll, Ruppert,
    Stefanski and Crainiceanu 2006, ch. 4).

    Parameters
    ----------
    inputs, expected
        (n, p) measured inputs, and (n, feet) instants expected from them.
    noise
        (p, p) covariance of the errors of the inputs, as `believable` returns it.
    """
    measured = regular(np.cov(inputs.T))
    true = measured - noise
    given = noise - noise @ np.linalg.solve(measured, noise)
    centred = inputs - inputs.mean(axis=0)
    weakened = np.linalg.lstsq(centred, expected, rcond=None)[0]
    slopes = np.linalg.solve(true, measured @ weakened)
    hidden = slopes.T @ given @ slopes
    return np.asarray(0.5 * (hidden + hidden.T))
