"""The touchdown table: columns, reasons, the example, a real recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.errors import AnalysisError, ConfigError
from hopdata.landings.contacts import kink_law
from hopdata.landings.contacts.descents import (
    CONTINUED_S,
    LANDED,
    Transitions,
    descents,
    find_hidden_landings,
)
from hopdata.landings.contacts.find import find_landings
from hopdata.landings.contacts.joined import join_feet
from hopdata.landings.contacts.judged import Contacts
from hopdata.landings.contacts.tables import floor_instants
from hopdata.landings.contacts.timing import METHODS
from hopdata.landings.contacts.velocity_minimum import example_touchdown
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.forces import force_onsets
from hopdata.landings.schedules import order_probability, schedule_names
from hopdata.landings.touchdowns import (
    exclusion_reasons,
    left_out,
    touchdown_table,
)
from hopdata.recording import Recording
from hopdata.recordings.importing import import_recording

SECTIONS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}


@pytest.fixture(scope="module")
def scene():
    return simulate(120, seed=9)


@pytest.fixture(scope="module")
def table(scene):
    return touchdown_table(scene.recording, **SECTIONS)


def with_feet(recording, heights):
    positions = recording.positions.copy()
    positions[:, recording.indices("foot"), 2] = heights
    return replace(recording, positions=positions)


def test_what_is_left_out_by_hand_says_why(table):
    begin, end = table["t_pre_s"][10], table["t_post_s"][12]
    spans = [
        {
            "from_s": begin - 0.01,
            "to_s": begin + 0.001,
            "reason": "a cable",
        },  # part of the first
        {"from_s": end - 0.001, "to_s": end + 0.01, "reason": "fell"},
        {"from_s": begin, "to_s": end, "reason": "both"},
    ]
    found = left_out(table, spans)
    assert found["reason"][10:13].tolist() == [
        "by hand: a cable",
        "by hand: both",
        "by hand: fell",
    ]
    assert found["excluded"].sum() == table["excluded"].sum() + 3
    pd.testing.assert_frame_equal(found.drop([10, 11, 12]), table.drop([10, 11, 12]))
    assert not table["excluded"][10:13].any()
    again = left_out(found, [{"from_s": begin, "to_s": end, "reason": "other"}])
    pd.testing.assert_frame_equal(again, found)


def test_landings_feet_and_recordings_are_left_out_by_hand(scene, table):
    foot, body = scene.recording.names("foot")[1], scene.recording.names("body")[0]
    used = ~table["excluded"]
    found = left_out(table, [{"landings": [4, 7], "reason": "a cable"}])
    by_hand = found["reason"] == "by hand: a cable"
    assert found["touchdown"][by_hand].tolist() == [4, 7]
    with pytest.raises(
        AnalysisError, match=r"expected numbers of the \d+ landings of .* found 9999"
    ):
        left_out(table, [{"landings": [9999], "reason": "typo"}])
    begin, end = table["t_pre_s"][4], table["t_post_s"][5]
    found = left_out(
        table, [{"from_s": begin, "to_s": end, "markers": [foot], "reason": "loose"}]
    )
    assert (found["reason"][4:6] == f"by hand: {foot}: loose").all()
    assert found["excluded"][4:6].all()
    pd.testing.assert_frame_equal(found.drop([4, 5]), table.drop([4, 5]))
    entry = {"from_s": begin, "to_s": end, "markers": [body], "reason": "loose"}
    pd.testing.assert_frame_equal(
        left_out(table, [entry]), table
    )  # the other recordings carry it
    gone = table.assign(excluded=table["excluded"] | (table.index == 4))
    assert left_out(gone, [entry])["reason"][4] == f"by hand: {body}: loose"
    whole = left_out(table, [{"reason": "the belt slipped"}])
    assert whole["excluded"].all()
    assert (whole["reason"][used] == "by hand: the belt slipped").all()


@pytest.mark.parametrize(
    ("lifted_m", "said"),
    [(0.3, "no foot of the study landed"), (0.0, "post section never reached")],
)
def test_a_descent_that_ends_early_is_another_leg_s_if_no_foot_comes_down(
    scene, lifted_m, said
):
    recording, t = scene.recording, scene.recording.time
    table = touchdown_table(recording, **SECTIONS)
    inside = (t > table["t_pre_s"][20] - 0.01) & (t < table["t_pre_s"][21] - 0.1)
    positions = recording.positions.copy()
    body, feet = recording.indices("body"), recording.indices("foot")
    sunk = np.minimum(recording.body_height - POST_HEIGHT_M - 0.01, 0.0)[inside]
    positions[np.ix_(inside, body, [2])] -= sunk[:, None, None]
    positions[np.ix_(inside, feet, [2])] += lifted_m
    found = touchdown_table(replace(recording, positions=positions), **SECTIONS)
    assert len(found) == len(table)
    assert found["reason"][20] == said


def test_columns(table):
    feet = ["foot1", "foot2", "foot3"]
    assert list(table.columns) == [
        "recording",
        "touchdown",
        "method",
        "t_pre_s",
        "t_post_s",
        *(f"contact_{foot}_s" for foot in feet),
        *(f"se_{foot}_s" for foot in feet),
        *(f"common_{foot}_s" for foot in feet),
        "schedule",
        "probability",
        "order_class",
        "runner_up",
        "runner_up_probability",
        "spread_s",
        "excluded",
        "reason",
    ]
    assert table["touchdown"].tolist() == list(range(1, 121))
    assert table["t_pre_s"].is_monotonic_increasing
    assert table["excluded"].dtype == bool
    assert not table["excluded"].any()
    assert (table["reason"] == "").all()


def test_contents_against_the_truth(scene, table):
    contacts = table[
        ["contact_foot1_s", "contact_foot2_s", "contact_foot3_s"]
    ].to_numpy()
    assert np.abs(contacts - scene.contact_times).max() < 0.0015
    np.testing.assert_allclose(table["spread_s"], contacts.std(axis=1))
    order = np.argsort(scene.contact_times, axis=1) + 1
    true = [">".join(map(str, row)) for row in order]
    right = table["schedule"] == true
    assert right.mean() > 0.95
    assert table["probability"].mean() == pytest.approx(right.mean(), abs=0.03)
    assert right[table["probability"] > 0.99].all()


def test_reasons(scene):
    recording = scene.recording
    time, heights = recording.time, recording.feet[:, :, 2].copy()
    cycle = (time // 0.64).astype(int)
    heights[cycle == 1] += 0.1
    heights[cycle == 2, 1] += 0.1
    heights[(time > 3 * 0.64 - 0.1) & (cycle <= 3), 2] = 0.0
    at = np.searchsorted(time, scene.contact_times[4, 0])
    heights[at : at + 14, 0] = np.nan
    positions = with_feet(recording, heights).positions.copy()
    first = touchdown_table(recording, **SECTIONS)
    pre = np.searchsorted(time, first["t_pre_s"].to_numpy())
    post = np.searchsorted(time, first["t_post_s"].to_numpy())
    positions[pre[5] - 2 : pre[5] + 1, 0] = np.nan
    positions[post[6] - 2 : post[6] + 2, 1] = np.nan
    bounce = (cycle == 7) & (positions[:, :3, 2].mean(axis=1) < POST_HEIGHT_M + 0.02)
    positions[bounce, :3, 2] += 0.1
    table = touchdown_table(replace(recording, positions=positions), **SECTIONS)
    feet = recording.names("foot")
    assert table["reason"].tolist()[:9] == [
        "",
        "no foot of the study landed",
        f"{feet[1]} not down by the post section",
        f"{feet[2]} down before the pre section",
        f"frames missing at the contact of {feet[0]}",
        "frames missing at the pre section",
        "frames missing at the post section",
        "post section never reached",
        "",
    ]
    assert (table["excluded"] == (table["reason"] != "")).all()
    assert (table["reason"] == "").sum() == 113


@pytest.mark.parametrize(
    ("hidden", "where"),
    [
        (lambda row: (row["t_pre_s"] + 0.02, row["t_pre_s"] + 0.35), "post"),
        (lambda row: (row["t_pre_s"] - 0.3, row["t_pre_s"] + 0.01), "pre"),
    ],
)
def test_a_crossing_hidden_by_a_gap_is_not_called_missed(scene, table, hidden, where):
    recording, row = scene.recording, table.iloc[20]
    start, stop = np.searchsorted(recording.time, hidden(row))
    positions = recording.positions.copy()
    positions[start:stop, 1] = np.nan
    found = touchdown_table(replace(recording, positions=positions), **SECTIONS)
    near = found[(found["t_pre_s"] - row["t_pre_s"]).abs() < 0.35]
    assert f"frames missing at the {where} section" in near["reason"].tolist()
    assert not near["reason"].str.contains("never reached|stayed below").any()


@pytest.mark.parametrize("part", [(0.0, 0.3), (0.3, 0.7), (0.6, 1.0), (0.41, 0.415)])
def test_landings_with_the_body_hidden_are_listed_too(scene, table, part):
    recording, span = scene.recording, scene.recording.time[-1]
    hidden = (recording.time >= part[0] * span) & (recording.time < part[1] * span)
    positions = recording.positions.copy()
    positions[hidden, 2] = np.nan
    found = touchdown_table(replace(recording, positions=positions), **SECTIONS)
    assert len(found) == len(table)
    first_contact = scene.contact_times.min(axis=1)
    inside = np.interp(first_contact, recording.time, hidden) > 0.5
    assert inside.sum() == round((part[1] - part[0]) * len(table)) or inside.sum() < 3
    assert found.loc[inside, "excluded"].all()
    assert set(found.loc[inside, "reason"]) <= {
        "frames missing at the pre section",
        "frames missing at the post section",
    }
    assert (found["excluded"] == table["excluded"])[~inside].mean() > 0.95


def test_contacts_outside_the_transition_are_left_out(scene):
    late = touchdown_table(
        scene.recording, **(SECTIONS | {"post_height_m": POST_HEIGHT_M + 0.035})
    )
    contacts = scene.contact_times
    truly_late = (contacts > late["t_post_s"].to_numpy()[:, None]).any(axis=1)
    assert 0 < truly_late.sum() < 120
    said_late = late["reason"].str.contains("not down by the post section").to_numpy()
    assert (said_late == truly_late).mean() > 0.97
    early = touchdown_table(
        scene.recording, **(SECTIONS | {"pre_height_m": PRE_HEIGHT_M - 0.05})
    )
    continued = early["t_pre_s"].to_numpy() - CONTINUED_S * scene.recording.time_scale
    truly_early = (contacts < continued[:, None]).any(axis=1)
    assert 0 < truly_early.sum() < 120
    said_early = early["reason"].str.contains("down before the pre section").to_numpy()
    assert (said_early == truly_early).mean() > 0.97


def test_ambiguous_orders_are_a_class_of_their_own(scene, table):
    doubtful = table["probability"] < 0.9
    assert doubtful.any()
    np.testing.assert_array_equal(table["order_class"] == "ambiguous", doubtful)
    assert (table["order_class"] == table["schedule"])[~doubtful].all()
    assert (table["runner_up"] != table["schedule"]).all()
    assert (table["runner_up_probability"] <= table["probability"] + 0.02).all()
    both = table["probability"] + table["runner_up_probability"]
    assert both[doubtful].min() > 0.7
    assert (both < 1 + 1e-9).all()


def test_ambiguous_orders_can_be_left_out(scene, table):
    options = {"ambiguous_below": 0.99, "ambiguous": "exclude"}
    strict = touchdown_table(scene.recording, **SECTIONS, **options)
    ambiguous = strict["reason"] == "order ambiguous"
    np.testing.assert_array_equal(ambiguous, table["probability"] < 0.99)
    np.testing.assert_array_equal(strict["excluded"], ambiguous)
    assert ambiguous.any()


def test_an_unknown_treatment_of_the_ambiguous_is_named(scene):
    with pytest.raises(
        ConfigError, match=r"touchdowns.ambiguous.*did you mean 'exclude'"
    ):
        touchdown_table(scene.recording, **SECTIONS, ambiguous="excluded")


def test_the_printed_method_is_selectable(scene):
    wide = SECTIONS | {"pre_height_m": PRE_HEIGHT_M + 0.04}
    table = touchdown_table(scene.recording, **wide, method="velocity_minimum")
    frames = table["contact_foot1_s"] * 100
    np.testing.assert_allclose(frames, frames.round(), atol=1e-6)


def test_example_is_of_median_spread_in_the_surer_half_of_the_commonest_schedule(
    scene, table
):
    example = example_touchdown([scene.recording], table)
    assert list(example.columns) == [
        "recording",
        "touchdown",
        "time_s",
        "foot",
        "height_m",
        "velocity_m_s",
    ]
    row = table.iloc[example["touchdown"].iloc[0] - 1]
    counts = table["schedule"].value_counts()
    assert counts[row["schedule"]] == counts.max()
    alike = table[(table["schedule"] == row["schedule"]) & ~table["excluded"]]
    of_kind = alike.loc[
        alike["probability"] >= alike["probability"].median(), "spread_s"
    ]
    assert row["probability"] >= alike["probability"].median()
    assert (
        abs((of_kind < row["spread_s"]).sum() - (of_kind > row["spread_s"]).sum()) <= 1
    )
    assert example["time_s"].min() >= -0.05
    assert example["time_s"].max() <= row["t_post_s"] - row["t_pre_s"] + 0.05
    assert example["velocity_m_s"].min() < -1.0
    assert len(set(example["foot"].value_counts())) == 1


def test_nothing_to_work_on_is_said(scene, table):
    with pytest.raises(AnalysisError, match="at least one usable"):
        example_touchdown([scene.recording], table.assign(excluded=True))
    recording = scene.recording
    lone = replace(recording, roles=("body",) * 3 + ("foot", "other", "other"))
    with pytest.raises(AnalysisError, match="at least 2 foot"):
        touchdown_table(lone, **SECTIONS)


def runner_table(path, side, hidden=None, **options):
    """Return touchdowns of one foot of the runner: heel, first and fifth metatarsal."""
    frame = pd.read_csv(path, sep="\t", skiprows=11)
    names = ("body1", "body2", "body3", f"{side}_heel", f"{side}_mt1", f"{side}_mt5")
    columns = [[f"{name} {axis}" for axis in "XYZ"] for name in names]
    positions = np.stack([frame[c].to_numpy() / 1000 for c in columns], axis=1)
    positions[:, 3:, 2] -= [0.034, 0.045, 0.050]
    if hidden is not None:
        positions[: len(positions) // 2, hidden] = np.nan
    time = np.arange(len(frame)) / 150
    roles = ("body",) * 3 + ("foot",) * 3
    recording = Recording("runner", time, positions, names, roles, 150.0)
    return touchdown_table(recording, pre_height_m=1.07, post_height_m=1.02, **options)


def test_a_runner(external_recording):
    table = runner_table(external_recording, "R")
    landed = table["reason"] != "no foot of the study landed"
    assert landed.sum() == 40, "in the first the recording begins"
    assert (~table["excluded"]).sum() >= 30
    assert (np.diff(np.flatnonzero(landed)) == 2).all()  # left and right in turn
    used = table[~table["excluded"]]
    gaps = used[["contact_R_heel_s", "contact_R_mt5_s"]].sub(
        used["contact_R_mt1_s"], axis=0
    )
    assert (gaps.median() > 0.01).all()
    assert (gaps.std() < 0.006).all()


@pytest.mark.parametrize(("side", "turn"), [("L", 0), ("R", 1)])
def test_a_runner_against_the_force_plate(
    external_recording, external_forces, side, turn
):
    table = runner_table(external_recording, side)
    contacts = table[[name for name in table if name.startswith("contact_")]]
    first = contacts[table["t_pre_s"] > 0].min(axis=1).dropna().to_numpy()
    force = pd.read_csv(external_forces, sep="\t")["Fy"].to_numpy()
    onsets = force_onsets(np.arange(len(force)) / 300, force)[turn::2]
    assert len(first) == len(onsets) == 39  # none missed, none invented
    late_ms = (first - onsets) * 1e3
    middle = np.median(late_ms)
    assert abs(middle) < 5
    assert 1.4826 * np.median(np.abs(late_ms - middle)) < 1.5
    assert np.abs(late_ms - middle).max() < 10


@pytest.mark.parametrize("side", ["L", "R"])
def test_a_quick_runner_s_foot_is_down_where_it_stands(quick_runner, side):
    """It is not down where the forefoot's marker slows in mid-fall, 28 to 47 mm above."""
    markers = {
        "body": ["R.ASIS", "L.ASIS", "R.PSIS"],
        "feet": [f"{side}.{name}" for name in ("Heel.Bottom", "MT1", "MT5")],
    }
    seen, _ = import_recording(
        [quick_runner], name="run", markers=markers, vertical_axis="y"
    )
    seen = level(seen, fit_floor(seen))
    landings = find_landings(seen)
    landed = landings[landings[f"status_{side}.MT1"] == LANDED]
    assert len(landed) == 39
    forefoot = seen.feet[:, 1, 2]
    for instant in landed[f"contact_{side}.MT1_s"]:
        later = forefoot[(seen.time > instant) & (seen.time < instant + 0.1)]
        assert np.interp(instant, seen.time, forefoot) - later.min() < 0.025
    columns = [
        [f"{kind}_{foot}_s" for foot in markers["feet"]] for kind in ("contact", "se")
    ]
    instant, se = (landed[names].to_numpy() for names in columns)
    sure = order_probability(instant, se) > 0.9
    assert sure.sum() >= 20
    assert {
        name for name, s in zip(schedule_names(instant), sure, strict=True) if s
    } == {"1>3>2"}


