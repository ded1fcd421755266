import os
from itertools import islice, permutations

import numpy as np
import pandas as pd
import pytest
from overlaps import text_faults, texts_crossed_by_upright_lines

from hopdata.figures.style import FOOT_COLOURS, INK
from hopdata.figures.verdict import (
    ASKED,
    BAR_ROW,
    SEEN_ROW,
    group_figure,
    size_figure,
    verdict_figure,
    verdicts_figure,
)

SENTENCES = {
    "different": "The maps of 6 contact orders are different: by 38 % of the map "
    "(95 % interval 32 % to 45 %).",
    "no difference": "No difference between the maps of 6 contact orders larger than 12 % of the "
    "map, at 95 % confidence.",
    "cannot tell": "These data cannot tell: no difference between the maps of 6 contact orders was "
    "found, but one of up to 33 % of the map cannot be excluded, and 20 % was wanted.",
}
EFFECTS = {  # estimate, low, high, upper bound, detectable
    "different": (0.38, 0.32, 0.45, 0.44, 0.06),
    "no difference": (0.0, 0.0, 0.13, 0.12, 0.075),
    "cannot tell": (0.0, 0.0, 0.36, 0.33, 0.13),
}


def verdict(conclusion="no difference", **changes):
    names = ("estimate", "low", "high", "upper_bound", "detectable")
    return {
        "conclusion": conclusion,
        "sentence": SENTENCES[conclusion],
        "confidence": 0.95,
        "margin": 0.2,
        "power": 0.8,
        "compared": "6 contact orders",
        "n_landings": 1621,
        "effect": dict(zip(names, EFFECTS[conclusion], strict=True)),
    } | changes


def touchdowns(*schedules):
    schedules = schedules or ("2>1>3", "2>1>3", "3>1>2", "1>2>3")
    used = {
        "schedule": [*schedules, None],
        "excluded": [*([False] * len(schedules)), True],
    }
    return pd.DataFrame(used)


def texts(axes):
    return [text.get_text().replace("\u00a0", " ") for text in axes.texts]


@pytest.mark.parametrize("conclusion", EFFECTS)
@pytest.mark.parametrize(
    "schedules", [(), ("1>2",), ("6>5>4>3>2>1", "1>2>3>4>5>6"), ("2>1", "1>2")]
)
def test_every_conclusion_is_drawn_without_overlap(conclusion, schedules):
    figure = verdict_figure(verdict(conclusion), touchdowns(*schedules))
    assert text_faults(figure) == []


@pytest.mark.parametrize(
    ("bound", "detectable", "true"),
    [(0.03, 0.02, 0.0), (0.17, 0.09, 0.2), (0.17, 0.18, 0.0), (0.33, 0.4, 0.1)],
)
def test_no_line_runs_through_a_text(bound, detectable, true):
    effect = {"estimate": 0.0, "low": 0.0, "high": bound + 0.01}
    effect |= {"upper_bound": bound, "detectable": detectable}
    conclusion = "no difference" if bound < 0.2 else "cannot tell"
    found = verdict(conclusion, effect=effect)
    truth = pd.DataFrame({"true_effect": [true]})
    figure = verdict_figure(found, touchdowns(), truth)
    assert text_faults(figure) == []
    size = figure.axes[0]
    assert "margin 20 %" in texts(size)
    assert len(size.collections[0].get_segments()) == 2, "the margin is drawn"
    assert texts_crossed_by_upright_lines(size) == []


def test_a_line_through_a_text_is_found():
    size = verdict_figure(verdict(), touchdowns()).axes[0]
    size.axvline(15.0)
    assert texts_crossed_by_upright_lines(size) != []


def test_a_reason_is_not_broken_within_a_number():
    unknown = verdict("cannot tell", effect=None, sentence=12 * "at 95 % of ")
    lines = verdict_figure(unknown, touchdowns().iloc[:0]).texts[0].get_text()
    assert len(lines.splitlines()) > 1
    assert not any(line.endswith("95") for line in lines.splitlines())


@pytest.mark.parametrize(
    ("conclusion", "words", "bar", "label"),
    [
        (
            "different",
            "Different maps: by 38 % (32 to 45 %)",
            [32, 45],
            "95 % interval",
        ),
        (
            "no difference",
            "No difference above 12 %",
            [0, 12],
            "not excluded",
        ),
        ("cannot tell", "Cannot tell: up to 33 % possible", [0, 33], "not excluded"),
    ],
)
def test_answer_interval_and_what_could_be_seen_are_those_given(
    conclusion, words, bar, label
):
    axes = verdict_figure(verdict(conclusion), touchdowns()).axes[0]
    assert axes.get_title("left").replace("\u00a0", " ") == words
    assert list(axes.lines[0].get_xdata()) == pytest.approx(bar)
    assert any(text.startswith(label) for text in texts(axes))
    (seen,) = [
        x.get_xdata()[0]
        for x in axes.lines
        if x.get_marker() == "|" and x.get_ydata()[0] == SEEN_ROW
    ]
    assert seen == pytest.approx(100 * EFFECTS[conclusion][-1])
    assert axes.get_xlabel().startswith(ASKED)
    told = "margin 20 %" in texts(axes)
    assert told == (conclusion != "different"), (
        "an estimate below the margin may be a difference"
    )


