"""What Kinetics Toolkit saves: time series in JSON in a zip file."""

import json
import tracemalloc

import numpy as np
import pytest
from qtm_files import NAMES, standing
from vendor_files import ktk, ktk_series, zipped

from hopdata.errors import RecordingError
from hopdata.foreign import budget
from hopdata.recordings.readers.formats import read_raw


def places(scale=1.0):
    positions = standing(20, scale=scale)
    positions[3:5, 1] = np.nan
    return positions


def written(tmp_path, content, name="trial.ktk.zip"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else ktk(content))
    return path


def test_a_series_of_points_is_read_with_its_events(tmp_path):
    series = ktk_series(places(), NAMES, rate=120.0, events=[("hop", 0.05)])
    found = read_raw(written(tmp_path, series))
    np.testing.assert_allclose(found.positions, places(), atol=1e-12)
    assert (found.markers, found.rate_hz, found.unit) == (NAMES, 120.0, "m")
    assert [(event.label, event.time_s) for event in found.events] == [("hop", 0.05)]


@pytest.mark.parametrize(("unit", "expected"), [("mm", "mm"), ("", "m"), ("m", "m")])
def test_the_unit_is_the_stated_one_else_m(tmp_path, unit, expected):
    scale = 1000.0 if unit == "mm" else 1.0
    found = read_raw(written(tmp_path, ktk_series(places(scale), NAMES, unit=unit)))
    assert (found.unit, found.unit_is_stated) == (expected, True)


def test_markers_are_taken_among_several_series_and_others_named(tmp_path):
    series = ktk_series(places(), NAMES)
    series["data"]["angle"] = np.zeros(20).tolist()
    other = ktk_series(places() + 1, NAMES)
    angles = {"class__": "ktk.TimeSeries", "time": [0.0], "data": {"knee": [1.0]}}
    content = {"Run1": {"Other": other, "Markers": series, "Angles": angles, "n": 3}}
    found = read_raw(written(tmp_path, content))
    np.testing.assert_allclose(found.positions, places(), atol=1e-12)
    told = {remark.code: remark.values for remark in found.remarks}
    assert told["recordings.series_read"]["others"] == "Run1.Other"
    assert told["recordings.series_left_out"]["series"] == "Run1.Angles"
    assert told["recordings.columns_left_out"]["columns"] == "angle"


def test_vectors_are_no_points(tmp_path):
    series = ktk_series(places(), NAMES)
    for rows in series["data"].values():
        for row in rows:
            row[3] = 0.0
    with pytest.raises(RecordingError, match="found time series without: one"):
        read_raw(written(tmp_path, series))


MISTAKES = {
    "no zip": (b"hop", "found: File is not a zip file; save it again"),
    "another zip": (zipped({"a.txt": "b"}), "expected a member data.json, found a.txt"),
    "no JSON": (zipped({"data.json": "{hop"}), "found: Expecting property name"),
    "no series": (
        zipped({"data.json": "[1, 2]"}),
        "expected a time series with points",
    ),
    "too deep": (
        zipped({"data.json": "[" * 100_000 + "]" * 100_000}),
        "found dictionaries or lists too deep to be one",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(tmp_path, mistake):
    content, words = MISTAKES[mistake]
    path = written(tmp_path, content)
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)


def test_two_units_and_odd_times_are_told(tmp_path):
    series = ktk_series(places(), NAMES)
    series["data_info"][NAMES[0]]["Unit"] = "mm"
    with pytest.raises(
        RecordingError, match="data_info: expected one unit, found m, mm"
    ):
        read_raw(written(tmp_path, series))
    series = ktk_series(places(), NAMES)
    series["time"][3] = "late"
    with pytest.raises(RecordingError, match="time: expected numbers, found others"):
        read_raw(written(tmp_path, series))


@pytest.mark.parametrize(
    ("text", "most_mb"), [("[" + "[]," * 4_000_000 + "1]", 90), (" " * 90_000_000, 30)]
)
def test_a_small_file_that_unpacks_to_too_much_is_refused_first(
    tmp_path, text, most_mb, monkeypatch, read_here
):
    monkeypatch.setattr(budget, "LEAST_UNPACKED", 30_000_000)
    path = written(tmp_path, zipped({"data.json": text}))
    assert path.stat().st_size < 200_000
    tracemalloc.start()
    try:
        with pytest.raises(
            RecordingError, match=f"expected at most {most_mb} MB once it is unpacked"
        ):
            read_raw(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 30e6


def test_another_zip_file_has_no_reader(tmp_path):
    path = written(tmp_path, json.dumps({}).encode(), name="other.zip")
    with pytest.raises(
        RecordingError, match=r"format: expected a file ending in .*\.ktk\.zip"
    ):
        read_raw(path)
