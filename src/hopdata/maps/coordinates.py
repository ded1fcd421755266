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
    centre, velocity = positions.mean(axis=1), velocities.mean(axis=1)
    rotation = kabsch(positions - centre[:, None], shape)
    arms = np.einsum("nij,bj->nbi", rotation, shape)
    moving = velocities - velocity[:, None]
    inertia = np.einsum("nbi,nbi->n", arms, arms)[:, None, None] * np.eye(3)
    inertia = inertia - np.einsum("nbi,nbj->nij", arms, arms)
    turning = np.linalg.solve(inertia, np.cross(arms, moving).sum(axis=1)[..., None])[
        ..., 0
    ]
    return RigidStates(
        centre, velocity, rotation, np.einsum("nji,nj->ni", rotation, turning)
    )


def section_coordinates(
    pre: RigidStates, post: RigidStates
) -> tuple[FloatArray, FloatArray]:
    """Return inputs (n, 8) and outputs (n, 11): see `INPUT_NAMES` and `OUTPUT_NAMES` in `rigid`.

    Steps and velocities are in the heading frame of the state at the pre section.
    """
    yaw, after = headings(pre.rotation), headings(post.rotation)
    step = turned(post.centre - pre.centre, yaw)[:, :2]
    x = np.column_stack([_tilt(pre.rotation), turned(pre.velocity, yaw), pre.spin])
    y = np.column_stack([_tilt(post.rotation), turned(post.velocity, yaw), post.spin])
    return x, np.column_stack([step, wrapped(after - yaw), y])


def output_weights(shape: FloatArray, time_unit_s: float) -> FloatArray:
    """Return weights (11,) that turn outputs into rms displacements of the markers, m.

    Angles are weighted by the rms distance of the markers from the axis, velocities by
    the distance covered in the unit of time.
    """
    about = np.sqrt(np.mean((shape**2).sum(axis=1, keepdims=True) - shape**2, axis=0))
    position = np.concatenate([[1.0, 1.0, about[2]], about[[1, 0]]])
    return np.concatenate([position, time_unit_s * np.ones(3), time_unit_s * about])


def _tilt(rotation: FloatArray) -> FloatArray:
    pitch = -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0))
    return np.column_stack([pitch, np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])])


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
ALL_SETS_UP_TO = 3
Feet = tuple[int, ...]


def foot_sets(n_feet: int) -> list[Feet]:
    """Return the sets of feet whose latest contacts are the kinks.

    >>> foot_sets(3)
    [(0, 1), (0, 2), (1, 2), (0, 1, 2)]
    """
    sizes = range(2, 1 + (n_feet if n_feet <= ALL_SETS_UP_TO else 2))
    return [feet for size in sizes for feet in combinations(range(n_feet), size)]


def kinks(instants: FloatArray) -> FloatArray:
    """Return the latest contact in each set of feet, (n, K), relative to the mean over all feet.

    Parameters
    ----------
    instants
        (n, feet) contact instants.
    """
    t = instants - instants.mean(axis=1, keepdims=True)
    return np.column_stack([t[:, feet].max(axis=1) for feet in foot_sets(t.shape[1])])


def kink_slopes(order: Feet) -> FloatArray:
    """Return the derivatives (K, feet) of the kinks with respect to the contact instants.

    They are constant on one schedule.

    Parameters
    ----------
    order
        Feet in the order of their contacts.
    """
    sets = foot_sets(len(order))
    slopes = np.zeros((len(sets), len(order)))
    for row, feet in enumerate(sets):
        slopes[row, max(feet, key=order.index)] = 1.0
    return slopes - 1.0 / len(order)


def time_differences(instants: FloatArray) -> FloatArray:
    """Return the difference between the contact instants of each pair of feet, (n, pairs)."""
    pairs = list(combinations(range(instants.shape[1]), 2))
    return np.column_stack([instants[:, i] - instants[:, j] for i, j in pairs])


# Free smooth terms of a landing map: monomials of the inputs, as many as the landings
# allow.

#: Number of landings required for each free term.
LANDINGS_PER_TERM = 2.5


def monomials(x: FloatArray, degrees: tuple[int, ...]) -> FloatArray:
    """Return all products of columns of `x` (n, p) of the given degrees, (n, terms)."""
    return np.hstack([_products_of(x, degree) for degree in degrees])


def _products_of(x: FloatArray, degree: int) -> FloatArray:
    chosen = list(combinations_with_replacement(range(x.shape[1]), degree))
    factors = np.array(chosen, dtype=np.int64).reshape(-1, degree).T
    return np.asarray(reduce(np.multiply, (x[:, factor] for factor in factors)))


def number_of_free_terms(n_inputs: int, n_feet: int, degree: int) -> int:
    """Return the number of monomials up to a degree, plus two terms for each pair of feet."""
    return comb(n_inputs + degree, degree) + n_feet * (n_feet - 1)


def affordable_degree(
    landings: int, n_inputs: int, n_feet: int, per_term: float = LANDINGS_PER_TERM
) -> int:
    """Return the highest degree of free terms that this number of landings allows: 3, 2, 1 or 0."""
    terms = (number_of_free_terms(n_inputs, n_feet, degree) for degree in (1, 2, 3))
    return sum(landings >= per_term * number for number in terms)
