"""Legs whose length scatters: a difference is found in its size, and none is invented."""

from functools import cache

import numpy as np
import pytest

import hopdata as hd
from hopdata.errors import ConfigError
from hopdata.maps.truth.maps import true_effect
from hopdata.synthesis.hops import rest_foot
from hopdata.synthesis.landings import SectionHeights, true_landings
from hopdata.synthesis.scaling import common_scene, exact_maps, true_states

HOPS, SCATTER_M = 400, 0.008
BODY = ["body1", "body2", "body3"]
LEVEL = {"bowl_depth_m": 0.0, "waves": 0}


@cache
def studied(coupling):
    """Return a study of a hopper whose legs scatter by 8 mm, and its truth."""
    recording, truth = hd.synthesize(
        "hopper",
        simulation={
            "hops": HOPS,
            "legs_scatter_m": SCATTER_M,
            "control": {"coupling": coupling},
        },
        motion_capture={"floor": LEVEL},
        seed=1,
    )
    return hd.analyse(recording, floor={"enabled": False}), truth


def sections_of(study, known):
    heights = study.sections.pre_height_m, study.sections.post_height_m
    return SectionHeights(*heights, known.points_of(BODY))


def test_the_difference_is_found_in_its_size():
    study, truth = studied(0.4)
    known = common_scene([truth])
    sections = sections_of(study, known)
    exact = exact_maps([truth], sections)
    states = true_states(truth, known, sections).x
    true = true_effect(exact, states, truth.contact_times)
    verdict = study.verdict
    assert verdict.conclusion == "different"
    assert verdict.posture == "inputs of the map"
    assert 0.75 < verdict.effect.estimate / true < 1.25
    assert verdict.effect.low < true < verdict.effect.high
    assert true < verdict.effect.upper_bound
    # The state alone would not do: the legs are most of what varies of the contacts.
    without = {key: value for key, value in exact.items() if key != "legs"}
    assert true_effect(without, states, truth.contact_times) > 1.25 * true


def test_the_same_hopper_without_a_difference_is_not_called_different():
    study, _ = studied(0.0)
    assert study.verdict.conclusion != "different"
    assert study.verdict.effect.upper_bound < 0.5


def test_what_foretells_the_contacts_is_said():
    study, _ = studied(0.0)
    verdict = study.verdict
    assert verdict.contacts_r2 > 0.99
    share = f"{100 * verdict.contacts_r2:.1f} %"
    assert f"the feet before the landing foretell {share}" in verdict.contacts
    pairs = study.pairs
    hidden = np.full(pairs.feet.shape, np.nan)
    averaged = hd.judge(
        pairs.x,
        pairs.y,
        pairs.instants,
        instants_se=pairs.instants_se,
        feet=hidden,
        seed=1,
    )
    assert averaged.contacts_r2 < 0.97
    assert "feet not seen before contact: averaged" in averaged.contacts
    assert averaged.conclusion == "cannot tell"


def test_feet_are_where_they_are_to_within_their_errors():
    study, truth = studied(0.0)
    known = common_scene([truth])
    flown = true_landings(
        known.scene,
        known.control,
        truth.apex_states,
        truth.preloads_n,
        sections_of(study, known),
        longer_m=truth.longer_m,
    )
    pairs = study.pairs
    crossed = truth.apex_times + flown.pre_time_s
    landing = np.nanargmin(np.abs(crossed - pairs.time_s[:, None]), axis=1)
    feet = [
        rest_foot(
            known.scene, flown.pre_state[landing], leg, truth.longer_m[landing, leg]
        )
        for leg in range(3)
    ]
    true = np.stack(feet, axis=1)
    relative = (pairs.feet - true)[:, :, 2] / pairs.feet_se[:, :, 2]
    assert 0.8 < np.sqrt(np.mean(relative**2)) < 1.25
    # Places in the plane are those of another frame, but distances are the same.
    for one, other in ((0, 1), (1, 2), (2, 0)):
        found = np.linalg.norm((pairs.feet[:, one] - pairs.feet[:, other]), axis=1)
        expected = np.linalg.norm(true[:, one] - true[:, other], axis=1)
        error = np.hypot(pairs.feet_se[:, one, 0], pairs.feet_se[:, other, 0])
        assert 0.8 < np.sqrt(np.mean(((found - expected) / error) ** 2)) < 1.25


def test_recordings_are_blocks_and_have_a_session_time():
    first, _ = hd.synthesize("hopper", name="a", simulation={"hops": 60}, seed=2)
    second, _ = hd.synthesize("hopper", name="b", simulation={"hops": 60}, seed=3)
    study = hd.study([first, second], recordings=[{"name": "b", "begins_s": 500.0}])
    is_second = study.pairs.recording == "b"
    assert study.pairs.time_s[is_second].min() > 500
    assert study.pairs.time_s[~is_second].max() < 100
    with pytest.raises(ConfigError, match=r"recordings: expected a, b, found c"):
        hd.study([first, second], recordings=[{"name": "c", "block": "sand"}])
