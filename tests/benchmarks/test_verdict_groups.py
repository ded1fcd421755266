"""Groups of bodies, and functions of the instants that are told from kinks."""

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
