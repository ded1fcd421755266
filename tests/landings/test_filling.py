from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.config.loading import load_config
from hopdata.landings.filling import (
    TOO_MUCH_FILLED,
    fill_gaps,
    filled_table,
    learn_shape,
    mark_filled,
    noise_gain,
    rigid_places,
)
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.importing import import_recording
from hopdata.recordings.readers.hdf5 import read_recording, write_recording
from hopdata.rigid import rigid_fit

HEIGHTS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}


@pytest.fixture(scope="module")
def scene():
    return simulate(60, body=5, seed=3)


@pytest.fixture(scope="module")
def gappy(scene):
    """Return the scene with gaps of 6 frames in body markers and feet."""
    rng = np.random.default_rng(4)
    positions = scene.recording.positions.copy()
    for marker in range(positions.shape[1]):
        for start in rng.integers(0, len(positions) - 6, 40):
            positions[start : start + 6, marker] = np.nan
    return replace(scene.recording, positions=positions)


def test_fills_body_markers_alone_and_marks_what_it_fills(scene, gappy):
    done = fill_gaps(gappy, longest_s=0.2)
    was, now = (np.isfinite(r.positions).all(axis=2) for r in (gappy, done))
    np.testing.assert_array_equal(done.filled, now & ~was)
    np.testing.assert_array_equal(done.positions[was], gappy.positions[was])
    assert not done.filled[:, done.indices("foot")].any()
    error = (done.positions - scene.clean.positions)[done.filled]
    assert len(error) > 50
    assert np.sqrt(np.mean(error**2)) < 1.5 * 0.0006
    assert gappy.filled is None


