"""States at the sections against the truth."""

from dataclasses import replace

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


def test_stance_is_four_times_better_than_the_filter(scene):
    split = velocity_error(scene, states(scene, "after"))
    assert split < velocity_error(scene, states(scene, "after", method="savitzky_golay")) / 4


def test_gravity_is_learned_where_flight_is_ballistic(scene):
    known = velocity_error(scene, states(scene, "before", gravity="known"))
    free = velocity_error(scene, states(scene, "before", gravity="free"))
    found = velocity_error(scene, states(scene, "before", gravity="auto"))
    assert known < 0.5 * free
    assert found <= known


def test_gravity_is_given_up_where_flight_is_not_ballistic(scene):
    body, rng = scene.recording.body.copy(), np.random.default_rng(2)
    cycle = 0.64
    hop = np.floor(scene.recording.time / cycle).astype(int)
    push = (rng.normal(0, 3.0, (hop.max() + 1, 3)) * [1, 1, 0])[hop]  # m/s^2, another each hop
    s = scene.recording.time - hop * cycle
    bent = body + (0.5 * push * s[:, None] ** 2)[:, None]
    truth = replace(scene, velocities=scene.velocities + (push * s[:, None])[:, None])
    error = {
        gravity: velocity_error(truth, states(scene, "before", bent, gravity=gravity))
        for gravity in ("auto", "known", "free")
    }
    assert error["auto"] <= error["free"]
    assert error["auto"] < 0.5 * error["known"]


@pytest.mark.parametrize("side", ["before", "after"])
@pytest.mark.parametrize("rate_hz", [100.0, 250.0])
def test_standard_errors_are_as_large_as_the_errors(side, rate_hz):
    scene = simulate(200, seed=5, rate_hz=rate_hz)
    quiet = replace(scene, recording=scene.clean)
    noisy, clean = (states(one, side, gravity="auto") for one in (scene, quiet))
    for found, truth, covariance in (
        (noisy.position, clean.position, noisy.position_covariance),
        (noisy.velocity, clean.velocity, noisy.velocity_covariance),
    ):
        score = (found - truth) / np.sqrt(np.einsum("lbkk->lbk", covariance))
        assert np.mean(score**2) == pytest.approx(1.0, abs=0.25)
        assert 0.63 < np.mean(np.abs(score) < 1) < 0.75


def test_the_error_of_the_instant_is_in_the_standard_errors(scene):
    found = states(scene, "before")
    up = found.position_covariance[..., 2, 2]
    # Three markers with equal errors: of each height a third is taken off by the instant.
    along = found.position_covariance[..., 0, 0] + found.position_covariance[..., 1, 1]
    np.testing.assert_allclose(up.mean() / (along.mean() / 2), 2 / 3, rtol=0.1)


def test_few_landings_are_fitted_one_by_one():
    few = simulate(5, seed=3)
    for side in ("before", "after"):
        found = states(few, side)
        assert np.isfinite(found.velocity_covariance).all()
        assert velocity_error(few, found) < 0.03
    known = states(few, "before", gravity="known")
    np.testing.assert_array_equal(states(few, "before").velocity, known.velocity)


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
