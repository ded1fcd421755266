import numpy as np
import pytest

from hopdata.errors import ConfigError
from hopdata.steering.live.limits import Limits


def test_no_swing_at_all_and_half_a_turn_are_limits():
    assert Limits(swing_rad=0.0).swing_rad == 0.0
    assert Limits(swing_rad=np.pi).swing_rad == np.pi


@pytest.mark.parametrize("swing", [-1.0, np.nan, np.inf, 67.5])
def test_a_limit_of_the_swing_that_would_not_hold_is_refused(swing):
    with pytest.raises(ConfigError, match="swing_rad: expected 0 to pi, found"):
        Limits(swing_rad=swing)


@pytest.mark.parametrize("name", ["pose_age_s", "command_s", "hop_s"])
@pytest.mark.parametrize("time", [-0.1, 0.0, np.nan])
def test_a_time_that_would_not_hold_is_refused(name, time):
    with pytest.raises(ConfigError, match=f"{name}: expected more than 0"):
        Limits(**{name: time})
