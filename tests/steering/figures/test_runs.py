import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults
from steered_runs import HORIZONS, curves, film, outcomes, runs, way_points

from hopdata.errors import AnalysisError
from hopdata.steering.experiments.tasks import CEILING, CONTROLLERS
from hopdata.steering.figures.runs import (
    CURVES,
    LOOKS,
    save_film,
    steering_outcomes_figure,
    steering_run_figure,
)


@pytest.mark.parametrize(
    ("experiment", "board"),
    [("origin", False), ("turn", False), ("origin_board", True), ("turn_board", True)],
)
def test_each_run_is_drawn_without_overlap(experiment, board):
    figure = steering_run_figure(curves(experiment, board=board))
    assert len(figure.axes) == 4
    assert text_faults(figure) == []


def test_the_arena_is_not_distorted():
    arena = steering_run_figure(curves()).axes[0]
    assert arena.get_aspect() == 1.0


def test_the_three_curves_are_those_given():
    table = curves()
    over_time = steering_run_figure(table).axes[1]
    pure, response, measured = over_time.lines[:3]
    for line, name in ((pure, "pure"), (response, "response"), (measured, "measured")):
        rows = table[table["curve"] == name]
        np.testing.assert_allclose(line.get_xdata(), rows["time_s"])
        np.testing.assert_allclose(line.get_ydata(), rows["x_m"])
        assert line.get_label() == CURVES[name][0]


def test_headings_are_shown_in_degrees_with_the_goal_of_a_turn():
    panel = steering_run_figure(curves("turn")).axes[3]
    assert panel.lines[2].get_ydata()[-1] == pytest.approx(180.0)
    assert panel.lines[3].get_ydata()[0] == 180.0


def test_the_goal_and_its_circle_are_there_only_if_a_place_is_the_goal():
    assert any(
        line.get_marker() == "*" for line in steering_run_figure(curves()).axes[0].lines
    )
    turn = steering_run_figure(curves("turn")).axes[0]
    assert not any(line.get_marker() == "*" for line in turn.lines)


def test_the_board_is_drawn_where_it_stood_and_where_it_was_pushed_to():
    arena = steering_run_figure(curves("origin_board", board=True)).axes[0]
    boards = [line for line in arena.lines if line.get_linewidth() == 3]
    assert [line.get_xdata()[0] for line in boards] == pytest.approx([0.5, -0.4])
    assert [line.get_label() for line in boards] == ["board, first", "board, last"]


def test_no_run_is_said():
    assert steering_run_figure(curves().iloc[:0]).axes == []


@pytest.mark.parametrize(
    ("experiment", "done"), [("origin", "arrived"), ("turn_board", "turned")]
)
def test_the_printed_run_stands_above_the_planners_in_the_same_way(experiment, done):
    board = experiment.endswith("board")
    both = [curves(experiment, board=board, by=by) for by in ("planner", "printed")]
    both[1]["x_m"] *= 3.0
    figure = steering_run_figure(pd.concat(both))
    assert text_faults(figure) == []
    assert len(figure.axes) == 8
    above, below = (
        dict(zip("axyh", figure.axes[k : k + 4], strict=True)) for k in (0, 4)
    )
    assert [axes["a"].get_title(loc="left") for axes in (above, below)] == [
        f"printed controller: not {done} in 19 hops",
        f"planner: {done} after 19 hops",
    ]
    printed, planner = (axes["x"].lines[2].get_ydata() for axes in (above, below))
    np.testing.assert_allclose(printed, 3.0 * planner)
    assert above["a"].get_xlim() == pytest.approx(below["a"].get_xlim())
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(told) == len(set(told))


def test_way_points_are_numbered_goals():
    arena, x, *_ = steering_run_figure(way_points()).axes
    stars = [line for line in arena.lines if line.get_marker() == "*"]
    assert [line.get_xdata()[0] for line in stars] == [0.5, 0.5, 0.0]
    assert [text.get_text() for text in arena.texts[:3]] == ["1", "2", "3"]
    assert len(x.lines) == 3, "no line at the origin"
    assert len(steering_run_figure(curves()).axes[1].lines) == 4


def test_outcomes_are_drawn_without_overlap_a_stroke_for_each_seed():
    made = runs()
    figure = steering_outcomes_figure(outcomes(made), made, HORIZONS)
    assert text_faults(figure) == []
    rates, hops, ahead = figure.axes
    strokes = [line for line in rates.lines if line.get_marker() == "|"]
    assert [len(line.get_xdata()) for line in strokes] == [3] * 20
    planner = made[(made["experiment"] == "origin") & (made["controller"] == "planner")]
    shares = 100 * planner.groupby("seed")["success"].mean()
    assert any(np.array_equal(line.get_xdata(), shares) for line in strokes)
    assert hops.get_xlim()[1] > made["hops"].median()
    np.testing.assert_allclose(ahead.lines[0].get_ydata(), [0, 10, 90])


def test_outcomes_without_any_success_have_no_hops():
    made = runs().assign(success=False, hops=-1)
    figure = steering_outcomes_figure(outcomes(made), made, HORIZONS)
    assert text_faults(figure) == []


def test_a_film_has_a_picture_for_every_frame(tmp_path):
    from PIL import Image

    save_film(tmp_path / "film.gif", film(), curves())
    with Image.open(tmp_path / "film.gif") as found:
        assert found.format == "GIF"
        assert found.n_frames == 12
        assert found.info["duration"] == 50
        first = np.asarray(found.convert("RGB"), dtype=int)
        found.seek(6)
        later = np.asarray(found.convert("RGB"), dtype=int)
    assert 0.001 < np.mean(np.abs(first - later).max(axis=2) > 40) < 0.2
    assert list(tmp_path.iterdir()) == [tmp_path / "film.gif"]


def test_the_same_run_gives_the_same_film(tmp_path):
    for name in ("a", "b"):
        save_film(tmp_path / f"{name}.gif", film(), curves("origin_board", board=True))
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_a_film_wants_frames(tmp_path):
    with pytest.raises(AnalysisError, match="expected frames of a run, found 0"):
        save_film(tmp_path / "film.gif", pd.DataFrame(film()).iloc[:0], curves())
    assert list(tmp_path.iterdir()) == []


def test_every_controller_is_drawn():
    assert set(LOOKS) == {*CONTROLLERS, CEILING}
