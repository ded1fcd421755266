"""The scaling study on made-up maps whose derivatives are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from hopdata.maps.truth.scaling import scaling_table, score_scaling

SCALES = (1.0, 0.5, 0.25, 0.125)
MATRIX = np.random.default_rng(1).normal(size=(11, 8))
KINK = np.random.default_rng(2).normal(size=11)
PUSH = np.random.default_rng(3).normal(size=(11, 3))


def landings(case, scale, *, kink=0.0, bend=0.1, push=1.0, count=600):
    """Outcomes of a map with a kink across x[0] = 0, a bend, and a part that the preloads have."""
    rng = np.random.default_rng(7)
    x = scale * rng.normal(size=(count, 8))
    preloads = scale * rng.normal(size=(count, 3))
    y = x @ MATRIX.T + push * preloads @ PUSH.T
    y += kink * np.abs(x[:, :1]) * KINK + bend * x[:, 1:2] ** 2 * KINK[::-1]
    first = x[:, 0] > 0
    exact = np.array([MATRIX + sign * kink * np.outer(KINK, np.eye(8)[0]) for sign in (1, -1)])
    return SimpleNamespace(
        case=case,
        control=SimpleNamespace(coupling=kink, impulse=0.0, delay_s=0.0),
        scale=scale,
        x=x,
        y=y,
        preloads_n=preloads,
        contact_s=0.01 * scale * rng.normal(size=(count, 3)),
        schedule=np.where(first, "1>2", "2>1"),
        n_failed=3,
        exact_maps=exact,
    )


def table(case="hopper", **how):
    return scaling_table(landings(case, scale, **how) for scale in SCALES)


def test_the_error_of_a_smooth_map_falls_with_the_square_of_the_scale():
    found = table()
    np.testing.assert_allclose(found["slope"], 2.0, atol=0.01)
    np.testing.assert_allclose(found["pooled_over_specialised"], 1.0, atol=0.1)
    assert found["map_difference"].iloc[-1] < 0.3 * found["map_difference"].iloc[0]
    assert (found["exact_difference"] == 0).all()
    assert found["map_error"].iloc[-1] < 0.01
    assert found[["landings", "failed", "schedules"]].iloc[0].tolist() == [600, 3, 2]
    np.testing.assert_allclose(found["spread_ms"] / found["scale"], found["spread_ms"].iloc[0])


def test_the_error_of_a_kinked_map_falls_with_the_scale_and_its_maps_stay_apart():
    found = table("coupling", kink=0.2, bend=0.005)
    np.testing.assert_allclose(found["slope"], 1.0, atol=0.05)
    assert found["pooled_over_specialised"].iloc[-1] > 20
    last = found.iloc[-1]
    assert last["map_difference"] == pytest.approx(last["exact_difference"], rel=0.05)


def test_preloads_are_no_noise_here():
    one, other = table(push=1.0), table(push=0.0)
    size = one["pooled_rms"] / other["pooled_rms"]
    np.testing.assert_allclose(size, size.iloc[0], rtol=1e-6)
    np.testing.assert_allclose(one["slope"], other["slope"], rtol=1e-6)


def test_a_schedule_with_too_few_landings_has_no_map():
    found = table(count=16)
    assert found["schedules"].max() < 2
    assert found["pooled_rms"].notna().all()


def test_a_case_without_landings_has_a_row_without_errors():
    import pandas as pd

    nothing = landings("delay", 1.0, count=0)
    found = scaling_table([nothing, *(landings("hopper", scale) for scale in SCALES)])
    row = found.iloc[0]
    assert (row["case"], row["landings"], row["failed"]) == ("delay", 0, 3)
    assert pd.isna(row["pooled_rms"])
    entries = score_scaling(found)
    assert entries["scaling_slope_delay"]["value"] is None
    assert entries["scaling_slope_hopper"]["value"] == pytest.approx(2, abs=0.01)


def test_the_entries_name_case_strength_and_scale():
    import pandas as pd

    found = pd.concat([table(), table("coupling", kink=0.2)])
    entries = score_scaling(found)
    assert entries["scaling_slope_hopper"]["value"] == pytest.approx(2, abs=0.01)
    assert "coupled forces (kappa 0.2)" in entries["scaling_slope_coupling"]["what"]
    assert "at 0.125 of the spread" in entries["scaling_map_difference_hopper"]["what"]
    assert entries["exact_map_difference_coupling"]["value"] > 0.01
