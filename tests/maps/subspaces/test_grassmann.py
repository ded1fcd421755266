import mpmath
import numpy as np
import pytest

from hopdata.maps.subspaces.grassmann import (
    DISTANCES,
    PRINTED_READING,
    READINGS,
    Reading,
    arc_length,
    noised_identities,
    noised_identity,
    orthonormalised,
    principal_angles,
    random,
)


def rotated_pair(rng, angles, dimension):
    """Bases in general position whose principal angles are `angles`, up to rounding."""
    k = len(angles)
    frame = np.linalg.qr(rng.normal(size=(dimension, 2 * k)))[0]
    mix_a, mix_b = (np.linalg.qr(rng.normal(size=(k, k)))[0] for _ in range(2))
    angles = np.asarray(angles)
    a = frame[:, :k] @ mix_a
    b = (frame[:, :k] * np.cos(angles) + frame[:, k:] * np.sin(angles)) @ mix_b
    return a, b


def exact_angles(a, b):
    """Principal angles of the column spaces of the given floats, in 60 digits."""
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
    np.testing.assert_allclose(principal_angles(a, b), np.sort(subspace_angles(a, b)), atol=1e-12)
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
    np.testing.assert_allclose(arc_length(a[0], b), [arc_length(a[0], other) for other in b])


def test_subspaces_of_unequal_dimension():
    a, b = rotated_pair(np.random.default_rng(5), [1e-9, 0.3, 1.2], 14)
    extra = np.linalg.qr(np.hstack([a, b]))[0][:, :6]
    np.testing.assert_allclose(principal_angles(extra, b), 0, atol=1e-15)
    np.testing.assert_allclose(principal_angles(b[:, :1], extra), [0], atol=1e-15)
    wide = np.hstack([a, np.linalg.svd(np.hstack([a, b]).T)[2][6:8].T])
    np.testing.assert_allclose(principal_angles(wide, b), [1e-9, 0.3, 1.2], atol=1e-14)


def test_angles_from_nothing_to_a_right_angle_in_one_pair():
    rng = np.random.default_rng(8)
    angles = np.concatenate([np.geomspace(1e-16, 1, 16), [np.pi / 2]])
    a, b = rotated_pair(rng, angles, 34)
    assert abs(arc_length(a[None], b[None])[0] - np.linalg.norm(angles)) < 1e-12


def test_float32_bases_are_computed_in_double():
    a, b = orthonormalised(np.random.default_rng(10).normal(size=(2, 6, 10, 4))).astype(np.float32)
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


def test_the_ratio_of_a_reading_is_ten():
    shape = (34, 17)
    for reading in READINGS:
        noise = reading.noise_sd(shape) * np.random.default_rng(2).normal(size=(400, *shape))
        identity = np.eye(*shape)
        signal = 1.0 if reading.signal == "entry" else np.linalg.norm(identity) ** 2
        power = (
            np.mean(noise**2) if reading.signal == "entry" else np.mean(np.sum(noise**2, (1, 2)))
        )
        ratio = signal / power
        assert (ratio**0.5 if reading.ratio == "amplitude" else ratio) == pytest.approx(
            10, rel=0.01
        )


def test_the_printed_reading_is_one_of_them():
    assert PRINTED_READING in READINGS
    assert len(set(READINGS)) == 8
    assert Reading("amplitude", "entry", 2) == PRINTED_READING
    assert PRINTED_READING.noise_sd((34, 17)) == 0.1


def test_only_as_many_as_are_said_have_noise():
    identity = np.eye(9, 4)
    a, b = noised_identities(np.random.default_rng(3), (9, 4), 5, 0.1, noised=1)
    np.testing.assert_allclose(np.abs(b), np.broadcast_to(identity, (5, 9, 4)))
    assert np.abs(np.abs(a) - identity).max() > 0.05


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
