"""Every subset of each list of choices in the block ``steering`` runs, down to the page."""

import os
from dataclasses import replace
from functools import cache
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from fake_steering import CAPTIONS, FIGURES, full_steering
from overlaps import text_faults
from seen_hopper import Swings, sight
from test_page import Page

from choices import lists_of_choices, subsets
from hopdata.config.loading import load_config
from hopdata.config.schema import load_schema
from hopdata.jobs import as_stored, stacked
from hopdata.report.inputs import (
    ReportFigure,
)
from hopdata.steering.experiments import study, tasks
from hopdata.steering.experiments.outcomes import outcome_table
from hopdata.steering.figures.runs import (
    save_film,
    steering_outcomes_figure,
    steering_run_figure,
)
from hopdata.steering.report.page import (
    RUN_BY,
    WORDS,
    SteeringInputs,
    build_steering_report,
)
from hopdata.steering.trial import TrueFrameChanges

LISTS = dict(lists_of_choices(load_schema()["properties"]["steering"]))


CONFIG = load_config("config/config.yaml", check_files=False)
# The smallest study: two hops from one start.
STEERING = {
    **CONFIG["steering"],
    "experiments": {**CONFIG["steering"]["experiments"], "starts": 1, "hops": 2},
}
SEED = np.random.SeedSequence(5)
TRUTH = TrueFrameChanges(*[np.arange(2.0)] * 3, np.zeros((2, 2, 2, 3)))
NO_HORIZONS = study.horizons_of(
    {**STEERING, "experiments": {"starts": 1, "horizons": []}}, {}
)
INPUTS = vars(full_steering())
# Those that steer swing as told, since a planner takes seconds to prepare; the others
# are real.
POLICIES = {
    **dict.fromkeys((*tasks.LEARNED, tasks.CEILING), lambda _start: Swings(0.4, -0.3)),
    tasks.RANDOM: lambda start: tasks.Unheeding(1.0, start.streams()[3]),
    tasks.NONE: lambda start: tasks.Unheeding(0.0, start.streams()[3]),
}


@pytest.fixture
def quick(monkeypatch):
    """Let the experiments run with `POLICIES`, each from each start once for all tests."""
    monkeypatch.setattr(
        tasks,
        "policies",
        lambda names, *_, **__: {name: POLICIES[name] for name in names},
    )
    monkeypatch.setattr(
        study.Setting, "run", lambda _, policy, start: _run(policy, start)
    )


REAL_RUN = study.Setting.run
GEOMETRY = sight().geometry


@cache
def _setting():
    robot, _ = study.robot_and_camera(STEERING["robot"], CONFIG["motion_capture"])
    return study.Setting("origin", STEERING["experiments"], robot, sight())


RUNS = {}


def _run(policy, start):
    name = next(name for name, known in POLICIES.items() if known is policy)
    if name in tasks.LEARNED:
        name = tasks.CEILING  # they all swing alike
    if name not in RUNS:
        RUNS[name] = REAL_RUN(_setting(), policy, start)
    return RUNS[name]


def steered(controllers, observations=("corrected",)):
    """Return the tables of a steering study as the workflow makes and reads them."""
    made = []
    for number, observation in enumerate(observations):
        tables = study.experiments_of(
            ["origin"],
            tasks.taking_part(controllers, later_observation=number > 0),
            STEERING,
            CONFIG["motion_capture"],
            model=None,
            truth=TRUTH,
            geometry=GEOMETRY,
            seed=SEED,
        )
        for table in tables.values():
            table.insert(0, "seed", 1)
            if number and "controller" in table:
                table["controller"] += f", {observation} observation"
        made.append({name: as_stored(table) for name, table in tables.items()})
    whole = {
        name: stacked([tables[name] for tables in made]) for name in ("runs", "stances")
    }
    return whole | {name: made[0][name] for name in ("example", "film")}


def captions():
    return [
        ReportFigure(
            name, b"", "", (CAPTIONS / f"{name}.md").read_text(encoding="utf-8")
        )
        for name in FIGURES
    ]


def page_of(tables):
    """Return figures and page of a steering study with these tables."""
    outcomes = as_stored(outcome_table(tables["runs"]))
    figures = [
        steering_run_figure(tables["example"], experiment="origin"),
        steering_outcomes_figure(outcomes, tables["runs"], NO_HORIZONS),
    ]
    inputs = {**INPUTS, "figures": captions(), "examples": tables["example"]}
    inputs |= {"outcomes": outcomes, "horizons": NO_HORIZONS}
    return figures, Page(build_steering_report(SteeringInputs(**inputs)))


