import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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


@pytest.mark.parametrize("damaged", [(2, 1e9), (2_000_000, 0.02), (1, 0.02), (0, -5.0)])
def test_one_damaged_frame_does_not_disturb_those_after_it(damaged):
    assert verdicts([(1, 0.01), damaged, (3, 0.03), (4, 0.04)]) == [
        "next", "implausible", "next", "next",
    ]  # fmt: skip


def test_frames_that_come_late_twice_or_out_of_order_are_outdated():
    numbers = [10, 8, 9, 11, 11, 13, 12, 10, 11, 14]
    heard = verdicts([(k, k / 100) for k in numbers])
    late = {1, 2, 4, 6, 7, 8}
    assert heard == ["outdated" if k in late else "next" for k in range(len(numbers))]


@given(st.integers(1, 60), st.lists(st.tuples(st.integers(0, 8), st.booleans()), max_size=300))
def test_a_stream_that_is_shuffled_a_little_keeps_its_order_and_its_clock(first, delays):
    sent = [
        (k + delay, first + k) for k, (delay, twice) in enumerate(delays) for _ in range(1 + twice)
    ]
    numbers = [number for _, number in sorted(sent)]
    heard = verdicts([(k, k / 100) for k in numbers])
    assert set(heard) <= {"next", "outdated"}
    kept = [k for k, verdict in zip(numbers, heard, strict=True) if verdict == "next"]
    assert kept == sorted(set(kept))
    assert kept == list(dict.fromkeys(np.maximum.accumulate(np.array(numbers, int)).tolist()))


def test_a_camera_system_that_begins_anew_soon_is_followed_in_the_end():
    frames = [(k, k / 100) for k in [*range(1, 31), *range(1, 31)]]
    assert verdicts(frames) == ["next"] * 30 + ["outdated"] * 10 + ["restart"] + ["next"] * 19


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