def test_a_marker_that_fell_off_is_placed_to_the_end(scene):
    markers = {"body": ["body1", "body2", "body3"], "feet": ["foot1", "foot2"]}
    keys = {"study": "x", "recordings": [{"name": "x"}], "markers": markers}
    options = load_config({**keys, "filling": {"longest_s": 3600}})["filling"]
    positions = scene.recording.positions.copy()
    positions[len(positions) // 2 :, 0] = np.nan
    done = fill_gaps(
        replace(scene.recording, positions=positions), longest_s=options["longest_s"]
    )
    error = (done.positions - scene.clean.positions)[len(positions) // 2 :, 0]
    assert np.sqrt(np.mean(error**2)) < 1.5 * 0.0006


def test_gaps_longer_than_asked_for_stay(gappy):
    positions = gappy.positions.copy()
    positions[100:112, 0] = np.nan
    done = fill_gaps(replace(gappy, positions=positions), longest_s=0.11)
    assert not done.filled[100:112, 0].any()
    assert done.filled.any()
    assert not fill_gaps(gappy, longest_s=0.0).filled.any()


def test_three_body_markers_are_not_filled_from_two():
    recording = simulate(10, seed=5).recording
    recording.positions[50:55, 0] = np.nan
    assert not fill_gaps(recording, longest_s=0.2).filled.any()


def test_every_missing_place_is_counted(gappy):
    before = filled_table([gappy]).set_index("marker")
    after = filled_table([fill_gaps(gappy, longest_s=0.2)]).set_index("marker")
    unseen = np.isnan(gappy.positions).any(axis=2)
    np.testing.assert_array_equal(before["missing"], unseen.sum(axis=0))
    for column in ("gaps", "longest_s", "missing"):
        pd.testing.assert_series_equal(before[column], after[column])
    assert (before["filled"] == 0).all()
    assert (after["missing"] == after["filled"] + after["left"]).all()
    assert (after.loc[after["role"] == "foot", "filled"] == 0).all()
    assert after.loc[after["role"] == "body", "filled"].sum() > 500


def test_wins_touchdowns_and_their_states_are_as_good_as_seen_ones(scene, gappy):
    done = fill_gaps(gappy, longest_s=0.2)
    tables = [touchdown_table(r, **HEIGHTS) for r in (gappy, done)]
    pairs = [
        assemble_pairs([r], t, **HEIGHTS)
        for r, t in zip((gappy, done), tables, strict=True)
    ]
    assert len(pairs[1]) > 1.5 * len(pairs[0])
    clean = assemble_pairs([scene.clean], tables[1], **HEIGHTS)
    share = mark_filled(done, tables[1]).set_index("touchdown")["filled_share"]
    found, at, _ = np.intersect1d(
        pairs[1].touchdown, clean.touchdown, return_indices=True
    )
    rows = np.searchsorted(clean.touchdown, found)
    error = np.sqrt(((pairs[1].x[at, :15] - clean.x[rows, :15]) ** 2).mean(axis=1))
    rests = share.loc[found].to_numpy() > 0
    assert rests.sum() > 20
    assert np.median(error[rests]) < 1.5 * np.median(error[~rests])


def test_touchdowns_that_rest_on_filled_places_are_told_and_may_be_left_out(gappy):
    done = fill_gaps(gappy, longest_s=0.2)
    table = touchdown_table(done, **HEIGHTS)
    told = mark_filled(done, table)
    pd.testing.assert_frame_equal(told.drop(columns="filled_share"), table)
    row = told[told["filled_share"] > 0].iloc[0]
    reach_s = 0.22 * done.time_scale
    after_begin = done.time >= row["t_pre_s"] - reach_s
    frames = after_begin & (done.time < row["t_post_s"] + reach_s)
    body = done.filled[:, done.indices("body")]
    assert row["filled_share"] == pytest.approx(body[frames].mean())
    strict = mark_filled(done, table, largest_share=0.0)
    out = (told["filled_share"] > 0) & ~table["excluded"]
    assert out.any()
    assert (strict.loc[out, "reason"] == TOO_MUCH_FILLED).all()
    assert strict.loc[out, "excluded"].all()
    pd.testing.assert_frame_equal(strict[~out], told[~out])


def test_a_part_of_a_recording_keeps_its_marks(gappy):
    done = fill_gaps(gappy, longest_s=0.2)
    half = done.part(slice(1000, None))
    np.testing.assert_array_equal(half.filled, done.filled[1000:])
    np.testing.assert_array_equal(half.positions, done.positions[1000:])
    assert half.time[0] == done.time[1000]
    assert gappy.part(slice(10)).filled is None


def test_without_filling_the_table_stays_as_it_is(gappy):
    table = touchdown_table(gappy, **HEIGHTS)
    assert mark_filled(gappy, table) is table


def test_the_mask_goes_through_a_file_and_is_not_taken_for_seen(gappy, tmp_path):
    done = fill_gaps(gappy, longest_s=0.2)
    path = tmp_path / "filled.h5"
    write_recording(path, done)
    np.testing.assert_array_equal(read_recording(path).filled, done.filled)
    markers = {"body": done.names("body"), "feet": done.names("foot")}
    again, _ = import_recording(path, name="again", markers=markers)
    np.testing.assert_array_equal(np.isnan(again.positions), np.isnan(gappy.positions))
    write_recording(path, gappy)
    assert read_recording(path).filled is None


POINTS = np.array(
    [
        [0.13, 0.03, 0.05],
        [-0.08, 0.11, 0.075],
        [-0.07, -0.14, 0.055],
        [0.02, -0.05, 0.1],
    ]
)
NOISE_M = 0.0006


def rotations(rng, n):
    q, r = np.linalg.qr(rng.standard_normal((n, 3, 3)))
    q *= np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    q[:, :, 2] *= np.linalg.det(q)[:, None]
    return q


def tumbling(n=400, noise_m=NOISE_M, points=POINTS, seed=0):
    """Return a rigid body at any place and attitude, (N, B, 3), and the same without noise."""
    rng = np.random.default_rng(seed)
    true = np.einsum("nij,bj->nbi", rotations(rng, n), points) + rng.uniform(
        -1, 1, (n, 1, 3)
    )
    return true + noise_m * rng.standard_normal(true.shape), true


def test_learns_the_shape_and_the_noise():
    body, _ = tumbling(2000)
    shape = learn_shape(body)
    fit = rigid_fit(POINTS[None], shape.points)
    laid = shape.points @ fit.rotation[0].T + fit.centre
    np.testing.assert_allclose(laid, POINTS, atol=5 * NOISE_M / 40)
    assert shape.misfit_m == pytest.approx(NOISE_M, rel=0.1)


@pytest.mark.parametrize("noise_m", [0.0, NOISE_M])
def test_places_are_as_far_off_as_the_noise_and_the_geometry_say(noise_m):
    body, true = tumbling(4000, noise_m)
    shape = learn_shape(body)
    wanted = np.zeros(body.shape[:2], bool)
    wanted[::2, 3] = True
    body[wanted] = np.nan
    places = rigid_places(body, wanted, shape)
    np.testing.assert_array_equal(np.isfinite(places).all(axis=2), wanted)
    error = (places - true)[wanted]
    if noise_m == 0:
        assert np.abs(error).max() < 1e-12
    else:
        gain = noise_gain(shape.points[:3], shape.points[3])
        worst = np.sqrt((error**2).sum(axis=1).mean())
        assert gain * noise_m < worst < np.sqrt(3) * gain * noise_m


def test_what_is_not_wanted_or_not_sure_is_not_placed():
    body, _ = tumbling()
    shape = learn_shape(body)
    body[:10, 3] = np.nan
    body[10:20, 2:] = np.nan
    body[20:30, 3] = np.nan
    body[20:30, 1] += [0.0, 0.0, 0.02]  # does not fit the shape
    wanted = np.isnan(body[..., 0])
    wanted[:5] = False
    found = np.isfinite(rigid_places(body, wanted, shape)).all(axis=2)
    assert found[5:10, 3].all()
    assert found.sum() == 5


def test_markers_in_a_line_tell_no_attitude():
    line = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]])
    assert noise_gain(line, np.array([0.1, 0.1, 0.0])) == np.inf
    body, _ = tumbling(points=np.vstack([line, [[0.1, 0.1, 0.0]]]))
    shape = learn_shape(body)
    body[:10, 3] = np.nan
    assert np.isnan(rigid_places(body, np.isnan(body[..., 0]), shape)).all()


def test_the_gain_in_the_middle_of_a_triangle_is_that_of_a_mean():
    corners = np.array([[1.0, 0, 0], [-0.5, 0.75**0.5, 0], [-0.5, -(0.75**0.5), 0]])
    assert noise_gain(corners, np.zeros(3)) == pytest.approx(1 / np.sqrt(3))


def test_needs_four_markers_and_frames_with_all_of_them():
    body, _ = tumbling()
    assert learn_shape(body[:, :3]) is None
    body[19:, 0] = np.nan
    assert learn_shape(body) is None
