import pandas as pd
from overlaps import text_faults

from hopdata.figures.gap_timeline import SIGNS, gap_timeline_figure

MARKERS = ("hip1", "hip2", "toe1", "toe2")
GAPS = pd.DataFrame(
    [("hip1", 1.0, 2.0), ("toe1", 5.0, 5.0001)], columns=["marker", "start_s", "stop_s"]
)
FAULTS = pd.DataFrame(
    [(name, kind, 3.0 + i) for i, (name, kind) in enumerate(zip(MARKERS, SIGNS, strict=True))]
    + [("", "dropped", 8.0)],
    columns=["marker", "kind", "time_s"],
)


def test_one_bar_a_marker_and_a_white_stretch_for_each_gap():
    figure = gap_timeline_figure(GAPS, FAULTS, markers=MARKERS, duration_s=10.0)
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == list(MARKERS)
    assert len(axes.patches) == len(MARKERS)
    stretches = [
        path.get_extents().bounds[:1] + path.get_extents().bounds[2:3]
        for collection in axes.collections
        for path in collection.get_paths()
    ]
    assert stretches[0] == (1.0, 1.0)
    start, length = stretches[1]
    assert start == 5.0
    assert length > 0.01  # wide enough to be seen
    assert text_faults(figure) == []


def test_every_kind_of_fault_stands_in_its_row_and_in_the_legend():
    figure = gap_timeline_figure(GAPS, FAULTS, markers=MARKERS, duration_s=10.0)
    (axes,) = figure.axes
    rows = {line.get_label(): list(line.get_ydata()) for line in axes.lines}
    for row, (_, _, meaning) in enumerate(SIGNS.values()):
        assert rows[meaning] == [row]
    assert "frames dropped" in rows
    (legend,) = figure.legends
    assert len(legend.get_texts()) == len(SIGNS) + 2


def test_nothing_to_show_is_said():
    figure = gap_timeline_figure(GAPS[:0], FAULTS[:0], markers=(), duration_s=10.0)
    assert "No marker" in figure.texts[0].get_text()


def test_a_whole_recording_without_faults():
    figure = gap_timeline_figure(GAPS[:0], FAULTS[:0], markers=MARKERS, duration_s=0.5)
    assert len(figure.axes[0].lines) == 0
    assert text_faults(figure) == []
