"""Noise from rigid-body residuals and its propagation to the coordinates, against drawn noise."""

import numpy as np
import pytest
from made_up_landings import ARMS, landings, noisy

from hopdata.errors import AnalysisError
from hopdata.landings.states.fits import section_states
from hopdata.maps.coordinates import rigid_states, section_coordinates
from hopdata.maps.corrected.marker_noise import MarkerNoise, input_errors, marker_noise
from hopdata.maps.truth.maps import marker_states


def coordinates(before, after, shape=ARMS):
    return section_coordinates(rigid_states(before, shape), rigid_states(after, shape))


def test_noise_is_found_from_the_residuals():
    before, _, _ = landings(20000)
    found = marker_noise(noisy(before, 2e-4, 5e-3, shared=0.4), ARMS)
    assert found.position == pytest.approx(4e-8, rel=0.03)
    assert found.velocity == pytest.approx(2.5e-5, rel=0.03)
    assert found.shared == pytest.approx(0.4 * 2e-4 * 5e-3, rel=0.05)


def test_exact_states_have_no_noise():
    before, after, _ = landings(50)
    found = marker_noise(before, ARMS)
    assert found.position < 1e-28
    assert found.velocity < 1e-26
    errors = input_errors(before, after, ARMS, found)
    assert np.abs(errors.inputs).max() < 1e-24


def test_four_markers_leave_more_to_see_the_noise_by():
    shape = np.vstack([ARMS, [[0.02, 0.05, -0.08]]])
    shape = shape - shape.mean(axis=0)
    place = np.hstack(
        [np.zeros((4000, 3)), np.random.default_rng(1).normal(size=(4000, 8)) * 0.1]
    )
    found = marker_noise(noisy(marker_states(place, shape), 3e-4, 1e-2), shape)
    assert found.position == pytest.approx(9e-8, rel=0.05)
    assert found.velocity == pytest.approx(1e-4, rel=0.05)


def measured_landings(count, noise_m, seed):
    """Return one landing seen repeatedly: in flight until a contact soon after the section."""
    before, after, _ = landings(1)
    start = before[0].reshape(6, 3)
    step, period = np.arange(-12, 8) / 100.0, 1.0
    rng = np.random.default_rng(seed)
    near = period * np.arange(count) + rng.uniform(0, 0.01, count)
    time = (period * np.arange(count)[:, None] + step).ravel()
    since = time - np.repeat(near, len(step))
    turn = since[:, None, None]
    track = (
        start[:3]
        + turn * start[3:]
        - 0.5 * 9.80665 * turn**2 * np.array([0.0, 0.0, 1.0])
    )
    seen = track + noise_m * rng.normal(size=track.shape)
    found = section_states(
        time,
        seen,
        near,
        height_m=0.0,
        side="before",
        contact=near + 0.035,
        gravity="known",
    )
    states = np.concatenate([found.position, found.velocity], axis=1).reshape(count, -1)
    return states, np.tile(after, (count, 1))


def test_propagated_errors_are_those_of_fitted_states_at_a_noisy_instant():
    """The fit ends at a contact, so errors of positions, velocities and instant are correlated."""
    before, after = measured_landings(6000, 3e-4, seed=3)
    # Here the markers move on straight lines, not as one body, so the spin at this
    # instant is fitted.
    noise = marker_noise(before - before.mean(axis=0) + landings(1)[0], ARMS)
    assert noise.shared / np.sqrt(noise.position * noise.velocity) > 0.3
    errors = input_errors(before, after, ARMS, noise)
    x, y = coordinates(before, after)
    moments = np.cov(np.hstack([x, y]), rowvar=False)
    sd = np.sqrt(np.diag(moments))
    scale = np.outer(sd[:8], np.where(sd > 1e-12, sd, np.inf)[8:])
    within = np.outer(sd[:8], sd[:8])
    np.testing.assert_allclose(
        errors.inputs / within, moments[:8, :8] / within, atol=0.06
    )
    np.testing.assert_allclose(
        errors.shared / scale, moments[:8, 8:] / scale, atol=0.06
    )


def test_outputs_share_errors_of_place_and_heading():
    before, after, _ = landings(30)
    errors = input_errors(before, after, ARMS, MarkerNoise(1e-8, 0.5e-8 * 1e2, 1e-4))
    assert (
        abs(errors.shared[2, 0]) > 1e-8
    )  # covariance of forward speed and forward step
    assert np.linalg.eigvalsh(errors.inputs)[0] > 0


def test_what_cannot_be_is_refused():
    before, after, _ = landings(3)
    with pytest.raises(AnalysisError, match="at least one landing"):
        marker_noise(before[:0], ARMS)
    rising = before.copy()
    rising[:, 11::3] *= -1.0
    with pytest.raises(AnalysisError, match="sink through"):
        input_errors(rising, after, ARMS, MarkerNoise(1e-8, 0.0, 1e-5))
