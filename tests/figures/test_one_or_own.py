"""The figure of what own maps gain for landings, in mm and degrees."""

import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures import style
from hopdata.figures.one_or_own import NOTHING_FORETOLD, ONE, OWN, one_or_own_figure
from hopdata.maps.one_or_own import COLUMNS

UNITS = {
    "mm": ("step x", "step y"),
    "°": ("turn", "pitch", "roll"),
    "mm/s": ("forward", "sideways", "climb"),
    "°/s": ("spin x", "spin y", "spin z"),
}


def foretold(scale=1.0, by_own=0.5):
    """Return a table whose own maps miss `by_own` of what the one map misses."""
    rows = []
    for unit, names in UNITS.items():
        for number, name in enumerate(names):
            missed = scale * (number + 1)
            rows.append(
                {
                    "outcome": name,
                    "unit": unit,
                    "happened": 100.0,
                    "one_map": 100.0 - 2 * missed,
                    "own_map": 100.0 + by_own * missed,
                    "missed_by_one": missed,
                    "missed_by_own": by_own * missed,
                }
            )
    return pd.DataFrame(rows)


def marks(axes, shift):
    """Return the errors of the marks of one map, or of own maps, row by row."""
    found = []
    for line in axes.lines:
        place = line.get_ydata()[0]
        if line.get_marker() == "o" and (place - shift) % 1 == pytest.approx(0):
            found.append(line.get_xdata())
    return [float(one[0]) for one in found]


def bars(axes, shift):
    """Return the ends of the bars of one map, or of own maps, row by row."""
    found = []
    for bar in axes.patches:
        middle = bar.get_y() + 0.5 * bar.get_height()
        if round(middle - shift, 6) % 1 == 0:
            found.append((bar.get_x(), bar.get_x() + bar.get_width()))
    return found


def test_marks_are_errors_of_the_example_and_bars_typical_ones():
    axes = one_or_own_figure(foretold()).axes[0]
    assert marks(axes, ONE) == pytest.approx([-2.0, -4.0])
    assert marks(axes, OWN) == pytest.approx([0.5, 1.0])
    assert bars(axes, ONE) == [(-1.0, 1.0), (-2.0, 2.0)]
    assert bars(axes, OWN) == [(-0.5, 0.5), (-1.0, 1.0)]
    assert "2.0 → 1.0" in [text.get_text() for text in axes.texts]
    assert axes.get_xlim()[0] < -4.0


def test_each_outcome_has_a_row_with_its_unit():
    figure = one_or_own_figure(foretold())
    for axes, (unit, names) in zip(figure.axes, UNITS.items(), strict=True):
        rows = [text.get_text() for text in axes.get_yticklabels()]
        assert rows == [f"{name} ({unit})" for name in names]
        assert axes.get_xlabel() == f"foretold less what happened ({unit})"


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1234.5])
def test_no_text_covers_another_whatever_the_numbers(scale):
    assert text_faults(one_or_own_figure(foretold(scale))) == []


def test_no_colour_of_a_foot_is_used():
    for axes in one_or_own_figure(foretold()).axes:
        colours = {line.get_color() for line in axes.lines}
        assert not colours & set(style.FOOT_COLOURS)


def test_where_nothing_was_foretold_the_figure_says_so():
    figure = one_or_own_figure(pd.DataFrame(columns=list(COLUMNS)))
    assert figure.texts[0].get_text() == NOTHING_FORETOLD
    assert figure.axes == []
