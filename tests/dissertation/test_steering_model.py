"""What the page says of observation and model, with one seed."""

import numpy as np
import pytest
from overlaps import text_faults

from hopdata.dissertation import steered
from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import steering_model
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement
from hopdata.steering.models import learning

NUMBERS = {56, 57, 58, 59, 60, 61, 62, 63, 65, 66}


@pytest.fixture(scope="module")
def made():
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(steering_model, "TILTED_FRAMES", 300)
        patched.setattr(steering_model, "TRUE_ANGLES", 6)
        patched.setattr(steering_model, "TRUE_SWINGS", 3)
        patched.setattr(steering_model, "TWICE", 120)
        kept = ("printed, length and noise fitted, m", "standardised, all fitted")
        shown = {name: learning.READINGS[name] for name in kept}
        patched.setattr(steering_model, "SHOWN", shown)
        return steering_model.make([3])


@pytest.fixture(scope="module")
def rows(made):
    return {row.item: row for row in made.rows}


def test_every_item_has_a_row_whose_sentences_can_be_filled(rows):
    items = {item.number: item for item in read_part("steering_model")}
    assert set(rows) == set(items) == NUMBERS
    for number, row in rows.items():
        item = items[number]
        for text in (item.printed_method, item.ours, item.reasons.get(row.reason, "")):
            assert "{" not in filled(text, row.values)
        assert not row.reason or row.reason in item.reasons


def test_the_keys_and_not_the_part_make_it_printed():
    printed, ours = (steered.config_of(printed=flag) for flag in (True, False))
    for key, value in (("observations", ["printed"]), ("observations", ["corrected"])):
        config = printed if value == ["printed"] else ours
        assert config["steering"][key] == value
    assert printed["steering"]["model"]["kernel"] == "printed"
    assert printed["steering"]["model"]["map_swing_rad"] == pytest.approx(np.pi / 4)
    assert printed["steering"]["experiments"]["controllers"] == ["printed"]
    assert ours["steering"]["model"]["kernel"] == "recommended"
    assert ours["steering"]["model"]["map_swing_rad"] is None


def test_the_errors_of_observation_are_of_their_known_size(rows):
    level, tilted = rows[57].values["printed"][0], rows[57].values["printed_tilted"][0]
    solid = rows[57].values["ours_tilted"][0]
    assert 1 < rows[57].values["ours"][0] < level < tilted < 12, "mrad"
    assert solid < tilted / 2
    assert 2 < rows[58].values["printed"][0] < 8, "mrad"
    assert rows[59].values["letter"] == [0]
    assert rows[59].values["pairs"][0] > 300
    assert rows[59].values["own_missed"] == [0]
    assert rows[60].values["ours_place_mm"] < rows[60].values["printed_place_mm"]
    assert rows[60].values["algebra"] < 1e-12


def test_the_shortest_sequence_is_the_shortest(rows):
    assert rows[56].values["ours"] == [336]
    assert rows[56].values["printed"][0] >= 336
    assert rows[56].agreement is Agreement.PARTLY


def test_ours_is_periodic_and_the_printed_one_nearly(rows):
    assert rows[62].values["own_seam"][0] < 1e-6
    assert 0.1 < rows[62].values["seam"][0] < 20
    assert rows[62].values["place"][0] < 50 < rows[62].values["own_covered"][0]


def test_agreement_on_the_kernels_follows_from_the_fits():
    """Kernels that never fail, fail on the hopper only, and fail on anything."""

    def table(failing):
        rows = [
            (
                data,
                reading,
                nu,
                component,
                0,
                0.0 if (data, reading, nu) in failing else 1,
            )
            for data in ("hopper", "smooth truth")
            for reading in (steering_model.IN_METRES, steering_model.STANDARDISED)
            for nu in (1.5, 2.5)
            for component in steering_model.COMPONENTS
        ]
        columns = ["data", "reading", "smoothness", "component", "seed", "r2"]
        return learning.pd.DataFrame(rows, columns=columns)

    metres, sound = steering_model.IN_METRES, steering_model.STANDARDISED
    hopper = {("hopper", metres, 2.5), ("hopper", sound, 2.5)}
    smooth = {("smooth truth", metres, 2.5)}
    judged = steering_model.smoothness_row
    assert judged(table(set())).agreement is Agreement.DIFFERS
    assert judged(table(hopper)).agreement is Agreement.AGREES
    assert judged(table(hopper | smooth)).agreement is Agreement.PARTLY
    only_printed = {("hopper", metres, 2.5)}
    assert judged(table(only_printed)).agreement is Agreement.PARTLY


def test_figures_are_drawn_without_overlap(made):
    figures = steering_model.draw(made.tables)
    assert set(figures) == {
        item.figure for item in read_part("steering_model") if item.figure
    }
    for figure in figures.values():
        assert text_faults(figure) == []
    maps = figures["fig3_3_frame_change"].axes
    assert [label.get_text() for label in maps[0].get_yticklabels()] == [
        "−π/4",
        "0",
        "π/4",
    ]
