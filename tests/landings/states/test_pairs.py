"""Pairs: assembly, invariance, conversion, and storage in a file."""

from dataclasses import replace
from functools import cache, partial

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.errors import AnalysisError
from hopdata.landings.states.assemble import (
    STATELESS,
    assemble_pairs,
    exclude_stateless,
    farthest_marker,
)
from hopdata.landings.states.pairs import DESCRIPTIONS, read_pairs, write_pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.seal import seal_for

SECTIONS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}
SCENE = simulate(40, seed=11, body=4)
TABLE = touchdown_table(SCENE.recording, **SECTIONS)


def moved(recording, angle, shift):
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return replace(recording, positions=recording.positions @ turn + [*shift, 0])


def pairs(recording=SCENE.recording, table=TABLE, **options):
    return assemble_pairs([recording], table, **SECTIONS, **options)


def test_shape_order_and_sections():
    found = pairs(home_marker="body2")
    assert found.x.shape == found.y.shape == (40, 24)
    np.testing.assert_allclose(
        found.x[:, 2:12:3].mean(axis=1), PRE_HEIGHT_M, atol=1e-12
    )
    np.testing.assert_allclose(
        found.y[:, 2:12:3].mean(axis=1), POST_HEIGHT_M, atol=1e-12
    )
    assert (found.x[:, 14:24:3].mean(axis=1) < -1.5).all()
    along = np.hypot(found.x[:, 3], found.x[:, 4])
    assert (found.x[:, 3] > 0.99 * along).all()  # body2 lies on the x axis, on average
    np.testing.assert_array_equal(found.schedule, TABLE["schedule"])
    assert found.body_markers == ("body1", "body2", "body3", "body4")


def test_ambiguous_touchdowns_can_serve_without_a_schedule():
    doubtful = TABLE.assign(
        **{"order_class": TABLE["schedule"].where(TABLE.index % 5 != 0, "ambiguous")}
    )
    kept, pooled = pairs(table=doubtful), pairs(table=doubtful, ambiguous="pool")
    np.testing.assert_array_equal(kept.schedule, TABLE["schedule"])
    np.testing.assert_array_equal(pooled.schedule == "", TABLE.index % 5 == 0)
    np.testing.assert_array_equal(pooled.x, kept.x)


@cache
def unmoved(method):
    return pairs(method=method)


@pytest.mark.parametrize("method", ["split_fit", "savitzky_golay"])
@settings(max_examples=15, deadline=None)
@given(angle=st.floats(-7, 7), shift=st.tuples(st.floats(-1, 1), st.floats(-1, 1)))
def test_no_planar_rigid_motion_matters(method, angle, shift):
    ours = unmoved(method)
    theirs = pairs(moved(SCENE.recording, angle, shift), method=method)
    np.testing.assert_allclose(theirs.x, ours.x, atol=1e-12, rtol=0)
    np.testing.assert_allclose(theirs.y, ours.y, atol=1e-12, rtol=0)
    np.testing.assert_allclose(theirs.feet, ours.feet, atol=1e-10, rtol=0)
    np.testing.assert_allclose(theirs.feet_se, ours.feet_se, rtol=1e-6)


def test_a_tilt_does_matter():
    tilt = np.array(
        [[1, 0, 0], [0, np.cos(0.05), np.sin(0.05)], [0, -np.sin(0.05), np.cos(0.05)]]
    )
    leaning = replace(SCENE.recording, positions=SCENE.recording.positions @ tilt)
    assert np.nanmax(np.abs(pairs(leaning).x - pairs().x)) > 1e-3


def test_units_and_back():
    raw = pairs()
    other = raw.with_units(0.02913, 0.027)
    x, y = other.normalised()
    np.testing.assert_allclose(x[:, :12], raw.x[:, :12] / 0.02913)
    np.testing.assert_allclose(y[:, 12:], raw.y[:, 12:] / (0.02913 / 0.027))
    assert np.array_equal(other.y, raw.y), "the states stay in metres and seconds"
    assert np.array_equal(raw.normalised()[1], raw.y)
    assert (other.length_unit_m, other.time_unit_s) == (0.02913, 0.027)


