"""The examples in the documentation run, and their numbers are right."""

from __future__ import annotations

import doctest
import re
import runpy
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"


SOURCE = DOCS.parent / "src"
SHOWN = [path for path in SOURCE.rglob("*.py") if "\n    >>> " in path.read_text(encoding="utf-8")]


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
    # until the first foot lands the body falls freely, its tilt at rest
    assert log.time[0] == pytest.approx(np.sqrt(2 * (0.7 - 0.002 - 0.5) / 9.81), abs=1e-14)
    assert energy(names["solution"].y_end) == pytest.approx(9.81 * 0.7, abs=1e-7)


def energy(y, stiffness=400.0, inertia=0.1):
    """Energy of the two-legged body: nothing dissipates."""
    pressed = [max(0.0, 0.5 - y[0] - side * y[1]) for side in (-0.2, 0.2)]
    springs = 0.5 * stiffness * np.square(pressed).sum()
    return 9.81 * y[0] + 0.5 * y[2] ** 2 + 0.5 * inertia * y[3] ** 2 + springs


def code_blocks(page):
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)


def test_the_code_in_the_integrators_page_runs():
    scope = {"__name__": "__main__"}
    blocks = code_blocks("integrator.md")
    assert len(blocks) >= 2
    for block in blocks:
        exec(compile(block, "docs/integrator.md", "exec"), scope)
    assert scope["batch"].jacobian.shape == (5, 4, 4)
    five_systems_are_right(scope)


def five_systems_are_right(scope):
    """Compare the examples with closed forms and, the neuron, with itself."""
    first = np.sqrt(2 / 9.81)
    assert scope["landed"][:2] == pytest.approx([first, first * 2.6], abs=1e-12)
    speed = 9.81 * first
    before = scope["bounces"](scope["landed"], side="left")
    assert before[1, :2] == pytest.approx([-speed, -0.8 * speed], abs=1e-11)
    assert scope["period"] == pytest.approx(np.full(6, 20 * np.log(1.5)), abs=1e-7)
    intervals = np.diff(scope["train"].events.time)
    assert intervals[5:] == pytest.approx(np.full(len(intervals) - 5, intervals[-1]), rel=1e-6)
    assert scope["counted"].n_events == pytest.approx(50_000 / intervals[-1], abs=2)
    assert np.diff(scope["opened"])[-5:] == pytest.approx(np.full(5, 400e-6), rel=1e-6)
    falling = 4 * np.sin(0.3) * np.sin(0.06) / (1 - np.cos(0.6) ** 2)
    assert scope["rates"][-1] == pytest.approx(np.cos(0.6) * np.sqrt(falling), abs=1e-6)


def test_the_code_in_the_page_on_steering_runs(capsys):
    (block,) = code_blocks("steering.md")
    scope = {"__name__": "__main__"}
    exec(compile(block, "docs/steering.md", "exec"), scope)
    assert re.findall(r"swing by [+-]\d\.\d\d rad, to land at", capsys.readouterr().out)[1:]
    assert scope["model"].inputs.shape == (100, 2)
    plan, landed = scope["plan"], scope["landed"]
    np.testing.assert_allclose(plan.poses[0], landed, rtol=1e-12)
    # it faces away from the origin, and so begins to turn
    headings = [landed[2], plan.poses[1, 2], plan.poses[2, 2]]
    assert np.all(np.diff(np.abs(headings)) > 0.05)


def test_the_code_in_the_page_on_the_verdict_runs():
    (block,) = code_blocks("verdict.md")
    scope = {"__name__": "__main__"}
    exec(compile(block, "docs/verdict.md", "exec"), scope)
    same, other = scope["same"], scope["other"]
    assert "larger than 5.9 % of the map" in same.sentence
    assert "by 26 % of the map (95 % interval 16 % to 34 %)" in other.sentence
    assert other.effect.low < scope["truth"](1.0) < other.effect.high
    assert scope["truth"](1.0) == pytest.approx(0.269, abs=5e-4)


def test_the_page_shows_the_example_as_it_is():
    assert (DOCS / "examples/two_legs.py").read_text() in code_blocks("integrator.md")
