"""Random coefficients against the population they were drawn from."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.landings.states.coefficients import (
    fit_with_population,
    learn_population,
    least_squares,
)
from hopdata.landings.states.tracks import Windows, joined, moments, turned

NOISE_M, WINDOW_S, LANDINGS = 0.0006, 0.1, 400
MEAN = np.array([[0.3, -0.2, 1.2], [0.1, 0.4, 0.8], [0.0, 0.0, 1.0]])  # of u^2, m / 100
SPREAD_M = np.array([0.002, 0.002, 0.004])


def seen(bend, seed):
    """Return parabolas with given curvatures (L, 3, 3), seen at random phases of the frames."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    time = (np.arange(LANDINGS)[:, None] + 0.01 * np.arange(21)).ravel()
    near = np.arange(LANDINGS) + 0.1 + rng.uniform(0, 0.01, LANDINGS)
    u = ((time.reshape(LANDINGS, -1) - near[:, None]) / WINDOW_S)[..., None, None]
    speed = rng.normal(0, 0.1, (LANDINGS, 3, 3))
    tracks = speed[:, None] * u + bend[:, None] * u**2
    tracks[..., 0] += [1.0, 0.0, -1.0]  # the first marker is on the x axis of the body
    tracks = (tracks + NOISE_M * rng.standard_normal(tracks.shape)).reshape(-1, 3, 3)
    start = np.searchsorted(time, near - 0.02)  # most frames follow it, as in stance
    sums = moments(time, tracks, Windows(near, start, start + 11, WINDOW_S), degree=2)
    return joined(sums), speed


@pytest.fixture(scope="module")
def study():
    """Return curvatures that differ from landing to landing."""
    rng = np.random.default_rng(np.random.SeedSequence(2))
    return seen(0.01 * MEAN + SPREAD_M * rng.standard_normal((LANDINGS, 3, 3)), seed=3)


def in_the_world(sums, vectors):
    return turned(vectors, sums.direction, back=True)


def test_the_population_is_found(study):
    sums, _ = study
    population = learn_population(sums)
    np.testing.assert_allclose(np.sqrt(population.variance), NOISE_M, rtol=0.05)
    np.testing.assert_allclose(np.sqrt(population.spread[:, 0, 0]), SPREAD_M, rtol=0.1)
    np.testing.assert_allclose(population.mean[..., 2, 0], 0.01 * MEAN[:, 2], atol=1e-3)


def test_landings_that_lack_frames_do_not_teach_wherever_they_stand(study):
    sums, _ = study
    some = sums.some(np.flatnonzero(np.arange(LANDINGS) % 3 == 1))
    frames = sums.frames.copy()
    frames[np.arange(LANDINGS) % 3 != 1] = 0
    known, found = (
        learn_population(some),
        learn_population(replace(sums, frames=frames)),
    )
    np.testing.assert_allclose(found.spread, known.spread, rtol=1e-9)


def test_errors_are_as_large_as_stated_and_no_larger_than_alone(study):
    sums, speed = study
    alone, together = (
        least_squares(sums),
        fit_with_population(sums, learn_population(sums), least_frames=6),
    )
    misses = [in_the_world(sums, fit.mean[..., 1]) - speed for fit in (alone, together)]
    assert np.mean(misses[1] ** 2) < np.mean(misses[0] ** 2)
    for fit, miss in zip((alone, together), misses, strict=True):
        score = miss / np.sqrt(fit.covariance[..., 1, 1])
        assert np.mean(score**2) == pytest.approx(1.0, abs=0.1)
        assert 0.63 < np.mean(np.abs(score) < 1) < 0.73


def test_an_order_that_nobody_needs_is_given_no_variance():
    straight, speed = seen(np.zeros((LANDINGS, 3, 3)), seed=4)
    population = learn_population(straight)
    alone, together = (
        least_squares(straight),
        fit_with_population(straight, population, least_frames=6),
    )
    assert (np.sqrt(population.spread[:, 0, 0]) < 0.25 * SPREAD_M).all()
    misses = [
        in_the_world(straight, fit.mean[..., 1]) - speed for fit in (alone, together)
    ]
    assert np.mean(misses[1] ** 2) <= np.mean(misses[0] ** 2)


def test_least_squares_is_polyfit():
    rng = np.random.default_rng(1)
    time = np.sort(rng.uniform(0, 0.2, 30))
    body = rng.standard_normal((30, 1, 3))
    windows = Windows(np.array([0.1]), np.array([0]), np.array([30]), 0.1)
    alone = joined(moments(time, body, windows, degree=3))
    fit = least_squares(alone)
    values = turned(body[None, :, 0] - body[:, 0].mean(axis=0), alone.direction)[0]
    for k in range(3):
        expected, covariance = np.polyfit((time - 0.1) / 0.1, values[:, k], 3, cov=True)
        np.testing.assert_allclose(fit.mean[0, 0, k], expected[::-1], atol=1e-9)
        np.testing.assert_allclose(
            fit.covariance[0, 0, k], covariance[::-1, ::-1], rtol=1e-6
        )


def test_too_few_frames_give_nothing(study):
    sums, _ = study
    population = learn_population(sums)
    few = sums.some(np.arange(3))
    few.frames[1, 2] = 2
    found = fit_with_population(few, population, least_frames=6)
    assert np.isnan(found.mean[1, 2]).all()
    assert np.isfinite(found.mean[0]).all()
    assert np.isfinite(found.mean[1, :2]).all()
    assert np.isnan(least_squares(few).mean[1, 2]).all()
