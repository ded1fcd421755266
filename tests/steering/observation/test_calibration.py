from dataclasses import replace

import numpy as np
import pytest
from steered_hopper import rms, steered

from hopdata.errors import AnalysisError
from hopdata.rigid import rigid_fit, wrapped
from hopdata.scenes.body import rotation_matrices
from hopdata.steering.observation.calibration import (
    algebraic_circle,
    arc_span,
    calibrate,
    fit_boom_circle,
    geometric_circle,
    marker_shape,
)
from hopdata.steering.observation.tracking import hopper_motion
from hopdata.synthesis.trial import MarkerOptions

BODY = np.array(MarkerOptions().body_m)


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.pi])
def test_body_axes_and_boom_circle_are_those_of_the_scene(angle):
    geometry = calibrate(steered(angle=angle).recording)
    np.testing.assert_allclose(geometry.body_m, BODY - BODY.mean(axis=0), atol=0.0005)
    centre = np.array([0.25, 0.0, -0.03]) - BODY.mean(axis=0)
    np.testing.assert_allclose(geometry.circle.centre_m, centre, atol=0.003)
    np.testing.assert_allclose(geometry.circle.normal, [0, 0, 1], atol=0.02)
    assert geometry.circle.radius_m == pytest.approx(0.25, abs=0.001)
    assert geometry.noise_m == pytest.approx(0.0006, rel=0.05)


def test_without_noise_the_geometry_is_exact():
    geometry = calibrate(steered(noise_m=0.0).recording)
    np.testing.assert_allclose(geometry.body_m, BODY - BODY.mean(axis=0), atol=1e-5)
    assert geometry.circle.radius_m == pytest.approx(0.25, abs=1e-5)


def test_heights_tell_stances_from_flights():
    hopper = steered()
    geometry = calibrate(hopper.recording)
    lowest = np.interp(hopper.lowest_s, hopper.recording.time, hopper.middle[:, 2])
    assert lowest.max() < geometry.stance_below_m < geometry.flight_above_m
    assert geometry.flight_above_m < np.percentile(hopper.middle[:, 2], 60)


def without(recording, *names):
    """Return a recording without some of its markers."""
    kept = [k for k, name in enumerate(recording.markers) if name not in names]
    return replace(
        recording,
        positions=recording.positions[:, kept],
        markers=tuple(recording.markers[k] for k in kept),
        roles=tuple(recording.roles[k] for k in kept),
    )


def test_with_a_leaning_hopper_the_feet_are_the_better_level():
    recording = steered(angle=0.0).recording
    two_feet = without(recording, recording.names("foot")[-1])
    by_feet, by_median = (
        np.abs(calibrate(one).circle.normal[:2]).max() for one in (recording, two_feet)
    )
    assert by_feet < 0.01 < by_median


def test_a_hopper_without_boom_is_calibrated_one_without_feet_is_not():
    recording = steered().recording
    boomless = without(recording, *recording.names("boom"))
    geometry = calibrate(boomless)
    assert geometry.circle is None
    assert geometry.boom_place(boomless.markers) is None
    assert np.isnan(hopper_motion(boomless, geometry).boom_angle_rad).all()
    with pytest.raises(AnalysisError, match="at least two foot markers"):
        calibrate(without(recording, *recording.names("foot")))


def test_feet_that_are_never_seen_in_flight_are_named():
    recording = steered().recording
    positions = recording.positions.copy()
    positions[:, recording.indices("foot")[0]] = np.nan
    with pytest.raises(
        AnalysisError, match="at least 3 feet in sight in flight, found 2"
    ):
        calibrate(replace(recording, positions=positions))


@pytest.mark.parametrize(
    ("reach", "told"),
    [(1e-9, "boom: expected it to move"), (0.3, "at least 30 degrees")],
)
def test_a_boom_that_moves_not_or_too_little_is_refused(reach, told):
    hopper = steered(hops=10)
    recording = hopper.recording
    little = (np.abs(wrapped(hopper.boom_angle - np.pi)) < reach).nonzero()[0]
    short = replace(
        recording,
        time=np.arange(len(little)) / 100.0,
        positions=recording.positions[little],
    )
    with pytest.raises(AnalysisError, match=told):
        calibrate(short)


