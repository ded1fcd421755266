"""Groups of bodies, and functions of the instants that are told from kinks."""

import fading
import numpy as np
import pandas as pd
import pytest
import verdict_groups
from verdict_growth import shape


def studies(true, *, scatter=0.003):
    """Return made-up studies of 20 subjects whose squared size is known."""
    rng = np.random.default_rng(1)
    rows = []
    for kind, size in true.items():
        for seed in range(20):
            squared = size**2 + scatter * rng.standard_normal()
            row = {"kind": kind, "seed": seed, "landings": 400, "true": size}
            row |= {"conclusion": "different" if size else "cannot tell", "low": 0.0}
            row |= {"squared": squared, "squared_error": scatter, "along_error": 0.01}
            rows.append(row | {"allowed": 0.1, "left": 0.1})
    return pd.DataFrame(rows)


def test_groups_with_a_difference_are_found_and_others_are_not(monkeypatch):
    monkeypatch.setattr(verdict_groups, "GROUPS", 5)
    table = verdict_groups.tables(studies({"c1": 0.0, "clutch": 0.4}))
    found = table.set_index(["kind", "subjects"])
    assert (found.loc["c1", "found"] == 0.0).all()
    assert (found.loc["clutch", "found"] == 1.0).all()
    assert (found.loc["clutch", "interval_holds"] == 1.0).all()
    assert found.loc[("clutch", 8), "true_median"] == pytest.approx(0.4)
    assert found.loc[("half", 8), "true_median"] == pytest.approx(0.4 / np.sqrt(2))
    assert (found.loc["conditions", "found"] == 1.0).all()


def test_a_truth_that_is_missed_is_told(monkeypatch):
    monkeypatch.setattr(verdict_groups, "GROUPS", 5)
    wrong = studies({"c1": 0.0, "clutch": 0.4})
    wrong.loc[wrong["kind"] == "clutch", "true"] = 0.9
    found = verdict_groups.tables(wrong).set_index(["kind", "subjects"])
    assert (found.loc["clutch", "bound_holds"] == 0.0).all()


def test_what_is_added_has_a_slope_at_the_simultaneous_contact_only_if_it_is_a_kink():
    rng = np.random.default_rng(2)
    far = rng.standard_normal((500, 3))
    near = np.concatenate([far, 1e-4 * far])
    slopes = {}
    for kind in ("kink", "square", "bend 1"):
        value = shape(kind, near)
        least = shape(kind, np.concatenate([far, 0.0 * far]))[-1]
        slopes[kind] = np.abs(value[500:] - least).max() / 1e-4
    assert slopes["kink"] > 0.5
    assert max(slopes["square"], slopes["bend 1"]) < 0.01


def test_a_difference_that_fades_starts_as_a_kink_of_known_size():
    """0.269 is the size that docs/verdict.md computes for the same landings."""
    lasting = fading.fading_landings("lasting", "latest - mean", 0.003, 1, strength=50)
    assert lasting.at_contact == pytest.approx(0.269, abs=5e-4)
    for delay in fading.DELAYS:
        sizes = {
            name: fading.fading_landings(name, delay, 0.003, 1, strength=50)
            for name in fading.SHAPES
        }
        at_contact = sizes["lasting"].at_contact
        assert sizes["lasting"].average == pytest.approx(at_contact)
        for name, found in sizes.items():
            assert found.at_contact == pytest.approx(at_contact)
            assert (found.average < 0.6 * at_contact) == (name != "lasting")


def test_shapes_have_the_slope_one_at_zero_and_that_of_their_derivative():
    delays = np.array([1e-6, 0.3, 0.8, 2.5])
    for function, derivative in fading.SHAPES.values():
        slope = (function(delays + 1e-7) - function(delays - 1e-7)) / 2e-7
        assert slope == pytest.approx(derivative(delays), rel=1e-4)
        assert slope[0] == pytest.approx(1.0, rel=1e-4)
