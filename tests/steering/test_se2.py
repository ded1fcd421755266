import numpy as np

from hopdata.steering.se2 import composed, inverse, relative, wrapped


def matrix(pose):
    x, y, t = pose
    return np.array([[np.cos(t), -np.sin(t), x], [np.sin(t), np.cos(t), y], [0, 0, 1]])


def poses(seed, n=50):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    return rng.uniform(-3, 3, (n, 3))


def test_composition_is_that_of_the_matrices():
    for a, b in zip(poses(1), poses(2), strict=True):
        np.testing.assert_allclose(matrix(composed(a, b)), matrix(a) @ matrix(b), atol=1e-14)


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
