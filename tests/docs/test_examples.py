"""The examples in the documentation run, and their numbers are right."""

from __future__ import annotations

import doctest
import re
import runpy
from importlib import import_module
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"


SOURCE = DOCS.parent / "src"
SHOWN = [
    path
    for path in SOURCE.rglob("*.py")
    if "\n    >>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("path", SHOWN, ids=lambda path: path.stem)
def test_the_examples_in_docstrings_are_right(path, monkeypatch):
    monkeypatch.chdir(DOCS.parent)
    name = ".".join(path.relative_to(SOURCE).with_suffix("").parts)
    result = doctest.testmod(import_module(name))
    assert result.attempted
    assert not result.failed


def test_two_legs(capsys):
    names = runpy.run_path(str(DOCS / "examples/two_legs.py"))
    printed = capsys.readouterr().out.splitlines()
    log = names["solution"].events
    assert printed[0] == "0.200915337 s  left foot lands"
    assert printed[-1].startswith("Event 'left' ended the integration at t = 0.7355")
    assert len(printed) == len(log) + 1
    # Until the first foot lands, the body falls freely without changing its tilt.
    assert log.time[0] == pytest.approx(
        np.sqrt(2 * (0.7 - 0.002 - 0.5) / 9.81), abs=1e-14
    )
    assert energy(names["solution"].y_end) == pytest.approx(9.81 * 0.7, abs=1e-7)


def energy(y, stiffness=400.0, inertia=0.1):
    """Return the energy of the two-legged body, which dissipates nothing."""
    pressed = [max(0.0, 0.5 - y[0] - side * y[1]) for side in (-0.2, 0.2)]
    springs = 0.5 * stiffness * np.square(pressed).sum()
    return 9.81 * y[0] + 0.5 * y[2] ** 2 + 0.5 * inertia * y[3] ** 2 + springs


def code_blocks(page):
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)


def test_the_code_in_the_page_on_the_verdict_runs():
    three_feet, four_feet = code_blocks("verdict.md")
    scope = {"__name__": "__main__"}
    exec(compile(three_feet, "docs/verdict.md", "exec"), scope)
    same, other = scope["same"], scope["other"]
    assert "larger than 5.7 % of the map" in same.sentence
    assert (
        "by 26 % of the map over these landings (rms over all pairs; 95 % interval 13 % to 34 %)"
        in other.sentence
    )
    assert other.effect.low < scope["truth"](1.0) < other.effect.high
    assert scope["truth"](1.0) == pytest.approx(0.269, abs=5e-4)
    assert other.effect.estimate == pytest.approx(repeated_size(scope), rel=0.02)
    exec(compile(four_feet, "docs/verdict.md", "exec"), scope)
    weights = scope["contrasts"](scope["orders"], scope["counts"])
    of_package = scope["relative_size"](scope["maps"], weights)
    by_definition = np.sqrt(np.mean(scope["squares"]))
    assert by_definition == pytest.approx(of_package, rel=1e-12)


def repeated_size(scope):
    """Return the size of the example, by what the page says of inputs and outcomes."""
    onto, smooth, bend = scope["onto"], scope["smooth"], scope["bend"]
    late = [onto[:, last] - onto.mean(axis=1) for last in (0, 0, 1, 1, 2, 2)]
    maps = np.array([smooth.T + np.outer(bend, slope) for slope in late])
    x = scope["x"] - scope["x"].mean(axis=0)
    arms = scope["markers"] - scope["markers"].mean(axis=0)

    def mean_squares(jacobian):
        outcomes = x @ jacobian.T
        steps = np.pad(outcomes[:, :2], ((0, 0), (0, 1)))
        moved = steps[:, None] + np.cross(outcomes[:, None, 2:5], arms)
        speeds = outcomes[:, None, 5:8] + np.cross(outcomes[:, None, 8:], arms)
        return np.array([np.sum(one**2, axis=2).mean() for one in (moved, speeds)])

    pairs = [mean_squares(a - b) for a, b in combinations(maps, 2)]
    ratios = np.mean(pairs, axis=0) / mean_squares(maps.mean(axis=0))
    return np.sqrt(ratios.mean())


def test_the_page_shows_the_example_as_it_is():
    assert (DOCS / "examples/two_legs.py").read_text() in code_blocks(
        "integrator_reference.md"
    )
