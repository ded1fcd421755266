import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from steered_hopper import as_landings, heights, steered, true_pairs

from hopdata.steering.observation import stances as observed
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry, height_band
from hopdata.steering.observation.stances import (
    HELD,
    HOLE,
    NO_STANCE,
    ONE_NO_STANCE,
    StanceDetector,
    local_fit,
)

NOISE_M = 0.00035 * np.sqrt(3)


def geometry(below_m, above_m):
    return HopperGeometry(("a", "b", "c"), np.eye(3), NOISE_M, below_m, above_m)


def find_stances(time, height, band_m=None):
    """Find the stances in heights with the noise above; by default by their own band."""
    return observed.find_stances(
        time, height, geometry(*(band_m or height_band(height)))
    )


CASES = [(angle, rate) for angle in (0.0, np.pi) for rate in (50.0, 100.0, 200.0)]


@pytest.mark.parametrize(("angle", "rate"), CASES)
@pytest.mark.parametrize("noise_m", [0.0, 0.00035, 0.0007])
def test_every_true_pair_is_found_and_none_invented(angle, rate, noise_m):
    hopper = steered(angle=angle, rate_hz=rate)
    found = find_stances(hopper.recording.time, heights(hopper, noise_m))
    np.testing.assert_array_equal(as_landings(found.time_s, hopper), np.arange(40))
    np.testing.assert_array_equal(found.pairs, true_pairs(hopper))
    assert found.rejected[HELD] == 39 - hopper.hop.sum()


def test_the_hopper_was_carried_or_the_test_above_is_weak():
    assert any((~steered(angle=angle).hop).sum() > 1 for angle in (0.0, np.pi))


def test_a_stumble_is_no_part_of_a_hop():
    # The hopper stays low for half a second and bounces at either end: one visit, whose
    # stance is the first bounce. A hop that began there, 0.4 s before the hopper flew,
    # spoiled a model learned from a hundred hops.
    hopper = steered()
    z, at = heights(hopper), int(np.round(100 * hopper.lowest_s[20]))
    low = z[at] + 0.04 * np.sin(np.linspace(0, np.pi, 50))
    for down in (-1e-3, 1e-3):  # which bounce is the lower one
        stumbled = np.concatenate(
            [z[: at + 1], low, z[at:] + down * (np.arange(len(z) - at) < 9)]
        )
        found = find_stances(np.arange(len(stumbled)) / 100, stumbled)
        assert len(found.time_s) == 40
        usual = find_stances(hopper.recording.time, z)
        lost = {tuple(pair) for pair in usual.pairs} - {
            tuple(pair) for pair in found.pairs
        }
        assert lost == {(20, 21)}


def test_instants_lie_between_frames():
    hopper = steered()
    found = find_stances(hopper.recording.time, heights(hopper))
    assert np.std(found.time_s - hopper.lowest_s) < 0.001
    assert np.abs(found.time_s - hopper.lowest_s).max() < 0.003
    np.testing.assert_array_equal(found.frame, np.round(100 * found.time_s))
    assert not found.bridged.any()


@pytest.mark.parametrize("missing", ["dropped", "unknown"])
def test_frames_may_be_missing(missing):
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    gone = np.random.default_rng(np.random.SeedSequence(2)).random(len(z)) < 0.1
    if missing == "dropped":
        found = find_stances(time[~gone], z[~gone])
    else:
        found = find_stances(time, np.where(gone, np.nan, z))
    np.testing.assert_array_equal(found.pairs, true_pairs(hopper))
    assert np.abs(found.time_s - hopper.lowest_s).max() < 0.012


def test_a_hole_at_the_lowest_point_is_bridged_and_said():
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    z[np.abs(time - hopper.lowest_s[5]) < 0.045] = np.nan
    found = find_stances(time, z)
    np.testing.assert_array_equal(np.flatnonzero(found.bridged), [5])
    assert abs(found.time_s[5] - hopper.lowest_s[5]) < 0.01
    near = np.abs(time - hopper.lowest_s[5]) < 0.2
    assert found.height_m[5] == np.nanmin(z[near]), "the lowest that was seen"
    np.testing.assert_array_equal(found.pairs, true_pairs(hopper))