@pytest.mark.parametrize("noise_m", [0.0, 0.0006])
@pytest.mark.parametrize("seen", [30, 30000])
def test_noise_about_a_place_is_no_circle(noise_m, seen):
    """This holds for any number of frames, and so however far apart the farthest frames are."""
    rng = np.random.default_rng(np.random.SeedSequence([4, seen]))
    boom = np.array([0.5, 0.0, -0.03]) + noise_m * rng.standard_normal((seen, 3))
    with pytest.raises(AnalysisError, match="boom: expected it to move"):
        fit_boom_circle(boom, 0.0006)


def test_a_small_circle_is_known_by_its_own_residual():
    """One of 20 mm is found in 0.6 mm of noise; in 3 mm its angles would say little."""
    rng = np.random.default_rng(np.random.SeedSequence(5))
    angle = rng.uniform(-1.0, 1.0, 2000)
    places = 0.02 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(2000)])
    noise = rng.standard_normal((2000, 3))
    assert fit_boom_circle(places + 0.0006 * noise, 0.0006).radius_m == pytest.approx(
        0.02, rel=0.1
    )
    with pytest.raises(AnalysisError, match="does the boom move"):
        fit_boom_circle(places + 0.003 * noise, 0.0006)


def test_boom_markers_mixed_up_in_some_frames_do_no_harm():
    recording = steered().recording
    positions = recording.positions.copy()
    boom = recording.indices("boom")[0]
    positions[::20, boom] = positions[::20, recording.indices("foot")[0]]
    geometry = calibrate(replace(recording, positions=positions))
    assert geometry.circle.radius_m == pytest.approx(0.25, abs=0.001)


def test_errors_are_rms_of_the_noise_alone():
    hopper = steered(hops=60)
    motion = hopper_motion(hopper.recording, calibrate(hopper.recording))
    arms = BODY - BODY.mean(axis=0)
    bound = 0.0006 / np.sqrt(np.sum(arms[:, :2] ** 2))
    assert rms(wrapped(motion.pose[:, 2] - hopper.yaw)) < 1.05 * bound


def arc(span, n=400, noise=0.0, seed=1):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    angle = np.linspace(0.3, 0.3 + span, n)
    points = 0.25 * np.column_stack([np.cos(angle), np.sin(angle)]) + [1.0, -2.0]
    return points + noise * rng.standard_normal(points.shape)


@pytest.mark.parametrize("fit", [algebraic_circle, geometric_circle])
@pytest.mark.parametrize("span", [0.5, 2.0, 6.2])
def test_exact_points_give_the_circle(fit, span):
    centre, radius = fit(arc(span))
    np.testing.assert_allclose(centre, [1.0, -2.0], atol=1e-9)
    assert radius == pytest.approx(0.25, abs=1e-9)


def test_on_a_short_arc_with_noise_the_algebraic_circle_is_too_small():
    radii = {
        fit: np.mean([fit(arc(0.8, noise=0.002, seed=s))[1] for s in range(60)])
        for fit in (algebraic_circle, geometric_circle)
    }
    assert radii[algebraic_circle] < 0.25 - 0.003
    assert abs(radii[geometric_circle] - 0.25) < 0.3 * (0.25 - radii[algebraic_circle])


@pytest.mark.parametrize("span", [0.2, 1.0, 3.0, 5.5])
def test_the_span_of_an_arc(span):
    x, y = (arc(span) - [1.0, -2.0]).T
    assert arc_span(np.arctan2(y, x)) == pytest.approx(span)


def generator(seed):
    return np.random.default_rng(np.random.SeedSequence(seed))


def seen(shape, n=600, noise=0.0006, seed=1):
    rng = generator(seed)
    angles = rng.uniform(-1, 1, (n, 3)) * [3.0, 0.3, 0.3]
    markers = np.einsum("nij,bj->nbi", rotation_matrices(angles), shape)
    return (
        markers
        + rng.uniform(-1, 1, (n, 1, 3))
        + noise * rng.standard_normal((n, len(shape), 3))
    )


