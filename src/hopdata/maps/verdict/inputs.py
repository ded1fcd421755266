"""Landings as the verdict sees them: a rigid body on a section, and the order to be expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

# The contact instants that the state before a landing leads one to expect.

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


# To which mode schedule a landing belongs, and how surely.

#: A half of a schedule's landings needs this many for each input.
_LANDINGS_PER_INPUT = 3


@dataclass(frozen=True)
class Memberships:
    """Schedules and the weight of each landing in them.

    Attributes
    ----------
    schedules
        Schedules seen, each as the feet (from 0) in the order of their contacts.
    weights
        (n, schedules), rows add up to one, or to zero for a landing without a schedule.
    """

    schedules: tuple[Feet, ...]
    weights: FloatArray


def memberships(instants: FloatArray, errors: FloatArray, least: int) -> Memberships:
    """Weigh schedules by the probability that the two contacts nearest in time are in this order.

    Parameters
    ----------
    instants, errors
        (n, feet) contact instants and their standard errors, s. A landing without an error counts
        as sure; one without an instant has no schedule.
    least
        Schedules with fewer landings are left out.
    """
    from scipy.special import ndtr

    n, feet = instants.shape
    known = np.asarray(np.isfinite(instants).all(axis=1))
    order = np.argsort(np.where(known[:, None], instants, 0.0), axis=1, kind="stable")
    times = np.take_along_axis(instants, order, axis=1)
    variance = np.take_along_axis(np.nan_to_num(errors) ** 2, order, axis=1)
    gaps = np.diff(times, axis=1)
    doubt = np.sqrt(variance[:, 1:] + variance[:, :-1])
    sure = np.divide(gaps, doubt, out=np.full_like(gaps, np.inf), where=doubt > 0)
    sure[~known] = np.inf
    place = np.argmin(sure, axis=1)
    rows = np.arange(n)
    probability = ndtr(sure[rows, place])
    swapped = order.copy()
    swapped[rows, place], swapped[rows, place + 1] = order[rows, place + 1], order[rows, place]
    own, other = _codes(order, feet), _codes(swapped, feet)
    codes, counts = np.unique(own[known], return_counts=True)
    kept = codes[counts >= least]
    weights = probability[:, None] * (own[:, None] == kept)
    weights += (1.0 - probability)[:, None] * (other[:, None] == kept)
    weights[~known] = 0.0
    first = [tuple(int(f) for f in order[known][np.argmax(own[known] == code)]) for code in kept]
    return Memberships(tuple(first), weights)


def large_classes(weights: FloatArray, n_inputs: int) -> list[NDArray[np.int64]]:
    """Return the landings of every schedule that has enough for a linear map of two halves each.

    Parameters
    ----------
    weights
        (n, schedules) membership of each landing; each counts where it weighs most.
    n_inputs
        Number of inputs p; a half needs three landings for each.
    """
    belongs = np.where(weights.max(axis=1) > 0.5, weights.argmax(axis=1), -1)
    classes = [np.flatnonzero(belongs == k) for k in range(weights.shape[1])]
    return [rows for rows in classes if len(rows) >= 2 * _LANDINGS_PER_INPUT * n_inputs]


def _codes(order: NDArray[np.int64], feet: int) -> NDArray[np.int64]:
    code: NDArray[np.int64] = order @ (feet ** np.arange(feet)[::-1])
    return code


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
    members
        Schedules to be expected, with weights.
    errors
        (8, 8) covariance of the errors of the inputs.
    instant_noise_s
        (feet,) scatter of the measured instants about those expected, s.
    """

    inputs: FloatArray
    outputs: FloatArray
    expected: FloatArray
    members: Memberships
    errors: FloatArray
    instant_noise_s: FloatArray

    @property
    def noise(self) -> FloatArray:
        """Standard deviations (8,) of the errors of the inputs, whose own are one."""
        deviations: FloatArray = np.sqrt(np.diag(self.errors))
        return deviations


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
        raise AnalysisError(f"{len(x)} landings with known contact instants")
    shape = body_shape(split_states(x)[0])
    before = rigid_states(x, shape)
    inputs, outputs = section_coordinates(before, rigid_states(y, shape))
    deviation = inputs.std(axis=0)
    least = inputs.shape[1] + 2  # an affine fit of the contact instants, with one landing to spare
    if len(x) < least:
        raise AnalysisError(
            f"landings with known contact instants: expected at least {least}, found {len(x)}"
        )
    if not (deviation > 0).all():
        raise AnalysisError("the states before the landing do not vary")
    inputs = (inputs - inputs.mean(axis=0)) / deviation
    outputs = (outputs - outputs.mean(axis=0)) * output_weights(shape, time_unit_s)
    expected = expected_contacts(inputs, instants)
    miss = instants - instants.mean(axis=1, keepdims=True) - expected
    doubt = 1.4826 * np.median(np.abs(miss), axis=0)
    members = memberships(expected, np.broadcast_to(doubt, expected.shape), LEAST_CLASS)
    errors = _input_errors(x, y, before, shape) / np.outer(deviation, deviation)
    return SectionLandings(inputs, outputs, expected, members, errors, doubt)


def _input_errors(
    x: FloatArray, y: FloatArray, before: RigidStates, shape: FloatArray
) -> FloatArray:
    """Return the covariance (8, 8) of the errors of the inputs, from what is not rigid in them."""
    if (before.velocity[:, 2] < 0).all():
        return input_errors(x, y, shape, marker_noise(x, shape)).inputs
    return np.diag(input_noise(before, shape) ** 2)  # no fall through a section, no noisy instant