def run_controllers(controllers, _folder):
    tables = steered(controllers)
    figures, page = page_of(tables)
    shown, beside = tasks.shown_of(controllers), tasks.beside_of(controllers)
    is_both = tasks.PRINTED in controllers and shown in (tasks.PLANNER, tasks.ADAPTIVE)
    assert beside == (tasks.PRINTED if is_both else None)
    assert [len(figure.axes) for figure in figures] == [8 if is_both else 4, 2]
    examples = tables["example"]
    drawn = list(dict.fromkeys(examples["controller"]))
    assert drawn == [shown, beside] if is_both else [shown]
    assert examples.groupby("controller")["run"].nunique().eq(1).all()
    assert examples["run"].nunique() == 1, "from the same start"
    assert page.text.count(f"run {RUN_BY[shown]}") == 2  # as a figure and as a film
    assert page.text.count("Above it is the run with the printed") == int(is_both)
    assert set(tables["runs"]["controller"]) == {*controllers, tasks.CEILING}
    assert ("Required of the planner" in page.text) == (tasks.PLANNER in controllers)
    assert ("the planner must reach" in page.text) == (tasks.PLANNER in controllers)


def run_observations(observations, _folder):
    for order in permutations(observations):
        for controllers in ([tasks.PRINTED, tasks.NONE], [tasks.RANDOM]):
            tables = steered(controllers, order)
            _, page = page_of(tables)
            learned = [name for name in controllers if name in tasks.LEARNED]
            later = {
                f"{name}, {other} observation"
                for name in learned
                for other in order[1:]
            }
            assert set(tables["runs"]["controller"]) == {
                *controllers,
                tasks.CEILING,
                *later,
            }
            assert page.open == []


# What runs each list; a list of the schema that is missing here fails the test below.
EACH = {
    "experiments.controllers": run_controllers,
    "observations": run_observations,
}


def test_every_list_of_choices_is_covered():
    assert set(LISTS) == set(EACH)


def some_subsets(choices):
    """Return every third subset and the whole list, or with `ALL=1` every subset."""
    every = list(subsets(choices))
    return every if "ALL" in os.environ else sorted({*every[::3], every[-1]})


@pytest.mark.parametrize(
    ("path", "some"),
    [(path, some) for path, choices in LISTS.items() for some in some_subsets(choices)],
    ids=lambda value: "+".join(value) if isinstance(value, tuple) else value,
)
def test_every_subset_runs(path, some, quick, tmp_path):
    EACH[path](some, tmp_path)


@pytest.mark.parametrize("controller", tasks.SHOWN_FIRST)
def test_each_controller_can_be_the_example(controller, quick, tmp_path):
    tables = steered([controller])
    figure = steering_run_figure(tables["example"], experiment="origin")
    assert text_faults(figure) == []
    told = {text.get_text() for text in figure.legends[0].get_texts()}
    foretells = controller in tasks.LEARNED
    assert (
        ("pure simulation" in told)
        == ("simulated control response" in told)
        == foretells
    )
    save_film(tmp_path / "film.gif", tables["film"], tables["example"])
    assert (tmp_path / "film.gif").stat().st_size > 5_000


@pytest.mark.parametrize(
    "controllers", [["printed"], ["planner"], ["planner", "printed"]], ids="+".join
)
def test_every_experiment_of_the_printed_controller_alone_is_drawn(controllers, quick):
    """Each alone, and the two together: origin and turn, free and with a board."""
    alone = len(controllers) == 1
    given = {**STEERING["experiments"], "waypoints_m": [[0.5, 0.0], [0.0, 0.5]]}
    tables = study.experiments_of(
        list(tasks.EXPERIMENTS),
        tasks.taking_part(controllers, later_observation=False),
        {**STEERING, "experiments": given},
        CONFIG["motion_capture"],
        model=None,
        truth=TRUTH,
        geometry=GEOMETRY,
        seed=SEED,
    )
    examples = as_stored(tables["example"])
    assert set(examples["controller"]) == set(controllers)
    points = examples[examples["curve"] == "point"]
    assert set(points["experiment"]) == {"waypoints"}
    assert len(points) == 2 * len(controllers)
    for experiment in tasks.EXPERIMENTS:
        figure = steering_run_figure(examples, experiment=experiment)
        assert len(figure.axes) == (4 if alone else 8)
        titles = [axes.get_title(loc="left") for axes in figure.axes]
        assert any(title.startswith("printed") for title in titles) == (not alone)


def test_a_study_in_which_nothing_is_seen_says_so(quick, tmp_path, monkeypatch):
    unseen = REAL_RUN(_setting(), POLICIES[tasks.NONE], _start())
    blank = unseen.stances.assign(**dict.fromkeys(study.MEASURED, np.nan))
    made = replace(unseen, stances=blank)
    monkeypatch.setattr(study.Setting, "run", lambda *_: made)
    tables = steered([tasks.NONE])
    assert tables["example"].empty
    figures, page = page_of(tables)
    assert figures[0].axes == []
    assert "No stance was seen in any run" in page.text
    save_film(tmp_path / "film.gif", tables["film"], tables["example"])
    assert Path(tmp_path / "film.gif").read_bytes().startswith(b"GIF")


def _start():
    return tasks.draw_starts("origin", 1, distance_m=1.0, seed=SEED)[0]


def test_words_for_the_example_come_in_the_order_in_which_it_is_chosen():
    assert tuple(RUN_BY) == tasks.SHOWN_FIRST
    assert set(WORDS["controllers"]) == {*tasks.CONTROLLERS, tasks.CEILING}
    assert tasks.shown_of([tasks.CEILING]) is None