@pytest.mark.parametrize(
    ("conclusion", "words"),
    [("different", "by at least 12 %"), ("cannot tell", "no upper bound")],
)
def test_a_size_without_an_upper_end_ends_in_an_arrow(conclusion, words):
    size = {"estimate": 0.3, "low": 0.0, "detectable": 0.2}
    if conclusion == "different":
        size["low"] = 0.12
    open_end = {"effect": size | {"high": None, "upper_bound": None}}
    axes = verdict_figure(verdict(conclusion, **open_end), touchdowns()).axes[0]
    assert words in axes.get_title("left").replace("\u00a0", " ")
    top = axes.get_xlim()[1]
    assert list(axes.lines[0].get_xdata()) == pytest.approx([100 * size["low"], top])
    assert axes.lines[1].get_marker() == ">"
    assert "no upper end, 95 % confidence" in texts(axes)


def test_a_size_that_fades_is_titled_as_the_sentence_tells_it():
    """The sentence has the size over the landings first, then that at the contact."""
    contact = {"estimate": 0.75, "low": 0.31, "high": None, "upper_bound": None}
    over = {"estimate": 0.53, "low": 0.31, "high": 0.69, "upper_bound": 0.68}
    power = {"detectable": 0.26}
    sizes = {"effect": contact | power, "effect_over_landings": over | power}
    fading = verdict("different", saturates=True, **sizes)
    figure = verdict_figure(fading, touchdowns())
    assert text_faults(figure) == []
    axes = figure.axes[0]
    title = axes.get_title("left").replace("\u00a0", " ")
    first, second = title.splitlines()
    assert first == "Different maps: by 53 % over these landings,"
    assert second == "by at least 31 % where all feet touch at once"
    assert "where all feet touch at once" in axes.get_xlabel()
    lasting = verdict_figure(verdict("different"), touchdowns()).axes[0]
    assert "at once" not in lasting.get_title("left") + lasting.get_xlabel()


def test_sentences_are_left_to_the_caption():
    """A figure of a paper has none below its axes, whatever is known."""
    plain = verdict_figure(verdict(), touchdowns())
    told = verdict_figure(verdict(**SAID, main_contrast="feet 1 and 2"), touchdowns())
    assert plain.get_supxlabel() == told.get_supxlabel() == ""
    for one, other in zip(plain.axes, told.axes, strict=True):
        assert texts(one) == texts(other)
    assert plain.get_figheight() == told.get_figheight()


SAID = {
    "contacts_r2": 0.971,
    "holds_from": 0.0073,
    "contact_spread": 0.01,
    "messages": {"outlook": {"values": {"asked": "20 %", "number": "1,100"}}},
}


def named(table, *feet):
    """Return touchdowns whose columns name the feet."""
    return table.assign(**{f"contact_{foot}_s": 0.0 for foot in feet})


def rows_of(axes, feet):
    """Return the feet of each row, from the first that touches on."""
    rows = {}
    for text in axes.texts:
        if text.get_text() in feet:
            x, y = text.get_position()
            rows.setdefault(y, []).append((x, text.get_text()))
    return [[foot for _, foot in sorted(rows[y])] for y in sorted(rows)]


@pytest.mark.parametrize(
    ("conclusion", "words"),
    [
        ("different", "not all\nalike"),
        ("no difference", "alike to"),
        ("cannot tell", "one map?"),
    ],
)
def test_all_orders_are_drawn_with_their_feet_their_landings_and_their_maps(
    conclusion, words
):
    feet = ("heel", "toe", "thumb")
    axes = verdict_figure(verdict(conclusion), named(touchdowns(), *feet)).axes[1]
    first, *others = rows_of(axes, feet)
    assert first == ["toe", "heel", "thumb"], "the commonest is first"
    assert sorted(others) == [["heel", "toe", "thumb"], ["thumb", "heel", "toe"]]
    assert [text for text in texts(axes) if text.isdigit()] == ["2", "1", "1"]
    said = ("not all", "alike to", "one map?", "own map")
    (box,) = [text for text in texts(axes) if text.startswith(said)]
    assert box.startswith(words)
    squares = [line for line in axes.lines if line.get_marker() == "s"]
    own = [line for line in squares if line.get_color() == INK]
    assert own == [], "orders may share a map"


