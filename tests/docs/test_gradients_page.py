"""The page on gradients, and its example."""

from __future__ import annotations

import os
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLE = DOCS / "examples/faster_hops.py"


@pytest.fixture(scope="module")
def names():
    """Run the example, unless the site does, whose page checks the same."""
    if "ALL" not in os.environ:
        pytest.skip("it runs for 13 s, and when the site is built: ALL=1")
    return runpy.run_path(str(EXAMPLE))


def test_the_hopper_learns(names):
    speed, height = names["after"].solution.y_end[[2, 1]]
    assert speed == pytest.approx(names["SPEED"], abs=0.02)
    assert height == pytest.approx(names["HEIGHT"], abs=0.01)
    assert names["before"].value > 1.0
    log = names["after"].solution.events
    assert len(log.of("leg", direction=1)) == 6
    assert len(np.unique(log.time)) == len(log)  # no foot is set down in the floor


def test_the_slope_of_the_guess_is_that_of_central_differences(names):
    trial, guess = names["trial"], names["guess"]
    direction = np.linspace(1.0, -1.0, len(guess))
    ahead = trial(guess + 1e-5 * direction).value
    behind = trial(guess - 1e-5 * direction).value
    slope = (ahead - behind) / 2e-5
    assert names["before"].by_params @ direction == pytest.approx(slope, rel=1e-4)


def test_the_page_shows_the_example_as_it_is():
    page = (DOCS / "gradients.md").read_text()
    assert EXAMPLE.read_text() in re.findall(r"```python\n(.*?)```", page, re.DOTALL)
