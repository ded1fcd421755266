import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hopdata.rigid import (
    LEAST_WIDTH,
    composed,
    headings,
    inverse,
    kabsch,
    relative,
    rigid_fit,
    wrapped,
)
from hopdata.scenes.body import rotation_matrices
from hopdata.synthesis.trial import MarkerOptions

BODY = np.array(MarkerOptions().body_m)
SHAPE = BODY - BODY.mean(axis=0)


def generator(seed):
    return np.random.default_rng(np.random.SeedSequence(seed))


def moved(shape, n, seed, tilt=0.3):
    rng = generator(seed)
    angles = np.column_stack([rng.uniform(-3, 3, n), rng.uniform(-tilt, tilt, (n, 2))])
    rotation, centre = rotation_matrices(angles), rng.uniform(-1, 1, (n, 3))
    return (
        centre[:, None] + np.einsum("nij,bj->nbi", rotation, shape),
        rotation,
        centre,
        angles,
    )


@settings(max_examples=30, deadline=None)
@given(number=st.integers(3, 8), seed=st.integers(0, 2**32))
def test_a_rigid_motion_is_found_exactly(number, seed):
    shape = generator(seed).uniform(-0.2, 0.2, (number, 3))
    markers, rotation, centre, _ = moved(shape, 5, seed, tilt=1.5)
    fit = rigid_fit(markers, shape)
    spread = np.linalg.svd(shape - shape.mean(axis=0), compute_uv=False)
    if spread[1] < LEAST_WIDTH * spread[0]:  # three that happen to be collinear
        assert not fit.known.any()
        return
    np.testing.assert_allclose(fit.rotation, rotation, atol=1e-7)
    np.testing.assert_allclose(fit.centre, centre, atol=1e-7)
    np.testing.assert_allclose(fit.residual_m, 0, atol=1e-9)


def test_rotations_are_proper_also_where_a_mirror_image_fits_better():
    shape = generator(1).uniform(-0.2, 0.2, (4, 3))
    fit = rigid_fit((shape * [1, 1, -1])[None], shape)
    assert np.linalg.det(fit.rotation[0]) == pytest.approx(1.0)
    assert fit.residual_m[0] > 0.01


@pytest.mark.parametrize("number", [3, 4, 8])
def test_rotations_are_those_of_scipy(number):
    shape = generator(number).uniform(-0.2, 0.2, (number, 3))
    shape -= shape.mean(axis=0)
    points = moved(shape, 20, number, tilt=1.5)[0]
    points += 0.02 * generator(30 + number).standard_normal(points.shape)
    points -= points.mean(axis=1, keepdims=True)
    expected = [Rotation.align_vectors(one, shape)[0].as_matrix() for one in points]
    np.testing.assert_allclose(kabsch(points, shape), expected, atol=1e-13)
    fit = rigid_fit(points, shape)
    np.testing.assert_allclose(fit.rotation, expected, atol=1e-13)


def test_three_of_four_markers_are_enough():
    shape = np.vstack([SHAPE, [[0.0, 0.0, 0.1]]])
    markers, rotation, centre, _ = moved(shape, 4, 2)
    for hidden in range(4):
        markers[hidden, hidden] = np.nan
    fit = rigid_fit(markers, shape)
    np.testing.assert_allclose(fit.rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(fit.centre, centre, atol=1e-9)
    assert not fit.leaned.any()


def test_three_markers_on_a_line_are_not():
    shape = np.array(
        [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.1, 0.0]]
    )
    markers, *_ = moved(shape, 1, 3)
    markers[0, 3] = np.nan
    assert not rigid_fit(markers, shape).known[0]


def test_two_markers_lean_on_an_earlier_attitude():
    markers, rotation, centre, _ = moved(SHAPE, 6, 4)
    markers[:, 2] = np.nan
    assert not rigid_fit(markers, SHAPE).known.any()
    fit = rigid_fit(markers, SHAPE, rotation)
    assert fit.leaned.all()
    np.testing.assert_allclose(fit.rotation, rotation, atol=1e-6)
    np.testing.assert_allclose(fit.centre, centre, atol=1e-6)


def test_an_earlier_attitude_only_decides_the_turn_about_the_line():
    markers, _, _, _ = moved(SHAPE, 6, 5)
    markers[:, 0] = np.nan
    stale = np.broadcast_to(np.eye(3), (6, 3, 3))
    fit = rigid_fit(markers, SHAPE, stale)
    np.testing.assert_allclose(fit.residual_m, 0, atol=1e-6)


def test_nothing_is_said_of_frames_with_fewer_markers():
    markers, rotation, _, _ = moved(SHAPE, 3, 6)
    markers[0, 1:], markers[1] = np.nan, np.nan
    fit = rigid_fit(markers, SHAPE, rotation)
    np.testing.assert_array_equal(fit.known, [False, False, True])
    assert np.isnan(fit.centre[:2]).all()
    assert np.isnan(fit.rotation[:2]).all()


def test_the_residual_is_the_noise_of_a_coordinate():
    shape = np.vstack([SHAPE, [[0.0, 0.0, 0.1], [0.05, -0.05, 0.0]]])
    markers, *_ = moved(shape, 4000, 7)
    noise = 0.0006 * generator(8).standard_normal(markers.shape)
    residual = rigid_fit(markers + noise, shape).residual_m
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(0.0006, rel=0.03)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_the_residual_of_markers_on_a_line_is_their_noise_too(count):
    line = np.linspace(0.0, 0.3, count)[:, None] * [0.6, 0.0, 0.8]
    markers, rotation, *_ = moved(line, 4000, 9)
    noise = 0.0006 * generator(10).standard_normal(markers.shape)
    fit = rigid_fit(markers + noise, line, rotation)
    assert fit.leaned.all()
    assert np.sqrt(np.mean(fit.residual_m**2)) == pytest.approx(0.0006, rel=0.03)


def test_heading_is_the_yaw_whatever_the_tilt():
    _, rotation, _, angles = moved(SHAPE, 50, 9, tilt=0.4)
    np.testing.assert_allclose(headings(rotation), angles[:, 0], atol=1e-12)


def matrix(pose):
    x, y, t = pose
    return np.array([[np.cos(t), -np.sin(t), x], [np.sin(t), np.cos(t), y], [0, 0, 1]])


def poses(seed, n=50):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    return rng.uniform(-3, 3, (n, 3))


def test_composition_is_that_of_the_matrices():
    for a, b in zip(poses(1), poses(2), strict=True):
        np.testing.assert_allclose(
            matrix(composed(a, b)), matrix(a) @ matrix(b), atol=1e-14
        )


def test_inverse_undoes_a_motion():
    np.testing.assert_allclose(composed(poses(3), inverse(poses(3))), 0, atol=1e-14)


def test_a_frame_change_leads_from_one_pose_to_the_other():
    a, b = poses(4), poses(5)
    arrived = composed(a, relative(a, b))
    np.testing.assert_allclose(arrived[:, :2], b[:, :2], atol=1e-14)
    np.testing.assert_allclose(wrapped(arrived[:, 2] - b[:, 2]), 0, atol=1e-14)


def test_a_turn_past_the_back_is_the_short_one():
    change = relative([0, 0, 3.0], [0, 0, -3.0])
    np.testing.assert_allclose(change[2], 2 * np.pi - 6.0)


def test_wrapped_keeps_minus_pi_and_moves_pi():
    np.testing.assert_allclose(
        wrapped([-np.pi, np.pi, 3 * np.pi + 0.1]), [-np.pi, -np.pi, 0.1 - np.pi]
    )
