import numpy as np

from hopdata.steering.experiments.starts import draw_starts


def starts(experiment="origin", heading="any", number=30, seed=7):
    return draw_starts(experiment, heading, number, distance_m=1.0, seed=seed)


def test_starts_lie_at_the_distance_in_all_directions():
    poses = np.array([start.pose for start in starts()])
    np.testing.assert_allclose(np.hypot(poses[:, 0], poses[:, 1]), 1.0)
    assert len(np.unique(np.floor(np.arctan2(poses[:, 1], poses[:, 0]) / (np.pi / 2)))) == 4
    assert len(np.unique(np.floor(poses[:, 2] / (np.pi / 2)))) == 4


def test_to_face_the_origin_is_to_look_at_it():
    for start in starts(heading="facing"):
        x, y, heading = start.pose
        np.testing.assert_allclose([x + np.cos(heading), y + np.sin(heading)], 0, atol=1e-12)


def test_turns_begin_at_the_origin():
    assert all(tuple(start.pose[:2]) == (0.0, 0.0) for start in starts("turn"))


def test_more_starts_leave_the_first_ones_as_they_were():
    for few, many in zip(starts(number=5), starts(number=9), strict=False):
        np.testing.assert_array_equal(few.pose, many.pose)


def test_experiments_and_seeds_have_starts_of_their_own():
    drawn = [starts(seed=7), starts(seed=8), starts("origin_board")]
    assert len({start[0].pose.tobytes() for start in drawn}) == 3


def test_the_chance_of_a_start_is_the_same_every_time_and_apart_by_stream():
    start = starts(number=1)[0]
    first = [stream.random() for stream in start.streams()]
    assert first == [stream.random() for stream in start.streams()]
    assert len(set(first)) == 3
