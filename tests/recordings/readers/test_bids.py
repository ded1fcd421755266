"""Motion-BIDS files, written as the standard describes them."""

import json

import numpy as np
import pytest
from bids_files import NAME, write_bids

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw

NAMES = ("hip", "knee", "toe")
TRACK = np.random.default_rng(3).uniform(-500, 900, (30, 3, 3)).round(3)
TRACK[4:6, 1] = np.nan


@pytest.mark.parametrize("missing", ["n/a", "-999"])
@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("heads", [False, True])
def test_points_that_have_three_coordinates(tmp_path, missing, above, heads):
    file = write_bids(
        tmp_path / "motion",
        TRACK,
        NAMES,
        missing=missing,
        above=above,
        heads=heads,
        rate=250.0,
    )
    found = read_raw(file)
    assert found.markers == NAMES
    assert found.rate_hz == 250.0
    assert found.unit == "mm"
    np.testing.assert_allclose(found.positions, TRACK, atol=1e-6)
    np.testing.assert_allclose(found.time, np.arange(30) / 250, atol=1e-9)


@pytest.mark.parametrize(
    ("spatial", "up"),
    [("ALS", "z"), ("RUF", "y"), ("ALI", "-z"), ("", ""), ("AL_", "")],
)
def test_the_file_s_own_word_on_up(tmp_path, spatial, up):
    assert read_raw(write_bids(tmp_path, TRACK, NAMES, spatial=spatial)).stated_up == up


def test_the_nearer_json_holds(tmp_path):
    file = write_bids(tmp_path / "motion", TRACK, NAMES, rate=250.0, latency=False)
    for name, rate in (
        ("task-hop_motion.json", 50.0),
        ("task-walk_tracksys-x_motion.json", 7.0),
    ):
        (tmp_path / name).write_text(json.dumps({"SamplingFrequency": rate}))
    assert read_raw(file).rate_hz == 250.0
    (tmp_path / "motion" / f"{NAME}_motion.json").unlink()
    assert read_raw(file).rate_hz == 50.0


@pytest.mark.parametrize(
    ("suffix", "old", "new", "said"),
    [
        ("channels.tsv", "POS", "VEL", "expected channels of the type POS"),
        ("channels.tsv", "hip_y\ty", "hip_y\tx", "expected x of 'hip' once"),
        (
            "channels.tsv",
            "tracked_point",
            "point",
            "line 1: column: expected 'tracked_point' once",
        ),
        (
            "channels.tsv",
            "toe\tmm",
            "toe\tm",
            "expected one unit of all positions, found m, mm",
        ),
        ("channels.tsv", "\tmm", "\tft", "expected mm, cm, m or inches, found 'ft'"),
        (
            "motion.json",
            "100.0",
            '"fast"',
            "SamplingFrequency: expected a number, found 'fast'",
        ),
        ("motion.json", "100.0", "", "motion.json: expected json, found"),
        (
            "motion.tsv",
            "\t0.05000\n",
            "\tsoon\n",
            "line 6, column 11: expected a number",
        ),
        ("motion.tsv", "\t0.05000\n", "\tn/a\n", "line 6: LATENCY: expected a time"),
    ],
)
def test_faults_are_named(tmp_path, suffix, old, new, said):
    file = write_bids(tmp_path, TRACK, NAMES)
    place = tmp_path / f"{NAME}_{suffix}"
    text = place.read_text()
    assert old in text
    place.write_text(text.replace(old, new))
    with pytest.raises(RecordingError, match=said):
        read_raw(file)


def test_a_rate_that_is_not_stated_is_that_of_the_time_stamps(tmp_path):
    for latency, name in ((True, "timed"), (False, "untimed")):
        file = write_bids(tmp_path / name, TRACK, NAMES, latency=latency)
        stated = file.with_name(f"{NAME}_motion.json")
        stated.write_text(stated.read_text().replace("SamplingFrequency", "Rate"))
        if latency:
            assert read_raw(file).rate_hz == 100.0
            continue
        with pytest.raises(
            RecordingError, match=r"expected a number in the file or in input\.r"
        ):
            read_raw(file)


def test_channels_that_are_not_there(tmp_path):
    file = write_bids(tmp_path, TRACK, NAMES)
    (tmp_path / f"{NAME}_channels.tsv").unlink()
    with pytest.raises(
        RecordingError, match=r"channels\.tsv: expected a file, found none"
    ):
        read_raw(file)
