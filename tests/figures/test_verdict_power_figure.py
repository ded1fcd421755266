import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.verdict_power import CONTROLS, verdict_power_figure

COLUMNS = (
    *("condition", "strength", "true_effect", "found_share", "found_low", "found_high"),
    *("effect_mean", "effect_sd"),
)


def table(kinds=tuple(CONTROLS)):
    rows = [
        (name, 0.0, 1e-16, 0.05, 0.03, 0.09, 0.03, 0.04)
        for name in ("C1", "C1 softer legs", "C1 stiffer legs", "C1 half the noise")
    ]
    rows += [
        (kind, size, size, min(1.0, 4 * size), max(0.0, 4 * size - 0.1), 1.0, 0.9 * size, 0.05)
        for kind in kinds
        for size in (0.05, 0.1, 0.25)
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def test_false_alarms_power_and_sizes_stand_side_by_side():
    figure = verdict_power_figure(table())
    left, middle, _ = figure.axes
    assert [label.get_text() for label in left.get_yticklabels()] == [
        *("hopper", "softer legs", "stiffer legs", "half the noise")
    ]
    assert len(middle.containers) == len(CONTROLS)
    assert text_faults(figure) == []


@pytest.mark.parametrize("kinds", [(), ("kappa",)])
def test_kinds_that_were_not_simulated_are_left_out(kinds):
    figure = verdict_power_figure(table(kinds))
    assert len(figure.axes[1].containers) == len(kinds)
    assert text_faults(figure) == []


def test_no_studies_are_said_in_words():
    figure = verdict_power_figure(table().iloc[:0])
    assert "No simulated studies" in figure.texts[0].get_text()
