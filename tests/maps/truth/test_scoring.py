import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from hopdata.landings.schedules import schedule_names
from hopdata.maps.truth.scoring import (
    recorded_effect,
    score,
    score_contacts,
    score_distances,
    score_floor,
    score_predictions,
    score_sections,
)
from hopdata.truth import Truth

FEET = ("a", "b", "c")


def known(rng, landings=200):
    contacts = 0.64 * np.arange(landings)[:, None] + 0.02 * rng.normal(
        size=(landings, 3)
    )
    frames = 10 * landings
    height = rng.uniform(0.2, 0.6, frames)
    # Each foot leaves the floor at its own height between 0.3 and 0.5 m.
    down = height[:, None] < np.array([0.3, 0.4, 0.5])
    floor = 0.003 * rng.normal(size=(landings, 3))
    return truth_of(contacts, down, height, floor)


def truth_of(contacts, down, height, floor=None):
    """Return the truth of a recording whose feet touch at these (landing, foot) indices."""
    number = len(contacts)
    points = np.stack(np.indices(contacts.shape), axis=-1).astype(float)
    return Truth(
        contact_times=contacts,
        apex_times=np.zeros(number),
        complete=np.ones(number, bool),
        foot_down=down,
        body_height=height,
        contact_points=points,
        floor_at_contacts=np.zeros_like(contacts) if floor is None else floor,
        apex_states=np.zeros((number, 12)),
        preloads_n=np.ones_like(contacts),
        noise_m=0.0,
        parameters_json="{}",
    )


def fitted(heights):
    """Return a floor model with these heights at the places of `truth_of`."""
    return SimpleNamespace(height=lambda x, y: heights[x.astype(int), y.astype(int)])


def touchdowns(item, found, name="hopper"):
    table = pd.DataFrame(found, columns=[f"contact_{foot}_s" for foot in FEET])
    table.insert(0, "recording", name)
    table["schedule"] = schedule_names(np.asarray(found))
    table["order_class"] = table["schedule"]
    table["excluded"], table["reason"] = False, ""
    return table


def sections(pre, post, *, rule="printed", frames="all", decided="data"):
    return {
        "pre_height_m": pre,
        "post_height_m": post,
        "rule": rule,
        "bandwidth_m": 0.001,
        "frames": frames,
        "chosen_by": {"pre_height_m": decided, "post_height_m": decided},
    }


def values(entries):
    return {name: entry["value"] for name, entry in entries.items()}


def test_perfect_labels_with_a_common_bias():
    item = known(np.random.default_rng(0))
    table = touchdowns(item, item.contact_times - 0.024)
    found = values(score_contacts({"hopper": item}, table, feet=FEET, method="printed"))
    assert found["labels_right_printed"] == 1.0
    assert found["contact_bias_printed"] == pytest.approx(-24)
    assert found["contact_rms_printed"] == pytest.approx(0, abs=1e-9)
    assert found["unmatched_printed"] == 0


def test_scatter_and_wrong_labels_are_measured():
    rng = np.random.default_rng(1)
    item = known(rng, landings=2000)
    table = touchdowns(item, item.contact_times + 0.0015 * rng.normal(size=(2000, 3)))
    table.loc[:499, "schedule"] = "9>9>9"
    found = values(score_contacts({"hopper": item}, table, feet=FEET, method="kink"))
    assert found["contact_rms_kink"] == pytest.approx(1.5, rel=0.03)
    truth = schedule_names(item.contact_times)
    assert found["labels_right_kink"] == np.mean(table["schedule"] == truth)
    assert found["labels_right_kink"] < 0.75


def test_touchdowns_are_matched_by_time_within_their_recording():
    first, second = (known(np.random.default_rng(seed)) for seed in (2, 3))
    late = touchdowns(second, second.contact_times, "late").iloc[::-1]
    both = pd.concat([late, touchdowns(first, first.contact_times[5:], "early")])
    entries = score_contacts(
        {"early": first, "late": second}, both, feet=FEET, method="kink"
    )
    assert values(entries)["labels_right_kink"] == 1.0
    assert values(entries)["contact_rms_kink"] == 0.0
    swapped = score_contacts(
        {"early": second, "late": first}, both, feet=FEET, method="kink"
    )
    assert values(swapped)["labels_right_kink"] < 0.5


def test_a_touchdown_without_a_true_landing_is_wrong():
    item = known(np.random.default_rng(4))
    item.complete[10] = False
    item.contact_times[20] = np.nan
    table = touchdowns(
        item, np.where(np.isnan(item.contact_times), 12.8, item.contact_times)
    )
    found = values(score_contacts({"hopper": item}, table, feet=FEET, method="kink"))
    assert found["unmatched_kink"] == 2
    assert found["labels_right_kink"] == 198 / 200