def test_of_two_orders_it_is_not_said_that_not_all_are_alike():
    two = touchdowns("1>2", "2>1")
    words = texts(verdict_figure(verdict("different"), two).axes[1])
    assert "not alike" in words
    assert "not all\nalike" not in words


def test_the_picture_claims_no_more_than_the_sentence():
    """No difference was found above a bound, over these landings: no map is proved one."""
    reserved = verdict("no difference", holds_from=0.0043)
    size, orders = verdict_figure(reserved, touchdowns()).axes
    words = [size.get_title("left"), *texts(size), *texts(orders)]
    words = [one.replace("\u00a0", " ") for one in words]
    assert words[0] == "No difference above 12 % over these landings"
    assert "alike to\n12 %" in words
    assert not any("one map" in one or "One smooth" in one for one in words)
    assert text_faults(verdict_figure(reserved, touchdowns())) == []


@pytest.mark.parametrize("holds_from", [None, 0.0043])
@pytest.mark.parametrize(
    ("jump_bound", "told"), [(None, ""), (0.2, ""), (0.24, "24 %")]
)
def test_a_jump_that_may_exceed_the_margin_stands_in_the_title(
    holds_from, jump_bound, told
):
    none = verdict(holds_from=holds_from, jump_bound=jump_bound)
    figure = verdict_figure(none, touchdowns())
    title = figure.axes[0].get_title("left").replace("\u00a0", " ")
    assert title.startswith("No difference above 12 %")
    assert ("but a jump of up to" in title) == bool(told)
    assert told in title
    for drawn in (figure, size_figure(none)):
        assert text_faults(drawn) == []


def test_a_foot_has_one_colour_and_mark_in_all_rows():
    axes = verdict_figure(verdict(), named(touchdowns(), "a", "b", "c")).axes[1]
    looks = {}
    names = [text for text in axes.texts if text.get_text() in ("a", "b", "c")]
    at = {text.get_position(): text.get_text() for text in names}
    for line in axes.lines:
        if line.get_color() in FOOT_COLOURS:
            (x,), (y,) = line.get_data()
            (foot,) = [
                name
                for (left, row), name in at.items()
                if row == y and 0 < left - x < 2
            ]
            looks.setdefault(foot, set()).add((line.get_color(), line.get_marker()))
    assert {*looks} == {"a", "b", "c"}
    assert all(len(own) == 1 for own in looks.values())
    assert len(set.union(*looks.values())) == 3


@pytest.mark.parametrize(
    ("names", "beside"),
    [("LFHOOF RFHOOF LHHOOF RHHOOF", False), ("left1 left2 right1 right2", True)],
)
def test_names_of_feet_stand_beside_their_marks_if_they_fit(names, beside):
    """Capitals are wider than small letters; a legend has what does not fit."""
    table = touchdowns("1>2>3>4", "2>1>3>4")
    for name in names.split():
        table[f"contact_{name}_s"] = 1.0
    (axes,) = verdict_figure(verdict("cannot tell", effect=None), table).axes
    assert (names.split()[0] in texts(axes)) == beside
    assert (axes.get_legend() is None) == beside


@pytest.mark.parametrize("n_orders", [6, 24, 40])
def test_many_orders_fit_and_the_rarest_are_counted_together(n_orders):
    every = islice(permutations("12345"), n_orders)
    orders = [">".join(one) for one in every]
    figure = verdict_figure(verdict(), touchdowns(*orders, *orders[:24]))
    axes = figure.axes[1]
    assert f"{n_orders - 24} rarer orders" in texts(axes) or n_orders <= 24
    assert text_faults(figure) == []
    bars = [patch.get_width() for patch in axes.patches]
    assert len(bars) == min(n_orders, 25)


@pytest.mark.parametrize("conclusion", EFFECTS)
@pytest.mark.parametrize("true", [0.0, 0.05, 0.21, 0.7])
def test_the_true_difference_of_a_simulated_study_is_marked(conclusion, true):
    truth = pd.DataFrame({"true_effect": [true]})
    figure = verdict_figure(verdict(conclusion), touchdowns(), truth)
    axes = figure.axes[0]
    (mark,) = [line for line in axes.lines if line.get_marker() == "^"]
    assert mark.get_xdata()[0] == pytest.approx(100 * true)
    assert axes.get_xlim()[1] > 100 * true
    found = f"{100 * EFFECTS[conclusion][0]:g} %"
    assert f"true: {100 * true:g} %, estimated: {found}" in texts(axes)
    assert text_faults(figure) == []
    unknown = verdict_figure(verdict(conclusion), touchdowns(), truth.iloc[:0]).axes[0]
    assert not [line for line in unknown.lines if line.get_marker() == "^"]


