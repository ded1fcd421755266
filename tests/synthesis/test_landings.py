"""True states at the sections, compared with single hops with all their events."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.scene import Control
from hopdata.synthesis.camera import fixed_markers
from hopdata.synthesis.hops import fly_hop, level_state
from hopdata.synthesis.landings import SectionHeights, true_landings
from hopdata.synthesis.trial import MarkerOptions

HOPPER = HopperParameters()
SWINGING = replace(HOPPER, boom_swing_rad=0.4, boom_duration_s=0.4)
SECTIONS = SectionHeights(0.5, 0.282, np.array(MarkerOptions().body_m))
CONTROLS = (
    Control(),
    Control(coupling=0.4),
    Control(impulse=0.3),
    Control(delay_s=0.005),
)


def apexes(count=12):
    rng = np.random.default_rng(4)
    states = np.tile(level_state(HOPPER, 0.24), (count, 1))
    states[:, :2] += rng.uniform(-0.5, 0.5, (count, 2))
    states[:, 3] = rng.uniform(-3, 3, count)
    states[:, 4:6] += 0.01 * rng.standard_normal((count, 2))
    states[:, 6:9] += 0.05 * rng.standard_normal((count, 3))
    states[:, 9:] += 0.15 * rng.standard_normal((count, 3))
    return states, HOPPER.preload_n * (1 + 0.05 * rng.standard_normal((count, 3)))


@pytest.mark.parametrize("hopper", [HOPPER, SWINGING], ids=["still", "swinging"])
@pytest.mark.parametrize(
    "control", CONTROLS, ids=["hopper", "coupling", "impulse", "delay"]
)
def test_states_and_contacts_are_those_of_the_single_hops(hopper, control):
    states, preloads = apexes()
    found = true_landings(hopper, control, states, preloads, SECTIONS, rtol=1e-11)
    assert found.whole.all()
    for k, (state, preload) in enumerate(zip(states, preloads, strict=True)):
        at = np.array([found.pre_time_s[k], found.post_time_s[k]])
        hop = fly_hop(
            hopper, state, variant=control, preloads_n=preload, frame_times_s=at
        )
        np.testing.assert_allclose(
            hop.states, [found.pre_state[k], found.post_state[k]], rtol=0, atol=2e-8
        )
        touch = hop.event_time[hop.first_contacts()]
        np.testing.assert_allclose(found.contact_s[k], touch, rtol=0, atol=1e-9)
        assert found.schedule[k] == ">".join(str(leg + 1) for leg in np.argsort(touch))
    for at, height in ((found.pre_state, 0.5), (found.post_state, 0.282)):
        means = fixed_markers(at, SECTIONS.points_m)[..., 2].mean(axis=1)
        np.testing.assert_allclose(means, height, rtol=0, atol=1e-10)
        assert np.all(at[:, 8] < 0)


@pytest.mark.parametrize(
    ("pre", "post", "reason"),
    [
        (0.7, 0.282, "no pre"),
        (0.33, 0.282, "early"),
        (0.5, 0.332, "late"),
        (0.5, 0.05, "no post"),
    ],
)
def test_a_landing_that_does_not_count(pre, post, reason):
    states, preloads = apexes()
    states[0, 4] = 0.12
    states[0, 9:] = [0.0, 0.5, 0.0]
    sections = SectionHeights(pre, post, SECTIONS.points_m)
    found = true_landings(HOPPER, CONTROLS[0], states, preloads, sections)
    assert not found.whole[0]
    assert found.schedule[0] == ""
    if reason in ("no pre", "early"):
        assert np.isnan(found.post_state[0]).all()
    if reason == "late":
        assert np.isfinite(found.post_state[0]).all()
        assert np.isnan(found.contact_s[0]).any()


def test_a_body_too_slow_for_the_section_is_told_from_one_that_passes():
    states, _ = apexes(2)
    stiff = replace(HOPPER, preload_n=60.0)
    found = true_landings(stiff, CONTROLS[0], states, [[60.0] * 3, [22.0] * 3] * np.ones((2, 1)),
                          SECTIONS)  # fmt: skip
    assert found.whole.tolist() == [False, True]


def test_the_number_of_threads_does_not_change_a_byte():
    states, preloads = apexes(150)
    one, two = (
        true_landings(HOPPER, CONTROLS[1], states, preloads, SECTIONS, workers=n)
        for n in (1, 2)
    )
    for name in ("pre_state", "post_state", "contact_s", "post_time_s"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


def test_sections_upside_down_are_refused():
    with pytest.raises(ValueError, match=r"pre_m: expected above 0.5"):
        SectionHeights(0.3, 0.5, SECTIONS.points_m)
