"""Printed variants of chapter II, each run from its key of the configuration."""

import numpy as np
import pytest

from hopdata.config.loading import load_config
from hopdata.landings.states.pairs import Pairs
from hopdata.maps.subspaces import (
    arc_length,
    bootstrap_subspaces,
    measure_distances,
    principal_subspaces,
)
from hopdata.stages import LINE

ORDERS = ("1>2>3", "1>3>2", "2>1>3", "2>3>1", "3>1>2", "3>2>1")
UNITS = {"length_unit_m": 1.0, "time_unit_s": 1.0}


@pytest.fixture(scope="module")
def pairs():
    """Return landings of six orders with one map and noise."""
    rng = np.random.default_rng(0)
    n = 6 * 50
    x = rng.normal(size=(n, 18))
    y = x @ rng.normal(size=(18, 18)) / 4 + 0.1 * rng.normal(size=(n, 18))
    return Pairs(
        x=x,
        y=y,
        schedule=np.repeat(ORDERS, 50),
        spread_s=rng.uniform(0, 0.03, n),
        recording=np.repeat("one", n),
        touchdown=np.arange(n) + 1,
        body_markers=("b1", "b2", "b3"),
    )


def run(stage, pairs, **keys):
    """Run a stage with these keys of the configuration."""
    content = {
        "study": "trial",
        "recordings": [{"name": "one", "file": "one.tsv"}],
        "markers": {"body": ["b1", "b2", "b3"], "feet": ["f1", "f2", "f3"]},
    }
    config = load_config({**content, **keys}, check_files=False)
    found = LINE.stages[stage]
    return found.function(pairs, UNITS, **found.settings(config, ""))


def median_errors(pairs, draws):
    keys = {"bootstraps": 60, "train": 40, "test": 10, "draws": draws}
    summary = run("prediction", pairs, prediction=keys).prediction_summary
    return summary.set_index("model")["median_mse"]


def test_bootstraps_with_replacement(pairs):
    distinct = median_errors(pairs, "distinct")
    resampled = median_errors(pairs, "resampled")
    together = median_errors(pairs, "resampled_together")
    # Fewer distinct landings make a worse fit; landings that are fitted and tested
    # flatter it.
    assert resampled["specialised"] > 1.5 * distinct["specialised"]
    assert together["specialised"] < 0.8 * resampled["specialised"]
    # A mean needs few landings, so replacement costs it little.
    assert resampled["mean"] == pytest.approx(distinct["mean"], rel=0.15)


def test_a_draw_with_replacement_may_be_larger_than_a_class(pairs):
    keys = {"bootstraps": 3, "train": 120, "test": 41}
    made = run("prediction", pairs, prediction={**keys, "draws": "resampled"})
    assert made.prediction_summary["n_train"].tolist() == [120] * 6
    assert made.prediction_notes == []
    distinct = run("prediction", pairs, prediction=keys)
    assert set(distinct.prediction_summary["n_train"]) == {37}
    (note,) = distinct.prediction_notes
    assert "instead of 120 and 41" in note["what"]


def distances(pairs, **keys):
    made = run(
        "constraint_subspaces",
        pairs,
        subspaces={"bootstraps": 40, **keys},
        distances={"pairs": 100},
    )
    return made.distance_summary.set_index("kind")[
        "mean_distance"
    ], made.distances_notes


def test_the_smallest_components_are_as_far_apart_as_the_leading_ones(pairs):
    leading, _ = distances(pairs)
    smallest, notes = distances(pairs, which="smallest")
    assert smallest["in_class"] == pytest.approx(leading["in_class"], abs=1e-9)
    assert smallest["cross_class"] == pytest.approx(leading["cross_class"], abs=1e-9)
    assert not notes


def test_the_smallest_of_the_spanned_components_are_no_complement(pairs):
    leading, _ = distances(pairs)
    spanned, _ = distances(pairs, which="smallest_spanned")
    assert spanned["in_class"] > 1.1 * leading["in_class"]


