"""The exact linear map of a study as marker states, which any choice of coordinates can read.

Neighbours of the landing with simultaneous contact, each with one coordinate at the pre section
moved a little: what their markers do at the post section is the derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.truth import Truth
from hopdata.scenes.rigid_body import rotation_matrices
from hopdata.synthesis.known_scene import common_scene
from hopdata.synthesis.landings import SectionHeights, true_landings
from hopdata.synthesis.section_jacobians import SectionJacobians, section_jacobians

FloatArray = NDArray[np.float64]

# Of tilts, rad, velocities, m/s, and spins, rad/s: central differences err by their squares.
STEPS = np.repeat([1e-4, 1e-4, 5e-4], [2, 3, 3])


@dataclass(frozen=True)
class KnownMap:
    """Exact linear map, mean of all schedules, and the landings that it is compared for.

    Parameters
    ----------
    before, after : (16, 6B) array
        Marker states of the neighbours at the sections, m and m/s: eight moved to one side, then
        the same to the other.
    states : (n, 6B) array
        True marker states of the study's landings at the pre section.
    points_m : (B, 3) array
        Body markers, body frame, m.
    """

    before: FloatArray
    after: FloatArray
    states: FloatArray
    points_m: FloatArray


def known_map(
    truths: Sequence[Truth], *, pre_m: float, post_m: float, workers: int | None = None
) -> KnownMap:
    """Compute the exact map of a simulated study.

    Parameters
    ----------
    truths : sequence of Truth
        Of all its recordings; of a boom that swings, only hops with the first hop's are taken.
    pre_m, post_m : float
        Heights of the sections, m.
    workers : int, optional
        Threads.
    """
    scene = common_scene(truths)
    rows = [next(scene.by_boom(len(truth.apex_states)))[1] for truth in truths]
    apexes = np.concatenate([t.apex_states[row] for t, row in zip(truths, rows, strict=True)])
    preloads = np.concatenate([t.preloads_n[row] for t, row in zip(truths, rows, strict=True)])
    sections = SectionHeights(pre_m, post_m, scene.body_points_m)
    found = true_landings(scene.hopper, scene.control, apexes, preloads, sections, workers=workers)
    exact = section_jacobians(scene.hopper, scene.control, apexes, sections)
    states = marker_states(found.pre_state[found.whole], scene.body_points_m)
    return KnownMap(*neighbours(exact, sections), states, scene.body_points_m)


def neighbours(exact: SectionJacobians, sections: SectionHeights) -> tuple[FloatArray, FloatArray]:
    """Return marker states (16, 6B) of neighbouring landings at both sections."""
    moved = np.vstack([np.diag(STEPS), -np.diag(STEPS)])
    inputs = exact.x + moved
    outcomes = exact.y.mean(axis=0) + moved @ exact.maps.mean(axis=0).T
    start = np.zeros((len(moved), 3))
    start[:, 2] = sections.pre_m
    end = np.column_stack([outcomes[:, :2], np.full(len(moved), sections.post_m)])
    before = state_of(start, np.zeros(len(moved)), inputs, sections.centre_m)
    after = state_of(end, outcomes[:, 2], outcomes[:, 3:], sections.centre_m)
    return marker_states(before, sections.points_m), marker_states(after, sections.points_m)


def state_of(
    centre: FloatArray, yaw: FloatArray, coordinates: FloatArray, centre_m: FloatArray
) -> FloatArray:
    """Return states (n, 12) with these places, headings and coordinates.

    Parameters
    ----------
    centre : (n, 3) array
        Mean of the body markers, world frame, m.
    yaw : (n,) array
        Headings, rad.
    coordinates : (n, 8) array
        See `hopdata.synthesis.section_coordinates`; velocities in the world frame.
    centre_m : (3,) array
        Mean of the body markers, body frame, m.
    """
    states = np.zeros((len(centre), 12))
    states[:, 3], states[:, 4:6], states[:, 9:] = yaw, coordinates[:, :2], coordinates[:, 5:]
    rotation = rotation_matrices(states[:, 3:6])
    states[:, :3] = centre - rotation @ centre_m
    arm = np.cross(states[:, 9:], centre_m)
    states[:, 6:9] = coordinates[:, 2:5] - np.einsum("nij,nj->ni", rotation, arm)
    return states


def marker_states(states: FloatArray, points_m: FloatArray) -> FloatArray:
    """Return positions and velocities (n, 6B) of points (B, 3) fixed in the body, m and m/s."""
    rotation = rotation_matrices(states[:, 3:6])
    positions = states[:, None, :3] + np.einsum("nij,bj->nbi", rotation, points_m)
    arms = np.cross(states[:, None, 9:], points_m)
    velocities = states[:, None, 6:9] + np.einsum("nij,nbj->nbi", rotation, arms)
    return np.concatenate([positions, velocities], axis=1).reshape(len(states), -1)
