"""Drawings of the board and of the live loop."""

from dataclasses import asdict

import numpy as np
import pandas as pd
import pytest

from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.steering.figures import drawings
from hopdata.steering.live.parts import FLOWS, PARTS
from hopdata.synthesis.sketch import hopper_sketch

SKETCH = hopper_sketch(HopperParameters())


def words(figure):
    return "\n".join(text.get_text() for axes in figure.axes for text in axes.texts)


def stances(touched):
    n = len(touched)
    return pd.DataFrame(
        {
            "x_m": 0.1 * np.arange(n),
            "y_m": np.zeros(n),
            "heading_rad": np.zeros(n),
            "board_m": 0.5 + 0.05 * np.cumsum(touched),
            "touched": np.array(touched, dtype=bool),
            "reach_m": 0.4,
            "drag_n": 3.0,
        }
    )


@pytest.mark.parametrize("touched", [[0, 0, 1, 1], [0, 0, 0, 0]])
def test_the_board_is_drawn_with_its_numbers_and_the_stances_that_push(touched):
    figure = drawings.board_figure(SKETCH, stances(touched))
    text = words(figure)
    assert "0.40 m ahead" in text
    assert "resists with 3 N" in text
    lines = {line.get_label(): line for line in figure.axes[1].lines}
    assert len(lines["stance that pushes"].get_xdata()) == sum(touched)
    assert len(lines["stance"].get_xdata()) == 4 - sum(touched)
    last = 0.5 + 0.05 * sum(touched)
    np.testing.assert_allclose(lines["board, last"].get_xdata(), last)


def loop(parts=PARTS, flows=FLOWS):
    return drawings.loop_figure(
        pd.DataFrame([asdict(part) for part in parts]),
        pd.DataFrame([asdict(flow) for flow in flows]),
    )


def test_each_part_and_flow_of_the_loop_is_drawn():
    text = words(loop())
    for part in PARTS:
        assert part.name in text
    for flow in FLOWS:
        method = flow.by.rpartition(".")[2]
        assert f".{method}()" in text or not flow.by
    assert set(drawings.PLACES) == {part.name for part in PARTS}


def test_tables_that_were_written_and_read_again_give_the_same_drawing(tmp_path):
    from hopdata.jobs import read_table, write_table

    tables = []
    for name, rows in (("parts", PARTS), ("flows", FLOWS)):
        path = tmp_path / f"{name}.csv"
        write_table(path, pd.DataFrame([asdict(row) for row in rows]))
        tables.append(read_table(path))
    assert words(drawings.loop_figure(*tables)) == words(loop())


def test_no_two_parts_share_a_place():
    places = np.array(list(drawings.PLACES.values()))
    apart = np.abs(places[:, None] - places[None])
    width, height = drawings.BOX
    overlaps = (apart[..., 0] < width) & (apart[..., 1] < height)
    assert overlaps.sum() == len(places)  # each with itself


def test_what_the_printed_figure_lacks_is_drawn_thin():
    figure = loop()
    widths = [patch.get_linewidth() for patch in figure.axes[0].patches]
    boxes = [width for width in widths if width in (0.7, 1.6)]
    printed = sum(part.printed for part in PARTS)
    assert boxes.count(1.6) == printed
    assert boxes.count(0.7) == len(PARTS) - printed