def test_only_used_touchdowns_of_all_recordings():
    second = replace(simulate(20, seed=12, body=4).recording, name="second")
    table = touchdown_table(second, **SECTIONS)
    table.loc[3, "excluded"] = True
    import pandas as pd

    both = pd.concat([TABLE, table])
    found = assemble_pairs([SCENE.recording, second], both, **SECTIONS)
    assert len(found) == 59
    assert found.recording.tolist() == ["second"] * 19 + ["synthetic"] * 40
    assert 4 not in found.touchdown[:19]
    same = assemble_pairs([second, SCENE.recording], both, **SECTIONS)
    np.testing.assert_array_equal(same.x, found.x)


def test_feet_are_in_the_home_frame_with_their_errors():
    found = pairs(home_marker="body2")
    quiet = pairs(SCENE.clean, home_marker="body2")
    assert found.feet.shape == found.feet_se.shape == (40, 3, 3)
    # Above the floor by what the body still has to fall.
    assert (found.feet[:, :, 2] > 0.01).all()
    assert (found.feet_se < 0.002).all()
    # The home frame's own error, common to both sections, is of the size of the noise.
    apart = found.feet[:, :, 2] - quiet.feet[:, :, 2]
    score = apart / found.feet_se[:, :, 2]
    assert np.sqrt(np.mean(score**2)) == pytest.approx(1.0, abs=0.25)
    # Feet are as far apart as in the body, whose tilt is small.
    sides = np.linalg.norm(np.diff(quiet.feet[:, [0, 1, 2, 0]], axis=1), axis=2)
    np.testing.assert_allclose(sides, 0.38 * np.sqrt(3), atol=0.01)


def test_a_foot_that_is_not_seen_in_flight_leaves_the_rest():
    positions = SCENE.recording.positions.copy()
    hidden = SCENE.recording.markers.index(SCENE.recording.names("foot")[1])
    crossing = TABLE["t_pre_s"].iloc[5]
    near = np.abs(SCENE.recording.time - crossing) < 0.25
    positions[near, hidden] = np.nan
    found = pairs(replace(SCENE.recording, positions=positions))
    is_missing = np.isnan(found.feet).any(axis=2)
    assert is_missing[5, 1]
    assert is_missing.sum() == 1
    apart = np.abs(found.feet - pairs().feet) / pairs().feet_se
    assert (apart[~is_missing] < 1).all()
    np.testing.assert_allclose(found.x, pairs().x, atol=1e-12)


def test_feet_stand_in_the_order_of_their_contacts():
    """The table's columns have an order of their own."""
    names = SCENE.recording.names("foot")
    columns = [name for name in TABLE if name.startswith(("contact_", "se_"))]
    others = [name for name in TABLE if name not in columns]
    found = pairs(table=TABLE[[*others, *columns[::-1]]])
    assert len(names) == 3
    np.testing.assert_array_equal(found.instants, pairs().instants[:, ::-1])
    np.testing.assert_allclose(found.feet, pairs().feet[:, ::-1], atol=1e-12)


def three_recordings():
    import pandas as pd

    names = ["b", "a", "c"]
    recordings = [replace(SCENE.recording, name=name) for name in names]
    tables = [TABLE.assign(recording=name) for name in names]
    return recordings, pd.concat(tables)


def test_recordings_follow_one_another_unless_the_study_says_when_they_begin():
    recordings, table = three_recordings()
    long_s = np.ptp(SCENE.recording.time)
    alone = pairs().time_s
    np.testing.assert_allclose(alone, TABLE["t_pre_s"], atol=0.01)
    found = assemble_pairs(recordings, table, **SECTIONS)
    expected = [alone, alone + long_s, alone + 2 * long_s]
    np.testing.assert_allclose(found.time_s, np.concatenate(expected), atol=1e-9)
    begins_s = {"a": 100.0, "b": None, "c": 5.0}
    found = assemble_pairs(recordings, table, **SECTIONS, begins_s=begins_s)
    since = alone - SCENE.recording.time[0]
    expected = [since + 100.0, since + 100.0 + long_s, since + 5.0]
    np.testing.assert_allclose(found.time_s, np.concatenate(expected), atol=1e-9)


def test_a_block_is_a_recording_or_what_the_study_says():
    recordings, table = three_recordings()
    found = assemble_pairs(recordings, table, **SECTIONS)
    np.testing.assert_array_equal(found.blocks({}), found.recording)
    labels = {"a": "sand", "b": "mat", "c": "sand"}
    blocks = found.blocks(labels)
    np.testing.assert_array_equal(blocks == "mat", found.recording == "b")
    assert found.blocks(dict.fromkeys("abc", "sand")) is None
    assert pairs().blocks({}) is None


