"""TRB: tracks in binary, with an entry for each marker that was seen."""

import numpy as np
import pytest
from qtm_files import NAMES, standing
from vendor_files import trb

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw


def places():
    positions = standing(20)
    positions[3:5, 1] = np.nan
    return positions


def written(tmp_path, data):
    path = tmp_path / "trial.trb"
    path.write_bytes(data)
    return path


def test_tracks_are_read_and_a_marker_without_an_entry_is_unseen(tmp_path):
    found = read_raw(written(tmp_path, trb(places(), NAMES, rate=120.0)))
    np.testing.assert_allclose(found.positions, places(), rtol=1e-6)
    assert (found.markers, found.rate_hz) == (NAMES, 120.0)
    assert (found.unit, found.unit_is_stated) == ("mm", False)


def test_frame_numbers_go_on_beyond_16_bits(tmp_path):
    found = read_raw(written(tmp_path, trb(places(), NAMES, first_frame=65_530)))
    np.testing.assert_allclose(np.diff(found.time), 0.01)
    assert found.time[0] == pytest.approx(655.29)


def test_a_number_that_is_left_out_is_a_missing_frame(tmp_path):
    whole = trb(places(), NAMES)
    n_bytes = 12 + 24 * len(NAMES)
    without = whole[: -3 * n_bytes] + whole[-2 * n_bytes :]
    found = read_raw(written(tmp_path, without))
    assert len(found.time) == 19
    assert np.diff(found.time)[-2] == pytest.approx(0.02)


def test_a_frame_that_is_cut_is_left_out_and_said(tmp_path):
    found = read_raw(written(tmp_path, trb(places(), NAMES)[:-10]))
    assert len(found.time) == 19
    assert [remark.code for remark in found.remarks] == ["recordings.last_frame_cut"]
    whole = read_raw(written(tmp_path, trb(places(), NAMES) + b"\0" * 400))
    assert (len(whole.time), whole.remarks) == (20, ())


def with_word(data, at, value):
    return data[:at] + value.to_bytes(2, "little") + data[at + 2 :]


MISTAKES = {
    "another file": (lambda d: b"x" + d, "byte 0: expected a TRB file"),
    "an empty file": (lambda _: b"", "found an empty file"),
    "data beyond the file": (
        lambda d: with_word(d, 10, 60_000),
        "byte 8: expected data between byte 12 and the end",
    ),
    "a record beyond the header": (
        lambda d: with_word(d, 14, 9_000),
        "byte 16: expected a record within the header",
    ),
    "no whole frame": (
        lambda d: d[: 4 * int.from_bytes(d[10:12], "little") + 10],
        "expected frames, found none",
    ),
    "an unknown key": (
        lambda d: with_word(d, len(d) - (12 + 24 * len(NAMES)) + 4, 7),
        "expected a frame (0000 0000 0600), found 0000 0000 0007",
    ),
    "an unknown marker": (
        lambda d: with_word(d, len(d) - 24, 77),
        "expected the number of one of its markers, found 77",
    ),
    "frames in another order": (
        lambda d: with_word(d, len(d) - (12 + 24 * len(NAMES)) + 6, 3),
        "expected a frame after 19, found 3",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(tmp_path, mistake):
    change, words = MISTAKES[mistake]
    path = written(tmp_path, change(trb(places(), NAMES)))
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)


@pytest.mark.parametrize("first_s", [np.inf, np.nan])
def test_a_rate_of_zero_is_told_whenever_the_file_begins(tmp_path, first_s):
    path = written(tmp_path, trb(places(), NAMES, rate=0.0, first_s=first_s))
    with pytest.raises(RecordingError, match=r"expected .* Hz, found 0"):
        read_raw(path)


def test_many_names_in_few_bytes_take_no_memory(tmp_path):
    names = tuple(f"m{k}" for k in range(15_000))
    empty = np.full((9000, len(names), 3), np.nan)
    data = trb(empty[:1], names)
    head, frame = data[:-12], data[-12:]
    frames = b"".join(
        frame[:6] + k.to_bytes(2, "little") + frame[8:] for k in range(1, 9000)
    )
    path = written(tmp_path, head + frames)
    with pytest.raises(RecordingError, match="seen in more than a few frames"):
        read_raw(path)