@pytest.mark.parametrize("rate", [100.0, 500.0])
@pytest.mark.parametrize("hole_s", [0.012, 0.03, 0.1])
def test_a_hole_beside_the_lowest_point_is_no_harm(rate, hole_s):
    hopper = steered(rate_hz=rate)
    time, z = hopper.recording.time, heights(hopper)
    for k, lowest in enumerate(hopper.lowest_s):
        z[np.abs(time - lowest - (-1) ** k * (0.02 + hole_s / 2)) <= hole_s / 2] = (
            np.nan
        )
    found = find_stances(time, z)
    assert len(found.time_s) == len(hopper.lowest_s)
    assert np.abs(found.time_s - hopper.lowest_s).max() < max(0.004, 0.1 * hole_s)


def test_a_hole_in_flight_is_no_harm_while_it_is_short():
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    apex = 0.5 * (hopper.lowest_s[5] + hopper.lowest_s[6])
    z[np.abs(time - apex) < 0.1] = np.nan
    np.testing.assert_array_equal(find_stances(time, z).pairs, true_pairs(hopper))


def test_a_stance_hidden_in_a_hole_leaves_two_pairs_out_and_invents_none():
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    z[np.abs(time - hopper.lowest_s[5]) < 0.22] = np.nan
    found = find_stances(time, z)
    left = [p for p in true_pairs(hopper).tolist() if 5 not in p]
    landings = as_landings(found.time_s, hopper)
    np.testing.assert_array_equal(landings[found.pairs], left)
    assert sum(found.rejected.values()) == 39 - hopper.hop.sum() + 1
    assert found.rejected[HOLE] == 1


def test_a_hopper_that_stands_still_has_no_stance():
    time = np.arange(400) / 100
    rng = np.random.default_rng(np.random.SeedSequence(4))
    standing = 0.3 + 0.0004 * rng.standard_normal(400)
    found = find_stances(time, standing, (0.35, 0.38))
    assert len(found.time_s) == 0
    assert found.pairs.shape == (0, 2)
    assert found.rejected[NO_STANCE] == 1


def test_lying_down_between_hops_is_no_stance():
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    cut = np.searchsorted(time, hopper.lowest_s[20])
    slow = 0.4 + 0.1 * np.cos(
        np.linspace(0, 2 * np.pi, 200)
    )  # laid down and picked up by hand
    both = np.concatenate([z[: cut - 40], slow, z[cut + 40 :]])
    found = find_stances(np.arange(len(both)) / 100, both)
    near = (found.time_s > time[cut - 40]) & (found.time_s < time[cut - 40] + 2.0)
    assert not near.any()
    assert found.rejected[NO_STANCE] == 1
    assert found.rejected[ONE_NO_STANCE] == 2


def test_no_heights_give_no_stances():
    found = find_stances(np.arange(10) / 100, np.full(10, np.nan), (0.3, 0.4))
    assert len(found.time_s) == 0
    assert found.pairs.shape == (0, 2)


