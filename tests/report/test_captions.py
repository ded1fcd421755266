"""Captions are made from what was done: no step, number or result that this study does not have."""

import re

import pandas as pd
import pytest
from fake_study import CAPTIONS, full_study, printed_study, touchdowns, truth, verdict
from test_page import Page

from hopdata.landings.contacts.timing import METHODS
from hopdata.maps.one_or_own import COLUMNS
from hopdata.report.language import sentence
from hopdata.report.page import CONTROLS, PLACES, build_report

# Numbers that a caption may state, since they say how a figure is drawn or a quantity
# defined. Every other number comes from the study's own tables.
OWN_NUMBERS = {
    "fig2_3_schedule": {"0.07"},  # s, the filter of the drawn velocities
    "fig2_4_prediction": {"2.5", "97.5"},  # %, whiskers
    "fig2_5_distances": {"5", "95"},
    "contact_overlay": {"95"},
}
NAMED = re.compile(
    r"Fig(?:ure|\.)\s*\d+\.\d+|\bC[12]\b|\{\{.*?\}\}|\{%.*?%\}", re.DOTALL
)


def numbers_in(text):
    """Return the numbers that the template of a caption itself states."""
    return set(re.findall(r"\d+(?:\.\d+)?", NAMED.sub("", text)))


# The caption of the sections has a test of its own.
@pytest.mark.parametrize("name", sorted({*PLACES} - {"fig2_2_sections"}))
def test_no_caption_quotes_a_number_of_another_study(name):
    text = (CAPTIONS / f"{name}.md").read_text(encoding="utf-8")
    assert numbers_in(text) <= OWN_NUMBERS.get(name, set())
    assert "make both-sides" not in text


def page(**changes):
    return Page(build_report(full_study(**changes))).text


def printed_page(**changes):
    return Page(build_report(printed_study(**changes))).text


@pytest.mark.parametrize("method", METHODS)
def test_only_contacts_by_kinks_are_said_to_be_kinks(method):
    text = page(touchdowns=touchdowns().assign(method=method))
    kinks = ("has its kink", "halfway up the jump", "whose instant is not determined")
    printed = ("foot's smoothed velocity", "The true scatter is larger")
    for words in kinks:
        assert (words in text) == (method == "kink"), words
    for words in printed:
        assert (words in text) == (method != "kink"), words
    assert ("from the rounding to a frame alone" in text) == (
        method == "velocity_minimum"
    )
    parabola = method == "velocity_minimum_parabola"
    assert ("from the noise of the heights alone" in text) == parabola
    assert ("at the vertex of a parabola" in text) == parabola


def test_without_a_known_method_none_is_named():
    text = page(touchdowns=touchdowns().drop(columns="method"))
    assert "A plus marks each contact." in text
    assert (
        "kink."
        not in text.partition("Figure 2.3")[2].partition("Estimates and truth")[0]
    )


SAYS = {
    "different": (
        "interval with the estimate in it",
        "those of the orders are not all the same",
    ),
    "no difference": ("cannot exclude", "those of the orders were not found to differ"),
    "cannot tell": ("cannot exclude", "from all orders, or more than one"),
}


def test_no_order_of_many_feet_is_said_to_have_a_map_of_its_own():
    text = page(verdict=verdict(conclusion="different", n_feet=5))
    assert "those of landings with either foot of a pair first" in text
    assert (
        "map of its own" not in text.partition("Figure 1")[2].partition("Figure 2")[0]
    )


@pytest.mark.parametrize("conclusion", SAYS)
def test_the_caption_of_the_verdict_says_how_this_one_came_out(conclusion):
    text = page(verdict=verdict(conclusion=conclusion))
    bar, maps = SAYS[conclusion]
    for words in (bar, maps):
        assert words in text
    for words in {one for both in SAYS.values() for one in both} - {bar, maps}:
        assert f"{words}." not in text, words
    assert ("The dashed line is the margin" in text) == (conclusion != "different")
    assert "Jacobians" in text
    assert sentence("meaning_of_effect") in text


