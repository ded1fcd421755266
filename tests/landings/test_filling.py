from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.errors import ConfigError
from hopdata.landings.filled_table import filled_table
from hopdata.landings.filling import TOO_MUCH_FILLED, fill_gaps, mark_filled
from hopdata.landings.pair_assembly import assemble_pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.hdf5 import read_recording, write_recording
from hopdata.recordings.importing import import_recording

HEIGHTS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}


@pytest.fixture(scope="module")
def scene():
    return simulate(60, body=5, seed=3)


@pytest.fixture(scope="module")
def gappy(scene):
    """The scene with gaps of 6 frames in body markers and feet."""
    rng = np.random.default_rng(4)
    positions = scene.recording.positions.copy()
    for marker in range(positions.shape[1]):
        for start in rng.integers(0, len(positions) - 6, 40):
            positions[start : start + 6, marker] = np.nan
    return replace(scene.recording, positions=positions)


@pytest.mark.parametrize("method", ["rigid", "cubic", "rigid_or_cubic"])
def test_fills_body_markers_alone_and_marks_what_it_fills(scene, gappy, method):
    done = fill_gaps(gappy, longest_s=0.2, method=method)
    was, now = (np.isfinite(r.positions).all(axis=2) for r in (gappy, done))
    np.testing.assert_array_equal(done.filled, now & ~was)
    np.testing.assert_array_equal(done.positions[was], gappy.positions[was])
    assert not done.filled[:, done.indices("foot")].any()
    error = (done.positions - scene.clean.positions)[done.filled]
    assert len(error) > 50
    assert np.sqrt(np.mean(error**2)) < 1.5 * 0.0006
    assert gappy.filled is None


def test_the_body_comes_first_and_the_cubic_fills_what_is_left(gappy):
    counts = {
        m: fill_gaps(gappy, longest_s=0.2, method=m).filled.sum()
        for m in ("rigid", "cubic", "rigid_or_cubic")
    }
    assert counts["cubic"] < counts["rigid"] <= counts["rigid_or_cubic"]
    rigid, both = (fill_gaps(gappy, longest_s=0.2, method=m) for m in ("rigid", "rigid_or_cubic"))
    np.testing.assert_array_equal(both.positions[rigid.filled], rigid.positions[rigid.filled])


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


def test_an_unknown_method_is_refused(gappy):
    with pytest.raises(ConfigError, match=r"filling\.method"):
        fill_gaps(gappy, method="rigd")


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
    pairs = [assemble_pairs([r], t, **HEIGHTS) for r, t in zip((gappy, done), tables, strict=True)]
    assert len(pairs[1]) > 1.5 * len(pairs[0])
    clean = assemble_pairs([scene.clean], tables[1], **HEIGHTS)
    share = mark_filled(done, tables[1]).set_index("index")["filled_share"]
    found, at, _ = np.intersect1d(pairs[1].index, clean.index, return_indices=True)
    rows = np.searchsorted(clean.index, found)
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
    frames = (done.time >= row["t_pre_s"] - 0.22) & (done.time < row["t_post_s"] + 0.22)
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
