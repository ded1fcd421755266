"""The part `drawings`, in a small version, and its rules of agreement."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import drawings as part
from hopdata.dissertation.rows import Agreement
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.steering import robot as plant
from hopdata.steering.live import parts as live_parts

ITEMS = [14, 51, 52, 53, 71, 74]
SMALL = part.Effort(calibration_hops=20, noticed_hops=6, fall_hops=5, drive_s=1.0)


@pytest.fixture(scope="module")
def made():
    return part.make([1, 2], effort=SMALL)


def test_each_item_has_its_row_and_every_sentence_its_numbers(made):
    rows = {row.item: row for row in made.rows}
    assert [one.number for one in read_part("drawings")] == ITEMS == list(rows)
    for item in read_part("drawings"):
        row = rows[item.number]
        numbers = {name: _middle(value) for name, value in row.values.items()}
        for sentence in (item.printed_method, item.ours, item.reasons[row.reason]):
            assert "{" not in sentence.format(**numbers)


def _middle(value):
    return float(np.median(value))


def test_each_figure_that_an_item_names_is_drawn(made):
    drawn = part.draw(made.tables)
    named = {one.figure for one in read_part("drawings") if one.figure}
    assert named == set(drawn)


def test_what_is_drawn_does_what_is_printed(made):
    rows = {row.item: row for row in made.rows}
    assert rows[14].agreement is rows[51].agreement is Agreement.BUILT
    assert rows[14].values["touchdown_n"] == pytest.approx(22.0)
    assert rows[51].values["neutral_mm"] == pytest.approx(0.0, abs=1e-9)
    assert rows[52].values["found"] == [100.0, 100.0]
    assert rows[53].values["cut_deg"] == pytest.approx(90.0)
    assert rows[71].agreement is Agreement.BUILT
    assert rows[74].values["pushing"] > 0


def test_a_leg_without_preload_is_not_the_printed_one():
    forces = pd.DataFrame(
        {"phase": "landing", "gap_m": [0.0, -0.01, -0.02], "force_n": [0.0, 1.0, 2.0]}
    )
    sketch = pd.DataFrame({"kind": ["foot"] * 3})
    tables = {"study_forces": forces, "study_sketch": sketch}
    study = HopperParameters()
    assert part.preload_row(study, tables).agreement is Agreement.DIFFERS
    bent = forces.assign(force_n=[22.0, 23.0, 27.0])
    tables["study_forces"] = bent
    assert part.preload_row(study, tables).agreement is Agreement.DIFFERS
    tables["study_forces"] = forces.assign(force_n=[22.0, 23.0, 24.0])
    assert part.preload_row(study, tables).agreement is Agreement.BUILT


@pytest.mark.parametrize(
    ("found", "false", "agreement"),
    [
        (1.0, 0, Agreement.PARTLY),
        (np.nan, 0, Agreement.DIFFERS),
        (1.0, 1, Agreement.DIFFERS),
    ],
)
def test_a_stance_that_is_missed_or_false_does_not_agree(found, false, agreement):
    delays = pd.DataFrame(
        {
            "lowest_s": [1.0, 2.0],
            "loaded_s": [0.9, 1.9],
            "found_s": [1.0, found],
            "recognised_s": [1.02, 2.02],
            "seed": 1,
            "false": false,
        }
    )
    assert part.stance_row(delays).agreement is agreement


@pytest.mark.parametrize(
    ("light", "heavy", "agreement"),
    [
        (5.0, 50.0, Agreement.AGREES),
        (0.0, 50.0, Agreement.PARTLY),
        (0.0, 0.0, Agreement.DIFFERS),
    ],
)
def test_the_limit_agrees_if_larger_swings_tip_the_robot_over(light, heavy, agreement):
    rows = []
    for weight, beyond in ((part.LIGHT_KG, light), (part.HEAVY_KG, heavy)):
        for swing in part.FALL_SWINGS_DEG:
            fell = beyond if swing == part.FALL_SWINGS_DEG[-1] else 0.0
            rows.append(
                {"seed": 1, "weight_kg": weight, "swing_deg": swing, "fell": fell}
            )
    found = part.limit_row(plant.SteeredHopper(), pd.DataFrame(rows))
    assert found.agreement is agreement


def test_the_loop_is_built_only_if_the_declared_threads_are_alive():
    driven = SimpleNamespace(
        decisions=[SimpleNamespace(latency_s=0.001)],
        loop=SimpleNamespace(frames=10, overrun=0),
    )
    declared = set(live_parts.threads(simulated=True, log=False))
    assert part.loop_row(declared, driven).agreement is Agreement.BUILT
    fewer = declared - {live_parts.CONTROL}
    assert part.loop_row(fewer, driven).agreement is Agreement.DIFFERS
    more = declared | {"hopdata-unknown"}
    assert part.loop_row(more, driven).agreement is Agreement.DIFFERS


@pytest.mark.parametrize(
    ("board_m", "agreement"),
    [([0.5, 0.5, 0.6], Agreement.PARTLY), ([0.5, 0.5, 0.5], Agreement.DIFFERS)],
)
def test_a_board_without_mass_agrees_in_part_if_it_is_pushed(board_m, agreement):
    board = pd.DataFrame(
        {
            "x_m": [0.0, 0.1, 0.15],
            "board_m": board_m,
            "touched": [False, False, True],
            "drag_n": 4.0,
        }
    )
    assert part.board_row(board).agreement is agreement
