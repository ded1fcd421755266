"""How a floor moves, from points of feet at rest that are placed by hand."""

import numpy as np
import pytest

from hopdata.landings.floor_motion import floor_motion, motion_messages
from hopdata.landings.floor_rests import RestPoints

FRAME_S = 0.01
FRAMES = 20  # of a rest, all of it within one span
RESTS = 200


def rests(moved, on_the_floor):
    """Return rests of two feet in turn, of which only the first frames are on the floor.

    In the others the foot is in the air, by up to 2 cm, as far in all frames of a rest.
    """
    rng = np.random.default_rng(5)
    number = np.repeat(np.arange(RESTS), FRAMES)
    frame = np.tile(np.arange(FRAMES), RESTS)
    time = 0.5 * number + FRAME_S * frame
    up = np.where(frame < on_the_floor, 0.0, rng.uniform(0.0, 0.02, RESTS)[number])
    places = rng.uniform(-1.0, 1.0, (RESTS, 2))[number]
    foot = (number % 2).astype(np.int8)
    mounts = np.array([0.01, 0.03])
    height = mounts[foot] + moved(time) + up
    return RestPoints(
        points=np.column_stack([places, height]),
        foot=foot,
        time=time,
        start_m=mounts,
        let_go=np.zeros(len(time), dtype=bool),
    )


def steps(time):
    """Return a floor that sinks by 5 cm half-way."""
    return np.where(time > 0.25 * RESTS, -0.05, 0.0)


def test_a_foot_that_is_down_for_three_tenths_of_a_rest_shows_where_the_floor_is():
    """The lower quartile of its heights is on the floor; more of them are not."""
    when, moved = floor_motion(rests(steps, 6))
    assert len(when) > 0.9 * RESTS
    # The medians of three rests blur the step.
    far = np.abs(when - 0.25 * RESTS) > 2.0
    np.testing.assert_allclose(moved[far], steps(when[far]), atol=1e-3)
    blurred = floor_motion(rests(steps, 4))[1]
    assert len(blurred) == 1 or np.abs(blurred[far] - steps(when[far])).max() > 2e-3


def test_a_floor_that_stands_still_is_a_single_zero():
    when, moved = floor_motion(rests(np.zeros_like, 6))
    assert when.tolist() == moved.tolist() == [0.0]
    assert motion_messages(moved) == []


def test_its_range_is_told():
    (told,) = motion_messages(floor_motion(rests(steps, FRAMES))[1])
    assert told.values["range_mm"] == pytest.approx(50.0, rel=0.05)
