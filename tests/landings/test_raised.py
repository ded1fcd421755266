import numpy as np
import pytest

from hopdata.landings.raised import raised_rests
from hopdata.landings.surface import design, polynomial_terms

NOISE_M, BAND_M = 0.0006, 0.02


def ground(n=3000, seed=0):
    """Rests of three feet all over a curved floor: heights, columns, feet and places."""
    rng = np.random.default_rng(seed)
    places, foot = rng.uniform(-1, 1, (n, 2)), np.arange(n) % 3
    contrasts = np.vstack([np.eye(2), [[-1.0, -1.0]]])
    columns = np.hstack([design(places, polynomial_terms(4)), contrasts[foot]])
    heights = (
        0.003 * places[:, 0] ** 2 - 0.002 * places[:, 1] + [0.001, 0.0, -0.001] @ np.eye(3)[:, foot]
    )
    return heights + NOISE_M * rng.standard_normal(n), columns, foot, places


def test_nothing_is_raised_on_a_clean_floor():
    heights, columns, _, _ = ground()
    assert not raised_rests(heights, columns, band_m=BAND_M).any()


@pytest.mark.parametrize("share", [0.1, 0.4, 0.7])
@pytest.mark.parametrize("height_m", [0.006, 0.015])
def test_finds_a_foot_that_hangs_low_even_more_often_than_not(share, height_m):
    heights, columns, foot, _ = ground()
    hangs = (foot == 0) & (np.arange(len(foot)) > (1 - share) * len(foot))
    heights[hangs] += height_m
    found = raised_rests(heights, columns, band_m=BAND_M)
    assert (found == hangs).mean() > 0.998


def test_finds_a_board_that_a_polynomial_could_follow():
    heights, columns, _, places = ground()
    board = np.hypot(places[:, 0] - 0.2, places[:, 1]) < 0.5
    heights[board] += 0.01
    assert board.mean() > 0.15
    assert (raised_rests(heights, columns, band_m=BAND_M) == board).mean() > 0.998


def test_a_few_are_left_to_the_regression():
    heights, columns, _, _ = ground()
    heights[:30] += 0.01
    assert not raised_rests(heights, columns, band_m=BAND_M).any()


def test_what_is_far_away_is_no_foot_at_rest():
    heights, columns, _, _ = ground()
    heights[:600] += 0.3
    found = raised_rests(heights, columns, band_m=BAND_M)
    assert not found[600:].any()


def test_too_few_points_say_nothing():
    heights, columns, _, _ = ground(n=18)
    assert not raised_rests(heights, columns, band_m=BAND_M).any()


@pytest.mark.filterwarnings("error")
def test_without_noise_it_is_silent():
    _, columns, foot, _ = ground()
    flat = np.where(foot == 0, 0.01, 0.0)
    assert not raised_rests(flat, columns, band_m=BAND_M).any()
    flat[::3][:300] += 0.01
    assert raised_rests(flat, columns, band_m=BAND_M).sum() == 300
