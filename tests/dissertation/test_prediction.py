"""The part `prediction` on a short sample and its control."""

import numpy as np
import pytest
from small_sample import small_sample

from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import prediction
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement

SMALL = {
    "SIZES": (25, 50, 100, 150),
    "DEVIATIONS": (1.0, 0.25, 0.0625),
    "SMALL_HOPS": 400,
    "SMALL_BOOTSTRAPS": 10,
    "MOST_SCALED": 250,
}


@pytest.fixture(scope="module")
def made():
    with pytest.MonkeyPatch.context() as patch:
        study_of, truth_of = small_sample()
        patch.setattr(prediction, "study_of", study_of)
        patch.setattr(prediction, "truth_of", truth_of)
        for name, value in SMALL.items():
            patch.setattr(prediction, name, value)
        return prediction.make([1])


@pytest.fixture
def rows(made):
    return {row.item: row for row in made.rows}


def test_each_item_has_its_row_and_every_sentence_its_numbers(rows):
    items = read_part("prediction")
    assert (
        [one.number for one in items] == [*rows] == [10, 32, 33, *range(39, 45), 49, 50]
    )
    for item in items:
        row = rows[item.number]
        sentences = [item.printed_method, item.ours]
        if row.reason:
            sentences.append(item.reasons[row.reason])
        for sentence in sentences:
            assert "nan" not in filled(sentence, row.values)
        assert set(item.reasons) <= {row.reason}
        row.to_dict()


def test_definitions_hold_and_means_are_outdone(rows):
    assert rows[32].agreement is Agreement.BUILT
    assert max(rows[32].values["difference"]) < 1e-9
    assert max(rows[33].values["hopdata_all"]) < 20
    assert max(rows[33].values["hopdata_specialised"]) < 40
    assert rows[39].values["resampled_distinct"] == pytest.approx(91, abs=3)
    assert rows[39].values["distinct_shared"] == 0
    assert rows[39].values["resampled_together_shared"] > 25


def test_nearer_contacts_tell_the_hopper_from_its_control(rows, made):
    values = rows[44].values
    assert values["C1_noise_quarter"][0] < 1.25 < values["C1_noise_full"][0]
    assert values["control_none_quarter"][0] > 1.5 * values["C1_none_quarter"][0]
    table = made.tables["ratio_by_spread"]
    assert len(table) == 4 * 2 * 2
    assert (np.diff(table.groupby("scale")["spread_ms"].median()) > 0).all()


def test_an_unseen_order_is_predicted_near_the_contact_by_a_c1_map_alone(rows):
    values = rows[50].values
    assert values["near_C1"] < 4
    assert values["near_control"] > 8
    assert rows[50].agreement is Agreement.AGREES


def test_more_impacts_err_less(made):
    table = (
        made.tables["impacts"].groupby(["what", "landings"])["median_error"].median()
    )
    for what in ("prediction", "map"):
        assert table[what].is_monotonic_decreasing


def test_figures_are_drawn_from_the_tables(made):
    figures = prediction.draw(made.tables)
    drawn = {item.figure for item in read_part("prediction")} - {""}
    assert set(figures) == drawn
    boxes = figures["fig2_4_prediction"].axes[0]
    labels = [one.get_text().replace("\n", " ") for one in boxes.get_xticklabels()]
    assert labels == [
        "affine specialised",
        "affine near",
        "affine all",
        "affine far",
        "mean specialised",
        "mean all",
    ]
