"""From files of contacts and forces to the tables of the overlay, on known and on real data."""

import numpy as np
import pandas as pd
import pytest
from external_blocks import block, columns
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.landings.external_truth import overlay_external_truth
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.overlay_example import FACTORS
from hopdata.landings.sections import select_sections
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.importing import import_recording

FEET = ("foot1", "foot2", "foot3")
SECTIONS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}
RATE_HZ = 1000.0
RISE_N_S, LOAD_N, THRESHOLD_N = 5000.0, 80.0, 10.0


@pytest.fixture(scope="module")
def scene():
    return simulate(60, seed=21)


@pytest.fixture(scope="module")
def touchdowns(scene):
    return touchdown_table(scene.recording, **SECTIONS)


def overlay(scene, touchdowns, *, window_s=0.05, **blocks):
    configured = {"contacts": block("contacts"), "forces": block("forces"), **blocks}
    return overlay_external_truth(
        [scene.recording], touchdowns, {scene.recording.name: configured}, window_s=window_s
    )


def force_file(path, scene, clock_s):
    """A plate under each foot, in kN and upside down, on a clock of its own."""
    time = np.arange(0, scene.recording.time[-1], 1 / RATE_HZ)
    table = {"t": time + clock_s}
    for foot, instants in zip(FEET, scene.contact_times.T, strict=True):
        force = np.random.default_rng(7).normal(0, 0.3, len(time))
        for instant in instants:
            stance = (time >= instant) & (time < instant + 0.15)
            force[stance] += np.minimum(RISE_N_S * (time[stance] - instant), LOAD_N)
        table[f"plate {foot}"] = -force / 1000
    pd.DataFrame(table).to_csv(path, index=False, float_format="%.9g")
    return str(path)


def test_truth_as_a_table_with_an_offset_a_loss_and_an_invention(scene, touchdowns, tmp_path):
    known = pd.DataFrame(1000 * (scene.contact_times - 12.5), columns=list(FEET))
    known.loc[30, "foot2"] = np.nan  # so hopdata's is an invention
    extra = pd.DataFrame({"foot3": [1000 * (scene.contact_times[10, 2] + 0.3 - 12.5)]})
    file = tmp_path / "contacts.csv"
    pd.concat([known, extra]).to_csv(file, index=False, float_format="%.12g")
    contacts = block("contacts", file=str(file), unit="ms", offset_s=12.5)
    found = overlay(scene, touchdowns, contacts=contacts)
    summary = found.summary.set_index("column")
    assert summary["n_matched"].to_dict() == {"foot1": 60, "foot2": 59, "foot3": 60}
    assert summary["n_invented"].to_dict() == {"foot1": 0, "foot2": 1, "foot3": 0}
    assert summary["n_missed"].to_dict() == {"foot1": 0, "foot2": 0, "foot3": 1}
    assert (summary["bias_s"].abs() < 2e-4).all()
    error = touchdowns["contact_foot1_s"] - scene.contact_times[:, 0]
    off = error - error.median()
    assert summary["bias_s"]["foot1"] == pytest.approx(error.median(), abs=1e-8)
    assert summary["robust_sd_s"]["foot1"] == pytest.approx(1.482602 * off.abs().median(), rel=1e-4)
    (invented,) = found.contacts[found.contacts["status"] == "invented"]["index"]
    assert invented == 30
    (missed,) = found.contacts[found.contacts["status"] == "missed"]["external_s"]
    assert missed == pytest.approx(scene.contact_times[10, 2] + 0.3, abs=1e-6)
    assert found.thresholds.empty
    assert set(found.example["kind"]) == {"height", "external", "found"}


def test_truth_as_forces_of_each_foot(scene, touchdowns, tmp_path):
    file = force_file(tmp_path / "plates.csv", scene, clock_s=3.0)
    forces = block(
        "forces", file=file, time_column="t", unit="kN", inverted=True, offset_s=-3.0,
        threshold_n=THRESHOLD_N, columns=columns(**{f"plate {foot}": [foot] for foot in FEET}),
    )  # fmt: skip
    found = overlay(scene, touchdowns, forces=forces)
    summary = found.summary
    assert (summary["n_matched"] == 60).all()
    assert (summary[["n_missed", "n_invented", "n_other_foot"]] == 0).all(axis=None)
    # The force crosses its threshold so long after the contact:
    np.testing.assert_allclose(summary["bias_s"], -THRESHOLD_N / RISE_N_S, atol=2e-4)
    at = found.thresholds[found.thresholds["column"] == "plate foot1"]
    lag = at["threshold"] / RISE_N_S
    np.testing.assert_allclose(at["bias_s"], -lag, atol=3e-4)
    np.testing.assert_allclose(at["threshold"], THRESHOLD_N * np.array(FACTORS))


def test_the_example_is_the_landing_of_median_error(scene, touchdowns, tmp_path):
    file = force_file(tmp_path / "plates.csv", scene, clock_s=0.0)
    forces = block(
        "forces", file=file, time_column="t", unit="kN", inverted=True, threshold_n=THRESHOLD_N,
        columns=columns(**{"plate foot2": ["foot2"]}),
    )  # fmt: skip
    found = overlay(scene, touchdowns, forces=forces)
    example = found.example.set_index("kind")
    assert example.loc["external", "time_s"] == 0.0
    median = np.sort(found.contacts["difference_s"])[29]
    assert example.loc["found", "time_s"] == pytest.approx(median)
    assert example.loc["threshold", "value"] == THRESHOLD_N
    force = example.loc[["force"]]
    before, after = force[force["time_s"] < -0.003], force[force["time_s"] > 0.02]
    assert before["value"].abs().max() < 3
    assert after["value"][:50].min() > 70
    assert set(example.loc["height", "name"]) == {"foot2"}
    assert (example["recording"] == "synthetic").all()


@pytest.mark.parametrize("side", ["R", "L"])
def test_a_runner_over_a_force_plate(external_recording, side):
    """Both feet of the 2.5 m/s run against the force, at the scatter that the project asks for."""
    feet = [f"{side}_{part}" for part in ("heel", "mt1", "mt5")]
    markers = {"body": ["body1", "body2", "body3"], "feet": feet}
    raw, _ = import_recording(external_recording, name="run25", markers=markers)
    recording = level(raw, fit_floor(raw))
    sections = select_sections([recording], frames="landings")
    touchdowns = touchdown_table(
        recording, pre_height_m=sections.pre_height_m, post_height_m=sections.post_height_m
    )
    forces = block(
        "forces", file=str(external_recording.with_name("RBDS001runT25forces.txt")), rate_hz=300,
        columns=columns(Fy=feet), other_feet_above_m=0.03,
    )  # fmt: skip
    configured = {"run25": {"contacts": block("contacts"), "forces": forces}}
    found = overlay_external_truth([recording], touchdowns, configured, window_s=0.05)
    row = found.summary.iloc[0]
    assert (row["n_matched"], row["n_missed"], row["n_invented"]) == (39, 0, 0)
    assert row["n_other_foot"] == 39
    assert row["robust_sd_s"] <= 0.0015
    assert abs(row["bias_s"]) < 0.005
    assert (found.thresholds["n_missed"] == 0).all()
