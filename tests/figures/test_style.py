import matplotlib
import pytest
from fake_tables import prediction_summary, units

from hopdata.figures.prediction import prediction_figure
from hopdata.figures.style import (
    FOOT_COLOURS,
    foot_colour,
    foot_dash,
    message_figure,
    paper_figure,
    style_context,
)


def test_size_on_paper_is_in_millimetres():
    assert paper_figure(85, 50).get_size_inches() * 25.4 == pytest.approx((85, 50))


def test_the_style_holds_within_and_only_there():
    matplotlib.get_backend()  # chosen when first asked for, whoever asks
    before = matplotlib.rcParams.copy()
    with style_context():
        assert matplotlib.rcParams["svg.hashsalt"] == "hopdata"
        assert matplotlib.rcParams["font.size"] == 7
    prediction_figure(prediction_summary(), units())
    assert matplotlib.rcParams == before


def test_a_users_own_settings_do_not_reach_the_figures():
    with matplotlib.rc_context({"axes.facecolor": "red", "font.size": 30}):
        figure = prediction_figure(prediction_summary(), units())
    assert figure.axes[0].get_facecolor() == (1, 1, 1, 1)
    assert figure.axes[0].yaxis.label.get_fontsize() == 7


def test_feet_differ_in_colour_and_in_dashes():
    assert len({foot_colour(i) for i in range(6)}) == len(FOOT_COLOURS) == 6
    assert len({foot_dash(i) for i in range(6)}) == 6
    assert foot_colour(6) == foot_colour(0)


def test_a_message_is_drawn_in_words():
    assert message_figure("nothing here").texts[0].get_text() == "nothing here"
