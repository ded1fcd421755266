"""The shares follow the definition, direction by direction."""

import numpy as np
import pytest

from hopdata.arrays import GRAVITY_M_S2
from hopdata.recordings.axes import DIRECTIONS
from hopdata.recordings.quality.free_fall import (
    UNITS_IN_M,
    WITHIN,
    shares_in_free_fall,
)


def falling(n=400, n_markers=3, seed=0):
    """Return accelerations of markers that fall along -y half the time, mm/s², some unknown."""
    rng = np.random.default_rng(seed)
    measured = 1000.0 * rng.standard_normal((n, n_markers, 3))
    measured[: n // 2, :, 1] -= 1e3 * GRAVITY_M_S2
    measured[rng.random((n, n_markers)) < 0.1] = np.nan
    measured[5, 1, 2] = np.nan
    return measured


def by_definition(measured, up):
    fall = np.zeros(3)
    fall["xyz".index(up[-1])] = GRAVITY_M_S2 if up.startswith("-") else -GRAVITY_M_S2
    shares = []
    for marker in np.moveaxis(measured, 1, 0):
        known = marker[np.isfinite(marker).all(axis=1)]
        if len(known):
            shares.append(
                np.mean(np.linalg.norm(known - fall, axis=1) < WITHIN * GRAVITY_M_S2)
            )
    return np.mean(shares) if shares else 0.0


def check(measured):
    found = {
        unit: shares_in_free_fall(measured, metres)
        for unit, metres in UNITS_IN_M.items()
    }
    for unit, metres in UNITS_IN_M.items():
        for up in DIRECTIONS:
            expected = by_definition(measured * metres, up)
            assert found[unit][up] == pytest.approx(expected, abs=1e-15)
    return found


def test_shares_are_those_of_the_definition():
    found = check(falling())
    assert found["mm"]["y"] > 0.1
    assert found["mm"]["y"] > 5 * found["mm"]["-y"]


def test_a_marker_that_is_never_seen_does_not_count():
    measured = falling()
    measured[:, 1] = np.nan
    check(measured)


def test_nothing_seen_and_no_frames_are_no_free_fall():
    assert set(check(np.full((10, 2, 3), np.nan))["m"].values()) == {0.0}
    assert set(check(np.zeros((0, 2, 3)))["m"].values()) == {0.0}


def test_infinite_numbers_are_not_seen():
    measured = falling()
    measured[7, 0, 1] = np.inf
    check(measured)
