"""The forecast names models that will not reach a point, and does not name sound ones."""

import numpy as np
import pytest

from hopdata.steering.control.forecast import LEAST_ARRIVED, forecast, warning
from hopdata.steering.frame_changes import FrameChanges, hopper_axes
from hopdata.steering.models.learning import prediction_score
from hopdata.steering.models.training import trained_process
from hopdata.steering.strides import USED
from steering.steered_hops import LIMIT, smooth_change


def made(n, *, noise_m=0.005, step=1.0, seed=1):
    """Return hops with errors of this size, and steps longer by this factor."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, n)
    swing = rng.uniform(-LIMIT, LIMIT, n)
    change = smooth_change(angle, swing) * [step, step, 1.0]
    change += rng.standard_normal((n, 3)) * [noise_m, noise_m, 0.02]
    return FrameChanges.hops(
        recording=np.full(n, "made"),
        time_s=0.6 * np.arange(n),
        boom_angle_rad=angle,
        swing_rad=swing,
        change=change,
        reason=np.full(n, USED),
        axes=hopper_axes(LIMIT),
    )


def foretold(learned, rest):
    process = trained_process(learned)
    expected = forecast(process, rest, state=[np.pi])
    scores = prediction_score(process, rest).assign(**expected.columns())
    return expected, warning(scores)


@pytest.fixture(scope="module")
def sound():
    hops = made(240)
    return hops.rows(np.arange(100)), hops.rows(np.arange(100, 240))


def test_a_sound_model_arrives_and_is_not_named(sound):
    expected, said = foretold(*sound)
    assert expected.arrived > LEAST_ARRIVED
    assert said is None
    away = expected.error_m / np.hypot(0.005, 0.005)
    assert 0.9 < away < 1.5
    assert 0.4 < expected.covered < 0.8  # 100 hops at random in 112 cells
    again, _ = foretold(*sound)
    assert again == expected


def test_a_model_whose_hops_end_anywhere_is_named_with_its_error():
    hops = made(240, noise_m=0.08)
    expected, said = foretold(hops.rows(np.arange(100)), hops.rows(np.arange(100, 240)))
    assert expected.arrived < 0.8
    assert said.code == "steering.will_not_reach"
    assert said.values["why"].code == "steering.errors_too_large"
    share = round(100 * expected.error_m / 0.11)
    assert said.values["why"].values == {"errors": share}
    assert f"{share} % of the goal's radius" in str(said)


def test_a_robot_that_hops_over_the_goal_is_named_with_its_step():
    hops = made(240, step=5.0)
    expected, said = foretold(hops.rows(np.arange(100)), hops.rows(np.arange(100, 240)))
    assert expected.step_m > 0.11
    assert said.values["why"].code == "steering.steps_too_large"


def test_errors_on_the_way_count_though_the_mean_error_is_small(sound):
    """The model is wrong about full swings to the left, by which it turns."""
    learned, rest = sound
    turns = rest.inputs[:, 0] > 0.5 * LIMIT
    change = rest.change.copy()
    change[turns, 2] = -change[turns, 2]
    change[~turns & (rest.inputs[:, 0] < -0.5 * LIMIT), 2] *= -1
    wrong = FrameChanges.hops(
        recording=rest.recording,
        time_s=rest.time_s,
        boom_angle_rad=rest.state[:, 0],
        swing_rad=rest.inputs[:, 0],
        change=change,
        reason=rest.reason,
        axes=rest.axes,
    )
    expected, said = foretold(learned, wrong)
    assert expected.error_m < 0.02
    assert expected.arrived < LEAST_ARRIVED
    assert said.values["why"].code == "steering.errors_where_needed"


def test_scores_without_a_forecast_say_nothing(sound):
    process = trained_process(sound[0])
    assert warning(prediction_score(process, sound[1])) is None
