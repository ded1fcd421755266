import mpmath
import numpy as np
import pytest

from hopdata.maps.subspaces import (
    arc_length,
    noised_identity,
    orthonormalised,
    principal_angles,
    random,
)


def rotated_pair(rng, angles, dimension):
    """Return bases in general position with principal angles `angles`, up to rounding."""
    k = len(angles)
    frame = np.linalg.qr(rng.normal(size=(dimension, 2 * k)))[0]
    mix_a, mix_b = (np.linalg.qr(rng.normal(size=(k, k)))[0] for _ in range(2))
    angles = np.asarray(angles)
    a = frame[:, :k] @ mix_a
    b = (frame[:, :k] * np.cos(angles) + frame[:, k:] * np.sin(angles)) @ mix_b
    return a, b


def exact_angles(a, b):
    """Return principal angles of the column spaces of the given floats, with 60 digits."""
    with mpmath.workdps(60):
        bases = [mpmath.qr(mpmath.matrix(m.tolist()), mode="skinny")[0] for m in (a, b)]
        overlap = bases[0].T * bases[1]
        sines = mpmath.svd_r(bases[1] - bases[0] * overlap, compute_uv=False)
        cosines = mpmath.svd_r(overlap, compute_uv=False)
        pairs = zip(sorted(sines), sorted(cosines, reverse=True), strict=True)
        return np.array([float(mpmath.atan2(s, c)) for s, c in pairs])


ANGLES = [
    [1e-16, 1e-12, 1e-8, 1e-4],
    [0.1, 0.2, np.pi / 2 - 1e-10],
    [1e-16, np.pi / 4, np.pi / 2],
    [np.pi / 4 - 1e-9, np.pi / 4, np.pi / 4 + 1e-9],
    [0.0, 0.0, 0.0],
    [1e-7] * 5,
    [np.pi / 2] * 3,
    list(np.linspace(0.01, 1.5, 6)),
]


@pytest.mark.parametrize("angles", ANGLES)
def test_angles_and_arc_length_against_sixty_digits(angles):
    a, b = rotated_pair(np.random.default_rng(0), angles, 16)
    expected = exact_angles(a, b)
    assert np.abs(principal_angles(a, b) - expected).max() < 1e-14
    assert abs(arc_length(a[None], b[None])[0] - np.linalg.norm(expected)) < 1e-12
    np.testing.assert_allclose(expected, np.sort(angles), atol=1e-14)


@pytest.mark.parametrize("scale", np.geomspace(1e-16, np.pi / 2, 40))
def test_arc_length_over_the_whole_range(scale):
    rng = np.random.default_rng(1)
    angles = scale * rng.uniform(0.1, 1, 17)
    a, b = rotated_pair(rng, angles, 34)
    assert abs(arc_length(a, b) - np.linalg.norm(angles)) < 1e-12


def test_scipy_agrees_where_it_is_accurate_and_not_where_its_mask_is_wrong():
    from scipy.linalg import subspace_angles

    rng = np.random.default_rng(2)
    a, b = (np.linalg.qr(rng.normal(size=(34, 17)))[0] for _ in range(2))
    np.testing.assert_allclose(
        principal_angles(a, b), np.sort(subspace_angles(a, b)), atol=1e-12
    )
    a, b = rotated_pair(rng, [0.1, 0.2, np.pi / 2 - 1e-10], 12)
    assert np.abs(np.sort(subspace_angles(a, b)) - exact_angles(a, b)).max() > 1e-13
    assert np.abs(principal_angles(a, b) - exact_angles(a, b)).max() < 1e-15


def test_complements_are_as_far_apart_as_the_subspaces():
    rng = np.random.default_rng(3)
    a, b = (np.linalg.qr(rng.normal(size=(34, 34)))[0] for _ in range(2))
    lengths = arc_length(a[:, :17], b[:, :17]), arc_length(a[:, 17:], b[:, 17:])
    assert abs(lengths[0] - lengths[1]) < 1e-12


def test_batches_equal_single_pairs_and_bases_do_not_matter():
    rng = np.random.default_rng(4)
    a, b = orthonormalised(rng.normal(size=(2, 6, 10, 4)))
    b[:3] = orthonormalised(a[:3] + 1e-9 * rng.normal(size=(3, 10, 4)))
    mix = orthonormalised(rng.normal(size=(6, 4, 4)))
    single = [arc_length(first, second) for first, second in zip(a, b, strict=True)]
    np.testing.assert_allclose(arc_length(a, b), single, atol=1e-15)
    np.testing.assert_allclose(arc_length(a @ mix, b), single, atol=1e-14)
    np.testing.assert_allclose(arc_length(b, a), single, atol=1e-14)
    np.testing.assert_allclose(
        arc_length(a[0], b), [arc_length(a[0], other) for other in b]
    )


def test_angles_from_nothing_to_a_right_angle_in_one_pair():
    rng = np.random.default_rng(8)
    angles = np.concatenate([np.geomspace(1e-16, 1, 16), [np.pi / 2]])
    a, b = rotated_pair(rng, angles, 34)
    assert abs(arc_length(a[None], b[None])[0] - np.linalg.norm(angles)) < 1e-12


def test_float32_bases_are_computed_in_double():
    a, b = orthonormalised(np.random.default_rng(10).normal(size=(2, 6, 10, 4))).astype(
        np.float32
    )
    expected = arc_length(a.astype(float), b.astype(float))
    np.testing.assert_allclose(arc_length(a, b), expected, rtol=0, atol=1e-14)


def test_haar_and_noised_identity_of_seventeen_in_thirty_four():
    haar = random(np.random.default_rng(0), (34, 17), 4000)
    noised = noised_identity(np.random.default_rng(1), (34, 17), 4000, 0.1)
    # Standard error of the mean 0.0016, of the sd 1.1 %.
    assert haar.mean() == pytest.approx(3.7605, abs=0.006)
    assert haar.std() == pytest.approx(0.102, rel=0.05)
    assert noised.mean() == pytest.approx(2.268, abs=0.006)
    assert noised.std() == pytest.approx(0.098, rel=0.05)