def test_a_marker_that_is_hidden_for_half_of_the_run_makes_no_landings(
    external_recording,
):
    """This foot, where it is seen, does not land in the other leg's descents."""
    table = runner_table(external_recording, "L", hidden=4)
    landed = table["reason"] != "no foot of the study landed"
    assert landed.sum() == 39
    hidden = table["reason"] == "frames missing at the contact of L_mt1"
    assert 15 <= hidden.sum() <= 20
    assert (~table["excluded"]).sum() >= 15


def test_a_recording_without_a_descent_has_a_table_without_rows(scene, table):
    still = scene.recording.part(slice(0, 5))
    empty = touchdown_table(still, **SECTIONS)
    assert len(empty) == 0
    assert list(empty.columns) == list(table.columns)


def test_landings_beyond_a_section_are_listed(scene, table):
    above = touchdown_table(scene.recording, pre_height_m=9.0, post_height_m=8.0)
    below = touchdown_table(scene.recording, pre_height_m=-8.0, post_height_m=-9.0)
    assert len(above) == len(below) == len(table)
    assert set(above["reason"][1:]) == {"body stayed below the pre section"}
    assert set(below["reason"]) == {"post section never reached"}
    assert np.isfinite(below["t_pre_s"]).all()


def test_contacts_are_found_once_and_serve_any_sections(scene, table):
    found = find_landings(scene.recording)
    pd.testing.assert_frame_equal(
        touchdown_table(scene.recording, landings=found, **SECTIONS), table
    )
    other = touchdown_table(
        scene.recording,
        landings=found,
        **{**SECTIONS, "pre_height_m": PRE_HEIGHT_M + 0.01},
    )
    contacts = [name for name in table if name.startswith(("contact_", "se_"))]
    pd.testing.assert_frame_equal(other[contacts], table[contacts])


