"""The home frame: its definition and its invariances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

from hopdata.errors import AnalysisError
from hopdata.landings.states.home_frames import home_frames, track_means

TIME = np.arange(40) / 100


def body(seed=0):
    rng = np.random.default_rng(seed)
    corners = np.array([[0.1, 0.0, 0.3], [-0.05, 0.09, 0.31], [-0.05, -0.09, 0.29]])
    drift = TIME[:, None, None] * [0.2, -0.1, -1.0]
    return corners + drift + rng.normal(0, 0.001, (len(TIME), 3, 3))


def test_mean_of_a_line_does_not_depend_on_the_frames():
    tracks = (TIME[:, None, None] * [0.2, -3.0]) + 1.0
    begin, end = np.array([0.1, 0.1234]), np.array([0.2, 0.1711])
    means = track_means(TIME, tracks, begin, end)
    expected = 1.0 + 0.5 * (begin + end)[:, None] * [0.2, -3.0]
    np.testing.assert_allclose(means[:, 0], expected, rtol=1e-14)
    tracks[12:15] = np.nan
    np.testing.assert_allclose(track_means(TIME, tracks, begin, end), means, rtol=1e-14)
    assert np.isnan(track_means(TIME, tracks * np.nan, begin, end)).all()


def test_means_are_those_of_a_spline_of_degree_one():
    generator = np.random.default_rng(8)
    time = np.arange(600) / 250
    tracks = np.cumsum(generator.normal(size=(600, 2, 3)), axis=0)
    begin = generator.uniform(0.0, 2.0, 50)
    end = begin + generator.uniform(0.001, 0.3, 50)
    means = track_means(time, tracks, begin, end)
    whole = make_interp_spline(time, tracks, k=1).antiderivative()
    expected = (whole(end) - whole(begin)) / (end - begin)[:, None, None]
    np.testing.assert_allclose(means, expected, rtol=0, atol=1e-10)


def test_a_long_gap_is_not_bridged():
    track = body()
    ends = np.array([0.05]), np.array([0.25])
    track[12:15, 1] = np.nan
    assert np.isfinite(home_frames(TIME, track, *ends, marker=0).origin).all()
    track[12:16, 1] = np.nan
    assert np.isnan(home_frames(TIME, track, *ends, marker=0).origin).all()


def test_forward_may_run_between_markers():
    ends = np.array([0.05]), np.array([0.25])
    ahead = home_frames(TIME, body(), *ends, marker=0)
    behind = home_frames(TIME, body(), *ends, marker=[1, 2])
    np.testing.assert_allclose(behind.direction, -ahead.direction, atol=1e-12)
    np.testing.assert_array_equal(behind.origin, ahead.origin)


def test_origin_axis_and_heights():
    track = body()
    t_pre, t_post = np.array([0.05]), np.array([0.25])
    home = home_frames(TIME, track, t_pre, t_post, marker=1)
    means = track_means(TIME, track, t_pre, t_post)
    at_home = home.points(means)
    np.testing.assert_allclose(at_home[0, :, :2].mean(axis=0), 0.0, atol=1e-15)
    assert at_home[0, 1, 0] > 0
    assert at_home[0, 1, 1] == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_array_equal(at_home[:, :, 2], means[:, :, 2])
    turned = home.vectors(means)
    np.testing.assert_allclose(
        np.linalg.norm(turned, axis=2), np.linalg.norm(means, axis=2)
    )


@settings(max_examples=50, deadline=None)
@given(
    angle=st.floats(-10, 10),
    shift=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    marker=st.integers(0, 2),
)
def test_no_planar_rigid_motion_matters(angle, shift, marker):
    track = body()
    c, s = np.cos(angle), np.sin(angle)
    moved = track @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [*shift, 0]
    ends = np.array([0.043]), np.array([0.201])
    ours = home_frames(TIME, track, *ends, marker=marker).points(track[10:11])
    theirs = home_frames(TIME, moved, *ends, marker=marker).points(moved[10:11])
    np.testing.assert_allclose(theirs, ours, atol=1e-12, rtol=0)


def test_a_mirror_image_does_matter():
    track = body()
    ends = np.array([0.043]), np.array([0.201])
    mirrored = track * [1, -1, 1]
    ours = home_frames(TIME, track, *ends, marker=0).points(track[10:11])
    theirs = home_frames(TIME, mirrored, *ends, marker=0).points(mirrored[10:11])
    assert np.abs(theirs - ours).max() > 0.1


def test_a_marker_at_the_origin_gives_no_direction():
    track = np.tile([[0.1, 0, 0.3], [-0.1, 0, 0.3], [0.0, 0.0, 0.3]], (len(TIME), 1, 1))
    with pytest.raises(AnalysisError, match=r"home\.marker"):
        home_frames(TIME, track, np.array([0.05]), np.array([0.1]), marker=2)
