"""Landings as the verdict sees them: a rigid body on a section, and the order to be expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.maps.corrected.marker_noise import input_errors, marker_noise
from hopdata.maps.rigid import (
    RigidStates,
    body_shape,
    input_noise,
    output_weights,
    rigid_states,
    section_coordinates,
    split_states,
)
from hopdata.maps.verdict.expected_contacts import contact_orders, expected_contacts
from hopdata.maps.verdict.kinks import Feet

#: Schedules with fewer landings play no part.
LEAST_CLASS = 20

Floats = NDArray[np.float64]


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

    inputs: Floats
    outputs: Floats
    expected: Floats
    schedules: tuple[Feet, ...]
    errors: Floats
    instant_noise_s: Floats


def section_landings(x: Floats, y: Floats, instants: Floats, time_unit_s: float) -> SectionLandings:
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


def _input_errors(x: Floats, y: Floats, before: RigidStates, shape: Floats) -> Floats:
    """Return the covariance (8, 8) of the errors of the inputs, from what is not rigid in them."""
    if (before.velocity[:, 2] < 0).all():
        return input_errors(x, y, shape, marker_noise(x, shape)).inputs
    return np.diag(input_noise(before, shape) ** 2)  # no fall through a section, no noisy instant
