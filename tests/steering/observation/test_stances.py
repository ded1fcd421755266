import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from steered_hopper import as_landings, heights, steered, true_pairs

from hopdata.steering.observation.stances import (
    BOTTOM_UNSEEN,
    HELD,
    HOLE,
    NO_BOUNCE,
    NO_STANCE,
    find_stances,
    local_fit,
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
    assert (
        abs(found.height_m[5] - hopper.middle[:, 2][np.abs(time - hopper.lowest_s[5]).argmin()])
        < 0.02
    )
    np.testing.assert_array_equal(found.pairs, true_pairs(hopper))


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
    assert found.rejected[NO_BOUNCE] + found.rejected[BOTTOM_UNSEEN] == 1


def test_lying_down_between_hops_is_no_stance():
    hopper = steered()
    time, z = hopper.recording.time, heights(hopper)
    cut = np.searchsorted(time, hopper.lowest_s[20])
    slow = 0.4 + 0.1 * np.cos(np.linspace(0, 2 * np.pi, 200))  # laid down, picked up by hand
    both = np.concatenate([z[: cut - 40], slow, z[cut + 40 :]])
    found = find_stances(np.arange(len(both)) / 100, both)
    near = (found.time_s > time[cut - 40]) & (found.time_s < time[cut - 40] + 2.0)
    assert not near.any()
    assert found.rejected[NO_BOUNCE] == 1
    assert found.rejected[NO_STANCE] == 2


def test_no_heights_give_no_stances():
    found = find_stances(np.arange(10) / 100, np.full(10, np.nan), (0.3, 0.4))
    assert len(found.time_s) == 0
    assert found.pairs.shape == (0, 2)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32), share=st.floats(0, 0.6))
def test_holes_anywhere_invent_no_pair(seed, share):
    hopper = steered()
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    length = int(rng.integers(1, 40))
    gone = np.repeat(rng.random(1 + len(hopper.middle) // length) < share, length)
    z = np.where(gone[: len(hopper.middle)], np.nan, heights(hopper))
    found = find_stances(hopper.recording.time, z, (0.35, 0.38))
    landings = as_landings(found.time_s, hopper, within=0.1)
    assert (np.diff(landings) > 0).all()
    true = {tuple(pair) for pair in true_pairs(hopper).tolist()}
    assert {tuple(pair) for pair in landings[found.pairs].tolist()} <= true


@settings(max_examples=60, deadline=None)
@given(
    height=st.lists(
        st.one_of(st.floats(0, 1), st.floats(allow_nan=True, allow_infinity=True)), max_size=60
    )
)
def test_whatever_comes_the_answer_is_consistent(height):
    z = np.array(height)
    with np.errstate(over="ignore", invalid="ignore"):
        found = find_stances(np.arange(len(z)) / 100, z, (0.35, 0.38))
    assert (np.diff(found.time_s) > 0).all()
    assert (np.diff(found.pairs, axis=1) == 1).all()
    assert len(found.height_m) == len(found.frame) == len(found.bridged) == len(found.time_s)


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


def test_the_lowest_point_lies_between_frames_and_is_no_maximum():
    t = np.arange(0, 1, 0.01)
    assert local_fit(t, (t - 0.503) ** 2, 0.45, 0.55, degree=3).lowest() == pytest.approx(0.503)
    assert local_fit(t, -((t - 0.503) ** 2), 0.45, 0.55, degree=2).lowest() is None
    assert local_fit(t, t, 0.45, 0.55, degree=1).lowest() is None


def test_a_minimum_beyond_the_frames_is_none():
    t = np.arange(0, 1, 0.01)
    assert local_fit(t, (t - 0.6) ** 2, 0.45, 0.55, degree=2).lowest() is None


def test_too_few_frames_give_nothing():
    t = np.arange(0, 1, 0.1)
    assert local_fit(t, t, 0.41, 0.59, degree=1) is None
