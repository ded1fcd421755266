"""Landings as motion capture would see them, without the frames between.

About each section every marker moves on a parabola through its true state; frames of it are drawn
at random phases, with noise, and go through the same fits as a recording's. So errors of the
states have the size and the correlations that the pipeline gives them, at a hundredth of its cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.landings.states import GRAVITY_M_S2, SectionStates, section_states
from hopdata.scenes.rigid_body import rotation_matrices
from hopdata.synthesis.landings import SectionHeights, TrueLandings

RATE_HZ = 100.0
REACH_S = 0.16
APART_S = 1.0
STANCE_M_S2 = 12.0  # upward, typical of the mean body marker at the post section


@dataclass(frozen=True)
class SeenLandings:
    """Marker states (n, 6B) before and after, m and m/s, and contact instants (n, feet), s."""

    before: np.ndarray
    after: np.ndarray
    instants: np.ndarray


def see_landings(
    landings: TrueLandings,
    sections: SectionHeights,
    *,
    noise_m: float,
    instant_noise_s: float,
    rng: np.random.Generator,
) -> SeenLandings:
    """Observe whole landings; those whose states cannot be fitted are left out."""
    contact = landings.contact_s
    pre = _observed(
        landings.pre_state, landings.pre_time_s, contact.min(axis=1), -GRAVITY_M_S2,
        sections, "before", noise_m, rng,
    )  # fmt: skip
    post = _observed(
        landings.post_state, landings.post_time_s, contact.max(axis=1), STANCE_M_S2,
        sections, "after", noise_m, rng,
    )  # fmt: skip
    seen = contact + instant_noise_s * rng.standard_normal(contact.shape)
    before, after = (_flat(states) for states in (pre, post))
    whole = np.isfinite(before).all(axis=1) & np.isfinite(after).all(axis=1)
    return SeenLandings(before[whole], after[whole], seen[whole])


def marker_states(states: np.ndarray, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return true positions and velocities (n, B, 3) of markers fixed in the body."""
    rotation = rotation_matrices(states[:, 3:6])
    arms = np.einsum("nij,bj->nbi", rotation, points_m)
    slip = np.einsum("nij,nbj->nbi", rotation, np.cross(states[:, None, 9:], points_m[None]))
    return states[:, None, :3] + arms, states[:, None, 6:9] + slip


def _observed(
    states: np.ndarray,
    at_s: np.ndarray,
    contact_s: np.ndarray,
    vertical_m_s2: float,
    sections: SectionHeights,
    side: str,
    noise_m: float,
    rng: np.random.Generator,
) -> SectionStates:
    position, velocity = marker_states(states, sections.points_m)
    start = APART_S * np.arange(len(states))
    offsets = np.arange(-REACH_S, REACH_S, 1.0 / RATE_HZ)
    tau = offsets + rng.uniform(0, 1.0 / RATE_HZ, (len(states), 1))
    tracks = position[:, None] + velocity[:, None] * tau[:, :, None, None]
    tracks[..., 2] += 0.5 * vertical_m_s2 * tau[:, :, None] ** 2
    tracks += noise_m * rng.standard_normal(tracks.shape)
    return section_states(
        (start[:, None] + tau).ravel(),
        tracks.reshape(-1, *tracks.shape[2:]),
        start,
        height_m=sections.pre_m if side == "before" else sections.post_m,
        side=side,
        contact=start + contact_s - at_s,
    )


def _flat(states: SectionStates) -> np.ndarray:
    both = np.concatenate([states.position, states.velocity], axis=1)
    return both.reshape(len(both), -1)
