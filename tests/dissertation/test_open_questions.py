"""Items 99 and 100: a filter and a gradient through contacts, and controls of both."""

import numpy as np
import pandas as pd
import pytest

from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import open_questions
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement


@pytest.fixture(scope="module")
def made():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(open_questions, "RUNS", 3)
        patch.setattr(open_questions, "EVALUATIONS", 20)
        return open_questions.make([1])


@pytest.fixture(scope="module")
def rows(made):
    return {row.item: row for row in made.rows}


def test_both_items_have_a_row_whose_numbers_fill_its_sentences(rows):
    items = read_part("open_questions")
    assert [one.number for one in items] == sorted(rows) == [99, 100]
    for one in items:
        values = rows[one.number].to_dict()["values"]
        reason = one.reasons[rows[one.number].reason]
        for sentence in (one.printed_method, one.ours, reason):
            assert "{" not in filled(sentence, values)


def test_the_filter_is_right_at_contacts_with_saltation_only(rows):
    values = rows[99].values
    assert rows[99].agreement == Agreement.AGREES
    assert values["saltation_held"][0] > 0.85
    assert values["none_held"][0] < 0.75
    assert values["saltation_elsewhere"][0] > 0.9
    # Where the force starts from zero there is nothing to lose.
    assert values["soft_none_held"] == values["soft_saltation_held"]


def test_the_gradient_reaches_its_target_and_is_that_of_differences(made, rows):
    values = rows[100].values
    assert values["through_error"][0] < 1e-5
    assert values["ignored_error"][0] > 0.1
    assert values["through_miss"][0] < open_questions.REACHED < values["start"][0]
    best = made.tables["gradient"].groupby(["goal", "gradient"])["best"]
    assert (best.diff().dropna() <= 0).all()
    # The place alone is reached with either.
    assert values["through_place_successes"] == values["ignored_place_successes"] == 1


def gradients(through, ignored):
    """Return a table in which the two gradients end at these misses."""
    rows = [
        (1, goal, name, evaluation, miss, error)
        for goal in open_questions.GOALS
        for name, misses, error in (
            (open_questions.THROUGH, through, 1e-7),
            (open_questions.IGNORED, ignored, 0.4),
        )
        for evaluation, miss in enumerate(misses, 1)
    ]
    columns = ["seed", "goal", "gradient", "evaluation", "best", "error"]
    table = pd.DataFrame(rows, columns=columns)
    return table.assign(miss=table["best"])


def test_a_gradient_that_is_no_better_does_not_agree():
    agrees = open_questions.gradient_row(gradients([2.0, 1e-4], [2.0, 0.5]))
    assert agrees.agreement == Agreement.AGREES
    assert agrees.values["through_needed"] == [2]
    for both in ([2.0, 1e-4], [2.0, 0.5]):
        same = open_questions.gradient_row(gradients(both, both))
        assert same.agreement == Agreement.DIFFERS


def test_a_filter_that_is_no_better_does_not_agree(made):
    table = made.tables["filter"].copy()
    table.loc[table["filtered_by"] == "none", "prediction"] = table.loc[
        table["filtered_by"] == "saltation", "prediction"
    ].to_numpy()
    assert open_questions.filter_row(table).agreement == Agreement.DIFFERS


def test_a_derivative_by_a_choice_is_that_of_its_unit():
    choice = np.array([0.3, 0.2, -0.1, 0.3])
    _, slopes = open_questions.apex_slopes(choice, True)
    np.testing.assert_allclose(
        slopes, open_questions.slopes_by_differences(choice), rtol=1e-5, atol=1e-6
    )


def test_the_figures_are_drawn(made):
    figures = open_questions.draw(made.tables)
    assert list(figures) == ["filter_through_contacts", "gradient_through_contacts"]
    for figure in figures.values():
        figure.savefig("/dev/null", format="svg")
