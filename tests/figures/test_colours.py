"""A colour means one thing in all figures of a study: a foot, or the landing itself."""

import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from hopdata.figures import style
from hopdata.figures.contacts import landings_figure, spread_figure
from hopdata.figures.maps import CASES
from hopdata.figures.one_or_own import one_or_own_figure
from hopdata.figures.orders import orders_figure
from hopdata.figures.quality import recording_gaps_figure, stability_figure
from hopdata.figures.style import FOOT_COLOURS, MEANINGS, foot_colour, paper_figure
from hopdata.figures.verdict import size_figure, verdict_figure


def beside(name):
    """Return a module of this folder; others have modules of the same names."""
    path = Path(__file__).with_name(f"{name}.py")
    spec = spec_from_file_location(f"beside_{name}", path)
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


test_contacts = beside("test_contacts")
test_one_or_own = beside("test_one_or_own")
test_orders = beside("test_orders")
test_overlay = beside("test_overlay")
test_quality = beside("test_quality")
test_style = beside("test_style")
test_verdict = beside("test_verdict")

GAPS = (test_quality.bars(10.0), test_quality.GAPS, test_quality.FAULTS)
DRAWN = {
    "verdict": lambda: verdict_figure(test_verdict.verdict(), NAMED),
    "size": lambda: size_figure(test_verdict.verdict("different")),
    "orders": lambda: orders_figure(test_orders.verdict(test_orders.by_last(0.3))),
    "one_or_own": lambda: one_or_own_figure(test_one_or_own.foretold()),
    "overlay": lambda: test_overlay.draw(n_columns=3),
    "gaps": lambda: recording_gaps_figure(*GAPS),
    "stability": lambda: stability_figure(
        test_quality.stability(), test_quality.drift()
    ),
    "landings": lambda: landings_figure(*test_contacts.made_up(2), FEET),
    "spread": lambda: spread_figure(*test_contacts.made_up(2)[1:], FEET),
    **{
        name: lambda name=name: test_style.draw(name)
        for name in ("sections", "schedule", "prediction", "distances")
    },
}
# Figures that have colours, and what these mean; the others have none.
COLOURED = {
    "verdict": {"a foot"},
    "overlay": {"a foot"},
    "landings": {"a foot"},
    "spread": {"a foot"},
    "schedule": {"a foot", "between the two sections"},
    "sections": {"between the two sections"},
}
FEET = test_contacts.FEET
NAMED = test_verdict.named(test_verdict.touchdowns(), "heel", "toe", "thumb")


def hues(figure):
    """Return the colours of a figure that are no shades of grey, as in its SVG."""
    content = StringIO()
    figure.savefig(content, format="svg")
    found = set(re.findall(r"(?:fill|stroke): (#[0-9a-f]{6})", content.getvalue()))
    return {one for one in found if np.ptp(to_rgb(one)) > 0.02}


def meant(name):
    colours = [MEANINGS[meaning] for meaning in COLOURED.get(name, ())]
    return {colour.lower() for some in colours for colour in some}


@pytest.mark.parametrize("name", DRAWN)
def test_a_figure_has_only_the_colours_of_what_it_shows(name):
    found = hues(DRAWN[name]())
    assert found <= meant(name)
    assert bool(found) == (name in COLOURED)


def test_another_colour_would_be_seen():
    figure = paper_figure(80.0, 40.0)
    axes = figure.subplots()
    axes.plot([0, 1], color="0.5")
    assert hues(figure) == set()
    axes.plot([1, 0], color=foot_colour(5))
    assert hues(figure) == {foot_colour(5).lower()}


def test_no_colour_has_two_meanings():
    every = [colour for colours in MEANINGS.values() for colour in colours]
    assert len(every) == len(set(every))
    assert not {colour for _, _, colour, _ in CASES.values()} & {*FOOT_COLOURS}


def test_the_same_foot_has_the_same_colour_in_each_figure():
    """The second foot of a study, in the verdict and in its touchdown."""
    second = foot_colour(1)
    names = {}
    schedule = test_style.draw("schedule")
    for line in schedule.axes[0].lines:
        names[line.get_label()] = line.get_color()
    assert names["foot2"] == second
    axes = DRAWN["verdict"]().axes[1]
    (first,) = [
        line
        for line in axes.lines
        if tuple(line.get_xdata()) == (0.8,) and line.get_ydata()[0] == 0
    ]
    assert first.get_color() == second, "toe is the second foot and touches first"


@pytest.mark.parametrize("package", ["", "steering", "dissertation"])
def test_a_foot_colour_is_taken_by_the_number_of_a_foot_only(package):
    """By its name it would mean something else in some figure."""
    folder = Path(style.__file__).parents[1] / package / "figures"
    names = "BLUE|GREEN|PURPLE|SKY|ORANGE|VERMILION"
    sources = [file for file in folder.glob("*.py") if file.name != "style.py"]
    assert len(sources) > 2
    for file in sources:
        assert re.findall(rf"style\.({names})\b", file.read_text("utf-8")) == []
