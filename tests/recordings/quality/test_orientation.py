from dataclasses import replace

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping

from hopdata.recordings.axes import rotate_up
from hopdata.recordings.quality.free_fall import free_fall
from hopdata.recordings.quality.orientation import guess_unit_and_up
from hopdata.recordings.raw import RawRecording

UNITS = {"m": 1.0, "mm": 1000.0, "cm": 100.0, "inch": 1 / 0.0254}


def raw(positions, unit="m", rate_hz=100.0):
    return RawRecording(MARKERS, np.arange(len(positions)) / rate_hz, positions, rate_hz, unit)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 1000.0])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("unit", UNITS)
def test_the_unit_is_found_by_free_fall(unit, seed, rate_hz):
    positions = UNITS[unit] * hopping(seed, rate_hz=rate_hz, noise_m=3e-4)[1]
    found, up = guess_unit_and_up(raw(positions, rate_hz=rate_hz))
    assert (found.value, up.value) == (unit, "z")
    assert found.is_sure
    assert up.is_sure
    assert "9.81" in found.reason


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_the_axis_is_found_and_turned_up(up):
    """The file's axes are those that `rotate_up` turns back, and it keeps handedness."""
    positions = hopping(1)[1]
    turn = rotate_up(np.eye(3), up)  # rows: where the file's axes go
    assert np.linalg.det(turn) == pytest.approx(1.0)
    in_file = positions @ np.linalg.inv(turn)
    assert guess_unit_and_up(raw(in_file))[1].value == up
    np.testing.assert_allclose(rotate_up(in_file, up), positions, atol=1e-12)


def walking(seed=1, n_frames=2000):
    """Feet that rest and swing, a body that rocks: nothing falls freely."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * np.arange(n_frames) / 120
    positions = np.zeros((n_frames, len(MARKERS), 3))
    positions[:, :3] = [0.0, 0.0, 0.9]
    positions[:, :3, 2] += 0.02 * np.sin(2 * phase)[:, None]
    for m, shift in ((3, 0.0), (4, np.pi), (5, 0.3)):
        swing = np.sin(phase + shift)
        positions[:, m, 0] = 0.3 * np.cos(phase + shift)
        positions[:, m, 2] = 0.1 * np.maximum(swing, 0.0) ** 2
    return positions + rng.normal(0, 5e-4, positions.shape)


def test_without_free_fall_the_floor_tells_and_the_size():
    found, up = guess_unit_and_up(raw(walking()))
    assert (up.value, up.is_sure) == ("z", True)
    assert "rest" in up.reason
    assert found.value == "m"
    assert "the format's own unit" in found.reason
    found, up = guess_unit_and_up(raw(walking()[..., [1, 2, 0]] * 1000, "mm"))
    assert (found.value, up.value) == ("mm", "y")


def test_a_unit_that_the_file_does_not_state_is_not_called_its_own():
    found, _ = guess_unit_and_up(replace(raw(walking() * 1000, "mm"), unit_is_stated=False))
    assert found.value == "mm"
    assert "usual, the file states none; the markers span" in found.reason


def test_what_cannot_be_guessed_is_said_to_be_unsure():
    drift = np.cumsum(np.random.default_rng(2).normal(0, 1e-3, (3000, 7, 3)), axis=0)
    found, up = guess_unit_and_up(raw(drift + np.arange(7)[:, None] * 0.1))
    assert not up.is_sure
    assert "only usual" in up.reason
    assert found.value == "m"


def test_what_the_user_gives_is_taken():
    found, up = guess_unit_and_up(raw(hopping(1)[1]), unit="mm", up="x")
    assert (found.value, up.value) == ("mm", "x")
    assert found.reason == up.reason == "as given"


def test_no_frames_no_fall():
    fall = free_fall(np.zeros((3, 2, 3)), 100.0)
    assert fall.share == 0.0
    assert not fall.is_clear
