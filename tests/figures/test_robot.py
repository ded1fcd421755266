"""The drawing of the robot names its parts and shows the scene's numbers."""

import numpy as np
import pytest

from hopdata.figures import robot
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.sketch import hopper_sketch, leg_forces

HOPPER = HopperParameters(foot_radius_m=0.31, leg_length_m=0.25, preload_n=25.0)
SKETCH = hopper_sketch(HOPPER, swing_limit_rad=np.pi / 3)
FORCES = leg_forces(HOPPER)


def words(axes):
    return " ".join(text.get_text() for text in axes.texts)


def test_all_panels_name_what_they_show():
    figure = robot.robot_figure(SKETCH, FORCES)
    assembly, leg, boom = (words(axes) for axes in figure.axes)
    for part in (
        "foot 1",
        "foot 2",
        "foot 3",
        "3 body markers",
        "counterweight",
        "motor",
    ):
        assert part in assembly
    assert "0.31 m from the axis" in assembly
    for name in "xyz":
        assert f" {name} " in assembly
    assert "0.25 m below the origin" in assembly
    assert "preload, 25 N" in leg
    assert "125 mm" in leg
    assert "90 N/m" in leg
    assert "±60.0°" in boom
    assert "neutral" in boom


def test_all_axes_of_the_body_are_within_the_limits():
    """Matplotlib leaves out an arrow whose tip is not."""
    axes = robot.robot_figure(SKETCH, FORCES, panels=["assembly"]).axes[0]
    names = [text for text in axes.texts if text.get_text() in ("x", "y", "z")]
    assert len(names) == 3
    for name in names:
        x, y = name.xy
        assert axes.get_xlim()[0] < x < axes.get_xlim()[1]
        assert axes.get_ylim()[0] < y < axes.get_ylim()[1]


def test_a_boom_away_from_neutral_is_not_called_neutral():
    turned = HopperParameters(boom_angle_rad=1.0)
    figure = robot.robot_figure(hopper_sketch(turned), FORCES, panels=["boom"])
    text = words(figure.axes[0])
    assert "neutral" not in text
    assert "one swing" not in text  # none was given


def test_panels_are_drawn_in_the_order_asked_for():
    figure = robot.robot_figure(SKETCH, FORCES, panels=["leg", "assembly"])
    assert [axes.get_ylabel() for axes in figure.axes] == ["force (N)", ""]


def test_the_projection_keeps_lengths_across_the_view():
    """Seen from the front, what is sideways keeps its length, and ahead has none."""
    seen = robot.projected(np.eye(3), azimuth_deg=0.0, elevation_deg=0.0)
    np.testing.assert_allclose(seen, [[0, 0], [1, 0], [0, 1]], atol=1e-15)
    above = robot.projected(np.eye(3), azimuth_deg=-90.0, elevation_deg=90.0)
    np.testing.assert_allclose(above, [[1, 0], [0, 1], [0, 0]], atol=1e-15)
    some = robot.projected([[1.0, 2.0, 2.0]])
    assert np.linalg.norm(some) <= 3.0


def test_legs_end_at_the_feet():
    figure = robot.robot_figure(SKETCH, FORCES, panels=["boom"])
    feet = HOPPER.rest_feet()[:, :2]
    ends = [tuple(np.round(line.get_xydata()[-1], 9)) for line in figure.axes[0].lines]
    for foot in np.round(feet, 9):
        assert tuple(foot) in ends


@pytest.mark.parametrize("kind", ["foot", "counterweight"])
def test_places_are_the_points_of_a_kind(kind):
    found = robot.places(SKETCH, kind)
    assert len(found) == (SKETCH["kind"] == kind).sum()
