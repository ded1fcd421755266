"""The forecast names models that will not reach a point, and does not name sound ones."""

import numpy as np
import pytest

from hopdata.steering.control.forecast import (
    LEAST_ARRIVED,
    Way,
    forecast,
    persistent,
    warning,
)
from hopdata.steering.frame_changes import FrameChanges, hopper_axes
from hopdata.steering.models.learning import prediction_score
from hopdata.steering.models.training import trained_process
from hopdata.steering.strides import USED, Input, StrideAxes, Strides
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
    assert f"{expected.covered:.0%} of the cells of states and inputs" in str(expected)
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


# A robot that is not the hopper: no state, a turn as input.

UNICYCLE = StrideAxes(inputs=(Input(name="turn", unit="", lower=-1.0, upper=1.0),))


def rolled(n, *, turn_rad=0.5, seed=1):
    """Return strides of a unicycle that turns by as much at the largest input."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(-1, 1, n)
    change = np.column_stack([np.full(n, 0.08), 0.02 * turn, turn_rad * turn])
    change += rng.standard_normal((n, 3)) * [0.005, 0.005, 0.02]
    none = np.empty((n, 0))
    return Strides(
        axes=UNICYCLE,
        recording=np.full(n, "rolled"),
        time_s=0.5 * np.arange(n),
        state=none,
        inputs=turn[:, None],
        change=change,
        next_state=none,
        reason=np.full(n, USED),
    )


@pytest.mark.parametrize(("turn_rad", "is_named"), [(0.5, False), (-0.2, True)])
def test_it_tells_of_any_robot_whether_its_model_will_do(turn_rad, is_named):
    process = trained_process(rolled(60))
    fresh = rolled(60, turn_rad=turn_rad, seed=2)
    way = Way(distance_m=0.8, width_m=0.1, strides=40)
    expected = forecast(process, fresh, way=way)
    said = warning(prediction_score(process, fresh).assign(**expected.columns()))
    assert (said is not None) == is_named
    assert expected.width_m == 0.1
    # Straight ahead from behind, any model arrives; from beside it, not one that errs.
    ahead = forecast(process, fresh, way=way, starts=np.tile([-0.8, 0.0, 0.0], (9, 1)))
    assert ahead.arrived == 1.0 or is_named


def errors_that_follow(correlation, n, seed):
    """Return errors (n, 3) of which the second correlates from stride to stride."""
    rng = np.random.default_rng(seed)
    error = rng.standard_normal((n, 3))
    for k in range(1, n):
        new = np.sqrt(1 - correlation**2) * error[k, 1]
        error[k, 1] = correlation * error[k - 1, 1] + new
    return error + 5.0  # a mean is no sign


@pytest.mark.parametrize("seed", range(5))
def test_errors_that_carry_over_are_named_and_independent_ones_are_not(seed):
    hops = made(300)
    error = errors_that_follow(0.85, 300, seed)
    assert persistent(error, hops) == ("dy",)
    assert persistent(errors_that_follow(0.0, 300, seed), hops) == ()
    # Strides of which others were learned, in any order.
    rest = np.random.default_rng(seed).permutation(300)[:120]
    assert persistent(error[rest], hops.rows(rest)) == ("dy",)
    # Strides of several recordings, or far apart, are not in a row.
    alone = hops.rows(np.arange(0, 300, 50))
    assert persistent(error[::50], alone) == ()


def test_a_forecast_that_is_too_hopeful_says_so(sound):
    expected, said = foretold(*sound)
    assert said is None
    scores = prediction_score(trained_process(sound[0]), sound[1])
    columns = {**expected.columns(), "persistent": "dy"}
    said = warning(scores.assign(**columns))
    assert said.code == "steering.errors_persist"
    assert "errors in dy" in str(said)
    del columns["persistent"]  # as older versions wrote it
    assert warning(scores.assign(**columns)) is None
