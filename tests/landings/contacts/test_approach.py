"""Rough instants, and which feet did not come down."""

import numpy as np
import pytest
from synthetic_landings import simulate, transitions_of

from hopdata.landings.contacts.approach import approaches
from hopdata.landings.contacts.descents import (
    ALREADY_DOWN,
    LANDED,
    MISSING,
    NOT_LANDED,
    Transitions,
)


@pytest.fixture(scope="module")
def landings():
    scene = simulate(60, seed=5)
    return scene, transitions_of(scene), scene.recording.feet[:, :, 2]


def find(landings, heights):
    scene, transitions, _ = landings
    return approaches(
        scene.recording.time,
        heights,
        transitions,
        noise_m=6e-4,
        down_height_m=0.02,
        lead_s=0.04,
        trail_s=0.03,
    )


def test_rough_instants_are_within_a_frame(landings):
    near, *_, status = find(landings, landings[2])
    assert (status == LANDED).all()
    assert np.abs(near - landings[0].contact_times).max() < 0.01


def test_a_foot_touches_later_than_it_is_too_high(landings):
    """It is higher above its rest than skin and compliance let it sink, which no contact is."""
    scene, transitions, heights = landings
    _, earliest, *_ = find(landings, heights)
    ahead = scene.contact_times - earliest
    assert ahead.min() > 0.0
    assert np.quantile(ahead, 0.9) < 0.02
    raised = heights + 0.015 * (transitions.t_pre[0] < scene.recording.time)[:, None]
    np.testing.assert_allclose(find(landings, raised)[1][1:], earliest[1:], atol=1e-9)


@pytest.mark.parametrize(
    ("foot", "expected"),
    [
        (lambda z: z + 0.05, NOT_LANDED),
        (lambda z: 0.0003 * np.sin(np.arange(len(z))), ALREADY_DOWN),
        (
            lambda z: 0.0048 * np.sin(0.11 * np.arange(len(z))),
            ALREADY_DOWN,
        ),  # the foot settles
        (lambda z: z * np.nan, MISSING),
    ],
)
def test_feet_that_do_not_land(landings, foot, expected):
    heights = landings[2].copy()
    heights[:, 1] = foot(heights[:, 1])
    near, *_, status = find(landings, heights)
    assert (status[:, 1] == expected).all()
    assert np.isnan(near[:, 1]).all()
    assert (status[:, [0, 2]] == LANDED).all()


@pytest.mark.parametrize("side", ["low", "high"])
def test_a_foot_that_is_hidden_is_not_said_to_be_up_or_down(landings, side):
    heights = landings[2].copy()
    z = heights[:, 1]
    hidden = (
        (z < 0.04) if side == "low" else (z > 0.004)
    )  # near its contact, or all of its descent
    heights[hidden, 1] = np.nan
    *_, status = find(landings, heights)
    assert (status[:, 1] == MISSING).mean() > 0.9
    assert not np.isin(status[:, 1], [ALREADY_DOWN, NOT_LANDED]).any()
    assert (status[:, [0, 2]] == LANDED).all()


@pytest.mark.parametrize("share", [0.02, 0.2])
def test_lost_frames_do_not_bring_a_foot_down(landings, share):
    heights = landings[2].copy()
    rng = np.random.default_rng(3)
    heights[:, 1] += 0.3
    heights[rng.random(len(heights)) < share, 1] = np.nan
    assert (find(landings, heights)[-1][:, 1] == NOT_LANDED).mean() > 0.99


def test_a_foot_that_hovers_and_is_hidden_then_may_have_landed(landings):
    scene, transitions, heights = landings[0], landings[1], landings[2].copy()
    rng = np.random.default_rng(4)
    heights[:, 1] = 0.06 + 6e-4 * rng.standard_normal(len(heights))
    for t_pre, t_post in zip(transitions.t_pre, transitions.t_post, strict=True):
        time = scene.recording.time
        heights[(time > t_pre) & (time < t_post + 0.1), 1] = np.nan
    assert (find(landings, heights)[-1][:, 1] == MISSING).mean() > 0.9


@pytest.mark.parametrize("seed", range(5))
def test_a_foot_that_hangs_low_before_it_falls_is_timed_by_its_fall(seed):
    """An example is a robot that is released just above the floor."""
    time, released, hung_m = np.arange(200) / 200.0, 0.5 + 1e-3 * seed, 0.034
    lowered = np.interp(time, [0.3, 0.4], [0.15, hung_m])
    falls = lowered - 0.5 * 9.81 * np.maximum(time - released, 0.0) ** 2
    heights = np.maximum(falls, 0.0) + 6e-4 * np.random.default_rng(
        seed
    ).standard_normal(200)
    ends, gap = np.array([[0.32], [0.7]]), np.array([0.005])
    options = {"noise_m": 6e-4, "down_height_m": 0.02, "lead_s": 0.04, "trail_s": 0.03}
    near, *_ = approaches(
        time, heights[:, None], Transitions(*ends, gap, gap), **options
    )
    assert abs(near[0, 0] - released - np.sqrt(2 * hung_m / 9.81)) < 0.02