def test_the_default_home_marker_is_the_farthest_in_any_order_of_markers():
    one = SCENE.recording
    assert farthest_marker([one]) == "body1"  # all are equally far but for noise
    middle = one.body.mean(axis=1)
    longer = one.positions.copy()
    longer[:, 2] = middle + 1.3 * (longer[:, 2] - middle)
    far = replace(one, positions=longer)
    columns = [2, 5, 0, 3, 6, 1, 4]
    other = replace(
        far,
        positions=longer[:, columns],
        markers=tuple(one.markers[k] for k in columns),
        roles=tuple(one.roles[k] for k in columns),
    )
    assert farthest_marker([far]) == farthest_marker([other]) == "body3"
    assert farthest_marker([one, far]) == farthest_marker([other, one]) == "body3"
    np.testing.assert_array_equal(pairs(far).x, pairs(far, home_marker="body3").x)


def test_a_state_without_frames_is_left_out_and_logged(caplog):
    caplog.set_level("INFO", "hopdata")
    positions = SCENE.recording.positions.copy()
    at = np.searchsorted(SCENE.recording.time, TABLE["t_pre_s"].iloc[5])
    positions[at - 40 : at + 4, 1] = np.nan
    found = pairs(replace(SCENE.recording, positions=positions))
    assert 6 not in found.touchdown
    assert len(found) == 39
    at_s = TABLE["t_pre_s"].iloc[5]
    assert (
        f"too few frames of the body markers for states at {at_s:.2f} s" in caplog.text
    )
    marked = exclude_stateless(TABLE, found)
    assert marked.loc[marked["excluded"], "touchdown"].tolist() == [6]
    assert marked.loc[5, "reason"] == STATELESS
    assert not exclude_stateless(TABLE, pairs())["excluded"].any()
    assert {r.levelname for r in caplog.records} == {"INFO"}, (
        "the table has the reason; no terminal needs it"
    )


def test_file_round_trip(tmp_path):
    ours = pairs().with_units(0.03, 0.02)
    path = tmp_path / "maps" / "pairs.h5"
    write_pairs(path, ours)
    theirs = read_pairs(path)
    assert ours.instants.shape == ours.instants_se.shape == (len(ours), 3)
    assert ours.feet.shape == (len(ours), 3, 3)
    for name in DESCRIPTIONS:
        np.testing.assert_array_equal(getattr(theirs, name), getattr(ours, name))
    import h5py

    with h5py.File(path) as file:
        assert all(file[name].attrs["description"] for name in file)
    assert theirs.body_markers == ours.body_markers
    assert (theirs.length_unit_m, theirs.time_unit_s) == (0.03, 0.02)
    assert [p.name for p in path.parent.iterdir()] == ["pairs.h5"]


def test_files_are_written_and_read_without_locks(tmp_path, monkeypatch):
    """File systems of clusters may have none."""
    import h5py

    asked = []

    def noting(path, mode, **options):
        asked.append((mode, options["locking"]))
        return opened(path, mode, **options)

    opened = h5py.File
    monkeypatch.setattr(h5py, "File", noting)
    write_pairs(tmp_path / "pairs.h5", pairs())
    read_pairs(tmp_path / "pairs.h5")
    assert asked == [("w", False), ("r", False)]


def test_a_file_may_have_no_standard_errors(tmp_path):
    without = replace(pairs(), x_se=None, y_se=None, feet=None, feet_se=None)
    write_pairs(tmp_path / "pairs.h5", without)
    theirs = read_pairs(tmp_path / "pairs.h5")
    assert theirs.x_se is theirs.y_se is None
    assert theirs.feet is theirs.feet_se is None


def test_standard_errors_are_those_of_the_states():
    scene = simulate(150, seed=13)
    table = touchdown_table(scene.recording, **SECTIONS)
    noisy, quiet = (pairs(one, table) for one in (scene.recording, scene.clean))
    for name in ("x", "y"):
        error = getattr(noisy, name) - getattr(quiet, name)
        score = (
            error[:, 12:] / getattr(noisy, f"{name}_se")[:, 12:]
        )  # the home frame shifts places
        assert np.mean(score**2) == pytest.approx(1.0, abs=0.25)
        assert 0.63 < np.mean(np.abs(score) < 1) < 0.76


