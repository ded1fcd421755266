import numpy as np
import pandas as pd
import pytest

from hopdata.maps.subspaces import (
    arc_length,
    auc,
    measure_distances,
    noised_identity,
    orthonormalised,
    pair_mean_error,
    random,
    summarise_distances,
)


def clouds(rng, centres, count=40, scatter=0.05):
    bases = orthonormalised(rng.normal(size=(centres, 1, 12, 5)))
    noise = scatter * rng.normal(size=(centres, count, 12, 5))
    return dict(zip("abcdef", orthonormalised(bases + noise), strict=False))


def test_baselines_of_a_line_in_a_plane():
    # The angle between two random lines in a plane is uniform in [0, pi/2].
    lengths = random(np.random.default_rng(2), (2, 1), 20_000)
    assert lengths.mean() == pytest.approx(np.pi / 4, abs=0.015)
    assert np.quantile(lengths, 0.25) == pytest.approx(np.pi / 8, abs=0.02)
    assert noised_identity(np.random.default_rng(3), (9, 4), 5, 0.0).max() == 0


def test_equal_pools_overlap_and_different_ones_do_not():
    apart = clouds(np.random.default_rng(8), 3)
    table = measure_distances(apart, (12, 5), seed=1, pairs=200).summary.set_index(
        "kind"
    )
    assert table.loc["cross_class", "auc_against_in_class"] == 1.0
    one = clouds(np.random.default_rng(9), 1, count=120)["a"]
    same = dict(zip("abc", np.split(one, 3), strict=True))
    table = measure_distances(same, (12, 5), seed=1, pairs=200).summary.set_index(
        "kind"
    )
    assert table.loc["cross_class", "auc_against_in_class"] == pytest.approx(
        0.5, abs=0.06
    )
    assert table.loc["in_class", "auc_against_in_class"] == 0.5


def test_tables():
    result = measure_distances(
        clouds(np.random.default_rng(10), 3), (12, 5), seed=1, pairs=50
    )
    assert result.notes == []
    counts = result.distances.groupby("kind", sort=False).size().to_dict()
    assert counts == {
        "in_class": 150,
        "cross_class": 150,
        "noised_identity": 50,
        "random": 50,
    }
    pairs = result.distances.query("kind == 'cross_class'")[
        ["schedule_a", "schedule_b"]
    ]
    assert sorted(set(map(tuple, pairs.to_numpy()))) == [
        ("a", "b"),
        ("a", "c"),
        ("b", "c"),
    ]
    row = result.summary.set_index("kind").loc["random"]
    values = result.distances.query("kind == 'random'")["distance_rad"]
    assert row["mean_distance"] == pytest.approx(values.mean(), rel=1e-12)
    assert row["sd"] == pytest.approx(values.std(), rel=1e-12)
    assert row["q95"] == pytest.approx(values.quantile(0.95), rel=1e-12)


def test_a_schedule_keeps_its_distances_when_others_come_and_go():
    bases = clouds(np.random.default_rng(11), 3)
    whole = measure_distances(bases, (12, 5), seed=1, pairs=50).distances
    part = measure_distances(
        {"c": bases["c"], "a": bases["a"]}, (12, 5), seed=1, pairs=50
    ).distances
    for kind in ("in_class", "random"):
        one, two = (
            table.query(f"kind == '{kind}' and schedule_a in ['', 'c']")[
                "distance_rad"
            ].to_numpy()
            for table in (whole, part)
        )
        assert np.array_equal(one, two)
    again = measure_distances(bases, (12, 5), seed=1, pairs=50).distances
    pd.testing.assert_frame_equal(whole, again)


