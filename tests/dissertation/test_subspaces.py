"""The part `subspaces` on a short sample and its control."""

import numpy as np
import pytest
from small_sample import small_sample

from hopdata.dissertation.items import read_part
from hopdata.dissertation.parts import subspaces
from hopdata.dissertation.report.sentences import filled
from hopdata.dissertation.rows import Agreement


@pytest.fixture(scope="module")
def made():
    with pytest.MonkeyPatch.context() as patch:
        study_of, truth_of = small_sample()
        patch.setattr(subspaces, "study_of", study_of)
        patch.setattr(subspaces, "truth_of", truth_of)
        patch.setattr(subspaces, "PAIRS", 40)
        return subspaces.make([1])


@pytest.fixture
def rows(made):
    return {row.item: row for row in made.rows}


def test_each_item_has_its_row_and_every_sentence_its_numbers(rows):
    items = read_part("subspaces")
    assert [one.number for one in items] == [*rows] == [*range(34, 39), *range(45, 49)]
    for item in items:
        row = rows[item.number]
        sentences = [item.printed_method, item.ours]
        if row.reason:
            sentences.append(item.reasons[row.reason])
        for sentence in sentences:
            assert "nan" not in filled(sentence, row.values)
        assert set(item.reasons) <= {row.reason}
        row.to_dict()


def test_the_sections_are_the_two_least_components(rows, made):
    assert rows[34].agreement is Agreement.PARTLY
    spectrum = made.tables["spectrum"]
    assert (np.diff(spectrum["sd"]) <= 0).all()
    assert 8 <= rows[34].values["above_noise"] < 17 < rows[34].values["true_rank"] < 34


def test_small_components_that_are_no_complement_lie_elsewhere(rows):
    values = rows[35].values
    assert values["difference"] < 1e-9
    assert values["smallest_spanned_in"][0] > 1.2 * values["leading_in"][0]


def test_baselines_and_draws(rows):
    assert rows[46].values["noised"][0] == pytest.approx(2.268, rel=0.02)
    assert rows[47].agreement is Agreement.AGREES
    assert rows[45].values["lacking"][0] == pytest.approx(16.5, abs=4)
    assert rows[36].agreement is Agreement.BUILT
    assert rows[38].agreement is Agreement.BUILT
    assert rows[47].values["hopdata_below"] == 100
    assert rows[37].values["first_mean_at"] == "arc length"


def test_figures_are_drawn_from_the_tables(made):
    figures = subspaces.draw(made.tables)
    drawn = {item.figure for item in read_part("subspaces")} - {""}
    assert set(figures) == drawn
    lower = figures["fig2_5_distances"].axes[3]
    labels = [one.get_text() for one in lower.get_yticklabels()]
    assert labels == ["in-class", "cross-class", "I + noise", "random"]