def misfit(found, shape):
    """Return the largest distance between two shapes, whatever their attitudes."""
    centred = shape - shape.mean(axis=0)
    fit = rigid_fit(found[None], centred)
    return np.abs(found - fit.centre[0] - centred @ fit.rotation[0].T).max()


@pytest.mark.parametrize("number", [3, 4, 6])
def test_the_shape_is_found_whatever_the_attitudes(number):
    shape = generator(number).uniform(-0.2, 0.2, (number, 3))
    found, noise = marker_shape(seen(shape))
    assert misfit(found, shape) < 0.0001
    assert noise == pytest.approx(0.0006, rel=0.05)
    np.testing.assert_allclose(found.mean(axis=0), 0, atol=1e-12)


def test_a_shape_is_not_taken_for_its_mirror_image():
    shape = np.array(
        [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1], [0.0, 0.0, 0.0], [0.02, 0.07, -0.1]]
    )
    for mirrored in (shape, shape * [1, 1, -1]):
        assert misfit(marker_shape(seen(mirrored))[0], mirrored) < 0.0001


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("noises_off", [0.0, 1.5])
def test_markers_in_one_plane_but_for_the_noise_are_no_mirror_images(seed, noises_off):
    off = noises_off * 0.002 * np.array([1, -1, 0.5, -0.3, 0.8])
    flat = np.array(
        [[0.1, 0], [0.03, 0.09], [-0.08, 0.06], [-0.08, -0.06], [0.03, -0.09]]
    )
    shape = np.column_stack([flat, off])
    found, noise = marker_shape(seen(shape, noise=0.002, seed=seed))
    assert misfit(found, shape) < 0.0005
    assert noise == pytest.approx(0.002, rel=0.05)


def test_a_tenth_of_the_frames_tells_a_shape_from_its_mirror_image():
    shape = generator(7).uniform(-0.2, 0.2, (4, 3))
    markers = seen(shape)
    markers[60:, 0][::2], markers[61:, 1][::2] = np.nan, np.nan
    assert misfit(marker_shape(markers)[0], shape) < 0.0005


def test_unseen_markers_are_left_out():
    shape = generator(5).uniform(-0.2, 0.2, (4, 3))
    markers = seen(shape)
    markers[generator(6).random(markers.shape[:2]) < 0.2] = np.nan
    assert misfit(marker_shape(markers)[0], shape) < 0.0002


def test_no_frame_need_show_all_markers():
    shape = generator(7).uniform(-0.2, 0.2, (5, 3))
    markers = seen(shape)
    markers[np.arange(600), np.arange(600) % 5] = np.nan
    assert misfit(marker_shape(markers)[0], shape) < 0.0002


def test_three_of_four_cannot_tell_a_shape_from_its_mirror_image():
    markers = seen(generator(7).uniform(-0.2, 0.2, (4, 3)))
    markers[np.arange(600), np.arange(600) % 4] = np.nan
    with pytest.raises(AnalysisError, match="mirror image"):
        marker_shape(markers)


def test_exchanged_markers_in_a_fifth_of_the_frames_do_no_harm():
    shape = generator(8).uniform(-0.2, 0.2, (3, 3))
    markers = seen(shape)
    markers[::5] = markers[::5, [1, 0, 2]]
    found, noise = marker_shape(markers)
    assert misfit(found, shape) < 0.0001
    assert noise < 0.0007


def test_markers_on_a_line_are_refused():
    with pytest.raises(AnalysisError, match="three that are not on a line"):
        marker_shape(seen(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.25, 0, 0]])))


def test_two_markers_are_refused():
    with pytest.raises(AnalysisError, match="expected at least 3, found 2"):
        marker_shape(np.zeros((100, 2, 3)))


def test_hardly_any_frames_are_refused():
    markers = seen(generator(9).uniform(-0.2, 0.2, (3, 3)))
    markers[10:, 0] = np.nan
    with pytest.raises(AnalysisError, match="found 10 of 600"):
        marker_shape(markers)