def holes(hopper, seed, share):
    """Mark about this share of the frames, in gaps of equal length."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    length = int(rng.integers(1, 40))
    gone = np.repeat(rng.random(1 + len(hopper.middle) // length) < share, length)
    return gone[: len(hopper.middle)]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32), share=st.floats(0, 0.6))
def test_holes_anywhere_invent_no_pair(seed, share):
    hopper = steered()
    z = np.where(holes(hopper, seed, share), np.nan, heights(hopper))
    found = find_stances(hopper.recording.time, z, (0.35, 0.38))
    landings = as_landings(found.time_s, hopper, within=0.1)
    assert (np.diff(landings) > 0).all()
    true = {tuple(pair) for pair in true_pairs(hopper).tolist()}
    assert {tuple(pair) for pair in landings[found.pairs].tolist()} <= true


@settings(max_examples=60, deadline=None)
@given(
    height=st.lists(
        st.one_of(st.floats(0, 1), st.floats(allow_nan=True, allow_infinity=True)),
        max_size=60,
    )
)
@example(height=[0.0] * 8 + [3.7541862203838216e154, 1.0, 0.0, 1.0])
def test_whatever_comes_the_answer_is_consistent(height):
    z = np.array(height)
    with np.errstate(over="ignore", invalid="ignore"):
        found = find_stances(np.arange(len(z)) / 100, z, (0.35, 0.38))
    assert (np.diff(found.time_s) > 0).all()
    assert (np.diff(found.pairs, axis=1) == 1).all()
    assert (
        len(found.height_m)
        == len(found.frame)
        == len(found.bridged)
        == len(found.time_s)
    )


def test_a_polynomial_is_found_with_its_derivatives_also_with_frames_missing():
    t = np.delete(np.arange(0, 1, 0.01), [48, 52, 53])
    fit = local_fit(t, 2 + 3 * (t - 0.4) ** 2 - (t - 0.4) ** 3, 0.45, 0.55, degree=3)
    assert fit.at(0.5) == pytest.approx(2 + 0.03 - 0.001)
    assert fit.at(0.5, 1) == pytest.approx(0.6 - 0.03)
    assert fit.at(0.5, 2) == pytest.approx(6 - 0.6)


def test_several_quantities_are_fitted_at_once():
    t = np.arange(0, 1, 0.1)
    fit = local_fit(t, np.column_stack([t, t**2]), 0.0, 1.0, degree=2)
    np.testing.assert_allclose(fit.at(0.35), [0.35, 0.35**2], atol=1e-12)


def test_too_few_frames_give_nothing():
    t = np.arange(0, 1, 0.1)
    assert local_fit(t, t, 0.41, 0.59, degree=1) is None


# Stances of a stream, reported as they occur.


def detector(rate_hz=100.0):
    return StanceDetector(geometry(0.35, 0.38), rate_hz=rate_hz)


def recognised(time, height, rate_hz=100.0):
    one = detector(rate_hz)
    return [
        s
        for t, z in zip(time, height, strict=True)
        if (s := one.feed(t, z)) is not None
    ]


def delays(stances, hopper):
    """Return the delay of each stance, after checking that each landing has one."""
    instants = np.array([s.time_s for s in stances])
    assert len(instants) == len(hopper.lowest_s)
    assert np.abs(instants - hopper.lowest_s).max() < 0.05
    return np.array([s.recognised_s for s in stances]) - hopper.lowest_s


@pytest.mark.parametrize(("rate", "ms"), [(60.0, 30), (100.0, 20), (250.0, 10)])
def test_how_soon_a_stance_is_recognised_is_as_written(rate, ms):
    hopper = steered(rate_hz=rate)
    delay = delays(recognised(hopper.recording.time, heights(hopper), rate), hopper)
    assert np.median(1e3 * delay) == pytest.approx(ms, abs=2.5)


@pytest.mark.parametrize(("angle", "rate"), CASES)
def test_each_stance_is_recognised_once_and_soon(angle, rate):
    hopper = steered(angle=angle, rate_hz=rate)
    delay = delays(recognised(hopper.recording.time, heights(hopper), rate), hopper)
    assert delay.min() >= 0
    assert delay.max() <= (0.04 if rate >= 100 else 0.06)


def test_instants_that_are_recognised_lie_between_frames():
    hopper = steered()
    stances = recognised(hopper.recording.time, heights(hopper))
    assert np.std([s.time_s for s in stances] - hopper.lowest_s) < 0.0015
    assert not any(s.bridged for s in stances)


@pytest.mark.parametrize("share", [0.01, 0.1])
@pytest.mark.parametrize("missing", ["dropped", "unknown"])
def test_frames_may_be_missing_from_a_stream(share, missing):
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    gone = np.random.default_rng(np.random.SeedSequence(2)).random(len(z)) < share
    if missing == "dropped":
        stances = recognised(time[~gone], z[~gone])
    else:
        stances = recognised(time, np.where(gone, np.nan, z))
    assert delays(stances, hopper).max() < 0.06


@pytest.mark.parametrize("before", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("hole_s", [0.08, 0.12, 0.2])
def test_a_hole_over_the_lowest_point_is_bridged(hole_s, before):
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    begin_s = hopper.lowest_s[3:20] - before * hole_s
    gone = ((time[:, None] > begin_s) & (time[:, None] < begin_s + hole_s)).any(axis=1)
    stances = recognised(time[~gone], z[~gone])
    assert delays(stances, hopper).max() < (1 - before) * hole_s + 0.05
    off = np.array([s.time_s for s in stances]) - hopper.lowest_s
    assert np.abs(off).max() < 0.02
    assert [s.bridged for s in stances[3:20]].count(True) == 17
    assert not any(s.bridged for s in stances[:3] + stances[20:])


def test_after_a_hole_as_long_as_a_hop_nothing_is_invented():
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    gone = (time > hopper.lowest_s[5] - 0.3) & (time < hopper.lowest_s[6] - 0.3)
    stances = recognised(time[~gone], z[~gone])
    instants = np.array([s.time_s for s in stances])
    np.testing.assert_allclose(instants, np.delete(hopper.lowest_s, 5), atol=0.01)


@pytest.mark.parametrize("size_m", [0.05, 0.2, -0.2, 5.0])
def test_single_frames_that_jump_away_are_left_out(size_m):
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    off = np.arange(len(z)) % 37 == 5
    one = detector()
    stances = [
        s for t, h in zip(time, z + size_m * off, strict=True) if (s := one.feed(t, h))
    ]
    assert delays(stances, hopper).max() <= 0.05
    assert one.n_left_out > 0.5 * off.sum()


@pytest.mark.parametrize("step_m", [0.02, -0.02, 0.05])
@pytest.mark.parametrize("after_s", [-0.08, -0.02, 0.0, 0.03, 0.1, 0.3])
def test_a_step_in_the_heights_tells_no_stance_twice(step_m, after_s):
    # This happens when a third marker returns to two that relied on an old attitude.
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    for instant in hopper.lowest_s:
        z = z + step_m * ((time > instant + after_s - 0.1) & (time < instant + after_s))
    stances = recognised(time, z)
    assert len(stances) == len(hopper.lowest_s)
    assert np.abs(np.array([s.time_s for s in stances]) - hopper.lowest_s).max() < 0.06


@pytest.mark.parametrize("rate", [100.0, 500.0])
def test_a_stream_that_begins_in_a_rise_begins_with_no_stance(rate):
    # The noise of the first two or three heights is not a fall.
    hopper = steered(rate_hz=rate)
    time, z = hopper.recording.time, heights(hopper)
    for instant, after in zip(hopper.lowest_s[:-1], hopper.lowest_s[1:], strict=True):
        for begin_s in instant + np.arange(0.16, 0.3, 0.01):
            part = (time > begin_s) & (time < after - 0.05)
            assert recognised(time[part], z[part], rate) == []


def test_standing_being_lifted_and_set_down_are_no_stances():
    time = np.arange(0, 8, 0.01)
    rng = np.random.default_rng(np.random.SeedSequence(5))
    by_hand = 0.4 + 0.12 * np.cos(2 * np.pi * time / 2.0)  # 1.2 m/s^2
    assert recognised(time, by_hand + 0.00035 * rng.standard_normal(len(time))) == []
    assert recognised(time, 0.3 + 0.00035 * rng.standard_normal(len(time))) == []


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("rate", [60.0, 100.0, 250.0])
def test_shaken_in_the_air_it_makes_no_stance(rate, gaps):
    # A stance used to be reported at each shake, about 0.2 m too high, with and without
    # gaps.
    rng = np.random.default_rng(np.random.SeedSequence(6))
    time = np.arange(0, 8, 1 / rate)
    for shakes_s, reach_m in (
        (1.5, 0.08),
        (2.0, 0.05),
        (3.0, 0.03),
    ):  # up to 7, 8 and 11 m/s^2
        z = 0.6 + reach_m * np.sin(2 * np.pi * shakes_s * time)
        hidden = gaps & (time % 0.37 < 0.1)
        z[~hidden] += 0.00035 * rng.standard_normal(len(z))[~hidden]
        assert recognised(time[~hidden], z[~hidden], rate) == []


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
    recognised_times = [
        s.time_s
        for t, h in zip([*time, *time], [*z, *z], strict=True)
        if (s := one.feed(t, h))
    ]
    assert len(recognised_times) == 2 * len(hopper.lowest_s)


def test_a_calibrated_detector_needs_nothing_else():
    hopper = steered()
    one = StanceDetector(calibrate(hopper.recording))
    z = hopper.recording.body_height
    found = [
        s
        for t, h in zip(hopper.recording.time, z, strict=True)
        if (s := one.feed(t, h))
    ]
    assert delays(found, hopper).max() <= 0.04


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(
        st.tuples(
            st.floats(-0.1, 0.3, allow_nan=False),
            st.one_of(
                st.floats(0.2, 0.6), st.floats(allow_nan=True, allow_infinity=True)
            ),
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
            assert last < stance.recognised_s <= time
            assert 0 <= stance.recognised_s - stance.time_s < 0.3
            last, risen = stance.recognised_s, False
        risen = risen or height > one.flight_above_m


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32), share=st.floats(0, 0.6))
def test_holes_anywhere_invent_no_stance(seed, share):
    hopper = steered()
    gone = holes(hopper, seed, share)
    stances = recognised(hopper.recording.time[~gone], heights(hopper)[~gone])
    near = [np.abs(s.time_s - hopper.lowest_s).argmin() for s in stances]
    assert len(set(near)) == len(near)
    assert all(
        abs(s.time_s - hopper.lowest_s[k]) < 0.15
        for s, k in zip(stances, near, strict=True)
    )
