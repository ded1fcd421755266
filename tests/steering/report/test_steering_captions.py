"""Captions of steering hold no number of another study."""

import pytest
from fake_steering import CAPTIONS, FIGURES
from test_captions import numbers_in

from hopdata.steering.report.page import PLACES

# Numbers that a caption may state, since they say how a figure is drawn or a quantity
# defined. Every other number comes from the study's own tables.
OWN_NUMBERS = {
    "fig3_3_printed": {"45"},  # degrees
    "fig3_6_turn": {"180"},  # degrees
    "steering_outcomes": {"5", "95"},
    "steering_learning": {"5", "95"},
    # Smoothness 3/2 and 5/2 (C1, C2), and the axis' end.
    "steering_kernels": {"3", "2", "1", "5", "0.15"},
}


@pytest.mark.parametrize("name", FIGURES)
def test_no_caption_quotes_a_number_of_another_study(name):
    text = (CAPTIONS / f"{name}.md").read_text(encoding="utf-8")
    assert numbers_in(text) <= OWN_NUMBERS.get(name, set())


def test_every_caption_is_of_a_figure_that_has_a_test():
    assert {file.stem for file in CAPTIONS.glob("*.md")} == set(FIGURES)
    assert set(PLACES) <= set(FIGURES)
