"""Limits of the loop that would hold nothing are refused."""

import numpy as np
import pytest

from hopdata.errors import ConfigError
from hopdata.steering.live.limits import Limits


def test_no_swing_at_all_and_half_a_turn_are_limits():
    assert Limits(swing_rad=0.0).swing_rad == 0.0
    assert Limits(swing_rad=np.pi).swing_rad == np.pi


@pytest.mark.parametrize("name", ["swing_rad", "tilt_rad"])
@pytest.mark.parametrize("angle", [-1.0, np.nan, np.inf, 67.5])
def test_an_angle_that_would_not_hold_is_refused(name, angle):
    with pytest.raises(ConfigError, match=f"{name}: expected 0 to pi, found"):
        Limits(**{name: angle})


@pytest.mark.parametrize(
    "name", ["pose_age_s", "command_s", "hop_s", "alive_s", "heard_s"]
)
@pytest.mark.parametrize("time", [-0.1, 0.0, np.nan])
def test_a_time_that_would_not_hold_is_refused(name, time):
    with pytest.raises(ConfigError, match=f"{name}: expected more than 0"):
        Limits(**{name: time})


@pytest.mark.parametrize("wrong", [0, -1, np.nan])
def test_a_number_of_wrong_swings_that_would_end_no_drive_is_refused(wrong):
    with pytest.raises(ConfigError, match="wrong_swings: expected 1 or more, found"):
        Limits(wrong_swings=wrong)
