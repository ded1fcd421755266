"""Landings as the verdict sees them: a rigid body on a section, and the order to be expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import (
    Feet,
    RigidStates,
    affordable_degree,
    input_noise,
    monomials,
    output_weights,
    rigid_states,
    section_coordinates,
    split_states,
)
from hopdata.maps.corrected.marker_noise import input_errors, marker_noise
from hopdata.rigid import body_shape

# The contact instants, and their orders, that the state before a landing leads one to expect.

_OUTLYING = 5.0


def expected_contacts(x: FloatArray, instants: FloatArray) -> FloatArray:
    """Return the contact instants (N, feet) that the inputs lead one to expect, mean removed.

    A polynomial of the inputs fitted to the measured instants, so that errors of these, which the
    outputs may share, move no landing across a kink. Its degree is the one that predicts best with
    each landing left out; landings whose instants lie far off take no part.
    """
    t = instants - instants.mean(axis=1, keepdims=True)
    highest = affordable_degree(len(x), x.shape[1], t.shape[1])
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
    expected: FloatArray = best - best.mean(axis=1, keepdims=True)
    return expected


def contact_orders(instants: FloatArray, least: int) -> tuple[Feet, ...]:
    """Return the orders, each as its feet from 0, that `least` landings (N, feet) or more have."""
    order = np.argsort(instants, axis=1, kind="stable")
    orders, counts = np.unique(order, axis=0, return_counts=True)
    return tuple(tuple(feet) for feet in orders[counts >= least].tolist())


#: Schedules with fewer landings play no part.
LEAST_CLASS = 20


@dataclass(frozen=True)
class SectionLandings:
    """Landings of a study, n of them.

    Attributes
    ----------
    inputs
        (n, 8) standardised coordinates at the pre section.
    outputs
        (n, 11) coordinates at the post section, as displacements of the markers, m.
    expected
        (n, feet) contact instants to be expected from the inputs, s, mean of the feet removed.
    schedules
        Mode schedules to be expected for `LEAST_CLASS` landings or more, each as its feet from 0.
    errors
        (8, 8) covariance of the errors of the inputs.
    instant_noise_s
        (feet,) scatter of the measured instants about those expected, s.
    """

    inputs: FloatArray
    outputs: FloatArray
    expected: FloatArray
    schedules: tuple[Feet, ...]
    errors: FloatArray
    instant_noise_s: FloatArray


def section_landings(
    x: FloatArray, y: FloatArray, instants: FloatArray, time_unit_s: float
) -> SectionLandings:
    """Bring pairs to rigid-body coordinates, and find the schedules that they lead to.

    Schedules are those to be expected from the inputs: measured ones err together with the states,
    and so would make maps differ that do not.

    Parameters
    ----------
    x, y
        (n, 6B) home-frame states at the two sections, m and m/s.
    instants
        (n, feet) contact instants, s.
    time_unit_s
        Unit of time that weighs velocities against positions.

    Raises
    ------
    AnalysisError
        If there are too few landings or markers, or nothing varies.
    """
    if len(x) < 2:
        raise AnalysisError(f"{len(x)} touchdowns with known contact instants")
    shape = body_shape(split_states(x)[0])
    before = rigid_states(x, shape)
    inputs, outputs = section_coordinates(before, rigid_states(y, shape))
    deviation = inputs.std(axis=0)
    least = inputs.shape[1] + 2  # an affine fit of the contact instants, with one landing to spare
    if len(x) < least:
        raise AnalysisError(
            f"touchdowns with known contact instants: expected at least {least}, found {len(x)}"
        )
    if not (deviation > 0).all():
        raise AnalysisError("the states before the landing do not vary")
    inputs = (inputs - inputs.mean(axis=0)) / deviation
    outputs = (outputs - outputs.mean(axis=0)) * output_weights(shape, time_unit_s)
    expected = expected_contacts(inputs, instants)
    miss = instants - instants.mean(axis=1, keepdims=True) - expected
    doubt = 1.4826 * np.median(np.abs(miss), axis=0)
    schedules = contact_orders(expected, LEAST_CLASS)
    errors = _input_errors(x, y, before, shape) / np.outer(deviation, deviation)
    return SectionLandings(inputs, outputs, expected, schedules, errors, doubt)


def _input_errors(
    x: FloatArray, y: FloatArray, before: RigidStates, shape: FloatArray
) -> FloatArray:
    """Return the covariance (8, 8) of the errors of the inputs, from what is not rigid in them."""
    if (before.velocity[:, 2] < 0).all():
        return input_errors(x, y, shape, marker_noise(x, shape)).inputs
    return np.diag(input_noise(before, shape) ** 2)  # no fall through a section, no noisy instant
