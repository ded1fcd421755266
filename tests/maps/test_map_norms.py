import numpy as np
import pytest

from hopdata.maps.map_norms import COLUMNS, map_differences

ORDERS = np.array(["1>2>3", "1>3>2", "2>1>3"])


def landings(difference, noise=0.01, n=900):
    """Return landings of maps that differ by order in one output and one input."""
    rng = np.random.default_rng(0)
    labels = np.arange(n) % 3
    x = rng.normal(size=(n, 5))
    slopes = np.eye(5)
    y = x @ slopes + noise * rng.normal(size=(n, 5))
    y[:, 0] += difference * x[:, 1] * (labels == 0)
    return x, y, ORDERS[labels]


def medians(table):
    return table.groupby(["kind", "schedule_a", "schedule_b"])[
        ["operator", "frobenius"]
    ].median()


def test_a_difference_of_rank_one_is_equal_in_both_norms():
    found = medians(map_differences(*landings(0.5), seed=1))
    # The map of all landings is the identity plus a sixth in one entry.
    whole = np.eye(5)
    whole[0, 1] = 0.5 / 3
    for other in ORDERS[1:]:
        row = found.loc["cross_class", ORDERS[0], other]
        assert row["operator"] == pytest.approx(0.5 / np.linalg.norm(whole, 2), rel=0.1)
        assert row["frobenius"] == pytest.approx(0.5 / np.linalg.norm(whole), rel=0.1)


def test_orders_of_one_map_differ_as_much_as_its_halves():
    found = map_differences(*landings(0.0), seed=1)
    by_kind = found.groupby("kind")[["operator", "frobenius"]].median()
    across = by_kind.loc["cross_class"]
    within = by_kind.loc["in_class"]
    np.testing.assert_allclose(across, within, rtol=0.1)
    assert (within < 0.01).all()
    apart = map_differences(*landings(0.5), seed=1)
    assert apart.groupby("kind")["operator"].median()["cross_class"] > 0.4


def test_the_size_of_inputs_does_not_matter():
    x, y, schedule = landings(0.5)
    found = map_differences(x, y, schedule, seed=1, draws=3)
    scaled = map_differences(
        x * np.array([1, 7, 1, 0.1, 1]), y, schedule, seed=1, draws=3
    )
    np.testing.assert_allclose(
        scaled[["operator", "frobenius"]], found[["operator", "frobenius"]], rtol=1e-9
    )


def test_too_few_landings_give_an_empty_table():
    x, y, schedule = landings(0.0, n=30)
    found = map_differences(x, y, schedule, seed=1)
    assert found.empty
    assert found.columns.tolist() == list(COLUMNS)
