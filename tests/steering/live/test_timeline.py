import numpy as np
import pytest

from hopdata.steering.live.timeline import CameraClock, Timeline


def verdicts(frames, rate_hz=100.0):
    timeline = Timeline(rate_hz)
    return [timeline.judge(number, time) for number, time in frames]


def test_frames_in_order_follow_each_other():
    assert verdicts([(k, k / 100) for k in range(1, 6)]) == ["next"] * 5


def test_missing_frames_are_counted():
    timeline = Timeline(100.0)
    timeline.judge(1, 0.01)
    assert timeline.judge(5, 0.05) == "next"
    assert timeline.missing == 3
    timeline.judge(6, 0.06)
    assert timeline.missing == 0


@pytest.mark.parametrize("damaged", [(2, 1e9), (2_000_000, 0.02), (1, 0.01), (0, -5.0)])
def test_one_damaged_frame_does_not_disturb_those_after_it(damaged):
    assert verdicts([(1, 0.01), damaged, (3, 0.03), (4, 0.04)]) == [
        "next", "implausible", "next", "next",
    ]  # fmt: skip


def test_a_camera_system_that_begins_anew_is_followed():
    frames = [(900, 9.0), (901, 9.01), (1, 0.01), (2, 0.02), (3, 0.03)]
    assert verdicts(frames) == ["next", "next", "implausible", "restart", "next"]


def test_a_first_frame_that_is_damaged_is_left_behind():
    frames = [(7, 1e12), (8, 0.08), (9, 0.09)]
    assert verdicts(frames) == ["next", "implausible", "restart"]


def test_a_frame_rate_that_is_not_the_one_told_is_put_up_with():
    heard = verdicts([(k, k / 60) for k in range(1, 31)])
    assert heard == ["next"] + ["implausible"] * 10 + ["next"] * 19


def test_without_a_rate_only_the_order_counts():
    assert verdicts([(1, 0.0), (2, 5.0), (2, 6.0)], None) == ["next", "next", "implausible"]


def test_a_held_up_frame_is_as_old_as_it_is():
    clock, rng = CameraClock(), np.random.default_rng(np.random.SeedSequence(2))
    for k in range(200):
        clock.captured(k / 100, 1000.0 + k / 100 + 0.002 + 0.001 * rng.random())
    captured = clock.captured(2.0, 1002.5)
    assert 1002.5 - captured == pytest.approx(0.5 - 0.002, abs=1e-3)


@pytest.mark.parametrize("drift", [-5e-5, 5e-5])
def test_clocks_that_drift_apart_do_not_make_frames_look_old(drift):
    clock = CameraClock()
    arrivals = np.arange(60_000) / 100
    ages = [a - clock.captured(a * (1 + drift), a) for a in arrivals]
    assert max(ages) < 1e-3
