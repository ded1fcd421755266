"""Distances between noisy subspaces, and the readings of a signal-to-noise ratio."""

import mpmath
import numpy as np
import pytest

from hopdata.maps.distances import (
    DISTANCES,
    NOISE_SDS,
    PRINTED_READING,
    READINGS,
    Reading,
    noise_sensitivity,
    noised_identities,
    snr_readings,
)
from hopdata.maps.subspaces import orthonormalised, principal_angles
from plain_columns import shadowed


def test_the_ratio_of_a_reading_is_ten():
    shape = (34, 17)
    for reading in READINGS:
        noise = reading.noise_sd(shape) * np.random.default_rng(2).normal(
            size=(400, *shape)
        )
        identity = np.eye(*shape)
        signal = 1.0 if reading.signal == "entry" else np.linalg.norm(identity) ** 2
        power = (
            np.mean(noise**2)
            if reading.signal == "entry"
            else np.mean(np.sum(noise**2, (1, 2)))
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
    assert found("projection_2", *pair) == pytest.approx(
        np.linalg.norm(difference, 2), rel=1e-13
    )
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
    assert all(
        distance(np.zeros((2, 3))).tolist() == [0, 0] for distance in DISTANCES.values()
    )
    right = {
        name: float(distance(np.full(3, np.pi / 2)))
        for name, distance in DISTANCES.items()
    }
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
    assert all(
        (values["arc_length"] >= others - 1e-14).all() for others in values.values()
    )
    single = angles[:, :1]
    for one, other in (("chordal_f", "chordal_2"), ("projection_f", "projection_2")):
        np.testing.assert_allclose(
            DISTANCES[one](single), DISTANCES[other](single), rtol=1e-14
        )


@pytest.fixture(scope="module")
def table():
    return noise_sensitivity((12, 5), seed=1, pairs=300)


def column(table, distance, name="mean_distance"):
    return table[table["distance"] == distance].set_index("noise_sd")[name]


def test_one_row_a_distance_and_level(table):
    assert len(table) == len(DISTANCES) * len(NOISE_SDS)
    assert shadowed(table) == []
    assert 0.1 in NOISE_SDS
    assert table["doubling"].isna().sum() == 2 * len(DISTANCES)


def test_little_noise_makes_every_distance_grow_in_proportion(table):
    for distance in DISTANCES:
        means = column(table, distance)
        assert means.iloc[2] / means.iloc[0] == pytest.approx(2, rel=0.06)


def test_the_arc_length_is_the_largest_at_any_noise(table):
    for distance in DISTANCES:
        assert (column(table, "arc_length") >= column(table, distance) - 1e-12).all()


def test_much_noise_makes_subspaces_random_and_bounded_distances_blind(table):
    shares = column(table, "arc_length", "share_of_random")
    assert shares.iloc[-1] == pytest.approx(1, abs=0.03)
    blind = {name: column(table, name, "doubling").loc[0.2] for name in DISTANCES}
    assert blind["arc_length"] > blind["fubini_study"]
    assert blind["arc_length"] > blind["projection_2"]


def test_a_level_does_not_depend_on_the_others(table):
    alone = noise_sensitivity((12, 5), seed=1, pairs=300, noise_sds=(0.1, 0.2))
    assert column(alone, "chordal_f").loc[0.1] == column(table, "chordal_f").loc[0.1]


def test_readings_mark_the_printed_one_and_only_it_gives_the_printed_distance():
    readings = snr_readings((34, 17), seed=1, pairs=300)
    assert readings["printed"].sum() == 1
    row = readings[readings["printed"]].iloc[0]
    assert (row["kind"], row["noise_sd"]) == ("noised_identity", 0.1)
    assert row["mean_distance"] == pytest.approx(2.268, abs=0.025)
    near = np.abs(readings["mean_distance"] - 2.268) < 0.3
    assert near.sum() == 1
    assert readings["kind"].tolist()[-1] == "random"
    assert readings["mean_distance"].iloc[-1] == pytest.approx(3.7605, abs=0.025)
