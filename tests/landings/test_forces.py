"""From files of contacts and forces to the tables of the overlay, on known and on real data."""

import numpy as np
import pandas as pd
import pytest
from external_blocks import block, columns
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.errors import AnalysisError
from hopdata.landings.external_truth import overlay_external_truth
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.forces import (
    FACTORS,
    contact_times_of,
    force_onsets,
    threshold_of,
)
from hopdata.landings.sections.select import select_sections
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.external import Column, ForceSignal
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
        [scene.recording],
        touchdowns,
        {scene.recording.name: configured},
        window_s=window_s,
    )


def force_file(path, scene, clock_s):
    """Write a plate under each foot, in kN and upside down, on a clock of its own."""
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


def test_truth_as_a_table_with_an_offset_a_loss_and_an_invention(
    scene, touchdowns, tmp_path
):
    known = pd.DataFrame(1000 * (scene.contact_times - 12.5), columns=list(FEET))
    known.loc[30, "foot2"] = (
        np.nan
    )  # so the contact that hopdata finds there is invented
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
    assert summary["robust_sd_s"]["foot1"] == pytest.approx(
        1.482602 * off.abs().median(), rel=1e-4
    )
    (invented,) = found.contacts[found.contacts["status"] == "invented"]["touchdown"]
    assert invented == 31
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
    # The force crosses its threshold this long after the contact.
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
    """Both feet of the 2.5 m/s run agree with the force within the required scatter."""
    feet = [f"{side}_{part}" for part in ("heel", "mt1", "mt5")]
    markers = {"body": ["body1", "body2", "body3"], "feet": feet}
    raw, _ = import_recording(external_recording, name="run25", markers=markers)
    recording = level(raw, fit_floor(raw))
    sections = select_sections([recording], frames="landings")
    touchdowns = touchdown_table(
        recording,
        pre_height_m=sections.pre_height_m,
        post_height_m=sections.post_height_m,
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


# Onsets of a force: instants of known crossings, rattles, dips, gaps, thresholds.

FORCE_CONTACTS_RATE_HZ = 500.0
OPTIONS = {
    "threshold_n": None,
    "threshold_share": 0.05,
    "body_weight_n": None,
    "other_feet_above_m": None,
}


def signal(force, **options):
    time = np.arange(len(force)) / FORCE_CONTACTS_RATE_HZ
    column = Column("Fz", ("heel", "toe"))
    unit = options.pop("unit", "N")
    return ForceSignal(
        column, time, np.asarray(force, float), unit, {**OPTIONS, **options}
    )


def stances(onsets, *, n=2000, rise_n_s=20_000.0, load_n=800.0, length_s=0.2):
    """Return ramps that start exactly at the onsets, are held, and drop."""
    time = np.arange(n) / FORCE_CONTACTS_RATE_HZ
    force = np.zeros(n)
    for onset in onsets:
        stance = (time > onset) & (time < onset + length_s)
        force[stance] = np.minimum(rise_n_s * (time[stance] - onset), load_n)
    return force


def instants(force_signal, threshold):
    return contact_times_of(force_signal, threshold=threshold).instant


ONSETS = np.array([0.3137, 1.1002, 1.9999, 3.0503])


def test_a_ramp_crosses_the_threshold_when_it_must():
    found = instants(signal(stances(ONSETS)), 100.0)
    np.testing.assert_allclose(found, ONSETS + 100 / 20_000, atol=1e-12)


def test_rattles_and_dips_make_no_contacts():
    force = stances(ONSETS)
    force[40:44] = 150.0  # a rattle of the plate
    force[(np.abs(np.arange(2000) / FORCE_CONTACTS_RATE_HZ - 1.2)) < 0.004] = (
        0.0  # a dip in stance
    )
    found = instants(signal(force), 50.0)
    np.testing.assert_allclose(found, ONSETS + 50 / 20_000, atol=1e-12)


def test_a_dip_during_the_rise_belongs_to_the_contact():
    force = stances(ONSETS)
    rise = np.flatnonzero(force > 100)[:1]
    force[rise + 1] = 0.0
    found = instants(signal(force), 50.0)
    np.testing.assert_allclose(found, ONSETS + 50 / 20_000, atol=1e-12)


def test_an_onset_beside_a_missing_sample_is_left_out():
    force = stances(ONSETS)
    first = int(np.flatnonzero(force > 0)[0])
    force[first - 1 : first + 2] = np.nan
    found = instants(signal(force), 100.0)
    np.testing.assert_allclose(found, ONSETS[1:] + 100 / 20_000, atol=1e-12)


def test_a_signal_that_begins_loaded_has_no_first_onset():
    force = stances([-0.1, 1.1002])
    np.testing.assert_allclose(instants(signal(force), 100.0), [1.1052])


def test_a_load_that_is_never_reached_is_told():
    with pytest.raises(
        AnalysisError, match=r"more than twice the threshold of 500 N.*800"
    ):
        instants(signal(stances(ONSETS)), 500.0)
    with pytest.raises(AnalysisError, match="found at most 0"):
        instants(signal(np.zeros(100)), 20.0)


def test_thresholds():
    force = stances(ONSETS)
    assert threshold_of(signal(force, threshold_n=33.0)) == 33.0
    assert threshold_of(signal(force, body_weight_n=700.0)) == pytest.approx(35.0)
    assert threshold_of(signal(force)) == pytest.approx(0.05 * force.mean())
    assert threshold_of(signal(force / 700, unit="body_weight")) == 0.05


def test_contact_times_carry_column_span_and_other_feet():
    times = contact_times_of(
        signal(stances(ONSETS), threshold_n=100.0, other_feet_above_m=0.02)
    )
    assert times.column.feet == ("heel", "toe")
    assert times.source == "forces"
    assert times.span_s == (0.0, pytest.approx(1999 / FORCE_CONTACTS_RATE_HZ))
    assert times.other_feet_above_m == 0.02
    np.testing.assert_allclose(times.instant, ONSETS + 0.005)
    higher = contact_times_of(signal(stances(ONSETS)), threshold=200.0)
    np.testing.assert_allclose(higher.instant, ONSETS + 0.01)


# Onsets of force on a plate.

TIME = np.arange(3000) / 300


def stances_force_onsets(starts, length=0.25, peak=1200.0):
    since = TIME[:, None] - np.asarray(starts)
    inside = (since > 0) & (since < length)
    return np.where(inside, peak * np.sin(np.pi * since / length), 0.0).sum(axis=1)


def test_each_stance_has_one_onset_despite_noise():
    rng = np.random.default_rng(0)
    starts = 0.3 + 0.38 * np.arange(25) + rng.uniform(0, 1 / 300, 25)
    force = stances_force_onsets(starts) + rng.normal(0, 20, len(TIME))
    found = force_onsets(TIME, force, least_n=90.0)
    assert len(found) == 25
    assert np.std(found - starts) < 0.002
    clean = force_onsets(TIME, stances_force_onsets(starts), least_n=90.0)
    expected = starts + 0.25 / np.pi * np.arcsin(90 / 1200)
    np.testing.assert_allclose(clean, expected, atol=1e-4)


def test_a_stance_under_way_and_one_too_weak_have_none():
    assert len(force_onsets(TIME, stances_force_onsets([-0.1, 2.0]))) == 1
    assert len(force_onsets(TIME, stances_force_onsets([2.0], peak=300.0))) == 0
    assert len(force_onsets(TIME, np.full(len(TIME), np.nan))) == 0
