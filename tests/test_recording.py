from types import SimpleNamespace

import numpy as np
import pytest

import hopdata as hd
from hopdata.errors import RecordingError
from hopdata.recording import Recording, require_distinct


def source(name, *digests):
    return SimpleNamespace(
        name=name, source=f"{name}.tsv", source_sha256=", ".join(digests)
    )


def test_different_files_and_those_without_a_file_are_distinct():
    require_distinct(
        [source("a", "1", "2"), source("b", "3"), source("c"), source("d")]
    )


@pytest.mark.parametrize(
    "recordings",
    [
        [source("a", "1", "2"), source("b", "3", "2")],
        [source("b", "2", "2")],
    ],
)
def test_the_same_bytes_under_another_name_are_refused(recordings):
    with pytest.raises(
        RecordingError,
        match=r"b\.tsv and 1 more: .* file 2 of recording 'b' .* count twice",
    ):
        require_distinct(recordings)


@pytest.mark.parametrize(
    "rate_hz", [50.0, 100.0, 119.88, 120.0, 200.0, 240.0, 250.0, 1000 / 3]
)
@pytest.mark.parametrize("written", [np.float32, np.float64, lambda t: np.round(t, 5)])
def test_the_rate_of_arrays_is_that_of_stamps_that_were_not_rounded(rate_hz, written):
    time = np.delete(np.arange(12_000) / rate_hz, [5000, 5001])
    names = ["toe", "hip1", "hip2", "hip3"]
    still = np.zeros((len(time), 4, 3))
    made = Recording.from_arrays(
        written(time), still, names, feet=names[:1], body=names[1:]
    )
    assert made.rate_hz == pytest.approx(
        rate_hz, rel=1e-12 if rate_hz % 1 == 0 else 1e-6
    )
    assert np.abs(made.time - time).max() < 2e-5


def test_what_an_array_masks_was_not_seen():
    names = ["toe", "hip1", "hip2", "hip3"]
    still = np.ma.masked_array(np.ones((20, 4, 3)), mask=False)
    still[5, 2] = np.ma.masked
    made = Recording.from_arrays(
        np.arange(20) / 100, still, names, feet=names[:1], body=names[1:]
    )
    assert np.isnan(made.positions[5, 2]).all()
    assert np.isnan(made.positions).sum() == 3
    assert type(made.positions) is np.ndarray


def standing(seen=True):
    time = np.arange(5) / 100
    positions = np.ones((5, 2, 3))
    if not seen:
        positions[2, 1] = np.nan
    return Recording.from_arrays(time, positions, ["toe", "hip"], feet=["toe"])


def test_recordings_are_equal_if_all_is_the_same(tmp_path):
    recording = standing(seen=False)
    assert recording == standing(seen=False)
    assert recording != standing()
    assert recording != "recording"
    assert [*recording] == ["toe", "hip"]
    assert (recording.n_frames, recording.duration_s) == (5, 0.04)
    again = hd.read(recording.save(tmp_path / "a" / "kept.h5"), name="recording")
    np.testing.assert_array_equal(again.positions, recording.positions)
    assert again.roles == recording.roles
    assert recording.plot("toe").axes
    for wrong, told in (
        (lambda: recording.save("kept.csv"), r"ends in \.h5, found 'kept.csv'"),
        (lambda: recording[0.0:0.02], r"in frames, .*take between\(begin_s, end_s\)"),
    ):
        with pytest.raises(hd.HopdataError, match=told):
            wrong()