PRINTED = [name for name, find in METHODS.items() if find is not None]


@pytest.mark.parametrize("method", PRINTED)
@pytest.mark.parametrize("size", [1.0, 0.25])
def test_contacts_are_found_by_the_method_asked_for(scene, method, size):
    """Before the sections are known as between them, and in an animal of any size."""
    time_scale = np.sqrt(size)
    recording = replace(
        scene.recording,
        time=scene.recording.time * time_scale,
        positions=scene.recording.positions * size,
        rate_hz=scene.recording.rate_hz / time_scale,
    )
    # The pre section is so high that the smoothed velocity has its minimum below it.
    sections = {
        "pre_height_m": (PRE_HEIGHT_M + 0.06) * size,
        "post_height_m": POST_HEIGHT_M * size,
    }
    landings = find_landings(recording, method=method)
    table = touchdown_table(recording, landings=landings, method=method, **sections)
    assert set(table["method"]) == set(landings["method"]) == {method}
    assert len(landings) == len(table) == (~table["excluded"]).sum() == 120
    names = [name for name in table if name.startswith("contact_")]
    # The filter reaches beyond the first frame, so the first descent has no minimum.
    same = np.isclose(landings[names], table[names], rtol=0, atol=1e-9)[1:]
    assert same.mean() > 0.99
    kinks = find_landings(recording)
    assert set(kinks["method"]) == {"kink"}
    ahead = (kinks[names] - landings[names]).median().to_numpy()
    assert (ahead > 0.01).all()  # smoothing moves the minimum ahead of the contact
    floor = floor_instants(landings)
    np.testing.assert_allclose(floor, kinks[names], atol=0.008)
    np.testing.assert_array_equal(floor_instants(kinks), kinks[names])