def test_a_jump_of_the_outcome_is_not_said_to_be_one_of_the_derivative():
    jump = {**verdict()["effect"], "detectable": 1.3}
    text = page(verdict=verdict(conclusion="different", decided_by="jump", jump=jump))
    assert "By how much the outcome jumps" in text
    assert sentence("meaning_of_jump") in text
    for words in ("Jacobians", sentence("meaning_of_effect"), "The thin arrow begins"):
        assert words not in text, words
    assert "The thin arrow begins at" in page()


def test_a_jump_is_drawn_with_the_smooth_maps_that_look_like_it():
    """In the captions of both figures, in the methods paragraph and beside the answer."""
    jump = {**verdict()["effect"], "low": 0.05}
    row = {"of": "jump", "first": "1", "second": "2", "p_value": 0.001, **jump}
    found = {"conclusion": "different", "decided_by": "jump", "contact_spread": 0.0112}
    of_jump = verdict(**found, jump=jump, orders=[row])
    look_alike = "steps within a fifth of the contact spread (here 2.2 ms)"
    assert page(verdict=of_jump).replace("\u00a0", " ").count(look_alike) == 4
    none = {**of_jump, "decided_by": "effect", "jump": {**jump, "low": 0.0}}
    # The methods paragraph tells it of any jump that could be named.
    assert page(verdict=none).replace("\u00a0", " ").count(look_alike) == 1


def test_the_scaling_study_is_of_the_scene_that_was_simulated():
    slopes = {"quadruped": 1.98, "coupling": 1.03}
    assert set(slopes) & set(CONTROLS) == {"coupling"}
    entries = {
        f"scaling_slope_{case}": {"value": slope, "unit": "1", "what": case}
        for case, slope in slopes.items()
    }
    text = page(truth=entries)
    assert "for the quadruped and for 1 kind of control" in text
    assert (
        "hopper"
        not in text.partition("Scaling study:")[2].partition("Estimates and truth")[0]
    )
    assert "scaling_slope_hopper" in truth() or "for the" in page()


MEASURES = (
    "feet", "n_external", "n_matched", "n_excluded", "n_missed", "n_invented",
    "n_other_foot", "n_not_compared", "bias_s", "bias_low_s", "bias_high_s", "drift_s",
    "robust_sd_s", "largest_s", "external_se_s", "scatter_over_se",
)  # fmt: skip


def test_forces_are_spoken_of_where_there_are_some():
    thresholds = pd.DataFrame(
        {"threshold": [20.0], "unit": "N", "recording": "a", "column": "f"}
    )
    thresholds = thresholds.assign(
        n_missed=0, n_invented=0, bias_s=0.001, robust_sd_s=0.001
    )
    for source, words_of_forces in (
        ("forces", True),
        ("plates", True),
        ("events", False),
    ):
        summary = pd.DataFrame({"source": [source], "recording": "a", "column": "f"})
        summary = summary.reindex(columns=[*summary, *MEASURES])
        overlay = {
            "contact_overlay_summary": summary,
            "contact_overlay_thresholds": thresholds,
        }
        text = page(overlay=overlay)
        for words in ("and (d) the force under them", "A force begins when"):
            assert (words in text) == words_of_forces
            assert words not in page()


def test_distances_that_were_not_asked_for_are_said_to_be_so():
    names = ("fig2_5_distances",)
    figures = [one for one in full_study().figures if one.name not in names]
    text = printed_page(distances=None, distances_asked=False, figures=figures)
    told = "does not ask for constraint subspaces and their distances (distances.enabled: false)"
    assert told in text
    assert "was not made" not in text
    assert told not in printed_page()
    assert "The figure of the distances was not made." in printed_page(
        distances=None, figures=figures
    )


def test_what_own_maps_gain_is_drawn_where_landings_were_foretold():
    drawn = "Landings foretold by one map and by their orders' own"
    assert drawn in page()
    for nothing in (None, pd.DataFrame(columns=list(COLUMNS))):
        assert drawn not in page(one_or_own=nothing)