def test_an_endless_interval_is_cut_and_ends_in_an_arrowhead():
    effect = {
        "estimate": 0.1,
        "low": 0.0,
        "high": 1e3,
        "upper_bound": 900.0,
        "detectable": 3.0,
    }
    figure = verdict_figure(verdict("cannot tell", effect=effect), touchdowns())
    axes = figure.axes[0]
    assert axes.get_xlim()[1] < 400
    assert any(
        line.get_marker() == ">" and line.get_ydata()[0] == BAR_ROW
        for line in axes.lines
    )
    assert text_faults(figure) == []


def test_without_an_answer_the_orders_are_drawn_and_the_caption_says_why():
    sentence = "These data cannot tell: " + 12 * "a reason that is long, " + "and ends."
    unknown = verdict("cannot tell", effect=None, sentence=sentence)
    figure = verdict_figure(unknown, touchdowns())
    (axes,) = figure.axes
    assert axes.get_title("left") == "Cannot tell"
    assert "one map?" in texts(axes)
    alone = verdict_figure(unknown, touchdowns("1>2>3")).axes[0]
    assert "one map?" not in texts(alone)
    assert "landings" in texts(axes)
    assert not any("reason" in text for text in texts(axes))
    assert text_faults(figure) == []
    figure = verdict_figure(
        verdict("cannot tell", effect=None, sentence=sentence), touchdowns().iloc[:0]
    )
    assert figure.axes == []
    assert " ".join(figure.texts[0].get_text().split()) == sentence
    assert text_faults(figure) == []


def test_verdicts_share_their_scale():
    different = verdict("different")
    figure = verdicts_figure(
        verdict(), touchdowns(), different, touchdowns(), names=("a", "b")
    )
    upper, lower = (part.axes[0] for part in figure.subfigs)
    assert upper.get_xlim() == lower.get_xlim()
    assert text_faults(figure) == []
    none = verdict("cannot tell", effect=None, sentence="Nothing.")
    figure = verdicts_figure(
        verdict(), touchdowns(), none, touchdowns(), names=("a", "b")
    )
    assert [len(part.axes) for part in figure.subfigs] == [2, 2]


def test_what_counts_as_none_is_seen_where_all_subjects_are_below():
    effect = {"estimate": 0.05, "low": 0.0, "high": 0.1, "upper_bound": 0.12}
    known = {"conclusion": "no difference", "margin": 0.2, "effect": effect}
    rows = [{"name": name, "reason": "", **known, **effect} for name in ("ann", "bob")]
    (axes,) = group_figure({**known, "members": rows}).axes
    assert axes.get_xlim()[1] > 20


def random_verdict(rng):
    """Draw a verdict with its touchdowns and, for one in two, the true difference."""
    conclusion = str(rng.choice(list(EFFECTS)))
    margin = round(float(rng.uniform(0.02, 0.6)), 2)
    estimate = float(rng.lognormal(-1.5, 1.2))
    low = 0.0
    high = estimate + float(rng.lognormal(-1.5, 1.5))
    if conclusion == "different":
        low = estimate * float(rng.uniform(0.05, 0.95))
    bound = float(rng.uniform(estimate, high))
    names = ("estimate", "low", "high", "upper_bound", "detectable")
    sizes = (estimate, low, high, bound, float(rng.lognormal(-1.0, 1.0)))
    by_jump = conclusion == "different" and rng.random() < 0.3
    decided = "jump" if by_jump else "effect"
    content = verdict(
        conclusion,
        margin=margin,
        confidence=float(rng.choice([0.8, 0.9, 0.95, 0.99, 0.995])),
        decided_by=decided,
        **(SAID if rng.random() < 0.5 else {}),
        **{decided: dict(zip(names, sizes, strict=True))},
    )
    feet = [str(k + 1) for k in range(rng.integers(2, 7))]
    orders = [">".join(rng.permutation(feet)) for _ in range(rng.integers(1, 6))]
    true = pd.DataFrame({"true_effect": [float(rng.lognormal(-1.5, 1.0))]})
    return content, touchdowns(*orders), true if rng.random() < 0.5 else None


@pytest.mark.parametrize("seed", range(4 if "ALL" in os.environ else 2))
def test_no_text_covers_another_whatever_the_numbers(seed):
    rng = np.random.default_rng(seed)
    for _ in range(25 if "ALL" in os.environ else 12):
        content, landings, true = random_verdict(rng)
        assert text_faults(verdict_figure(content, landings, true)) == [], (
            content,
            true,
        )


def test_texts_that_cover_each_other_would_be_seen():
    """The control of the test above: a label moved into another's row is found."""
    figure = verdict_figure(verdict("cannot tell"), touchdowns())
    labels = [text for text in figure.axes[0].texts if text.get_text()]
    labels[0].xy = labels[1].xy
    labels[0].set_horizontalalignment(labels[1].get_horizontalalignment())
    assert text_faults(figure)
