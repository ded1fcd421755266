from dataclasses import replace

import pandas as pd
import pytest
from fake_steering import FIGURES, counts, examples, full_steering, horizons, outcomes
from test_page import Page

from hopdata.errors import ConfigError
from hopdata.report.inputs import ReportFigure
from hopdata.steering.report.page import (
    SteeringInputs,
    build_steering_report,
    left_out_table,
    outcomes_table,
    steering_facts,
)

MODELS = ("steering_map", "fig3_3_printed", "steering_learning", "steering_kernels")
RUNS = [name for name in FIGURES if name not in (*MODELS, "steering_outcomes")]


@pytest.fixture(scope="module")
def page():
    return Page(build_steering_report(full_steering()))


@pytest.mark.parametrize("inputs", [full_steering(), SteeringInputs("bare")])
def test_the_page_is_well_formed_and_loads_nothing(inputs):
    made = Page(build_steering_report(inputs))
    assert made.unbalanced == []
    assert made.open == []
    assert len(made.ids) == len(set(made.ids))
    assert all(link.startswith(("#", "data:")) for link in made.links)
    assert {f"#{name}" for name in made.ids} >= {
        x for x in made.links if x.startswith("#")
    }


def test_every_figure_is_there_with_its_caption_and_the_film_moves(page):
    assert len(page.images) == len(FIGURES)
    assert all(image["alt"] for image in page.images)
    assert sum(image["src"].startswith("data:image/gif") for image in page.images) == 1
    for title in ("Figure 3.3", "Figure 3.5", "Figure 3.6", "Figure 3.8", "Figure 3.9"):
        assert title in page.text
    assert "29.5 of 30 succeeded" in page.text


def test_the_worst_seed_its_hops_and_the_horizon_are_shown(page):
    for words in (
        "28 of 30",
        "29.5 of 30",
        "1.05",
        "1.12",
        "worst of 10 seeds",
        "simulated",
    ):
        assert words in page.text
    assert "9 of 10" in page.text
    assert "27.5" in page.text


def test_what_was_left_out_is_counted_with_its_reason(page):
    for reason in ("held or carried in between", "boom angle missing", "unseen"):
        assert reason in page.text
    table = left_out_table(counts())
    assert ("excitation", "hops", "boom angle missing", "3") in table.rows
    assert not any(row[-1] == "0" for row in table.rows)


def test_provenance_is_on_the_page(page):
    for word in ("numpy", "steering_model", "a.h5", "Configuration"):
        assert word in page.text


def test_what_is_missing_is_said_in_words():
    made = Page(build_steering_report(SteeringInputs("bare")))
    assert "No experiment was made." in made.text
    assert "No model was learned." in made.text
    assert "no truth to compare with" in made.text


def test_a_caption_that_names_no_fact_is_a_mistake():
    broken = ReportFigure("steering_map", b"", "", "# Title\n\n{{ nothing }}")
    with pytest.raises(ConfigError, match="steering_map"):
        build_steering_report(SteeringInputs("bare", figures=[broken]))


def test_captions_of_runs_name_the_controller_that_is_drawn(page):
    assert page.text.count("un with the planner") == len(RUNS)


def test_captions_tell_of_the_run_beside_and_how_it_ended(page):
    printed = examples("printed", success=False)
    printed = printed[printed["experiment"] != "turn"]
    both = replace(full_steering(), examples=pd.concat([examples(), printed]))
    other = Page(build_steering_report(both)).text
    beside = "Above it is the run with the printed controller from the same start"
    assert other.count(beside) == len(RUNS) - 2  # not of the turn, nor in the film
    assert beside not in page.text
    assert other.count(f"{beside}, which did not") == other.count(beside)
    assert other.count("un with the planner") == len(RUNS)


def test_captions_say_what_was_done_and_no_more(page):
    """The same page with another controller, no success, one seed, and no other horizons."""
    alone = replace(
        full_steering(),
        outcomes=outcomes().query("controller == 'printed'").assign(seeds=1, runs=30),
        horizons=horizons()[:0],
        examples=examples("none", success=False),
    )
    other = Page(build_steering_report(alone))
    planner_only = (
        "with the planner",
        "the planner must reach",
        "Required of the planner",
    )
    with_success = ("among those that succeeded", "so the path is an arc")
    of_predictions = ("pure simulation", "what the model predicted")
    of_many = (
        "in each of 10 seeds",
        "Each seed has its own excitation and its own model",
    )
    for words in (
        *planner_only,
        *with_success,
        *of_predictions,
        *of_many,
        "different horizons",
    ):
        assert words.lower() in page.text.lower(), words
        assert words.lower() not in other.text.lower(), words
    for words in ("with the boom at rest", "since in its seed none succeeded"):
        assert words in other.text, words
        assert words not in page.text, words


def test_captions_need_no_outcomes():
    bare = replace(full_steering(), outcomes=None, scores=None)
    assert steering_facts(bare)["share"] == {}
    assert Page(build_steering_report(bare)).open == []


def test_a_controller_without_a_success_has_no_hops():
    row = outcomes_table(outcomes()).rows[1]
    assert row[2:7] == ("0 of 30", "2 of 30", "—", "—", "—")


def test_a_recorded_robot_has_no_experiments_and_the_page_says_so():
    recorded = replace(full_steering(), outcomes=None, horizons=None, truth=None)
    told, asked = "there is no simulation of it to steer", "reaches its goals with it"
    of_recorded, simulated = (
        Page(build_steering_report(inputs)).text
        for inputs in (recorded, full_steering())
    )
    assert told in of_recorded
    assert told not in simulated
    assert asked not in of_recorded
    assert asked in simulated


def test_a_model_that_will_probably_not_reach_a_point_is_named():
    expected = {
        "expected_arrivals": 0.52,
        "error_over_width": 0.79,
        "step_over_width": 1.2,
        "covered": 0.6,
        "unresolved": "",
    }
    good = full_steering()
    assert good.scores is not None
    bad = replace(good, scores=good.scores.assign(**expected))
    named = (
        "Seed 1, observed as corrected: This model will probably not reach the point"
    )
    page = Page(build_steering_report(bad)).text
    assert named in page
    assert "arrives from 52 % of its starts" in page
    assert "by 79 % of the goal's radius" in page
    sound = good.scores.assign(**{**expected, "expected_arrivals": 0.98})
    for other in (good, replace(good, scores=sound)):
        assert named not in Page(build_steering_report(other)).text


def test_one_seed_is_not_called_the_worst_of_several():
    inputs = replace(full_steering(), outcomes=outcomes().assign(seeds=1, runs=30))
    text = Page(build_steering_report(inputs)).text
    assert "one seed" in text
    assert "worst of" not in text.replace("worst of at least ten seeds", "")
