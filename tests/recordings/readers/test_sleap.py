"""SLEAP's analysis files in three dimensions, HDF5 and CSV."""

import h5py
import numpy as np
import pytest
from qtm_files import NAMES, standing
from vendor_files import sleap_analysis, sleap_csv

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw

RATE = {"rate_hz": 50.0}


def places():
    positions = np.round(standing(20), 4)
    positions[3:5, 1] = np.nan
    return positions


@pytest.mark.parametrize("dims", [True, False])
def test_the_axes_of_an_analysis_file_are_told_by_dims_or_its_form(tmp_path, dims):
    path = sleap_analysis(tmp_path / "a.h5", places(), NAMES, dims=dims)
    found = read_raw(path, **RATE)
    assert (found.markers, found.rate_hz, found.unit_is_stated) == (NAMES, 50.0, False)
    np.testing.assert_array_equal(found.positions, places())


def test_animals_have_their_names(tmp_path):
    tracks = ("cat", "dog")
    found = read_raw(
        sleap_analysis(tmp_path / "a.h5", places(), NAMES, tracks=tracks), **RATE
    )
    assert found.markers[0] == f"cat {NAMES[0]}"
    assert found.markers[-1] == f"dog {NAMES[-1]}"
    np.testing.assert_array_equal(found.positions[:, : len(NAMES)], places())


def test_points_with_low_scores_are_unseen_in_both_forms(tmp_path):
    scores = np.full(places().shape[:2], 0.9)
    scores[10:12, 0] = 0.2
    expected = places()
    expected[10:12, 0] = np.nan
    path = sleap_analysis(tmp_path / "a.h5", places(), NAMES, scores=scores)
    table = tmp_path / "a.csv"
    table.write_bytes(sleap_csv(places(), NAMES, scores=scores))
    for file in (path, table):
        found = read_raw(file, **RATE)
        np.testing.assert_allclose(found.positions, expected, atol=1e-5)
        assert "2 of 100 places have a score below 0.6" in str(found.remarks[0])


def test_rows_of_animals_become_rows_of_frames(tmp_path):
    path = tmp_path / "a.csv"
    lines = sleap_csv(places(), NAMES, tracks=("cat", "dog")).decode().splitlines()
    # The dog leaves after 5 frames; frame 8 has no row.
    kept = [
        line
        for line in lines
        if not (line.startswith("dog") and int(line.split(",")[1]) > 4)
        and not line.startswith("cat,8,")
    ]
    path.write_text("\n".join(kept) + "\n")
    found = read_raw(path, **RATE)
    assert len(found.time) == 19
    assert np.diff(found.time)[7] == pytest.approx(2 / 50)
    n = len(NAMES)
    np.testing.assert_allclose(found.positions[:8, :n], places()[:8], atol=1e-5)
    np.testing.assert_allclose(found.positions[:5, n:], places()[:5], atol=1e-5)
    assert np.isnan(found.positions[5:, n:]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.replace(".z", ".w"), "one camera's plane; triangulate"),
        (lambda t: t.replace("m1,3,", "m1,4,"), "expected one row of 'm1' in frame 4"),
        (lambda t: t.replace("m1,3,", "m1,,"), "frame_idx: expected a number"),
        (
            lambda t: t.replace("heel.y", "heel.why"),
            "expected a column heel.y, found none",
        ),
    ],
)
def test_mistakes_in_the_table_are_told(tmp_path, change, words):
    path = tmp_path / "a.csv"
    path.write_text(change(sleap_csv(places(), NAMES).decode()))
    with pytest.raises(RecordingError) as caught:
        read_raw(path, **RATE)
    assert words in str(caught.value)


def test_mistakes_in_hdf5_are_told(tmp_path):
    path = sleap_analysis(tmp_path / "a.h5", places(), NAMES, dims=True)
    with h5py.File(path, "r+") as file:
        file["tracks"].attrs["dims"] = '["track", "track", "node", "frame"]'
    with pytest.raises(RecordingError, match="attribute 'dims': expected frame, track"):
        read_raw(path, **RATE)
    scores = np.full(places().shape[:2], 0.9)
    path = sleap_analysis(tmp_path / "b.h5", places(), NAMES, scores=scores[:, :2])
    with pytest.raises(RecordingError, match=r"point_scores': expected \(20, 1, 5\)"):
        read_raw(path, **RATE)
