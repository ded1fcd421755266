import numpy as np
import pytest

from hopdata.landings.cubic_filling import FLANK, cubic_places, one_phase

RATE, NOISE_M = 100.0, 0.0006


def flight(n=60, feet_m=0.1):
    """One body marker on a parabola, and three feet well above the floor, seen with noise."""
    rng = np.random.default_rng(0)
    time = np.arange(n) / RATE
    track = np.stack([0.3 * time, -0.1 * time, 0.4 + 1.5 * time - 4.9 * time**2], axis=1)
    body = track[:, None] + NOISE_M * rng.standard_normal((n, 1, 3))
    feet = feet_m + NOISE_M * rng.standard_normal((n, 3))
    return time, body, feet, track


def filled(time, body, feet, start, stop, longest=20):
    body = body.copy()
    body[start:stop] = np.nan
    return cubic_places(time, body, feet, np.isnan(body[..., 0]), longest=longest)


def test_bridges_a_gap_in_flight_to_within_the_noise():
    time, body, feet, track = flight()
    places = filled(time, body, feet, 20, 30)
    np.testing.assert_array_equal(np.isfinite(places[:, 0, 0]), (time > 0.195) & (time < 0.295))
    assert np.abs(places[20:30, 0] - track[20:30]).max() < 3 * NOISE_M


def test_is_exact_for_a_cubic_without_noise():
    time, _, feet, _ = flight()
    body = np.stack([time**3, 2 - time**2, 0.4 + time - time**3], axis=1)[:, None]
    np.testing.assert_allclose(filled(time, body, feet, 20, 30)[20:30], body[20:30], atol=1e-12)


@pytest.mark.parametrize("frame", [20 - FLANK + 2, 25, 30 + FLANK - 3])
def test_never_bridges_a_contact_or_a_lift_off(frame):
    time, body, feet, _ = flight(feet_m=0.0)
    past = np.arange(len(time)) - frame
    for fall in (np.maximum(-past, 0), np.maximum(past, 0)):
        moving = feet.copy()
        moving[:, 1] += 1.0 * fall / RATE
        assert np.isnan(filled(time, body, moving, 20, 30)).all()


def test_bridges_where_all_feet_stand():
    time, body, feet, _ = flight(feet_m=0.0)
    assert np.isfinite(filled(time, body, feet, 20, 30)[20:30]).all()


def test_a_foot_unseen_may_have_touched():
    time, body, feet, _ = flight()
    feet[24, 2] = np.nan
    assert np.isnan(filled(time, body, feet, 20, 30)).all()
    assert not one_phase(feet[20:30], NOISE_M)


@pytest.mark.parametrize(("start", "stop"), [(0, 5), (57, 60), (20, 41)])
def test_neither_ends_nor_long_gaps_are_bridged(start, stop):
    time, body, feet, _ = flight()
    assert np.isnan(filled(time, body, feet, start, stop)).all()


def test_a_jump_is_not_smoothed_over():
    time, body, feet, _ = flight()
    body[25:] += [0.05, 0.0, 0.0]
    assert np.isnan(filled(time, body, feet, 20, 30)).all()


def test_flanks_must_be_whole():
    time, body, feet, _ = flight()
    body[32] = np.nan
    assert np.isnan(filled(time, body, feet, 20, 30)).all()
