"""Exports of Motive, Nexus, DeepLabCut and Anipose, written as those programs write them."""

import numpy as np
import pytest
from csv_files import cells, motive, nexus

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw

NAMES = ("hip", "knee", "toe")


def track(n=30, seed=0):
    """Positions (n, 3, 3) in mm; the knee is hidden for two frames."""
    positions = np.random.default_rng(seed).uniform(-500, 900, (n, 3, 3)).round(3)
    positions[4:6, 1] = np.nan
    return positions


def deeplabcut(positions, scores, *, plane=False):
    axes = ("x", "y", "likelihood") if plane else ("x", "y", "z", "likelihood")
    header = [
        ",".join(["scorer", *["net"] * len(axes) * 3]),
        ",".join(["bodyparts", *[name for name in NAMES for _ in axes]]),
        ",".join(["coords", *axes * 3]),
    ]
    rows = [
        f"{k},"
        + ",".join(f"{cells(p[: len(axes) - 1])},{s}" for p, s in zip(place, score, strict=True))
        for k, (place, score) in enumerate(zip(positions, scores, strict=True))
    ]
    return "\n".join(header + rows) + "\n"


def anipose(positions, scores):
    header = [
        f"{name}_{part}" for name in NAMES for part in ("x", "y", "z", "error", "ncams", "score")
    ]
    rows = [
        ",".join(f"{cells(p)},1.2,3,{s}" for p, s in zip(place, score, strict=True))
        + f",1,0,0,0,1,0,0,0,1,0,0,0,{k}"
        for k, (place, score) in enumerate(zip(positions, scores, strict=True))
    ]
    matrix = [f"M_{i}{j}" for i in range(3) for j in range(3)] + [f"center_{i}" for i in range(3)]
    return "\n".join([",".join([*header, *matrix, "fnum"]), *rows]) + "\n"


def read(folder, text, **options):
    file = folder / "monday.csv"
    file.write_bytes(text.encode())
    return read_raw(file, **options)


@pytest.mark.parametrize("unit", ["Millimeters", "Centimeters", "Meters"])
@pytest.mark.parametrize("code", [False, True])
def test_motive_markers_in_the_file_s_unit(tmp_path, unit, code):
    found = read(tmp_path, motive(track(), NAMES, unit=unit, code=code))
    assert found.markers == NAMES
    assert found.rate_hz == 100.0
    millimetres = found.positions * (1e3 if found.unit == "m" else 1.0)
    np.testing.assert_allclose(millimetres, track(), atol=1e-3)
    np.testing.assert_allclose(found.time, np.arange(30) / 100, atol=1e-12)
    assert "1 unlabeled" in found.remarks[0]


def test_motive_solved_markers_only_where_there_are_no_others(tmp_path):
    text = motive(track(), NAMES, kind="Rigid Body Marker").replace("Unlabeled 1042", "")
    text = text.replace(",Marker,Marker,Marker\r\n", ",Bone,Bone,Bone\r\n")
    found = read(tmp_path, text)
    assert found.markers == ("pelvis:Marker1", *NAMES)
    assert any("solved" in remark for remark in found.remarks)


def test_motive_rate_of_the_configuration_must_agree(tmp_path):
    with pytest.raises(RecordingError, match=r"expected 100 Hz as the file states"):
        read(tmp_path, motive(track(), NAMES), rate_hz=120.0)


@pytest.mark.parametrize("others", [False, True])
def test_nexus_trajectories_beside_other_sections(tmp_path, others):
    found = read(tmp_path, nexus(track(), NAMES, others=others))
    assert found.markers == NAMES
    np.testing.assert_allclose(found.positions, track())
    assert found.time[0] == 0.0
    assert ("Devices" in " ".join(found.remarks)) == others


def test_nexus_two_animals_keep_their_names_apart(tmp_path):
    found = read(tmp_path, nexus(track(), NAMES, subjects=("cat", "dog")))
    assert found.markers[:1] + found.markers[3:4] == ("cat:hip", "dog:hip")


@pytest.mark.parametrize("write", [deeplabcut, anipose])
def test_keypoints_that_are_not_sure_count_as_unseen(tmp_path, write):
    scores = np.full((30, 3), 0.95)
    scores[10, 2] = 0.3
    found = read(tmp_path, write(track(), scores), rate_hz=50.0)
    want = track()
    want[10, 2] = np.nan
    np.testing.assert_allclose(found.positions, want)
    assert found.markers == NAMES
    assert "1 of 90" in found.remarks[-1]
    lenient = read(tmp_path, write(track(), scores), rate_hz=50.0, least_score=0.2)
    np.testing.assert_allclose(lenient.positions, track())


def test_keypoints_state_no_rate(tmp_path):
    with pytest.raises(RecordingError, match=r"input\.rate_hz"):
        read(tmp_path, anipose(track(), np.ones((30, 3))))


def test_one_camera_s_plane_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"line 3: .*triangulate"):
        read(tmp_path, deeplabcut(track(), np.ones((30, 3)), plane=True), rate_hz=50.0)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda _: "a,b,c\n1,2,3\n", "line 1: expected an export of Motive"),
        (
            lambda t: t.replace("Millimeters", "Furlongs"),
            "expected Millimeters, Centimeters or Meters",
        ),
        (lambda t: t.replace("0.030000", "x"), "line 11, column 2: expected a number, found 'x'"),
        (lambda t: t[:-40], "was it cut short"),
        (lambda t: t[: t.index("\r\n0,")] + "\r\n", "expected rows of numbers"),
        (lambda t: t.replace("Frame,Time", "Fame,Time"), "expected a row Frame"),
        (lambda t: "\ufeff" + t.replace("X,Y,Z,X", "X,Z,Y,X"), "expected X, Y, Z of"),
        (lambda t: t.replace("100.000000", "fast"), "expected a number, found 'fast'"),
    ],
)
def test_faults_are_named(tmp_path, spoil, said):
    with pytest.raises(RecordingError, match=said):
        read(tmp_path, spoil(motive(track(), NAMES)))
