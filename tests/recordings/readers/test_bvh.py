"""BVH: joints by forward kinematics, ends of limbs, guessed unit, rounded frame times."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vendor_files import bvh

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw

# A hip whose position channels move it, a knee and a foot that end in a toe.
LEG = """HIERARCHY
ROOT Hips
{{
\tOFFSET 0 90 0
\tCHANNELS 6 Xposition Yposition Zposition {order}
\tJOINT LeftLeg {{
\t\tOFFSET 10 -5 0
\t\tCHANNELS 3 {order}
\t\tJOINT mixamorig:LeftFoot
\t\t{{
\t\t\tOFFSET 0 -40 2
\t\t\tCHANNELS 3 {order}
\t\t\tEnd Site
\t\t\t{{
\t\t\t\tOFFSET 0 -5 15
\t\t\t}}
\t\t}}
\t}}
}}
MOTION
Frames: {n}
Frame Time: {time}
{rows}
"""


def leg(tmp_path, rows, *, order="ZXY", time="0.01", n=None, change=None):
    names = " ".join(f"{axis}rotation" for axis in order)
    text = LEG.format(
        order=names,
        n=len(rows) if n is None else n,
        time=time,
        rows="\n".join(" ".join(f"{x:.6f}" for x in row) for row in rows),
    )
    path = tmp_path / "leg.bvh"
    path.write_text(change(text) if change else text)
    return path


@pytest.mark.parametrize("order", ["ZXY", "XYZ", "YXZ", "ZYX"])
def test_joints_are_where_their_rotations_in_the_listed_order_put_them(tmp_path, order):
    rows = np.random.default_rng(3).uniform(-80, 80, (7, 12))
    rows[:, :3] = rows[:, :3] / 10 + [0, 95, 0]
    found = read_raw(leg(tmp_path, rows, order=order))
    names = ("Hips", "LeftLeg", "mixamorig:LeftFoot", "mixamorig:LeftFoot end")
    assert found.markers == names
    # Intrinsic rotations: each about the axes that the ones before have turned.
    hip, knee, ankle = (
        Rotation.from_euler(order, rows[:, k : k + 3], degrees=True) for k in (3, 6, 9)
    )
    places = [rows[:, :3]]  # the channels replace the offset of the root
    places.append(places[0] + hip.apply([10, -5, 0]))
    places.append(places[1] + (hip * knee).apply([0, -40, 2]))
    places.append(places[2] + (hip * knee * ankle).apply([0, -5, 15]))
    # cm by habit, turned to mm
    expected = 10 * np.stack(places, axis=1)
    np.testing.assert_allclose(found.positions, expected, atol=1e-4)
    assert (found.unit, found.unit_is_stated, found.rate_hz) == ("mm", False, 100.0)


def test_what_the_markers_are_and_the_unit_is_said(tmp_path):
    rows = np.tile([0, 95, 0, *[0] * 9], (4, 1))
    first, second = read_raw(leg(tmp_path, rows)).remarks
    assert first.code == "recordings.bvh_joints"
    assert (first.values["n_joints"], first.values["n_ends"]) == (3, 1)
    assert second.code == "recordings.bvh_unit"
    assert "taken for cm" in str(second)


@pytest.mark.parametrize(
    ("scale", "unit", "factor"),
    [(0.01, "m", 1.0), (1.0, "mm", 10.0), (30.0, "mm", 1.0)],
)
def test_the_unit_follows_the_size_of_the_skeleton(tmp_path, scale, unit, factor):
    places = scale * np.array([[[0, 95, 0], [10, 50, 0], [0, 1, 5]]] * 3, float)
    path = tmp_path / "a.bvh"
    path.write_bytes(bvh(places, ("hip", "knee", "toe")))
    found = read_raw(path)
    assert found.unit == unit
    np.testing.assert_allclose(found.positions, factor * places, atol=1e-4)


@pytest.mark.parametrize(
    ("time", "rate_hz", "is_said"),
    [
        ("0.008333", 120.0, False),
        ("0.0083", 120.0, True),
        ("0.033", 30.0, True),
        ("0.0333333", 30.0, False),
        ("0.01", 100.0, False),
        ("0.0041666", 240.0, False),
    ],
)
def test_a_rounded_frame_time_gives_the_rate_that_was_meant(
    tmp_path, time, rate_hz, is_said
):
    rows = np.tile([0, 95, 0, *[0] * 9], (4, 1))
    found = read_raw(leg(tmp_path, rows, time=time))
    assert found.rate_hz == pytest.approx(rate_hz, rel=1e-4)
    codes = [remark.code for remark in found.remarks]
    assert ("recordings.rate_of_rounded_time" in codes) == is_said


def test_a_wrong_count_of_frames_is_said(tmp_path):
    rows = np.tile([0, 95, 0, *[0] * 9], (4, 1))
    found = read_raw(leg(tmp_path, rows, n=9))
    assert len(found.time) == 4
    assert "expected 9 frames as stated, found 4 rows" in str(found.remarks[-1])


MISTAKES = {
    "another file": (
        lambda t: "a" + t,
        "line 1: expected HIERARCHY, found 'aHIERARCHY'",
    ),
    "no closing brace": (
        lambda t: t.replace("\t\t}\n", "", 1),
        "expected the whole hierarchy, found MOTION with",
    ),
    "no motion": (lambda t: t.split("MOTION")[0], "expected MOTION, found the end"),
    "a short offset": (
        lambda t: t.replace("OFFSET 10 -5 0", "OFFSET 10 -5"),
        "line 7: expected three numbers after OFFSET, found '10 -5'",
    ),
    "an unknown channel": (
        lambda t: t.replace("Xposition", "Xplace"),
        "line 5: expected channels such as Xposition and Zrotation, found 'Xplace'",
    ),
    "a wrong count of channels": (
        lambda t: t.replace("CHANNELS 6", "CHANNELS 5"),
        "line 5: expected 6 after CHANNELS, found '5'",
    ),
    "channels named twice": (
        lambda t: t.replace("OFFSET 10 -5 0", "CHANNELS 1 Xrotation"),
        "line 8: expected one CHANNELS a joint, found another in the joint of line 6",
    ),
    "a short row": (
        lambda t: t.replace(" 0.000000\n", "\n", 1),
        "expected 12 columns, found 11",
    ),
    "a word among the numbers": (
        lambda t: t.replace("95.000000", "high", 1),
        "column 2: expected a number, found 'high'",
    ),
    "a negative frame time": (
        lambda t: t.replace("0.01", "-0.01"),
        "Frame Time: expected more than 0 s",
    ),
    "no frame time": (
        lambda t: t.replace("Frame Time: 0.01\n", ""),
        "expected a number in the file or in input.rate_hz",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(tmp_path, mistake):
    change, words = MISTAKES[mistake]
    rows = np.tile([0, 95, 0, *[0] * 9], (4, 1))
    path = leg(tmp_path, rows, change=change)
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)
