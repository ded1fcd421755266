import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults

from hopdata.figures.verdict import DIFFERENCE, verdict_figure

SENTENCES = {
    "different": "The maps of different contact orders are different: by 0.38 of the map "
    "(95 % interval 0.32 to 0.45, p = 0.0005).",
    "no difference": "No difference between the maps of different contact orders larger than 0.12 "
    "of the map, at 95 % confidence (p = 0.73).",
    "cannot tell": "These data cannot tell: no difference was found (p = 0.95), but one of up to "
    "0.33 of the map cannot be excluded, and 0.2 was wanted.",
}
EFFECTS = {  # estimate, low, high, upper bound, detectable, p
    "different": (0.38, 0.32, 0.45, 0.44, 0.06, 0.0005),
    "no difference": (0.0, 0.0, 0.13, 0.12, 0.075, 0.73),
    "cannot tell": (0.0, 0.0, 0.36, 0.33, 0.13, 0.95),
}


def verdict(conclusion="no difference", **changes):
    *sizes, p = EFFECTS[conclusion]
    names = ("estimate", "low", "high", "upper_bound", "detectable")
    return {
        "conclusion": conclusion,
        "sentence": SENTENCES[conclusion],
        "confidence": 0.95,
        "margin": 0.2,
        "power": 0.8,
        "effect": dict(zip(names, sizes, strict=True)),
        "test": {"p_value": p},
    } | changes


def windows(n=5, chosen=1):
    shares = np.array([1.0, 0.71, 0.5, 0.35, 0.25])[:n]
    table = pd.DataFrame({"window": shares})
    return table.assign(
        kinks=[0.0, 0.05, 0.1, 0.02, 0.2][:n],
        kinks_low=0.0,
        kinks_high=[0.1, 0.13, 0.2, 0.3, 0.6][:n],
        chosen=np.arange(n) == chosen,
    )


def texts(figure, panel):
    return [label.get_text() for label in figure.axes[panel].get_yticklabels()]


@pytest.mark.parametrize("conclusion", EFFECTS)
def test_every_conclusion_is_drawn_without_overlap(conclusion):
    figure = verdict_figure(verdict(conclusion), windows())
    assert len(figure.axes) == 2
    shown = figure.get_supxlabel().replace("\n", " ").replace("\u00a0", " ")
    assert shown == SENTENCES[conclusion]
    assert text_faults(figure) == []


def test_the_sentence_is_not_broken_within_a_number():
    lines = verdict_figure(verdict("different"), windows()).get_supxlabel().splitlines()
    assert len(lines) > 1
    assert not any(line.endswith(("p", "=", "95")) for line in lines)


def test_the_chosen_window_is_filled_and_bold():
    axes = verdict_figure(verdict(), windows(chosen=2)).axes[0]
    filled = [line for line in axes.lines if line.get_marker() == "s" and
              line.get_markerfacecolor() != "white"]  # fmt: skip
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in filled] == [(2, 0.1)]
    ticks = axes.get_xticklabels()
    assert [tick.get_text() for tick in ticks] == ["25", "35", "50", "71", "100"]
    assert [tick.get_fontweight() == "bold" for tick in ticks] == [i == 2 for i in range(5)]


def test_size_bound_and_detectable_difference_are_those_given():
    axes = verdict_figure(verdict("cannot tell"), windows()).axes[1]
    interval, estimate, *rest = axes.lines
    assert (list(interval.get_xdata()), list(estimate.get_xdata())) == ([0.0, 0.36], [0.0])
    starts = [x.get_xdata()[0] for x in rest if x.get_marker() == "|"]
    assert starts == [0.33, 0.13]
    assert axes.get_xlabel() == DIFFERENCE
    assert any("0 (0 to 0.36)" in text for text in texts(verdict_figure(verdict("cannot tell"),
               windows()), 1))  # fmt: skip


def test_an_endless_interval_is_cut_and_ends_in_an_arrowhead():
    effect = {"estimate": 0.1, "low": 0.0, "high": 1e3, "upper_bound": 900.0, "detectable": 0.3}
    table = windows().assign(kinks_high=1e3)
    figure = verdict_figure(verdict(effect=effect), table)
    top = figure.axes[0].get_ylim()[1]
    assert top < 2
    assert sum(line.get_marker() == "^" for line in figure.axes[0].lines) == 5
    assert max(np.max(line.get_ydata()) for line in figure.axes[0].lines) <= top
    assert text_faults(figure) == []


def test_one_window_is_enough():
    assert text_faults(verdict_figure(verdict(), windows(1, chosen=0))) == []


@pytest.mark.parametrize("table", [windows(), windows(5).iloc[:0]])
def test_without_an_answer_the_picture_says_why(table):
    sentence = "These data cannot tell: " + 12 * "a reason that is long, " + "and ends."
    figure = verdict_figure(verdict(effect=None, sentence=sentence), table)
    assert figure.axes == []
    assert " ".join(figure.texts[0].get_text().split()) == sentence
    assert text_faults(figure) == []