def test_excluded_touchdowns_are_not_scored():
    item = known(np.random.default_rng(5))
    table = touchdowns(item, item.contact_times)
    table.loc[:9, ["excluded", "schedule"]] = True, "1>1>1"
    table["reason"] = ["foot a down before the pre section"] * 7 + [None] * 193
    found = values(score_contacts({"hopper": item}, table, feet=FEET, method="kink"))
    assert found["labels_right_kink"] == 1.0
    nothing = table.assign(excluded=True, schedule=np.nan, reason=np.nan)
    score_contacts({"hopper": item}, nothing, feet=FEET, method="kink")


def test_missed_and_invented_touchdowns_count():
    item = known(np.random.default_rng(15))
    table = touchdowns(item, item.contact_times)
    few = values(score_contacts({"hopper": item}, table[:1], feet=FEET, method="kink"))
    assert few["labels_right_kink"] == 1.0
    assert few["labels_right_of_all_kink"] == 1 / 200
    assert few["landings_not_used_kink"] == 199
    copies = pd.concat([table[:1]] * 100)
    many = values(score_contacts({"hopper": item}, copies, feet=FEET, method="kink"))
    assert many["labels_right_kink"] == 1 / 100
    assert many["unmatched_kink"] == 99


def test_sections_of_a_known_order():
    item = known(np.random.default_rng(6), landings=20_000)
    found = values(score_sections({"hopper": item}, sections(0.501, 0.302), {}))
    # Frames are uniform: the density of those with a foot down has left zero 2 mm above
    # 0.5 m.
    assert found["section_pre_true"] == pytest.approx(0.502, abs=3e-4)
    assert found["section_post_true"] == pytest.approx(0.298, abs=3e-4)
    assert found["section_pre_error"] == pytest.approx(-1.0, abs=0.3)
    assert found["section_post_error"] == pytest.approx(4.0, abs=0.3)


def test_sections_by_the_true_contacts_of_landings():
    time = np.arange(0, 60.0, 0.01)
    height = 0.4 + 0.2 * np.cos(2 * np.pi * time)  # a top at each whole second
    scatter = 0.001 * np.random.default_rng(1).normal(size=(59, 2))
    contacts = np.arange(59)[:, None] + [0.2, 0.3] + scatter
    item = truth_of(contacts, np.zeros((len(time), 2), bool), height)
    recording = SimpleNamespace(time=time, time_scale=1.0)
    given = sections(0.55, 0.3, rule="landings")
    found = values(score_sections({"hopper": item}, given, {"hopper": recording}))
    untouched_m = 0.4 + 0.2 * np.cos(2 * np.pi * (0.2 - 0.002))
    settled_m = 0.4 + 0.2 * np.cos(2 * np.pi * (0.3 + 0.002))
    assert found["section_pre_true"] == pytest.approx(
        0.6 - 0.25 * (0.6 - untouched_m), abs=2e-3
    )
    assert found["section_post_true"] == pytest.approx(settled_m, abs=4e-3)
    assert found["section_post_error"] == pytest.approx(
        1e3 * (0.3 - found["section_post_true"]), abs=1e-6
    )
    none = truth_of(contacts[:0], np.zeros((len(time), 2), bool), height)
    assert score_sections({"hopper": none}, given, {"hopper": recording}) == {}


def test_sections_of_landings_alone_and_those_given():
    # The body is up on its toes: one foot stays down until 0.5 m on the way up, none
    # below 0.3 m on the way down.
    phase = np.linspace(0, 40 * np.pi, 40_001)
    height = 0.4 + 0.2 * np.cos(phase)
    rising = np.sin(phase) < 0
    down = np.repeat((height < np.where(rising, 0.5, 0.3))[:, None], 2, axis=1)
    item = truth_of(np.zeros((0, 2)), down, height)
    everywhere = values(score_sections({"hopper": item}, sections(0.3, 0.3), {}))
    landing = values(
        score_sections({"hopper": item}, sections(0.3, 0.3, frames="landings"), {})
    )
    assert everywhere["section_pre_true"] == pytest.approx(0.5, abs=3e-3)
    assert landing["section_pre_true"] == pytest.approx(0.3, abs=3e-3)
    given = score_sections({"hopper": item}, sections(0.3, 0.3, decided="config"), {})
    assert "section_pre_error" not in given


