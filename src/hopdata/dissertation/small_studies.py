"""Small simulated studies: the states at the sections, with and without noise.

They are not seen by a camera: the true states are integrated, and noise of the size
that the sample's states have is added to them. So a study of 900 hops takes a second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hopdata.analysis import synthesize
from hopdata.arrays import FloatArray
from hopdata.maps.draws import named_generator
from hopdata.rigid import turned
from hopdata.scenes.scene import Control
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import TrueStates, known_scene, true_states

if TYPE_CHECKING:
    from hopdata.landings.states.pairs import Pairs
    from hopdata.truth import Truth
    from hopdata.walk import Study

#: Disturbances at each apex in the thesis-sized study: half of them is the study
#: half_spread.
#: Unit: m/s, rad/s, 1. Origin: convention: the defaults of the configuration.
KICKS = {
    "velocity_m_s": 0.05,
    "angular_velocity_rad_s": 0.25,
    "preload_fraction": 0.05,
}


@dataclass(frozen=True)
class Noise:
    """Standard errors of the states of a measured study, m and m/s.

    Attributes
    ----------
    x, y
        (6B,) medians over its landings, at the pre and the post section.
    """

    x: FloatArray
    y: FloatArray

    @classmethod
    def of(cls, pairs: Pairs) -> Noise:
        """Return the noise of measured pairs."""
        if pairs.x_se is None or pairs.y_se is None:
            raise ValueError("pairs: expected standard errors of the states")
        x = np.nanmedian(pairs.x_se, axis=0)
        y = np.nanmedian(pairs.y_se, axis=0)
        return cls(x, y)


def hops_with_spread(scale: float, hops: int, seed: int) -> Truth:
    """Return the truth of hops whose kicks are `scale` times those of the sample."""
    kicks = {name: scale * size for name, size in KICKS.items()}
    _, truth = synthesize(
        "hopper", simulation={"hops": hops, "kicks": kicks}, seed=seed
    )
    return truth


def landings_of(
    truth: Truth, sections: tuple[float, float], coupling: float = 0.0
) -> TrueStates:
    """Return the true states at the sections, for the hopper or for a control.

    Parameters
    ----------
    truth
        Truth of the hops; a control lands from the same apexes.
    sections
        Heights of the pre and the post section, m.
    coupling
        Share of force that a leg loses for each leg that does not yet stand.
    """
    known = replace(known_scene(truth), control=Control(coupling=coupling))
    heights = SectionHeights(*sections, known.body_points_m)
    return true_states(truth, known, heights)


def in_home_frame(states: TrueStates) -> tuple[FloatArray, FloatArray]:
    """Return states (n, 6B) at both sections in the home frame of each landing.

    Its origin is half-way between the body's places at the sections, on the floor; its
    x-axis runs through the first marker.
    """
    before = _split(states.x)
    after = _split(states.y)
    # Half-way between the places of each marker, (n, B, 3).
    middle = (before[0] + after[0]) / 2
    origin = middle.mean(axis=1, keepdims=True)
    to_marker = middle[:, 0] - origin[:, 0]
    heading = np.arctan2(to_marker[:, 1], to_marker[:, 0])
    origin[..., 2] = 0.0
    found = []
    for positions, velocities in (before, after):
        places = turned(positions - origin, heading[:, None])
        rates = turned(velocities, heading[:, None])
        both = np.concatenate([places, rates], axis=1)
        found.append(both.reshape(len(heading), -1))
    return found[0], found[1]


def with_noise(
    states: tuple[FloatArray, FloatArray], noise: Noise, seed: int, *names: str
) -> tuple[FloatArray, FloatArray]:
    """Return states (n, 6B) at both sections with normal noise on each coordinate."""
    generator = named_generator(seed, "state noise", *names)
    x, y = states
    noisy_x = x + noise.x * generator.standard_normal(x.shape)
    noisy_y = y + noise.y * generator.standard_normal(y.shape)
    return noisy_x, noisy_y


def _split(states: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities, (n, B, 3) each."""
    positions, velocities = np.split(states, 2, axis=1)
    shape = (len(states), -1, 3)
    return positions.reshape(shape), velocities.reshape(shape)


def section_heights_m(study: Study) -> tuple[float, float]:
    """Return the heights of a study's pre and post section, m."""
    return study.sections.pre_height_m, study.sections.post_height_m


def units_of(pairs: Pairs) -> FloatArray:
    """Return the units (6B,) of a study's states, m and m/s."""
    half = pairs.x.shape[1] // 2
    velocity_unit = pairs.length_unit_m / pairs.time_unit_s
    return np.repeat([pairs.length_unit_m, velocity_unit], half)
