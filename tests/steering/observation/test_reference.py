import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.scenes.rigid_body import rotation_matrices
from hopdata.steering.observation.reference import marker_shape
from hopdata.steering.observation.rigid import rigid_fit


def generator(seed):
    return np.random.default_rng(np.random.SeedSequence(seed))


def seen(shape, n=600, noise=0.0006, seed=1):
    rng = generator(seed)
    angles = rng.uniform(-1, 1, (n, 3)) * [3.0, 0.3, 0.3]
    markers = np.einsum("nij,bj->nbi", rotation_matrices(angles), shape)
    return markers + rng.uniform(-1, 1, (n, 1, 3)) + noise * rng.standard_normal((n, len(shape), 3))


def misfit(found, shape):
    """Largest distance between two shapes, whatever their attitude."""
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
    shape = np.array([[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1], [0.0, 0.0, 0.0], [0.02, 0.07, -0.1]])
    for mirrored in (shape, shape * [1, 1, -1]):
        assert misfit(marker_shape(seen(mirrored))[0], mirrored) < 0.0001


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
    with pytest.raises(AnalysisError, match="off one line"):
        marker_shape(seen(np.array([[0.0, 0, 0], [0.1, 0, 0], [0.25, 0, 0]])))


def test_two_markers_are_refused():
    with pytest.raises(AnalysisError, match="expected at least 3, found 2"):
        marker_shape(np.zeros((100, 2, 3)))


def test_hardly_any_frames_are_refused():
    markers = seen(generator(9).uniform(-0.2, 0.2, (3, 3)))
    markers[10:, 0] = np.nan
    with pytest.raises(AnalysisError, match="found 10 of 600"):
        marker_shape(markers)