def test_distances_do_not_depend_on_the_names_of_the_schedules():
    bases = clouds(np.random.default_rng(13), 2)
    streams = {"a": "landing 0", "b": "landing 7"}
    plain = measure_distances(
        bases, (12, 5), seed=1, pairs=50, streams=streams
    ).distances
    renamed = {"a": bases["b"], "b": bases["a"]}
    swapped = {"a": streams["b"], "b": streams["a"]}
    other = measure_distances(
        renamed, (12, 5), seed=1, pairs=50, streams=swapped
    ).distances
    for kind in ("in_class", "cross_class"):
        one, two = (
            table[table["kind"] == kind]["distance_rad"] for table in (plain, other)
        )
        np.testing.assert_allclose(np.sort(one), np.sort(two), rtol=1e-12)
    unstreamed = measure_distances(renamed, (12, 5), seed=1, pairs=50).distances
    assert not np.allclose(
        np.sort(plain["distance_rad"]), np.sort(unstreamed["distance_rad"]), rtol=1e-12
    )


def test_missing_classes_are_noted_and_the_baselines_stay():
    result = measure_distances({}, (34, 17), seed=1, pairs=20)
    assert result.summary["kind"].tolist() == ["noised_identity", "random"]
    assert result.summary["auc_against_in_class"].isna().all()
    assert [note["what"] for note in result.notes] == [
        "in-class distances",
        "cross-class distances",
    ]
    one = measure_distances(
        clouds(np.random.default_rng(12), 1), (12, 5), seed=1, pairs=20
    )
    assert one.notes == [
        {
            "what": "cross-class distances",
            "reason": "1 of the 2 schedules needed have subspaces",
        }
    ]


def test_auc_by_hand_with_ties():
    assert auc(np.array([2.0, 3.0]), np.array([1.0, 2.0, 4.0])) == pytest.approx(
        (1.5 + 2) / 6
    )
    assert np.isnan(auc(np.array([1.0]), np.array([])))


def test_summary_of_a_single_distance():
    row = summarise_distances(
        {"random": np.array([1.25]), "in_class": np.zeros(0)}, {}
    ).iloc[0]
    assert row["kind"] == "random"
    assert row["median_distance"] == 1.25
    assert np.isnan(row["sd"])
    assert np.isnan(row["mean_se"])


def bases(counts, seed=0):
    rng = np.random.default_rng(seed)
    return {
        name: orthonormalised(rng.normal(size=(n, 12, 5))) for name, n in counts.items()
    }


def test_all_pairs_are_measured_once_where_they_are_few():
    draws = bases({"a": 5, "b": 3})
    a, b = draws.values()
    table = measure_distances(draws, (12, 5), seed=1, pairs=1000).distances.set_index(
        "kind"
    )
    found = table.loc["in_class"].query("schedule_a == 'a'")["distance_rad"]
    expected = [arc_length(a[i], a[j]) for i in range(5) for j in range(i + 1, 5)]
    np.testing.assert_allclose(np.sort(found), np.sort(expected), atol=1e-14)
    expected = [arc_length(i, j) for i in a for j in b]
    found = table.loc["cross_class", "distance_rad"]
    np.testing.assert_allclose(np.sort(found), np.sort(expected), atol=1e-14)


def test_in_class_never_compares_a_draw_with_itself():
    table = measure_distances(bases({"a": 30}), (12, 5), seed=1, pairs=400).distances
    assert table.loc[table["kind"] == "in_class", "distance_rad"].min() > 0.1


def test_error_of_a_mean_of_pairs_that_share_draws():
    """For all pairs of R draws it is Hoeffding's: the error of twice the means of the draws."""
    rng = np.random.default_rng(4)
    found, means = [], []
    for _ in range(300):
        draw = rng.normal(size=40)
        first, second = np.triu_indices(40, 1)
        values = draw[first] + draw[second] + 0.1 * rng.normal(size=len(first))
        found.append(pair_mean_error(values, first, second))
        means.append(values.mean())
    assert np.mean(found) == pytest.approx(np.std(means), rel=0.15)
    apart = pair_mean_error(values[:2], np.array([0, 1]), np.array([2, 3]))
    assert apart == pytest.approx(np.std(values[:2]) / np.sqrt(2))
    assert np.isnan(pair_mean_error(values[:1], first[:1], second[:1]))
