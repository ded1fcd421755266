import numpy as np
import pytest

from hopdata.landings.rigid_filling import align, learn_shape, noise_gain, rigid_places

POINTS = np.array(
    [[0.13, 0.03, 0.05], [-0.08, 0.11, 0.075], [-0.07, -0.14, 0.055], [0.02, -0.05, 0.1]]
)
NOISE_M = 0.0006


def rotations(rng, n):
    q, r = np.linalg.qr(rng.standard_normal((n, 3, 3)))
    q *= np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    q[:, :, 2] *= np.linalg.det(q)[:, None]
    return q


def tumbling(n=400, noise_m=NOISE_M, points=POINTS, seed=0):
    """A rigid body anywhere in any attitude, (N, B, 3), and the same without noise."""
    rng = np.random.default_rng(seed)
    true = np.einsum("nij,bj->nbi", rotations(rng, n), points) + rng.uniform(-1, 1, (n, 1, 3))
    return true + noise_m * rng.standard_normal(true.shape), true


def test_aligns_exactly_and_never_mirrors():
    rng = np.random.default_rng(1)
    rotation = rotations(rng, 50)
    place = rng.standard_normal((50, 3))
    frames = np.einsum("nij,bj->nbi", rotation, POINTS) + place[:, None]
    found, at = align(POINTS, frames)
    np.testing.assert_allclose(found, rotation, atol=1e-12)
    np.testing.assert_allclose(at, place, atol=1e-12)
    mirrored, _ = align(POINTS, frames * [1, 1, -1])
    np.testing.assert_allclose(np.linalg.det(mirrored), 1.0)


def test_three_points_in_a_plane_are_aligned_as_well():
    rng = np.random.default_rng(2)
    rotation = rotations(rng, 50)
    frames = np.einsum("nij,bj->nbi", rotation, POINTS[:3])
    np.testing.assert_allclose(align(POINTS[:3], frames)[0], rotation, atol=1e-12)


def test_learns_the_shape_and_the_noise():
    body, _ = tumbling(2000)
    shape = learn_shape(body)
    _, at = align(shape.points, POINTS[None])
    rotation = align(shape.points, POINTS[None])[0][0]
    np.testing.assert_allclose(shape.points @ rotation.T + at, POINTS, atol=5 * NOISE_M / 40)
    assert shape.misfit_m == pytest.approx(NOISE_M, rel=0.1)


@pytest.mark.parametrize("noise_m", [0.0, NOISE_M])
def test_places_are_as_far_off_as_the_noise_and_the_geometry_say(noise_m):
    body, true = tumbling(4000, noise_m)
    shape = learn_shape(body)
    wanted = np.zeros(body.shape[:2], bool)
    wanted[::2, 3] = True
    body[wanted] = np.nan
    places = rigid_places(body, wanted, shape)
    np.testing.assert_array_equal(np.isfinite(places).all(axis=2), wanted)
    error = (places - true)[wanted]
    if noise_m == 0:
        assert np.abs(error).max() < 1e-12
    else:
        gain = noise_gain(shape.points[:3], shape.points[3])
        worst = np.sqrt((error**2).sum(axis=1).mean())
        assert gain * noise_m < worst < np.sqrt(3) * gain * noise_m


def test_what_is_not_wanted_or_not_sure_is_not_placed():
    body, _ = tumbling()
    shape = learn_shape(body)
    body[:10, 3] = np.nan
    body[10:20, 2:] = np.nan
    body[20:30, 3] = np.nan
    body[20:30, 1] += [0.0, 0.0, 0.02]  # does not fit the shape
    wanted = np.isnan(body[..., 0])
    wanted[:5] = False
    found = np.isfinite(rigid_places(body, wanted, shape)).all(axis=2)
    assert found[5:10, 3].all()
    assert found.sum() == 5


def test_markers_in_a_line_tell_no_attitude():
    line = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]])
    assert noise_gain(line, np.array([0.1, 0.1, 0.0])) == np.inf
    body, _ = tumbling(points=np.vstack([line, [[0.1, 0.1, 0.0]]]))
    shape = learn_shape(body)
    body[:10, 3] = np.nan
    assert np.isnan(rigid_places(body, np.isnan(body[..., 0]), shape)).all()


def test_the_gain_in_the_middle_of_a_triangle_is_that_of_a_mean():
    corners = np.array([[1.0, 0, 0], [-0.5, 0.75**0.5, 0], [-0.5, -(0.75**0.5), 0]])
    assert noise_gain(corners, np.zeros(3)) == pytest.approx(1 / np.sqrt(3))


def test_needs_four_markers_and_frames_with_all_of_them():
    body, _ = tumbling()
    assert learn_shape(body[:, :3]) is None
    body[19:, 0] = np.nan
    assert learn_shape(body) is None