@pytest.mark.parametrize("incomplete", ["leave_out", "redraw", "keep"])
def test_subspaces_of_landings_drawn_with_replacement(pairs, incomplete):
    drawn, notes = distances(pairs, draws="resampled", incomplete=incomplete)
    distinct, _ = distances(pairs)
    # Of 50 landings drawn 30 times some 23 are distinct: no draw lacks 17 components.
    assert not notes
    assert drawn["in_class"] != distinct["in_class"]


def thirty(pairs, incomplete):
    rows = np.arange(30)
    return bootstrap_subspaces(
        pairs.x[rows],
        pairs.y[rows],
        pairs.schedule[rows],
        seed=1,
        bootstraps=1000,
        draws="resampled",
        incomplete=incomplete,
    )


def test_a_class_of_thirty_lacks_components_in_a_sixth_of_the_draws(pairs):
    left_out = thirty(pairs, "leave_out")
    (bases,) = left_out.bases.values()
    # The share of draws of 30 out of 30 with at most 17 distinct ones is 16.5 %.
    assert 1000 - len(bases) == pytest.approx(165, abs=35)
    (note,) = left_out.notes
    lacking = 1000 - len(bases)
    assert note["reason"] == f"{lacking} of 1000 draws have fewer than 17 components"

    kept = thirty(pairs, "keep")
    assert len(kept.bases["1>2>3"]) == 1000
    assert kept.notes[0]["reason"].startswith(f"{lacking} of 1000 draws")
    assert kept.notes[0]["reason"].endswith("a part of each subspace is arbitrary")

    again = thirty(pairs, "redraw")
    assert len(again.bases["1>2>3"]) == 1000
    assert again.notes[0]["reason"].endswith("they were drawn again")
    # Those that were complete are the same; the others are new.
    same = (again.bases["1>2>3"] == kept.bases["1>2>3"]).all(axis=(1, 2))
    assert np.sum(~same) == lacking


def test_a_draw_of_too_few_distinct_landings_is_told():
    points = np.random.default_rng(1).normal(size=(30, 34))
    few = np.repeat(np.arange(15), 2)[None]
    enough = np.arange(30)[None]
    for which in ("leading", "smallest", "smallest_spanned"):
        bases, full = principal_subspaces(points, np.vstack([few, enough]), 17, which)
        assert full.tolist() == [False, True]
        eye = bases.swapaxes(1, 2) @ bases
        np.testing.assert_allclose(eye, np.tile(np.eye(17), (2, 1, 1)), atol=1e-12)


def test_smallest_components_are_the_complement():
    points = np.random.default_rng(2).normal(size=(40, 34))
    draws = np.arange(40)[None]
    leading, _ = principal_subspaces(points, draws, 17)
    smallest, _ = principal_subspaces(points, draws, 17, "smallest")
    assert np.abs(leading[0].T @ smallest[0]).max() < 1e-12
    assert arc_length(leading[0], smallest[0]) > 6


@pytest.mark.parametrize("key", ["which", "draws", "incomplete"])
def test_unknown_choices_are_refused(pairs, key):
    with pytest.raises(Exception, match=f"subspaces.{key}: expected one of"):
        bootstrap_subspaces(pairs.x, pairs.y, pairs.schedule, seed=1, **{key: "odd"})


def test_defaults_are_as_before(pairs):
    plain = bootstrap_subspaces(pairs.x, pairs.y, pairs.schedule, seed=1, bootstraps=5)
    named = bootstrap_subspaces(
        pairs.x,
        pairs.y,
        pairs.schedule,
        seed=1,
        bootstraps=5,
        which="leading",
        draws="distinct",
        incomplete="leave_out",
    )
    for order, bases in plain.bases.items():
        assert (bases == named.bases[order]).all()
    found = measure_distances(plain.bases, plain.shape, seed=1, pairs=10)
    assert set(found.summary["kind"]) == {
        "in_class",
        "cross_class",
        "noised_identity",
        "random",
    }
