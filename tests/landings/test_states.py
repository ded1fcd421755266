"""States at the sections against the truth."""

import numpy as np
import pytest
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.errors import ConfigError
from hopdata.landings.states import section_states
from hopdata.landings.transitions import find_transitions


@pytest.fixture(scope="module")
def scene():
    return simulate(300, seed=7)


def states(scene, side, body=None, **options):
    recording = scene.recording
    transitions = find_transitions(
        recording.time,
        recording.body_height,
        pre_height_m=PRE_HEIGHT_M,
        post_height_m=POST_HEIGHT_M,
    )
    before = side == "before"
    return section_states(
        recording.time,
        recording.body if body is None else body,
        transitions.t_pre if before else transitions.t_post,
        height_m=PRE_HEIGHT_M if before else POST_HEIGHT_M,
        side=side,
        contact=scene.contact_times.min(axis=1) if before else scene.contact_times.max(axis=1),
        **options,
    )


def velocity_error(scene, found):
    """Root mean square, m/s; the truth is linear between frames to 2 mm/s."""
    body = scene.velocities.shape[1]
    truth = np.empty_like(found.velocity)
    for b, k in np.ndindex(body, 3):
        truth[:, b, k] = np.interp(found.time, scene.recording.time, scene.velocities[:, b, k])
    return float(np.sqrt(np.mean((found.velocity - truth) ** 2)))


@pytest.mark.parametrize("method", ["split_fit", "savitzky_golay"])
@pytest.mark.parametrize(("side", "height"), [("before", PRE_HEIGHT_M), ("after", POST_HEIGHT_M)])
def test_the_mean_height_is_the_sections_and_sinks(scene, method, side, height):
    found = states(scene, side, method=method)
    assert np.isfinite(found.velocity).all()
    np.testing.assert_allclose(found.position[:, :, 2].mean(axis=1), height, atol=1e-12)
    assert (found.velocity[:, :, 2].mean(axis=1) < 0).all()


def test_flight_is_four_times_better_than_the_filter(scene):
    split = velocity_error(scene, states(scene, "before"))
    smoothed = velocity_error(scene, states(scene, "before", method="savitzky_golay"))
    assert smoothed == pytest.approx(0.0306, abs=0.003)  # FACTS: 30.7 mm/s
    assert split < smoothed / 4


def test_stance_is_better_than_the_filter(scene):
    split = velocity_error(scene, states(scene, "after"))
    assert split < 0.65 * velocity_error(scene, states(scene, "after", method="savitzky_golay"))


def test_gravity_is_found_where_flight_is_ballistic(scene):
    known = states(scene, "before", gravity="known")
    free = states(scene, "before", gravity="free")
    found = states(scene, "before", gravity="auto")
    np.testing.assert_array_equal(found.velocity, known.velocity)
    assert velocity_error(scene, known) < 0.5 * velocity_error(scene, free)
    bent = scene.recording.body + 2.0 * np.sin(12 * scene.recording.time)[:, None, None] ** 2 * [
        [[0.02, 0.02, 0.0]]
    ]
    np.testing.assert_array_equal(
        states(scene, "before", bent, gravity="auto").velocity,
        states(scene, "before", bent, gravity="free").velocity,
    )


def test_exact_on_motions_within_the_model():
    time = np.arange(100) / 100
    fall = 1.0 - 0.5 * 9.80665 * (time - 0.2) ** 2
    body = np.stack(
        [np.column_stack([0.3 * time + b, b - 0.1 * time, fall + 0.1 * b]) for b in (-1, 0, 1)],
        axis=1,
    )
    drop = 0.4
    t = 0.2 + np.sqrt(2 * drop / 9.80665)
    for gravity in ("known", "free", "auto"):
        found = section_states(
            time,
            body,
            np.array([t + 0.004]),
            height_m=1 - drop,
            side="before",
            contact=np.array([t + 0.02]),
            gravity=gravity,
        )
        np.testing.assert_allclose(found.time, t, atol=1e-10)
        expected = np.tile([0.3, -0.1, -9.80665 * (t - 0.2)], (3, 1))
        np.testing.assert_allclose(found.velocity[0], expected, atol=1e-9)
        np.testing.assert_allclose(found.position[0, :, 0], 0.3 * t + np.array([-1, 0, 1]))


def test_frames_beyond_the_contacts_are_not_used(scene):
    recording = scene.recording
    spoiled = recording.body.copy()
    after = recording.time[:, None] >= scene.contact_times.min(axis=1)
    before = recording.time[:, None] < np.roll(scene.contact_times.min(axis=1), -1) - 0.3
    spoiled[(after & before).any(axis=1)] += 1.0
    clean = states(scene, "before")
    np.testing.assert_array_equal(states(scene, "before", spoiled).velocity, clean.velocity)
    filtered = states(scene, "before", spoiled, method="savitzky_golay")
    assert not np.allclose(
        filtered.velocity, states(scene, "before", method="savitzky_golay").velocity, equal_nan=True
    )


def test_few_missing_frames_are_bridged_and_many_are_not(scene):
    body = scene.recording.body.copy()
    at = np.searchsorted(scene.recording.time, states(scene, "before").time)
    body[at[0] - 3, 1] = np.nan
    body[at[1] - 40 : at[1] + 40, 1] = np.nan
    found = states(scene, "before", body)
    assert np.isfinite(found.velocity[0]).all()
    assert np.isnan(found.velocity[1]).all()
    assert np.isfinite(found.velocity[2:]).all()


def test_unknown_choices_are_named(scene):
    with pytest.raises(ConfigError, match="did you mean 'split_fit'"):
        states(scene, "before", method="split_fits")
    with pytest.raises(ConfigError, match=r"states\.gravity"):
        states(scene, "before", gravity="moon")
