"""MVNX: segments of Xsens, parsed with limits and without entities."""

import numpy as np
import pytest
from qtm_files import NAMES, standing
from vendor_files import mvnx

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw

PLACES = np.round(standing(20, scale=1.0), 5)


def written(tmp_path, data=None, **options):
    path = tmp_path / "trial.mvnx"
    path.write_bytes(mvnx(PLACES, NAMES, **options) if data is None else data)
    return path


@pytest.mark.parametrize("namespace", [True, False])
def test_positions_of_segments_are_read_without_poses(tmp_path, namespace):
    found = read_raw(written(tmp_path, namespace=namespace, rate=240.0))
    np.testing.assert_allclose(found.positions, PLACES, atol=1e-9)
    assert (found.markers, found.rate_hz, found.unit) == (NAMES, 240.0, "m")
    assert (found.unit_is_stated, found.stated_up) == (True, "z")
    assert found.started.isoformat() == "2021-01-01T12:00:00"
    codes = [remark.code for remark in found.remarks]
    assert codes == ["recordings.xsens_segments", "recordings.frames_of_poses"]


def test_an_index_that_is_left_out_is_a_missing_frame(tmp_path):
    text = mvnx(PLACES, NAMES, first=500).decode()
    lines = [line for line in text.split("\n") if 'index="510"' not in line]
    found = read_raw(written(tmp_path, "\n".join(lines).encode()))
    assert found.time[0] == pytest.approx(5.0)
    assert np.diff(found.time)[9] == pytest.approx(0.02)
    assert len(found.time) == 19


def test_nothing_that_expands_is_read(tmp_path):
    lol = "".join(
        f'<!ENTITY l{k} "&l{k - 1};&l{k - 1};">' if k else '<!ENTITY l0 "lol">'
        for k in range(40)
    )
    sound = mvnx(PLACES, NAMES).decode()
    bomb = sound.replace("<mvnx ", f"<!DOCTYPE mvnx [{lol}]><mvnx ")
    bomb = bomb.replace("<comment>hop", "<comment>&l39;")
    with pytest.raises(RecordingError, match="line 2: expected plain elements"):
        read_raw(written(tmp_path, bomb.encode()))
    deep = sound.replace("<comment>hop", "<comment>" + "<a>" * 10_000)
    with pytest.raises(RecordingError, match="at most 32 elements within one another"):
        read_raw(written(tmp_path, deep.encode()))
    long = sound.replace("</position>", " 1" * 800_000 + "</position>")
    with pytest.raises(RecordingError, match=r"at most 1,500,000 characters"):
        read_raw(written(tmp_path, long.encode()))


MISTAKES = {
    "another file": (lambda _: "<a/>", "expected <mvnx> first, found <a>"),
    "no XML": (lambda _: "hop", "expected XML of Xsens MVN, found syntax error"),
    "cut short": (lambda t: t[:-300], "was it cut short"),
    "two subjects": (
        lambda t: t.replace("</subject>", "</subject><subject/>"),
        "expected one subject, found several",
    ),
    "no positions": (
        lambda t: t.replace("position>", "velocity>"),
        "that has an element position; export the positions",
    ),
    "two coordinates": (
        lambda t: t.replace(
            "</position></frame>\n</frames>", " 1</position></frame></frames>"
        ),
        "expected x, y, z of each segment, found 16 numbers",
    ),
    "one segment more": (
        lambda t: t.replace(
            "</position></frame>\n</frames>", " 1 2 3</position></frame></frames>"
        ),
        "expected 15 numbers as in the frames before, found 18",
    ),
    "a segment without a place": (
        lambda t: t.replace("<segments>", '<segments><segment label="x"/>'),
        "expected 6 segments in element position, found 5",
    ),
    "an index twice": (
        lambda t: t.replace('index="7"', 'index="6"'),
        "frame 8: index: expected more than 6, found 6",
    ),
    "a rate that is a word": (
        lambda t: t.replace('frameRate="100"', 'frameRate="fast"'),
        "frameRate: expected a number, found 'fast'",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(tmp_path, mistake):
    change, words = MISTAKES[mistake]
    path = written(tmp_path, change(mvnx(PLACES, NAMES).decode()).encode())
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)
