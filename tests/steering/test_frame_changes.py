"""Frame changes of a recording: geometry, history, and which are unused and why."""

import numpy as np
import pytest
from steered_hops import chained_hops

from hopdata.errors import RecordingError
from hopdata.jobs import read_table, write_table
from hopdata.rigid import composed
from hopdata.steering.frame_changes import (
    FAR_SWING,
    NO_BOOM,
    TILTED,
    UPRIGHT_RAD,
    StanceStates,
    frame_changes,
    from_table,
)
from hopdata.steering.strides import NO_POSE, USED, joined, to_table

RATE = 100.0
STANCES = np.arange(10, 310, 60)
PAIRS = np.column_stack([STANCES[:-1], STANCES[1:]])
SWINGS = np.array([0.5, -0.8, 1.0, 0.3])
CHANGES = np.array(
    [[0.05, 0.01, 0.1], [0.02, -0.03, -0.2], [0.08, 0.0, 3.0], [0.03, 0.02, 0.4]]
)


def motion(first_boom=6.0):
    """Return poses and boom angles of frames; both change half-way between the stances."""
    stances = [np.array([0.4, -0.2, 2.9])]
    for change in CHANGES:
        stances.append(composed(stances[-1], change))
    which = np.clip((np.arange(320) - 10 + 30) // 60, 0, 4)
    booms = first_boom + np.append(0.0, np.cumsum(SWINGS))
    return np.array(stances)[which], booms[which]


def collected(poses, booms, pairs=PAIRS, **options):
    frames, stances = np.unique(pairs, return_inverse=True)
    options = {"swing_limit_rad": 1.2} | options
    return frame_changes(
        states(poses, booms, frames, stances.reshape(-1, 2)), **options
    )


def states(poses, booms, frames, pairs, tilt_rad=np.nan):
    tilts = np.broadcast_to(tilt_rad, len(frames))
    return StanceStates(
        frames / RATE, poses[frames], booms[frames], np.asarray(pairs), tilts
    )


def test_swings_and_changes_are_those_that_were_made():
    found = collected(*motion(), recording="a")
    np.testing.assert_allclose(found.change, CHANGES, atol=1e-12)
    np.testing.assert_allclose(found.swing_rad, SWINGS, atol=1e-12)
    booms = (6.0 + np.append(0.0, np.cumsum(SWINGS[:-1]))) % (2 * np.pi)
    np.testing.assert_allclose(found.boom_angle_rad, booms, atol=1e-12)
    assert found.time_s.tolist() == [0.1, 0.7, 1.3, 1.9]
    assert set(found.recording) == {"a"}
    assert found.excluded() == {}


def test_stances_that_do_not_exist_are_an_error():
    poses, booms = motion()
    with pytest.raises(IndexError):
        frame_changes(states(poses, booms, STANCES, [[0, 5]]), swing_limit_rad=1.2)


def test_wrapped_boom_angles_are_the_same():
    poses, booms = motion()
    wrapped = (booms + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(
        collected(poses, wrapped).swing_rad,
        collected(poses, booms).swing_rad,
        atol=1e-12,
    )


def test_what_is_not_used_is_counted_by_reason():
    poses, booms = motion()
    poses[PAIRS[0, 0]] = np.nan
    booms[PAIRS[3, 1]] = np.nan
    found = collected(poses, booms)
    assert found.reason.tolist() == [NO_POSE, "", "", NO_BOOM]
    assert found.excluded() == {NO_BOOM: 1, NO_POSE: 1}
    assert len(found.used()) == 2


def test_a_robot_that_tips_over_is_not_used():
    poses, booms = motion()
    numbers = np.column_stack([np.arange(4), np.arange(1, 5)])
    booms = np.where(np.arange(320) == STANCES[4], np.nan, booms)
    tilts = [0.05, 0.1, np.nan, 0.1, UPRIGHT_RAD + 0.01]
    found = frame_changes(
        states(poses, booms, STANCES, numbers, tilts), swing_limit_rad=1.2
    )
    assert found.reason.tolist() == [USED, USED, USED, TILTED]
    assert found.excluded() == {TILTED: 1}


def test_a_swing_beyond_the_limit_is_not_used():
    found = collected(*motion(), swing_limit_rad=0.9)
    assert found.excluded() == {FAR_SWING: 1}
    assert found.reason[2] == FAR_SWING


def test_no_pairs_make_an_empty_table():
    found = collected(*motion(), pairs=np.zeros((0, 2), dtype=int))
    assert len(found) == 0
    assert found.excluded() == {}


def test_a_table_comes_back_from_its_file(tmp_path):
    poses, booms = motion()
    poses[PAIRS[0, 0]] = np.nan
    both = joined(
        [collected(poses, booms, recording="a"), collected(*motion(), recording="b")]
    )
    write_table(tmp_path / "hops.csv", to_table(both))
    back = from_table(read_table(tmp_path / "hops.csv"))
    assert back.reason.tolist() == both.reason.tolist()
    assert back.recording.tolist() == ["a"] * 4 + ["b"] * 4
    np.testing.assert_allclose(back.change, both.change, rtol=1e-8, atol=1e-9)


def test_a_table_without_a_column_is_an_error():
    table = to_table(chained_hops(3)).drop(columns="swing_rad")
    with pytest.raises(RecordingError, match="missing swing_rad"):
        from_table(table)