@pytest.mark.parametrize("method", METHODS)
def test_no_kink_is_fitted_for_another_method(scene, monkeypatch, method):
    def fitted(*_, **__):
        raise AssertionError("a kink was fitted")

    for name in ("joint_fits", "single_fits"):
        monkeypatch.setattr(kink_law, name, fitted)
    part = scene.recording.part(slice(0, 2_000))
    if method in PRINTED:
        assert len(touchdown_table(part, method=method, **SECTIONS)) > 0
    else:
        with pytest.raises(AssertionError, match="a kink was fitted"):
            touchdown_table(part, method=method, **SECTIONS)


def test_minima_are_not_taken_for_kinks(scene, table):
    """A study by another method that is scored fits its own kinks; descents serve any method."""
    minima = find_landings(scene.recording, method="velocity_minimum")
    again = touchdown_table(scene.recording, landings=minima, method="kink", **SECTIONS)
    pd.testing.assert_frame_equal(again, table)
    by = {"method": "velocity_minimum_parabola", **SECTIONS}
    pd.testing.assert_frame_equal(
        touchdown_table(scene.recording, landings=minima, **by),
        touchdown_table(scene.recording, **by),
    )


def test_a_foot_of_two_markers_has_a_contact_by_every_method(scene):
    """The foot is where its lower marker is; here both are at the same height."""
    recording = scene.recording
    (first, *_), feet = (
        recording.names("foot"),
        recording.positions[:, recording.indices("foot")],
    )
    seen = replace(
        recording,
        positions=np.concatenate(
            [recording.positions, feet[:, :1] + [0.01, 0.0, 0.0]], axis=1
        ),
        markers=(*recording.markers, "heel"),
        roles=(*recording.roles, "foot"),
    )
    joined = join_feet(seen, [{"name": "left", "markers": [first, "heel"]}])
    for method in PRINTED:
        alone = find_landings(recording, method=method)
        both = find_landings(joined, method=method)
        np.testing.assert_array_equal(
            both["contact_left_s"], alone[f"contact_{first}_s"]
        )


