"""Coordinates of a rigid body on a section, computed from marker states.

Three or more markers on one rigid body have 6B coordinates and twelve degrees of
freedom. The section removes one of these, and leaving out place and heading removes
three. Eight remain: pitch and roll, the velocity of the centre in the heading frame,
and the angular velocity. Eleven numbers describe the outcome of a landing: the change
of place and heading, and the same eight coordinates at the post section.

Angles are those of the body relative to its mean attitude, about axes that turn with
its heading, so they stay small and free of singularities for any body that lands on its
feet.
"""

from dataclasses import dataclass
from functools import reduce
from itertools import combinations, combinations_with_replacement
from math import comb

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.rigid import headings, kabsch, turned, wrapped


@dataclass(frozen=True)
class RigidStates:
    """States of a rigid body, in the frame of the marker states.

    Attributes
    ----------
    centre, velocity
        (n, 3) mean position of the markers, m, and its velocity, m/s.
    rotation
        (n, 3, 3) rotation from the mean attitude to the present one.
    spin
        (n, 3) angular velocity in body axes, rad/s.
    """

    centre: FloatArray
    velocity: FloatArray
    rotation: FloatArray
    spin: FloatArray


def split_states(states: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split (n, 6B) states into positions and velocities, (n, B, 3) each."""
    positions, velocities = np.split(np.asarray(states, float), 2, axis=1)
    shape = (len(states), positions.shape[1] // 3, 3)
    return positions.reshape(shape), velocities.reshape(shape)


def rigid_states(states: FloatArray, shape: FloatArray) -> RigidStates:
    """Fit a rigid body to marker states.

    Parameters
    ----------
    states
        (n, 6B) positions, m, and velocities, m/s.
    shape
        (B, 3) markers in the body, m; see `body_shape`.
    """
    positions, velocities = split_states(states)
    centre = positions.mean(axis=1)
    velocity = velocities.mean(axis=1)
    rotation = kabsch(positions - centre[:, None], shape)

    # The angular velocity is the angular momentum about the centre over the inertia,
    # with a unit mass at each marker.
    arms = np.einsum("nij,bj->nbi", rotation, shape)
    relative_velocity = velocities - velocity[:, None]
    momentum = np.cross(arms, relative_velocity).sum(axis=1)
    squared_arms = np.einsum("nbi,nbi->n", arms, arms)
    outer_products = np.einsum("nbi,nbj->nij", arms, arms)
    inertia = squared_arms[:, None, None] * np.eye(3) - outer_products
    angular_velocity = np.linalg.solve(inertia, momentum[..., None])[..., 0]
    spin = np.einsum("nji,nj->ni", rotation, angular_velocity)
    return RigidStates(centre, velocity, rotation, spin)


def section_coordinates(
    pre: RigidStates, post: RigidStates
) -> tuple[FloatArray, FloatArray]:
    """Return inputs (n, 8) and outputs (n, 11).

    `INPUT_NAMES` and `OUTPUT_NAMES` in `hopdata.rigid` name them. Steps and velocities
    are in the heading frame of the state at the pre section.
    """
    heading = headings(pre.rotation)
    turn = wrapped(headings(post.rotation) - heading)
    step = turned(post.centre - pre.centre, heading)[:, :2]
    velocity_before = turned(pre.velocity, heading)
    velocity_after = turned(post.velocity, heading)

    inputs = [_tilt(pre.rotation), velocity_before, pre.spin]
    outputs = [step, turn, _tilt(post.rotation), velocity_after, post.spin]
    return np.column_stack(inputs), np.column_stack(outputs)


def output_weights(shape: FloatArray, time_unit_s: float) -> FloatArray:
    """Return weights (11,) that turn outputs into rms displacements of the markers, m.

    Angles are weighted by the rms distance of the markers from the axis, velocities by
    the distance covered in the unit of time.
    """
    squared_distances = (shape**2).sum(axis=1, keepdims=True) - shape**2
    about_x, about_y, about_z = np.sqrt(np.mean(squared_distances, axis=0)).tolist()
    step = [1.0, 1.0]
    turn = [about_z]
    tilt = [about_y, about_x]  # pitch, then roll
    velocity = [time_unit_s] * 3
    spin = [time_unit_s * about_x, time_unit_s * about_y, time_unit_s * about_z]
    return np.array([*step, *turn, *tilt, *velocity, *spin])


def _tilt(rotation: FloatArray) -> FloatArray:
    pitch = -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0))
    roll = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
    return np.column_stack([pitch, roll])


# Kinks: the shape of a landing map that is not C1 near a simultaneous contact.
#
# The flow of an event-selected system is continuous, and to first order it is linear on
# each mode schedule (Burden et al. 2016; chapter I of the dissertation). The maps of
# two schedules can differ only in how they depend on the contact instants, and they
# must agree where two feet touch at once. So the difference from one linear map is a
# continuous function of the contact instants that is linear on each contact order. The
# functions "latest contact of a set of feet" span all such functions; there are 2^n - n
# - 1 of them for n feet. Their coefficients in the map are all zero exactly if the map
# has one derivative.
#
# A C1 map can still have second derivatives that differ between schedules. The
# differences begin with the signed square of the time between two contacts, ``d |d|``,
# and continue with ``|d|^3``.

#: Up to this many feet the kinks of all sets of feet are used; with more feet only
#: those of pairs.
#: Unit: feet. Origin: chosen.
ALL_SETS_UP_TO = 3

Feet = tuple[int, ...]


def foot_sets(n_feet: int) -> list[Feet]:
    """Return the sets of feet whose latest contacts are the kinks.

    >>> foot_sets(3)
    [(0, 1), (0, 2), (1, 2), (0, 1, 2)]
    """
    largest = 2
    if n_feet <= ALL_SETS_UP_TO:
        largest = n_feet
    sets: list[Feet] = []
    for size in range(2, largest + 1):
        sets.extend(combinations(range(n_feet), size))
    return sets


def kinks(instants: FloatArray) -> FloatArray:
    """Return the latest contact in each set of feet, (n, K).

    Instants are relative to the mean over all feet.

    Parameters
    ----------
    instants
        (n, feet) contact instants.
    """
    relative = instants - instants.mean(axis=1, keepdims=True)
    sets = foot_sets(instants.shape[1])
    return np.column_stack([relative[:, feet].max(axis=1) for feet in sets])


def kink_slopes(order: Feet) -> FloatArray:
    """Return the derivatives (K, feet) of the kinks by the contact instants.

    They are constant on one schedule.

    Parameters
    ----------
    order
        Feet in the order of their contacts.
    """
    sets = foot_sets(len(order))
    slopes = np.zeros((len(sets), len(order)))
    for row, feet in enumerate(sets):
        latest = max(feet, key=order.index)
        slopes[row, latest] = 1.0
    return slopes - 1.0 / len(order)


def time_differences(instants: FloatArray) -> FloatArray:
    """Return the times between the contacts of each pair of feet, (n, pairs)."""
    pairs = list(combinations(range(instants.shape[1]), 2))
    return np.column_stack([instants[:, i] - instants[:, j] for i, j in pairs])


# Free smooth terms of a landing map: monomials of the inputs, as many as the landings
# allow.

#: Number of landings required for each free term.
#: Unit: landings. Origin: chosen.
LANDINGS_PER_TERM = 2.5


def monomials(x: FloatArray, degrees: tuple[int, ...]) -> FloatArray:
    """Return all products of columns of `x` (n, p) of the given degrees, (n, terms)."""
    return np.hstack([_products_of(x, degree) for degree in degrees])


def _products_of(x: FloatArray, degree: int) -> FloatArray:
    terms = list(combinations_with_replacement(range(x.shape[1]), degree))
    columns_of_factors = np.array(terms, dtype=np.int64).reshape(-1, degree).T
    factors = [x[:, columns] for columns in columns_of_factors]
    return np.asarray(reduce(np.multiply, factors))


def number_of_free_terms(n_inputs: int, n_feet: int, degree: int) -> int:
    """Return the number of free terms up to a degree.

    They are the monomials of the inputs, and two terms for each pair of feet.
    """
    of_pairs = n_feet * (n_feet - 1)
    return comb(n_inputs + degree, degree) + of_pairs


def affordable_degree(
    landings: int, n_inputs: int, n_feet: int, per_term: float = LANDINGS_PER_TERM
) -> int:
    """Return the highest degree of free terms that the landings allow: 3, 2, 1 or 0."""
    for degree in (3, 2, 1):
        if landings >= per_term * number_of_free_terms(n_inputs, n_feet, degree):
            return degree
    return 0
