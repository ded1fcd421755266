import numpy as np
import pytest

from hopdata.maps.subspaces.sensitivity import NOISE_SDS, noise_sensitivity, snr_readings
from hopdata.maps.subspaces.subspace_distances import DISTANCES


@pytest.fixture(scope="module")
def table():
    return noise_sensitivity((12, 5), seed=1, pairs=300)


def column(table, distance, name="mean"):
    return table[table["distance"] == distance].set_index("noise_sd")[name]


def test_one_row_a_distance_and_level(table):
    assert len(table) == len(DISTANCES) * len(NOISE_SDS)
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
    assert row["mean"] == pytest.approx(2.268, abs=0.025)
    near = np.abs(readings["mean"] - 2.268) < 0.3
    assert near.sum() == 1
    assert readings["kind"].tolist()[-1] == "random"
    assert readings["mean"].iloc[-1] == pytest.approx(3.7605, abs=0.025)