@pytest.mark.parametrize("after_s", [0.02, 0.06, 0.1])
def test_a_recording_that_ends_in_a_landing_keeps_it(scene, table, after_s):
    """The recording ends at this time after the last contact, before or after the section."""
    stop = np.searchsorted(
        scene.recording.time, scene.contact_times[60].max() + after_s
    )
    found = touchdown_table(scene.recording.part(slice(stop)), **SECTIONS)
    assert len(found) == 61
    assert found["reason"][60] == (
        "post section never reached" if after_s < 0.05 else ""
    )
    contacts = [f"contact_foot{k}_s" for k in (1, 2, 3)]
    np.testing.assert_allclose(
        found.loc[60, contacts], table.loc[60, contacts], atol=1e-3
    )


def test_a_landing_from_below_the_pre_section_is_listed(scene, table):
    """The pre section lies above the top of some flights; their landings stay in the table."""
    time, height = scene.recording.time, scene.recording.body_height
    tops = np.array(
        [height[(time >= t - 0.3) & (time < t)].max() for t in table["t_pre_s"]]
    )
    sections = {**SECTIONS, "pre_height_m": float(np.quantile(tops, 0.1))}
    found = touchdown_table(scene.recording, **sections)
    low = found["reason"] == "body stayed below the pre section"
    assert 5 <= low.sum() <= 13  # 12 of 120; without the first top if it is one of them
    assert found.loc[low, "excluded"].all()
    assert found["touchdown"].tolist() == list(range(1, len(found) + 1))
    contacts = [f"contact_foot{i}_s" for i in (1, 2, 3)]
    near = table.loc[
        np.searchsorted(table["t_post_s"], found.loc[low, "t_post_s"] - 0.05)
    ]
    np.testing.assert_allclose(found.loc[low, contacts], near[contacts], atol=0.002)


