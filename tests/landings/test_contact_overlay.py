"""Contacts found beside known ones: what is matched, missed, invented, another foot's."""

import numpy as np
import pandas as pd
import pytest
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.errors import AnalysisError
from hopdata.landings.contact_overlay import COLUMNS, compare_contacts
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.external import Column, ContactTimes

FEET = ("foot1", "foot2", "foot3")
SECTIONS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}


@pytest.fixture(scope="module")
def scene():
    return simulate(40, seed=3)


@pytest.fixture(scope="module")
def touchdowns(scene):
    return touchdown_table(scene.recording, **SECTIONS)


def known(instants, feet=("foot1",), *, span_s=None, other_feet_above_m=None):
    instants = np.sort(np.asarray(instants, float))
    span = span_s or (float(instants[0]), float(instants[-1]))
    return ContactTimes(Column("switch", feet), instants, "contacts", span, other_feet_above_m)


def compare(scene, touchdowns, contacts, window_s=0.05):
    return compare_contacts(scene.recording, touchdowns, contacts, window_s=window_s)


@pytest.mark.parametrize("foot", range(3))
def test_each_foot_against_the_truth(scene, touchdowns, foot):
    table = compare(scene, touchdowns, known(scene.contact_times[:, foot], FEET[foot : foot + 1]))
    assert list(table.columns) == list(COLUMNS)
    assert (table["status"] == "matched").all()
    assert (table["first_foot"] == FEET[foot]).all()
    np.testing.assert_array_equal(table["index"], np.arange(40))
    np.testing.assert_array_equal(table["found_s"], touchdowns[f"contact_{FEET[foot]}_s"])
    np.testing.assert_allclose(
        table["difference_s"], table["found_s"] - scene.contact_times[:, foot]
    )
    assert table["difference_s"].abs().max() < 0.0015
    np.testing.assert_array_equal(table["se_s"], touchdowns[f"se_{FEET[foot]}_s"])


def test_feet_of_one_column_are_compared_by_their_first_contact(scene, touchdowns):
    table = compare(scene, touchdowns, known(scene.contact_times.min(axis=1), FEET))
    assert (table["status"] == "matched").all()
    assert table["difference_s"].abs().max() < 0.0015
    first = np.argmin(scene.contact_times, axis=1)
    right = table["first_foot"].to_numpy() == np.array(FEET)[first]
    assert right.mean() > 0.9
    assert set(table["feet"]) == {"foot1 foot2 foot3"}


def test_a_known_offset_is_the_difference(scene, touchdowns):
    table = compare(scene, touchdowns, known(scene.contact_times[:, 0] + 0.01))
    assert table["difference_s"].median() == pytest.approx(-0.01, abs=0.0005)


def test_a_contact_that_hopdata_lost_is_missed_with_the_reason(scene, touchdowns):
    lost = touchdowns.copy()
    lost.loc[7, ["contact_foot1_s", "se_foot1_s"]] = np.nan
    lost.loc[7, ["excluded", "reason"]] = [True, "poor fit of foot 1"]
    lost = lost.drop(index=12).reset_index(drop=True)
    table = compare(scene, lost, known(scene.contact_times[:, 0]))
    missed = table[table["status"] == "missed"]
    assert missed["index"].tolist() == [7, pd.NA]
    assert missed["reason"].tolist() == ["poor fit of foot 1", "no descent through the pre section"]
    np.testing.assert_array_equal(missed["external_s"], scene.contact_times[[7, 12], 0])
    assert (table["status"] == "matched").sum() == 38


def test_a_foot_that_lands_after_the_post_section_belongs_to_that_touchdown(scene, touchdowns):
    late = touchdowns.copy()
    late.loc[7, ["contact_foot1_s", "se_foot1_s"]] = np.nan
    late.loc[7, ["excluded", "reason"]] = [True, "foot 1 not down by the post section"]
    instants = scene.contact_times[:, 0].copy()
    instants[7] = late.loc[7, "t_post_s"] + 0.06
    (row,) = compare(scene, late, known(instants)).query("status == 'missed'").to_dict("records")
    assert (row["index"], row["reason"]) == (7, "foot 1 not down by the post section")


def test_a_contact_that_nobody_else_knows_is_invented(scene, touchdowns):
    instants = np.delete(scene.contact_times[:, 0], 20)
    table = compare(scene, touchdowns, known(instants))
    invented = table[table["status"] == "invented"]
    assert invented["index"].tolist() == [20]
    assert invented["external_s"].isna().all()
    assert (table["status"] == "matched").sum() == 39


def test_what_lies_beyond_the_external_data_is_not_compared(scene, touchdowns):
    table = compare(scene, touchdowns, known(scene.contact_times[10:30, 0]))
    out = table[table["status"] == "not compared"]
    assert len(out) == 20
    assert set(out["reason"]) == {"outside the external data"}


def test_what_lies_beyond_the_recording_is_not_compared(scene, touchdowns):
    end = scene.recording.time[-1]
    table = compare(scene, touchdowns, known([*scene.contact_times[:, 0], end + 0.4]))
    assert table.iloc[-1]["status"] == "not compared"
    assert table.iloc[-1]["reason"] == "outside the recording"


def test_contacts_of_excluded_touchdowns_are_matched_but_never_invented(scene, touchdowns):
    out = touchdowns.copy()
    out.loc[[5, 6], "excluded"] = True
    out.loc[[5, 6], "reason"] = "order ambiguous"
    table = compare(scene, out, known(np.delete(scene.contact_times[:, 0], 6)))
    five, six = (table[table["index"] == i].iloc[0] for i in (5, 6))
    assert (five["status"], five["excluded"], five["reason"]) == (
        "matched",
        True,
        "order ambiguous",
    )
    assert (six["status"], six["reason"]) == ("not compared", "order ambiguous")


def test_contacts_of_feet_that_are_not_followed(scene, touchdowns):
    apexes = 0.5 * (scene.contact_times[:-1, 0] + scene.contact_times[1:, 0])
    heights = [np.interp(apexes, scene.recording.time, scene.recording.feet[:, i, 2])
               for i in range(3)]  # fmt: skip
    aloft = apexes[np.min(heights, axis=0) > 0.03]
    assert len(aloft) > 10
    both = [*scene.contact_times.min(axis=1), *aloft]
    table = compare(scene, touchdowns, known(both, FEET, other_feet_above_m=0.03))
    assert (table["status"] == "other foot").sum() == len(aloft)
    assert (table["status"] == "matched").sum() == 40
    assert len(table) == 40 + len(aloft)


def test_times_that_do_not_overlap_are_told(scene, touchdowns):
    with pytest.raises(AnalysisError, match=r"within the recording \(0.000 to .* found 1000.*unit"):
        compare(scene, touchdowns, known(scene.contact_times[:, 0] + 1000))


def test_where_nothing_was_found_all_known_contacts_are_missed(scene, touchdowns):
    table = compare(scene, touchdowns.iloc[:0], known(np.sort(scene.contact_times[:, 0])))
    assert set(table["status"]) == {"missed"}
    assert len(table) == 40


def test_an_offset_between_the_clocks_is_told(scene, touchdowns):
    shifted = known(np.sort(scene.contact_times[:, 0]) + 0.1503)
    with pytest.raises(AnalysisError, match=r"found none among 40 and 40.*larger by -0.150"):
        compare(scene, touchdowns, shifted, window_s=0.02)
