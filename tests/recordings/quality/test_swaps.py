"""Exchanged names, by the tracks of the markers."""

import numpy as np

from hopdata.recordings.quality.surprises import surprises
from hopdata.recordings.quality.swaps import exchanges

N_MARKERS = 16


def wheel(n_frames=60):
    """Return markers on a rim that turns by their distance in every frame."""
    frames = np.arange(n_frames)[:, None]
    angle = 2 * np.pi * (frames + np.arange(N_MARKERS)) / N_MARKERS
    return 0.05 * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=2)


def found_in(positions):
    return list(exchanges(positions, surprises(positions), rate_hz=100.0))


def test_markers_that_come_to_one_another_s_places_smoothly_exchange_nothing():
    """Each of them fits the track of the next one better than its own, if that rests."""
    assert found_in(wheel()) == []


def test_an_exchange_among_them_is_found_with_its_frames():
    positions = wheel()
    positions[20:40, [0, 8]] = positions[20:40, [8, 0]]
    assert found_in(positions) == [((0, 8), 20), ((0, 8), 40)]


def test_an_exchange_in_a_gap_is_found_at_its_end():
    walk = 0.002 * np.arange(60.0)[:, None, None] * [1.0, 0.0, 0.0]
    positions = walk + np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.4]])
    positions[15:20, :2] = np.nan
    assert found_in(positions) == []
    positions[20:, [0, 1]] = positions[20:, [1, 0]]
    assert found_in(positions) == [((0, 1), 20)]