@pytest.mark.parametrize("settle_m", [0.0, 0.003])
def test_a_body_that_sways_on_its_feet_does_not_land(settle_m):
    scene = simulate(12, seed=4)
    positions = scene.recording.positions.copy()
    time = scene.recording.time
    standing = time > time[-1] * 0.6
    middle, half = (
        0.5 * (PRE_HEIGHT_M + POST_HEIGHT_M),
        0.5 * (PRE_HEIGHT_M - POST_HEIGHT_M),
    )
    sway = middle + half * (0.9 * np.sin(20 * time[standing]) - 0.2)
    body, feet = scene.recording.indices("body"), scene.recording.indices("foot")
    positions[np.ix_(standing, body, [2])] = sway[:, None, None]
    positions[np.ix_(standing, feet, [2])] = (
        settle_m * np.cos(9 * time[standing])[:, None, None]
    )
    swaying = replace(scene.recording, positions=positions)
    found = touchdown_table(swaying, **SECTIONS)
    assert (found["t_pre_s"] < time[-1] * 0.62).all()


def test_a_contact_known_no_better_than_the_transition_is_left_out():
    gap = np.full(3, 0.01)
    body = Transitions(np.zeros(3), np.full(3, 0.1), gap, gap)
    se = np.array([[0.001, 0.099], [0.001, 0.101], [20.0, 0.001]])
    contacts = Contacts(np.full((3, 2), 0.05), se, np.full((3, 2), LANDED), 0.0006)
    assert exclusion_reasons(body, contacts, longest_gap_s=0.025) == [
        "",
        "contact of foot 2 not determined",
        "contact of foot 1 not determined",
    ]


