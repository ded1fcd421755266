"""Sections from parts of the data, and drift: found where it exists, and not elsewhere."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from section_fakes import hopper

from hopdata.landings.sections.select import select_sections
from hopdata.landings.stability import (
    BANDWIDTH_FACTORS,
    LEAST,
    QUANTITIES,
    drift_table,
    quantity_rows,
    section_stability,
)
from hopdata.landings.touchdowns import touchdown_table


def trial(name, seed, **options):
    made = hopper(np.random.default_rng(seed), hops=150, **options).recording
    return replace(made, name=name)


@pytest.fixture(scope="module")
def recordings():
    return [trial("a", 1), trial("b", 2)]


@pytest.fixture(scope="module")
def sections(recordings):
    return select_sections(recordings)


def tables_of(recordings, sections):
    heights = {
        "pre_height_m": sections.pre_height_m,
        "post_height_m": sections.post_height_m,
    }
    return pd.concat(
        [touchdown_table(one, **heights) for one in recordings], ignore_index=True
    )


def test_the_chosen_sections_stand_first_and_every_variant_once(recordings, sections):
    table = section_stability(recordings, sections, {})
    assert table["pre_height_m"][0] == sections.pre_height_m
    counts = dict(table["kind"].value_counts(sort=False))
    assert counts.pop("second") in (1, 2)
    assert counts == {
        "chosen": 1,
        "bandwidth": len(BANDWIDTH_FACTORS),
        "half": 2,
        "recording": 2,
    }
    assert table["pre_height_m"].notna().all()
    moved = (table["pre_height_m"] - sections.pre_height_m).abs()
    assert moved.max() < 0.03
    assert moved[table["kind"] == "recording"].max() > 0.0


def test_one_bad_second_is_named_and_moves_no_section(recordings, sections):
    """Someone lifts the animal while a marker on the floor bears a foot's name."""
    positions = recordings[1].positions.copy()
    bad = slice(1000, 1040)
    positions[bad, recordings[1].indices("foot")[0], 2] = sections.ground_m
    for marker in recordings[1].indices("body"):
        positions[bad, marker, 2] += 0.1
    lifted = [recordings[0], replace(recordings[1], positions=positions)]
    found = select_sections(lifted)
    assert found.pre_height_m == pytest.approx(sections.pre_height_m, abs=0.003)
    assert found.post_height_m == pytest.approx(sections.post_height_m, abs=0.003)
    table = section_stability(lifted, found, {})
    second = table[table["kind"] == "second"].iloc[0]
    assert second["variant"].endswith("± 0.5 s of b")
    named = float(second["variant"].split()[1])
    assert recordings[1].time[bad][0] - 0.1 < named < recordings[1].time[bad][-1] + 0.1
    assert second["pre_height_m"] == pytest.approx(sections.pre_height_m, abs=0.003)


def test_a_single_recording_has_no_variants_by_recording(recordings, sections):
    table = section_stability(recordings[:1], sections, {})
    assert "recording" not in set(table["kind"])


def test_heights_from_the_configuration_stay(recordings):
    options = {"pre_height_m": 0.45, "post_height_m": 0.3}
    table = section_stability(
        recordings, select_sections(recordings, **options), options
    )
    assert set(table["kind"]) == {"chosen", "second", "half", "recording"}
    assert (table["pre_height_m"] == 0.45).all()
    assert (table["post_height_m"] == 0.3).all()


def test_a_part_that_gives_no_sections_says_why(recordings, sections):
    still = recordings[0].positions.copy()
    half = len(still) // 2
    still[half:] = still[half]
    resting = replace(recordings[0], positions=still)
    table = section_stability([resting], sections, {})
    second = table[table["variant"] == "second half"].iloc[0]
    assert np.isnan(second["pre_height_m"])
    assert second["note"]


def test_recordings_of_one_kind_do_not_drift(recordings, sections):
    drift = drift_table(recordings, tables_of(recordings, sections))
    assert set(drift["quantity"]) == set(QUANTITIES)
    assert set(drift["part"]) == {"a", "b"}
    off = ((drift["median_of_part"] - drift["typical"]) / drift["se"]).abs()
    assert off.max() < 4.0


@pytest.mark.parametrize("touchdowns", [5, 6, 8, 20])
def test_parts_of_few_touchdowns_spread_as_they_do(touchdowns):
    found = []
    for seed in range(300):
        values = np.random.default_rng(seed).normal(size=4 * touchdowns)
        table = {"contact spread": values, "part": np.repeat([*"abcd"], touchdowns)}
        row = quantity_rows(pd.DataFrame(table), "contact spread")[0]
        assert row[5] == pytest.approx(1.2533 * row[7] / np.sqrt(touchdowns))
        found.append(row[7])
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1.0, abs=0.06)


def test_a_moved_marker_is_drift_of_the_body_alone(recordings, sections):
    marker = recordings[1].positions.copy()
    marker[:, recordings[1].indices("body")[0], 0] += 0.004
    moved = [recordings[0], replace(recordings[1], positions=marker)]
    drift = drift_table(moved, tables_of(moved, sections))
    off = ((drift["median_of_part"] - drift["typical"]) / drift["se"]).abs()
    largest = off.groupby(drift["quantity"]).max()
    assert largest["distance between body markers"] > 5.0
    assert largest.drop("distance between body markers").max() < 4.0


def test_a_single_recording_is_compared_by_quarters(recordings, sections):
    drift = drift_table(recordings[:1], tables_of(recordings[:1], sections))
    assert list(dict.fromkeys(drift["part"])) == [
        f"part {k} of 4" for k in (1, 2, 3, 4)
    ]
    sizes = drift[drift["quantity"] == "contact spread"]["touchdowns"]
    assert sizes.max() - sizes.min() <= 1


def test_too_few_touchdowns_give_an_empty_table(recordings, sections):
    few = tables_of(recordings[:1], sections).head(LEAST - 1)
    assert drift_table(recordings[:1], few).empty
    assert drift_table(recordings[:1], few.head(0)).empty


def test_a_single_part_is_compared_with_nothing(recordings, sections):
    table = tables_of(recordings, sections)
    other = table["recording"] == recordings[1].name
    few = pd.concat([table[~other], table[other].head(LEAST - 1)])
    assert drift_table(recordings, few).empty


# The landings to inspect: one of each reason, then the least sure.