def test_floor_residual_ignores_the_mean_of_each_recording():
    rng = np.random.default_rng(7)
    item = known(rng, landings=3000)
    true = item.floor_at_contacts
    floors = {
        "even": fitted(true + 0.001),
        "rough": fitted(true + 0.005 + 0.001 * rng.normal(size=(3000, 3))),
    }
    even = values(score_floor({"even": item}, floors))["floor_residual_rms"]
    assert even == pytest.approx(0, abs=1e-12)
    rough = replace(item, floor_at_contacts=true.copy())
    rough.floor_at_contacts[4, 1] = np.nan
    both = values(score_floor({"even": item, "rough": rough}, floors))[
        "floor_residual_rms"
    ]
    assert both == pytest.approx(1 / np.sqrt(2), rel=0.03)


@pytest.mark.parametrize(("far", "ordered"), [(4.0, True), (2.9, False)])
def test_order_of_the_models(far, ordered):
    models = ["specialised", "near", "all", "far", "specialised_mean", "mean"]
    table = pd.DataFrame(
        {"model": models, "median_mse": [2.0, 2.1, 3.0, far, 16.0, 30.0]}
    )
    found = values(score_predictions(table))
    assert found["near_below_all_below_far"] is ordered
    assert score_predictions(table[:2]) == {}


def test_clearance_of_the_random_distances():
    table = pd.DataFrame(
        {
            "kind": ["in_class", "cross_class", "random"],
            "q05": [2.0, 2.1, 3.6],
            "q95": [3.2, 3.3, 3.9],
        }
    )
    found = values(score_distances(table))
    assert found["random_clearance"] == pytest.approx(0.3)
    assert score_distances(table[2:]) == {}


def test_the_whole_score_is_json_with_units():
    item = known(np.random.default_rng(8))
    table = touchdowns(item, item.contact_times)
    none = table.assign(excluded=True, reason="no contact found")
    entries = score(
        {"hopper": item},
        floors={"hopper": fitted(item.floor_at_contacts)},
        feet=FEET,
        tables={"kink": table, "printed": none},
        sections=sections(0.5, 0.3),
        recordings={},
        prediction_summary=pd.DataFrame({"model": ["all"], "median_mse": [3.0]}),
        distance_summary=pd.DataFrame({"kind": [], "q05": [], "q95": []}),
    )
    assert json.loads(json.dumps(entries, allow_nan=False)) == entries
    assert all(set(entry) == {"value", "unit", "what"} for entry in entries.values())
    assert entries["labels_right_kink"]["value"] == 1.0
    assert entries["labels_right_printed"]["value"] is None


def test_distances_are_scored_only_if_they_were_made():
    item = known(np.random.default_rng(8))
    made = pd.DataFrame(
        {"kind": ["in_class", "random"], "q05": [2.0, 3.6], "q95": [3.2, 3.9]}
    )
    of = {
        "floors": {"hopper": fitted(item.floor_at_contacts)},
        "feet": FEET,
        "tables": {"kink": touchdowns(item, item.contact_times)},
        "sections": sections(0.5, 0.3),
        "recordings": {},
        "prediction_summary": pd.DataFrame({"model": ["all"], "median_mse": [3.0]}),
    }
    assert "random_clearance" in score({"hopper": item}, distance_summary=made, **of)
    assert "random_clearance" not in score({"hopper": item}, **of)


def test_why_there_are_no_exact_maps_is_told():
    item = known(np.random.default_rng(8))
    of = {
        "floors": {"hopper": fitted(item.floor_at_contacts)},
        "feet": FEET,
        "tables": {"kink": touchdowns(item, item.contact_times)},
        "sections": sections(0.5, 0.3),
        "recordings": {},
        "prediction_summary": pd.DataFrame({"model": ["all"], "median_mse": [3.0]}),
    }
    found = score({"hopper": item}, **of, without_exact_maps="feet never land at once")
    assert found["exact_maps"]["value"] is False
    assert found["exact_maps"]["what"].endswith("feet never land at once")
    assert "exact_maps" not in score({"hopper": item}, **of)


def test_the_true_difference_that_a_file_states_is_told():
    item = known(np.random.default_rng(8))
    stated = replace(item, true_effect=0.31)
    found = recorded_effect({"a": stated, "b": stated})
    assert values(found)["recorded_true_effect"] == 0.31
    assert recorded_effect({"a": item}) == {}, "it does not say"
    other = replace(item, true_effect=0.2)
    assert recorded_effect({"a": stated, "b": other}) == {}, "they do not agree"