# Landings that the feet show while the body is hidden, in made-up hops of one second.

TIME = np.arange(0.0, 10.0, 0.01)
PHASE = TIME % 1.0
FEET = np.where(PHASE < 0.5, 0.1 * np.sin(2 * np.pi * PHASE), 0.0)[:, None] * [1.0, 0.8]
BODY = 0.5 + 0.1 * np.sin(2 * np.pi * PHASE)


def hidden_landings(body, feet=FEET):
    spans = TIME[np.array(descents(body)).reshape(-1, 2)]
    return find_hidden_landings(TIME, feet, body, spans, down_height_m=0.01)


def without(body, first, last):
    return np.where((TIME - first) * (last - TIME) > 0, np.nan, body)


def test_there_is_none_while_the_body_is_seen():
    assert len(hidden_landings(BODY)) == 0


@pytest.mark.parametrize(
    ("first", "last", "landings"),
    [(2.1, 6.9, 4), (-1.0, 3.05, 3), (6.05, 11.0, 4), (2.2, 2.8, 0), (2.3, 2.93, 0)],
)
def test_each_has_a_row_but_the_one_that_the_body_shows(first, last, landings):
    found = hidden_landings(without(BODY, first, last))
    assert len(found) == landings
    np.testing.assert_allclose(found[:, 1] % 1.0, 0.5, atol=0.02)
    assert ((found[:, 0] > first) & (found[:, 1] < last)).all()


def test_feet_that_are_hidden_too_show_nothing():
    feet = np.where(((TIME > 2.1) & (TIME < 6.9))[:, None], np.nan, FEET)
    assert len(hidden_landings(without(BODY, 2.1, 6.9), feet)) == 0


def test_one_foot_in_the_air_is_no_flight():
    feet = FEET * [1.0, 0.0]
    assert len(hidden_landings(without(BODY, 2.1, 6.9), feet)) == 0
