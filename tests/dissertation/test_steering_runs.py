"""What the page says of controller and runs, with one seed and short ways."""

import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import steering_runs
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement
from hopdata.dissertation.steered import learned

NUMBERS = {67, 68, 69, 70, 72, 73, 75, 76, 77, 78}
SHORT = {
    "excitation": {"repeats": 1},
    "experiments": {"distance_m": 0.3, "hops": 7, "turn_hops": 7, "turned_rad": 2.7},
}


@pytest.fixture(scope="module")
def made():
    with pytest.MonkeyPatch.context() as patched:
        one_each = dict.fromkeys(steering_runs.STARTS, 1)
        for name, value in (
            ("STARTS", one_each),
            ("FAR_STARTS", 1),
            ("FAR_HOPS", 4),
            ("PLANS", 3),
            ("TIMED", 1),
            ("HOPS_A_POINT", 2),
            ("learned", lambda seed, printed: learned(seed, printed=printed, **SHORT)),
        ):
            patched.setattr(steering_runs, name, value)
        return steering_runs.make([3])


def test_every_item_has_a_row_whose_sentences_can_be_filled(made):
    rows = {row.item: row for row in made.rows}
    items = {item.number: item for item in read_part("steering_runs")}
    assert set(rows) == set(items) == NUMBERS
    for number, row in rows.items():
        item = items[number]
        for text in (item.printed_method, item.ours, item.reasons.get(row.reason, "")):
            assert "{" not in filled(text, row.values)
        assert not row.reason or row.reason in item.reasons
        row.to_dict()


def test_all_run_from_the_same_starts(made):
    runs = made.tables["runs"]
    counts = runs.groupby(["experiment", "who"]).size()
    assert counts["origin"].to_dict() == {
        "planner": 1,
        "printed": 1,
        "printed controller": 1,
    }
    assert set(counts["turn_board"].index) == {"planner", "printed"}
    assert runs.groupby("experiment")["bearing_rad"].nunique().eq(1).all()
    examples = made.tables["examples"]
    shown = examples.groupby("experiment")
    for names in shown["controller"].unique():
        assert list(names) == ["printed", "planner"]
    assert shown["run"].nunique().eq(1).all()


def test_numbers_are_what_they_are_said_to_be(made):
    rows = {row.item: row for row in made.rows}
    assert rows[69].values["difference"] < 1e-12
    assert rows[77].values["drawn"] == 4
    assert 0.1 < rows[68].values["planner"][0] < rows[68].values["printed"][0] * 10
    assert 0 <= rows[67].values["four"][0] <= rows[67].values["single"][0] <= 100
    assert rows[73].values["printed_pure"][0] > 0


def test_a_bearing_is_the_angle_between_heading_and_goal():
    assert steering_runs.bearing_of(np.array([1.0, 0.0, np.pi])) == pytest.approx(0)
    assert steering_runs.bearing_of(np.array([1.0, 0.0, 0.0])) == pytest.approx(np.pi)
    away = steering_runs.bearing_of(np.array([0.0, 2.0, 0.0]))
    assert away == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("origin", "turn", "agreement"),
    [
        (True, True, Agreement.AGREES),
        (False, True, Agreement.PARTLY),
        (False, False, Agreement.DIFFERS),
    ],
)
def test_agreement_on_success_follows_from_the_runs(made, origin, turn, agreement):
    runs = made.tables["runs"].copy()
    is_turn = runs["experiment"].str.startswith("turn")
    runs["success"] = np.where(is_turn, turn, origin)
    row = steering_runs.success_row(runs, made.tables["farther"])
    assert row.agreement is agreement
    assert row.values["planner_origin"] == [int(origin)]


def test_figures_are_drawn_without_overlap(made):
    figures = steering_runs.draw(made.tables)
    named = {item.figure for item in read_part("steering_runs") if item.figure}
    assert named == set(figures)
    for name in ("fig3_6_turn", "way_points", "success"):
        assert text_faults(figures[name]) == []
    assert len(figures["fig3_9_turn_board"].axes) == 8


@pytest.mark.parametrize(
    ("done", "pure", "agreement"),
    [
        ([1, 1, 1, 1, 1], 200.0, Agreement.AGREES),
        ([1, 1, 1, 0, 0], 200.0, Agreement.PARTLY),
        ([0, 0, 0, 0, 0], 20.0, Agreement.DIFFERS),
    ],
)
def test_a_figure_agrees_if_nearly_all_seeds_have_such_a_run(done, pure, agreement):
    values = {"printed_done": done, "planner_done": done}
    values |= {"printed_response": [30.0] * 5, "printed_pure": [pure] * 5}
    row = steering_runs.figure_row(72, values, pd.DataFrame())
    assert row.agreement is agreement


@pytest.mark.parametrize(
    ("visited", "agreement"),
    [(4, Agreement.AGREES), (2, Agreement.PARTLY), (1, Agreement.DIFFERS)],
)
def test_way_points_are_followed_if_the_model_visits_all(visited, agreement):
    row = steering_runs.way_points_row([({"printed_alone": visited}, pd.DataFrame())])
    assert row.agreement is agreement
