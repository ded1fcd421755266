"""What a simulated study would measure at the sections without noise, and its exact linear maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.recordings.truth import Truth
from hopdata.scenes.rigid_body import rotation_matrices
from hopdata.synthesis.known_scene import KnownScene, common_scene
from hopdata.synthesis.landings import SectionHeights, TrueLandings, true_landings
from hopdata.synthesis.markers import fixed_markers
from hopdata.synthesis.section_coordinates import INPUT_NAMES, OUTPUT_NAMES
from hopdata.synthesis.section_jacobians import section_jacobians

FloatArray = NDArray[np.float64]

RTOL = 1e-9


@dataclass(frozen=True)
class TrueStates:
    """Marker states of one recording at the sections; n landings count.

    Parameters
    ----------
    x, y : (n, 6B) array
        Positions of the B body markers (x1, y1, z1, x2, ...), m, and their velocities, m/s, in the
        world, at the pre and at the post section.
    schedule : (n,) array of str
        Orders of the contacts.
    spread_s : (n,) array
        Standard deviation of the contact instants, s.
    index : (n,) array of int
        Number of each landing in the truth.
    """

    x: FloatArray
    y: FloatArray
    schedule: NDArray[np.str_]
    spread_s: FloatArray
    index: NDArray[np.int64]


@one_blas_thread()
def true_states(truth: Truth, scene: KnownScene, sections: SectionHeights) -> TrueStates:
    """Integrate the landings of a recording to the sections.

    Parameters
    ----------
    truth : Truth
        Its apex states and preloads.
    scene : KnownScene
        What landed.
    sections : SectionHeights
        The sections of the study.
    """
    parts = [
        (rows, _landings(truth, replace(scene, hopper=hopper), rows, sections))
        for hopper, rows in scene.by_boom(len(truth.apex_states))
    ]
    index = np.concatenate([rows[found.whole] for rows, found in parts])
    order = np.argsort(index)

    def joined(name: str) -> Any:
        return np.concatenate([np.array(getattr(f, name))[f.whole] for _, f in parts])[order]

    return TrueStates(
        marker_states(joined("pre_state"), sections.points_m),
        marker_states(joined("post_state"), sections.points_m),
        joined("schedule"),
        joined("contact_s").std(axis=1),
        index[order],
    )


def _landings(
    truth: Truth, scene: KnownScene, rows: NDArray[np.int64], sections: SectionHeights
) -> TrueLandings:
    return true_landings(
        scene.hopper,
        scene.control,
        truth.apex_states[rows],
        truth.preloads_n[rows],
        sections,
        rtol=RTOL,
        workers=1,
    )


def marker_states(states: FloatArray, points_m: FloatArray) -> FloatArray:
    """Positions and velocities, (n, 6B), of points (B, 3) of the body, for states (n, 12)."""
    turning = np.cross(states[:, None, 9:12], points_m[None])
    rotation = rotation_matrices(states[:, 3:6])
    velocity = states[:, None, 6:9] + np.einsum("nij,nbj->nbi", rotation, turning)
    positions = fixed_markers(states, points_m)
    return np.hstack([positions.reshape(len(states), -1), velocity.reshape(len(states), -1)])


@one_blas_thread()
def exact_maps(truths: Sequence[Truth], sections: SectionHeights) -> dict[str, Any]:
    """Return the exact linear maps of a study as plain data.

    Returns
    -------
    dict
        ``inputs`` and ``outputs`` (names of the coordinates), ``body_points_m`` (B, 3),
        ``schedules`` (S), ``maps`` (S, 11, 8), and the input ``x`` (8) and outcomes ``y`` (S, 11)
        of the landing at which they hold.
    """
    scene = common_scene(truths)
    hopper, _ = next(scene.by_boom(0))
    rows = [next(scene.by_boom(len(truth.apex_states)))[1] for truth in truths]
    apexes = np.concatenate([t.apex_states[row] for t, row in zip(truths, rows, strict=True)])
    found = section_jacobians(replace(hopper, boom_swing_rad=0.0), scene.control, apexes, sections)
    return {
        "inputs": list(INPUT_NAMES),
        "outputs": list(OUTPUT_NAMES),
        "body_points_m": sections.points_m.tolist(),
        "schedules": list(found.schedules),
        "maps": found.maps.tolist(),
        "x": found.x.tolist(),
        "y": found.y.tolist(),
    }
