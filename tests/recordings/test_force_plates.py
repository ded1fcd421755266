"""Force plates of C3D files: a known force at a known place, in all types and forms."""

import numpy as np
import pytest
from plate_files import CORNERS, PlateFile, Stance, write_plates

from hopdata.recordings.force_plates import read_force_plates
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.c3d_plates import count_plates

N_FRAMES = 50
PER_FRAME = 10
RATE_HZ = 100.0


def recording(**given):
    rng = np.random.default_rng(3)
    positions = rng.uniform(100, 900, (N_FRAMES, 2, 3))
    time = np.arange(N_FRAMES) / RATE_HZ
    return RawRecording(("a", "b"), time, positions, RATE_HZ, "mm", **given)


def stances(n=N_FRAMES * PER_FRAME):
    """Return one stance on each plate; the force is up, and acts beside the middle."""
    time = np.arange(n) / n
    load = 900 * np.sin(np.pi * time) ** 2
    first = np.column_stack([0.1 * load, -0.05 * load, load])
    second = np.column_stack([-0.08 * load, 0.02 * load, 0.7 * load])
    at_first = np.column_stack([120 + 60 * time, 350 - 80 * time, 0 * time])
    at_second = np.column_stack([700 - 90 * time, 250 + 70 * time, 3 + 0 * time])
    return [
        Stance(first, at_first, 2000 * np.sin(7 * time)),
        Stance(second, at_second, -900 * time),
    ]


def check(path, truth, *, newtons=1e-3, metres=1e-5, is_turned=False):
    found = read_force_plates(path, vertical_axis="z")
    assert not found.refused
    assert [plate.number for plate in found.plates] == [1, 2]
    for plate, stance, corners in zip(found.plates, truth, CORNERS, strict=True):
        np.testing.assert_allclose(plate.force, stance.force, atol=newtons)
        loaded = stance.force[:, 2] > 100
        place = 1e-3 * stance.place[loaded]
        np.testing.assert_allclose(plate.pressure[loaded], place, atol=metres)
        np.testing.assert_allclose(plate.corners, 1e-3 * corners, atol=1e-9)
        np.testing.assert_allclose(plate.time, np.arange(len(plate.time)) / 1000)
        assert plate.rate_hz == pytest.approx(1000)
        assert bool(plate.remarks) == is_turned
    return found


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
@pytest.mark.parametrize("processor", ["Intel", "DEC", "MIPS"])
def test_floats(tmp_path, kind, processor):
    path = tmp_path / "floats.c3d"
    how = PlateFile(kind, processor=processor)
    write_plates(path, recording(), stances(), how)
    check(path, stances(), newtons=2e-3, metres=2e-5)


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
@pytest.mark.parametrize("is_unsigned", [False, True])
@pytest.mark.parametrize("processor", ["Intel", "DEC", "MIPS"])
def test_whole_numbers(tmp_path, kind, is_unsigned, processor):
    """An offset of 32768 is one only if the format says that words have no sign."""
    path = tmp_path / "whole.c3d"
    how = PlateFile(
        kind,
        processor=processor,
        whole_numbers=True,
        is_unsigned=is_unsigned,
        general_scale=0.5,
    )
    write_plates(path, recording(), stances(), how)
    check(path, stances(), newtons=0.2, metres=2e-3)


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
def test_a_plate_that_shows_the_force_on_itself(tmp_path, kind):
    path = tmp_path / "action.c3d"
    write_plates(path, recording(), stances(), PlateFile(kind, sign=-1.0))
    found = check(path, stances(), newtons=2e-3, metres=2e-5, is_turned=True)
    codes = [remark.code for remark in found.plates[0].remarks]
    assert codes == ["recordings.plate_inverted"]


@pytest.mark.parametrize("kind", [2, 4])
def test_an_origin_that_points_down(tmp_path, kind):
    path = tmp_path / "origin.c3d"
    write_plates(path, recording(), stances(), PlateFile(kind, origin_sign=-1.0))
    found = check(path, stances(), newtons=2e-3, metres=2e-5, is_turned=True)
    codes = [remark.code for remark in found.plates[0].remarks]
    assert codes == ["recordings.plate_origin"]


def test_moments_in_newton_metres(tmp_path):
    """The unit of a channel is taken, not that of the positions."""
    path = tmp_path / "metres.c3d"
    told = ["N", "N", "N", "Nm", "N.m", "N m"]
    write_plates(path, recording(), stances(), PlateFile(2, units=told))
    # The numbers are in N mm, so that the stated unit puts the subject far away.
    found = check(path, stances(), newtons=2e-3, metres=2e-5, is_turned=True)
    codes = [remark.code for remark in found.plates[0].remarks]
    assert codes == ["recordings.plate_moments"]


def test_axes_follow_the_recording(tmp_path):
    """The plates turn with the markers, and the laboratory's floor is then a wall."""
    path = tmp_path / "turned.c3d"
    write_plates(path, recording(), stances(), PlateFile(2))
    as_filed = read_force_plates(path, vertical_axis="z").plates[0]
    turned = read_force_plates(path, vertical_axis="x").plates[0]
    # x points up in the file, so y, z, x become x, y, z.
    np.testing.assert_allclose(turned.force, as_filed.force[:, [1, 2, 0]])
    np.testing.assert_allclose(turned.corners, as_filed.corners[:, [1, 2, 0]])
    np.testing.assert_allclose(turned.pressure, as_filed.pressure[:, [1, 2, 0]])


