import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from steered_hopper import steered

from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.stances import StanceDetector

NOISE = 0.00035
CASES = [(angle, rate) for angle in (0.0, np.pi) for rate in (50.0, 100.0, 200.0)]


def detector(rate_hz=100.0):
    return StanceDetector(stance_below_m=0.35, flight_above_m=0.38, noise_m=NOISE, rate_hz=rate_hz)


def heights(hopper, seed=1):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    return hopper.middle[:, 2] + NOISE * rng.standard_normal(len(hopper.middle))


def told(time, height, rate_hz=100.0):
    one = detector(rate_hz)
    return [s for t, z in zip(time, height, strict=True) if (s := one.feed(t, z)) is not None]


def delays(stances, hopper):
    """Delay of each stance, after requiring that there is one for each landing."""
    instants = np.array([s.time_s for s in stances])
    assert len(instants) == len(hopper.lowest_s)
    assert np.abs(instants - hopper.lowest_s).max() < 0.05
    return np.array([s.told_s for s in stances]) - hopper.lowest_s


@pytest.mark.parametrize(("angle", "rate"), CASES)
def test_each_stance_is_told_once_and_soon(angle, rate):
    hopper = steered(angle=angle, rate_hz=rate)
    delay = delays(told(hopper.recording.time, heights(hopper), rate), hopper)
    assert delay.min() >= 0
    assert delay.max() <= (0.04 if rate >= 100 else 0.06)


def test_instants_lie_between_frames():
    hopper = steered()
    stances = told(hopper.recording.time, heights(hopper))
    assert np.std([s.time_s for s in stances] - hopper.lowest_s) < 0.0015
    assert not any(s.bridged for s in stances)


@pytest.mark.parametrize("share", [0.01, 0.1])
@pytest.mark.parametrize("missing", ["dropped", "unknown"])
def test_frames_may_be_missing(share, missing):
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    gone = np.random.default_rng(np.random.SeedSequence(2)).random(len(z)) < share
    if missing == "dropped":
        stances = told(time[~gone], z[~gone])
    else:
        stances = told(time, np.where(gone, np.nan, z))
    assert delays(stances, hopper).max() < 0.06


@pytest.mark.parametrize("half_s", [0.04, 0.06, 0.1])
def test_a_hole_over_the_lowest_point_is_bridged(half_s):
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    gone = (np.abs(time[:, None] - hopper.lowest_s[3:20]) < half_s).any(axis=1)
    stances = told(time[~gone], z[~gone])
    delay = delays(stances, hopper)
    assert delay.max() < half_s + 0.05
    assert [s.bridged for s in stances] == [3 <= k < 20 for k in range(40)]


def test_after_a_hole_as_long_as_a_hop_nothing_is_invented():
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    gone = (time > hopper.lowest_s[5] - 0.3) & (time < hopper.lowest_s[6] - 0.3)
    stances = told(time[~gone], z[~gone])
    instants = np.array([s.time_s for s in stances])
    np.testing.assert_allclose(instants, np.delete(hopper.lowest_s, 5), atol=0.01)


@pytest.mark.parametrize("size_m", [0.05, 0.2, -0.2, 5.0])
def test_single_frames_that_jump_away_are_left_out(size_m):
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    off = np.arange(len(z)) % 37 == 5
    one = detector()
    stances = [s for t, h in zip(time, z + size_m * off, strict=True) if (s := one.feed(t, h))]
    assert delays(stances, hopper).max() <= 0.05
    assert one.n_left_out > 0.5 * off.sum()


@pytest.mark.parametrize("step_m", [0.02, -0.02, 0.05])
@pytest.mark.parametrize("after_s", [-0.08, -0.02, 0.0, 0.03, 0.1, 0.3])
def test_a_step_in_the_heights_tells_no_stance_twice(step_m, after_s):
    # As when a third marker comes back to two that had leaned on an old attitude.
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    for instant in hopper.lowest_s:
        z = z + step_m * ((time > instant + after_s - 0.1) & (time < instant + after_s))
    stances = told(time, z)
    assert len(stances) == len(hopper.lowest_s)
    assert np.abs(np.array([s.time_s for s in stances]) - hopper.lowest_s).max() < 0.06


def test_standing_being_lifted_and_set_down_are_no_stances():
    time = np.arange(0, 8, 0.01)
    rng = np.random.default_rng(np.random.SeedSequence(5))
    by_hand = 0.4 + 0.12 * np.cos(2 * np.pi * time / 2.0)  # 1.2 m/s^2
    assert told(time, by_hand + NOISE * rng.standard_normal(len(time))) == []
    assert told(time, 0.3 + NOISE * rng.standard_normal(len(time))) == []


def test_frames_that_come_twice_or_late_are_left_out():
    hopper = steered()
    one = detector()
    stances = []
    for t, z in zip(hopper.recording.time, heights(hopper), strict=True):
        stances += [one.feed(t, z), one.feed(t, z), one.feed(t - 0.02, z + 0.3)]
    assert len([s for s in stances if s]) == len(hopper.lowest_s)
    assert one.n_left_out == 2 * len(hopper.recording.time)


def test_a_clock_that_begins_anew_is_followed():
    hopper = steered()
    one, time, z = detector(), hopper.recording.time, heights(hopper)
    told_times = [
        s.time_s for t, h in zip([*time, *time], [*z, *z], strict=True) if (s := one.feed(t, h))
    ]
    assert len(told_times) == 2 * len(hopper.lowest_s)


def test_a_calibrated_detector_needs_nothing_else():
    hopper = steered()
    one = StanceDetector.of(calibrate(hopper.recording))
    z = hopper.recording.body_height
    found = [s for t, h in zip(hopper.recording.time, z, strict=True) if (s := one.feed(t, h))]
    assert delays(found, hopper).max() <= 0.04


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(
        st.tuples(
            st.floats(-0.1, 0.3, allow_nan=False),
            st.one_of(st.floats(0.2, 0.6), st.floats(allow_nan=True, allow_infinity=True)),
        ),
        max_size=200,
    )
)
def test_whatever_comes_no_error_and_no_two_stances_without_a_flight(steps):
    one, time, last, risen = detector(), 0.0, -np.inf, True
    for step, height in steps:
        time += step
        stance = one.feed(time, height)
        if stance is not None:
            assert risen
            assert last < stance.told_s <= time
            assert 0 <= stance.told_s - stance.time_s < 0.3
            last, risen = stance.told_s, False
        risen = risen or height > one.flight_above_m


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32), share=st.floats(0, 0.6))
def test_holes_anywhere_invent_nothing(seed, share):
    hopper = steered()
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    length = int(rng.integers(1, 40))
    gone = np.repeat(rng.random(1 + len(hopper.middle) // length) < share, length)
    gone = gone[: len(hopper.middle)]
    gone = np.append(gone, np.zeros(len(hopper.middle) - len(gone), bool))
    stances = told(hopper.recording.time[~gone], heights(hopper)[~gone])
    near = [np.abs(s.time_s - hopper.lowest_s).argmin() for s in stances]
    assert len(set(near)) == len(near)
    assert all(
        abs(s.time_s - hopper.lowest_s[k]) < 0.15 for s, k in zip(stances, near, strict=True)
    )
