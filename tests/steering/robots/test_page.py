"""The page on another robot: its example is short, runs, and arrives."""

import re
from pathlib import Path

import numpy as np

from hopdata.steering import robots

PAGE = Path(__file__).parents[3] / "docs" / "another_robot.md"
FOLDER = Path(robots.__file__).parent


def test_the_robot_of_the_page_arrives():
    # What follows on the page forecasts the arrivals.
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    robot, steering = blocks[:2]
    assert len(robot.splitlines()) <= 30
    names = {}
    exec(robot + steering, names)
    log = names["log"]
    assert np.hypot(*log.poses[0, :2]) > 0.9
    assert np.hypot(*log.poses[-1, :2]) < 0.11
    assert len(log.stances) > 10
    np.testing.assert_array_equal(names["again"], log.inputs)


def test_each_robot_is_one_short_file():
    for name in ("planar_hopper", "quadruped", "steered_hopper"):
        lines = (FOLDER / f"{name}.py").read_text().splitlines()
        assert len(lines) <= 150