def test_the_rate_of_the_recording_sets_the_clock(tmp_path):
    path = tmp_path / "rate.c3d"
    write_plates(path, recording(), stances(), PlateFile(2))
    plate = read_force_plates(path, vertical_axis="z", rate_hz=50.0).plates[0]
    assert plate.rate_hz == pytest.approx(500)


REFUSED = {
    "volts": (PlateFile(2, units=["V"] * 6), ["channel 'a1'", "'V'", "type 4"]),
    "volts of type 3": (PlateFile(3, units=["mV"] * 8), ["channel 'a1'", "'mV'"]),
    "moments as forces": (PlateFile(2, units=["Nmm"] * 6), ["'Nmm'"]),
    "no matrix": (
        PlateFile(4, group={"CAL_MATRIX": np.empty(0, dtype=float)}),
        ["'V'"],
    ),
    "zeros in the matrix": (
        PlateFile(4, group={"CAL_MATRIX": np.zeros((2, 6, 6))}),
        ["CAL_MATRIX", "vertical force", "zeros"],
    ),
    "type": (PlateFile(2, group={"TYPE": np.array([7, 7])}), ["one of 1, 2", "7"]),
    "corners": (
        PlateFile(2, group={"CORNERS": np.zeros((2, 4, 3))}),
        ["four corners of an area"],
    ),
    "few corners": (
        PlateFile(2, group={"CORNERS": np.zeros(5)}),
        ["CORNERS", "12 numbers for plate 1", "found 5"],
    ),
    "channel": (
        PlateFile(2, group={"CHANNEL": np.full((2, 6), 40)}),
        ["channels from 1 to 12", "40"],
    ),
}


@pytest.mark.parametrize("mistake", REFUSED)
def test_what_is_no_plate_is_refused_by_name(tmp_path, mistake):
    how, parts = REFUSED[mistake]
    path = tmp_path / "wrong.c3d"
    write_plates(path, recording(), stances(), how)
    found = read_force_plates(path, vertical_axis="z")
    assert not found.plates
    assert len(found.refused) == 2
    for part in ("force plate 1 is not used", *parts):
        assert part in str(found.refused[0])


def test_more_rows_than_plates_use(tmp_path):
    """Tables may have room for eight channels and more plates than are used."""
    path = tmp_path / "room.c3d"
    channel = np.zeros((3, 8), dtype=int)
    channel[:2, :6] = np.arange(1, 13).reshape(2, 6)
    how = PlateFile(2, group={"CHANNEL": channel, "TYPE": np.array([2, 2, 0])})
    write_plates(path, recording(), stances(), how)
    check(path, stances(), newtons=2e-3, metres=2e-5)


def test_a_matrix_stored_by_rows(tmp_path):
    from plate_files import MATRIX

    path = tmp_path / "rows.c3d"
    group = {"CAL_MATRIX": np.stack([MATRIX] * 2), "MATRIX_STORE": ["BYROW"]}
    write_plates(path, recording(), stances(), PlateFile(4, group=group))
    check(path, stances(), newtons=2e-3, metres=2e-5)


def test_files_without_plates_have_none(tmp_path):
    from written_files import write_c3d

    path = tmp_path / "none.c3d"
    write_c3d(path, recording())
    assert count_plates(path) == 0
    assert not read_force_plates(path, vertical_axis="z").plates
    table = tmp_path / "table.csv"
    table.write_text("a\n1\n")
    assert count_plates(table) == 0


KISTLER = np.array([[3e-16, -5e-11, 3e-7, -9e-12, 3e-6, -8e-3,
                     2e-16, -2e-11, -7e-7, -3e-11, 3e-6, 5e-2]] * 2)  # fmt: skip


@pytest.mark.parametrize("kind", [1, 2, 3, 4, "with a polynomial"])
def test_the_same_as_ezc3d(tmp_path, kind):
    """Forces and centres of pressure are those of ezc3d, but for its 32-bit samples."""
    import ezc3d

    path = tmp_path / "same.c3d"
    group = {}
    if kind == "with a polynomial":
        kind = 3
        group = {"FPCOPPOLY": KISTLER}
    if kind != 4:  # ezc3d wants one, and uses it for none of these types
        group["CAL_MATRIX"] = np.zeros((2, 6, 6))
    write_plates(path, recording(), stances(), PlateFile(kind, group=group))
    theirs = ezc3d.c3d(str(path), extract_forceplat_data=True)["data"]["platform"]
    ours = read_force_plates(path, vertical_axis="z").plates
    for plate, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(plate.force, other["force"].T, atol=1e-6)
        loaded = plate.force[:, 2] > 10
        their_pressure = 1e-3 * other["center_of_pressure"].T[loaded]
        np.testing.assert_allclose(plate.pressure[loaded], their_pressure, atol=1e-7)
