import mpmath
import numpy as np
import pytest

from hopdata.maps.subspaces.grassmann import orthonormalised, principal_angles
from hopdata.maps.subspaces.subspace_distances import DISTANCES


@pytest.fixture
def pair():
    a, b = orthonormalised(np.random.default_rng(0).normal(size=(2, 9, 4)))
    return a, orthonormalised(a + 0.4 * b)


def found(name, a, b):
    return float(DISTANCES[name](principal_angles(a, b)))


def test_projection_distances_are_norms_of_differences_of_projections(pair):
    difference = pair[0] @ pair[0].T - pair[1] @ pair[1].T
    assert found("projection_2", *pair) == pytest.approx(np.linalg.norm(difference, 2), rel=1e-13)
    expected = np.linalg.norm(difference) / np.sqrt(2)
    assert found("projection_f", *pair) == pytest.approx(expected, rel=1e-13)


def test_chordal_distances_are_the_least_of_all_bases(pair):
    a, b = pair
    left, _, right = np.linalg.svd(a.T @ b)
    best = a @ left @ right - b  # Schonemann's solution of the Procrustes problem
    assert found("chordal_f", a, b) == pytest.approx(np.linalg.norm(best), rel=1e-13)
    assert found("chordal_2", a, b) == pytest.approx(np.linalg.norm(best, 2), rel=1e-13)
    for turn in orthonormalised(np.random.default_rng(1).normal(size=(50, 4, 4))):
        assert np.linalg.norm(a @ turn - b) > found("chordal_f", a, b)


def test_fubini_study_is_the_angle_of_the_minors(pair):
    a, b = pair
    cosine = abs(np.linalg.det(a.T @ b))
    assert found("fubini_study", a, b) == pytest.approx(np.arccos(cosine), rel=1e-13)


@pytest.mark.parametrize("size", [1e-16, 1e-9, 1e-4, 0.3, 1.5])
def test_every_angle_is_as_good_as_many_digits(size):
    angles = size * np.array([0.2, 0.5, 1.0])
    with mpmath.workdps(60):
        exact = [mpmath.mpf(float(angle)) for angle in angles]
        root = [mpmath.sqrt(sum(f(x) ** 2 for x in exact)) for f in (
            lambda x: x, lambda x: 2 * mpmath.sin(x / 2), mpmath.sin)]  # fmt: skip
        fubini = mpmath.acos(mpmath.fprod(mpmath.cos(x) for x in exact))
        single = [2 * mpmath.sin(exact[-1] / 2), mpmath.sin(exact[-1])]
        expected = [float(value) for value in (*root, fubini, *single)]
    values = [float(distance(angles)) for distance in DISTANCES.values()]
    np.testing.assert_allclose(values, expected, rtol=1e-14)


def test_the_ends_of_the_range():
    assert all(distance(np.zeros((2, 3))).tolist() == [0, 0] for distance in DISTANCES.values())
    right = {name: float(distance(np.full(3, np.pi / 2))) for name, distance in DISTANCES.items()}
    root = np.sqrt(3.0)
    assert right == pytest.approx(
        {
            "arc_length": root * np.pi / 2,
            "chordal_f": root * np.sqrt(2),
            "projection_f": root,
            "fubini_study": np.pi / 2,
            "chordal_2": np.sqrt(2),
            "projection_2": 1.0,
        }
    )


def test_the_arc_length_is_the_largest_and_one_angle_makes_no_difference_of_norms():
    angles = np.random.default_rng(2).uniform(0, np.pi / 2, (200, 5))
    values = {name: distance(angles) for name, distance in DISTANCES.items()}
    assert all((values["arc_length"] >= others - 1e-14).all() for others in values.values())
    single = angles[:, :1]
    for one, other in (("chordal_f", "chordal_2"), ("projection_f", "projection_2")):
        np.testing.assert_allclose(DISTANCES[one](single), DISTANCES[other](single), rtol=1e-14)