@pytest.mark.parametrize("angle", [0.7, 2.0])
def test_standard_errors_turn_with_the_home_frame(angle):
    theirs = pairs(moved(SCENE.recording, angle, (0.3, -0.2)))
    np.testing.assert_allclose(theirs.x_se, pairs().x_se, rtol=1e-9)
    np.testing.assert_allclose(theirs.y_se, pairs().y_se, rtol=1e-9)


def test_mistakes_are_named(tmp_path):
    with pytest.raises(AnalysisError, match="found none"):
        pairs(table=TABLE.assign(excluded=True))
    with pytest.raises(
        AnalysisError, match=r"none\.h5: not a file of pairs: .*No such file"
    ):
        read_pairs(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("not HDF5")
    with pytest.raises(AnalysisError, match="not a file of pairs"):
        read_pairs(tmp_path / "text.h5")


def test_why_there_is_no_pair_is_said_of_each_recording():
    far = replace(SCENE.recording, name="far")
    poor = TABLE.assign(excluded=True, reason="poor fit of foot 1")
    with pytest.raises(AnalysisError) as caught:
        assemble_pairs(
            [SCENE.recording, far], poor, pre_height_m=9.0, post_height_m=8.0
        )
    text = str(caught.value)
    assert f"{len(TABLE)} descents, poor fit of foot 1 in {len(TABLE)}" in text
    assert (
        "far: the body never sinks through the pre section, with heights from 0."
        in text
    )
    assert "sections.pre_height_m" in text
    with pytest.raises(AnalysisError, match=": 1 descent, poor fit of foot 1 in 1"):
        assemble_pairs(
            [SCENE.recording], poor.head(1), pre_height_m=9.0, post_height_m=8.0
        )


def test_two_pairs_are_too_few_and_it_is_said_why():
    few = TABLE.copy()
    few.loc[2:, ["excluded", "reason"]] = [True, "post section never reached"]
    told = f"at least 3 usable .* found 2 .*{len(TABLE)} descents, post section never reached in "
    with pytest.raises(AnalysisError, match=told):
        pairs(table=few)


def test_a_flipped_bit_in_a_file_of_pairs_is_noticed(tmp_path):
    path = tmp_path / "pairs.h5"
    write_pairs(path, pairs())
    whole = path.read_bytes()
    for place in range(0, len(whole), len(whole) // 50):
        damaged = bytearray(whole)
        damaged[place] ^= 8
        path.write_bytes(damaged)
        with pytest.raises(AnalysisError, match="not a file of pairs: it is damaged"):
            read_pairs(path)
    path.write_bytes(whole[: -len(seal_for(path))])  # as older versions wrote it
    assert len(read_pairs(path).x) == 40


def _without(name, file):
    del file[name]


def _huge(file):
    del file["spread_s"]
    file.create_dataset("spread_s", (1 << 40,), "f8", chunks=(1 << 10,))


def _short(file):
    rows = file["touchdown"][:-1]
    del file["touchdown"]
    file["touchdown"] = rows


def _of_texts(file):
    n = len(file["x"])
    del file["x"]
    file["x"] = np.full((n, 24), b"1.5")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (partial(_without, "x"), "'x'"),
        (
            lambda file: file.move("x", "y2") or file.create_group("x"),
            "x is no dataset",
        ),
        (_huge, "more numbers than the file has bytes"),
        (_short, r"rows of touchdown, not \d+"),
        (_of_texts, "x has no numbers"),
        (lambda file: file.attrs.pop("body_markers"), "body_markers"),
    ],
)
def test_a_file_that_others_changed_is_read_or_refused(tmp_path, change, words):
    path = tmp_path / "pairs.h5"
    whole = pairs()
    write_pairs(path, whole)
    with h5py.File(path, "r+") as file:  # which cuts the checksum off
        file.attrs["note"] = "by hand"
    np.testing.assert_array_equal(read_pairs(path).x, whole.x)
    assert read_pairs(path).body_markers == whole.body_markers
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(AnalysisError, match=f"not a file of pairs: .*{words}"):
        read_pairs(path)
