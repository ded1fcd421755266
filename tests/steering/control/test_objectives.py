"""Objectives have the stated meaning, and refuse values that make no sense."""

import numpy as np
import pytest

from hopdata.errors import ConfigError
from hopdata.steering.control.objectives import (
    Horizon,
    ToHeading,
    ToPoint,
    goal_errors,
)

POSES = np.array([[3.0, 4.0, 0.0], [0.0, 2.0, 3.0]])


def test_distances_are_added_up():
    assert goal_errors(ToPoint(), POSES).sum() == pytest.approx(7.0)


def test_distances_are_those_from_the_point():
    np.testing.assert_allclose(
        goal_errors(ToPoint(point_m=(3.0, 2.0)), POSES), [2.0, 3.0]
    )


def test_heading_errors_go_the_short_way():
    goal = ToHeading(heading_rad=-3.0)
    np.testing.assert_allclose(goal_errors(goal, POSES), [3.0, 2 * np.pi - 6.0])
    turned = ToHeading(heading_rad=-3.0 + 6 * np.pi)
    assert goal_errors(turned, POSES).sum() == pytest.approx(2 * np.pi - 3.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: ToPoint(point_m=(np.nan, 0.0)),
            "point_m: expected two finite numbers",
        ),
        (lambda: ToPoint(point_m=3), "point_m: expected two finite numbers, found 3"),
        (lambda: ToPoint(point_m=("1 m", 0)), "point_m: expected two finite numbers"),
        (
            lambda: ToHeading(heading_rad=np.inf),
            "heading_rad: expected a finite number",
        ),
        (
            lambda: ToHeading(heading_rad="north"),
            "heading_rad: expected a finite number",
        ),
        (lambda: Horizon(hops=0), "hops: expected 1 to 16, found 0"),
        (lambda: Horizon(hops=2.5), "hops: expected 1 to 16, found 2.5"),
        (lambda: Horizon(hops="2"), "hops: expected 1 to 16, found 2"),
        (lambda: Horizon(swing_limit_rad=4.0), "swing_limit_rad: expected more than 0"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
