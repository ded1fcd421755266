"""C3D: false counts, long recordings, absolute events, residuals; compared with another library."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import vendor_files
import written_files as c3d_writing
from external_blocks import block, columns
from written_files import from_floats, from_whole, parameter_bytes, write_c3d

from hopdata.errors import RecordingError
from hopdata.recording import Event
from hopdata.recordings.external import read_force_signals
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.c3d import open_c3d, read_analogs, read_c3d
from hopdata.recordings.readers.c3d_parameters import (
    BLOCK,
    PROCESSORS,
    Parameters,
    count_frames,
    read_c3d_header,
    read_parameters,
)
from hopdata.recordings.readers.formats import read_raw

INTEL = PROCESSORS[84]


def raw(n_frames=20, n_markers=3, **changes):
    rng = np.random.default_rng(4)
    positions = (
        rng.uniform(1, 900, (n_frames, n_markers, 3)).astype(np.float32).astype(float)
    )
    names = tuple(f"marker {i + 1}" for i in range(n_markers))
    made = RawRecording(names, np.arange(n_frames) / 100, positions, 100.0, "mm")
    return replace(made, **changes)


def written(folder, content=None, **options):
    path = folder / "a.c3d"
    write_c3d(path, raw() if content is None else content, **options)
    return path


def changed(path, at, data):
    content = bytearray(path.read_bytes())
    content[at : at + len(data)] = data
    path.write_bytes(content)
    return path


def value_at(path, name):
    """Return the byte at which the value of a single-number parameter starts."""
    content = path.read_bytes()
    at = content.index(name) + len(name) + 2  # past the distance to the next record
    return at + 2 + content[at + 1]


def test_an_unseen_marker_has_a_negative_residual_a_nan_or_three_zeros(tmp_path):
    content = raw()
    content.positions[3, 1] = np.nan
    path = written(tmp_path, content)
    header = read_c3d_header(path.read_bytes()[:512], INTEL)
    start, frame = header.data_start, header.frame_bytes
    changed(path, start, np.zeros(4, "<f4").tobytes())
    changed(path, start + frame, np.full(4, np.nan, "<f4").tobytes())
    changed(path, start + 2 * frame + 12, np.array([-1], "<f4").tobytes())
    found = np.isnan(read_c3d(path).positions).all(axis=2)
    assert np.argwhere(found).tolist() == [[0, 0], [1, 0], [2, 0], [3, 1]]


def test_a_residual_may_be_a_16_bit_word_beside_the_cameras(tmp_path):
    path = written(tmp_path)
    header = read_c3d_header(path.read_bytes()[:512], INTEL)
    for frame, (cameras, residual) in enumerate(
        [(127, 12), (-1, 3), (127, -1), (0, -16512)]
    ):
        at = header.data_start + frame * header.frame_bytes + 12
        changed(path, at, np.array([cameras, residual], "<i2").tobytes())
    found = np.isnan(read_c3d(path).positions).all(axis=2)
    assert np.argwhere(found).tolist() == [[2, 0], [3, 0]]


@pytest.fixture
def with_parameters(monkeypatch, tmp_path):
    """Return a function that writes a recording whose group POINT has extra parameters."""
    groups = c3d_writing._groups

    def write(content, **more):
        def enlarged(*given):
            found = groups(*given)
            return {**found, "POINT": {**found["POINT"], **more}}

        monkeypatch.setattr(c3d_writing, "_groups", enlarged)
        return written(tmp_path, content)

    return write


def test_a_parameter_of_an_unknown_type_is_left_out_and_said(with_parameters):
    path = with_parameters(raw(), ODD=np.array([1.0], "<f4"), LAST=1)
    at = value_at(path, b"ODD") - 3
    again = read_c3d(changed(path, at, b"\x03"))
    np.testing.assert_array_equal(again.positions, raw().positions)
    (remark,) = again.remarks
    assert (
        f"byte {at}: parameter ODD: expected the type -1, 1, 2 or 4, found 3" in remark
    )


def test_model_outputs_are_no_markers(with_parameters):
    names = ("hip", "Angle", "toe", "Force", "Power")
    content = raw(n_markers=5, markers=names)
    more = {
        "ANGLES": ["Angle"],
        "FORCES": ["Force"],
        "POWERS": ["None such"],
        "POWERS2": ["Power"],
    }
    again = read_c3d(with_parameters(content, **more))
    assert again.markers == ("hip", "toe")
    np.testing.assert_array_equal(again.positions, content.positions[:, [0, 2]])
    assert (
        "3 model outputs are no markers and left out: Angle, Force, Power"
        in again.remarks[0]
    )
    with pytest.raises(
        RecordingError, match="expected markers, found model outputs only"
    ):
        read_c3d(with_parameters(content, ANGLES=list(names)))


def test_outputs_of_plug_in_gait_are_known_by_name_where_no_list_has_them(
    with_parameters,
):
    names = ("hip", "cat:LHipAngles", "toe", "RKneeMoment", "*113")
    again = read_c3d(with_parameters(raw(n_markers=5, markers=names)))
    assert again.markers == ("hip", "toe")
    np.testing.assert_array_equal(
        again.positions, raw(n_markers=5).positions[:, [0, 2]]
    )
    assert "1 unlabeled" in again.remarks[0]
    assert (
        "2 model outputs are no markers and left out: cat:LHipAngles"
        in again.remarks[1]
    )


def test_events_that_do_not_fit_together_are_left_out_and_said(tmp_path, monkeypatch):
    groups = c3d_writing._groups
    event = {"USED": 2, "LABELS": ["strike"], "TIMES": np.array([[0.0, 0.05]], "<f4")}
    monkeypatch.setattr(
        c3d_writing, "_groups", lambda *given: {**groups(*given), "EVENT": event}
    )
    again = read_c3d(written(tmp_path))
    assert again.events == ()
    assert "expected 2 events, found 1 labels" in again.remarks[0]


def test_markers_of_one_name_are_numbered_and_said(tmp_path):
    content = raw(markers=("toe", "hip", "toe"))
    again = read_c3d(written(tmp_path, content))
    assert again.markers == ("toe 1", "hip", "toe 2")
    np.testing.assert_array_equal(again.positions, content.positions)
    assert "POINT:LABELS: expected each marker name once, found 'toe' twice" in str(
        again.remarks[0]
    )


def test_a_clipped_header_alone_is_replaced_by_the_size(tmp_path):
    data = written(tmp_path).read_bytes()
    parameters = read_parameters(tmp_path / "a.c3d", data[512:], 512)
    parameters.groups = {}
    header = replace(read_c3d_header(data[:512], INTEL), first=10, last=65_535)
    assert count_frames(header, parameters, 182_611 * header.frame_bytes)[0] == 182_611

    # Its last frame may be beyond the limit though it has few frames.
    late = replace(header, first=60_000)
    assert count_frames(late, parameters, 7_000 * header.frame_bytes)[0] == 7_000
    with pytest.raises(RecordingError, match=r"found room for 5000 .*cut short"):
        count_frames(late, parameters, 5_000 * header.frame_bytes)


def test_event_times_are_absolute(tmp_path):
    content = raw(
        time=(500 + np.arange(20)) / 100, events=(Event("down", 5.05), Event("up", 5.1))
    )
    again = read_raw(written(tmp_path, content))
    assert again.time[0] == 5.0
    assert [e.time_s for e in again.events] == pytest.approx([5.05, 5.1])
    assert not again.remarks
    late = replace(content, events=(Event("down", 5.05), Event("next trial", 65.0)))
    assert "1 of 2 events lie outside" in read_raw(written(tmp_path, late)).remarks[0]


def test_events_of_the_header_are_read(tmp_path):
    path = written(tmp_path)
    changed(path, 298, np.array([12345, 2], "<i2").tobytes())
    changed(path, 304, np.array([0.05, 0.1], "<f4").tobytes())
    changed(path, 396, b"RHS LTO ")
    assert [e.label for e in read_c3d(path).events] == ["RHS", "LTO"]


def test_more_than_255_markers(tmp_path):
    content = raw(n_markers=300)
    again = read_c3d(written(tmp_path, content))
    assert again.markers == content.markers
    np.testing.assert_array_equal(again.positions, content.positions)


@pytest.mark.parametrize("n_frames", [65_535, 65_536, 70_001, 182_611])
def test_a_long_recording_comes_back_whole(tmp_path, n_frames):
    positions = np.full((n_frames, 1, 3), 7.0)
    positions[-1] = 9.0
    long = RawRecording(("a",), np.arange(n_frames) / 100, positions, 100.0, "mm")
    again = read_c3d(written(tmp_path, long))
    assert len(again.time) == n_frames
    assert again.positions[-1, 0, 0] == 9.0
    assert not again.remarks


def counted(path, n_frames_room, **claims):
    """Return `count_frames` for a file with room for these frames and only 16-bit claims."""
    data = path.read_bytes()
    parameters = read_parameters(path, data[512:], 512)
    for group, name in (("TRIAL", "ACTUAL_END_FIELD"), ("POINT", "LONG_FRAMES")):
        del parameters.groups[group][name]
    header = replace(read_c3d_header(data[:512], INTEL), **claims)
    parameters.groups["POINT"]["FRAMES"] = np.array([header.last - header.first + 1])
    return count_frames(header, parameters, n_frames_room * header.frame_bytes)


def test_a_full_16_bit_count_is_replaced_by_the_size_and_said(tmp_path):
    path = written(tmp_path)
    for last in (65_535, 182_611 % 65_536):
        n, remarks = counted(path, 182_611, last=last)
        assert n == 182_611
        assert "counted from the size" in remarks[-1]


@pytest.mark.parametrize("n_frames", [15_617, 65_400])
def test_a_full_16_bit_count_needs_as_many_frames(tmp_path, n_frames):
    """A long file that was cut short below its count is no short recording."""
    path = written(tmp_path)
    with pytest.raises(RecordingError, match=f"room for {n_frames} .*cut short"):
        counted(path, n_frames, last=65_535)
    assert counted(path, 65_535, last=65_535) == (65_535, ())


def long_and_only_counted_in_16_bits(path, n_frames, *, n_points=12, unseen=0, extra=0):
    """Write frames beyond 16 bits, the last ones unseen, and blocks of zeros behind them."""
    positions = np.full((n_frames, n_points, 3), 7.0)
    if unseen:
        positions[-unseen:] = np.nan
    names = [f"marker {i + 1}" for i in range(n_points)]
    no_more_counts = {"ACTUAL_START_FIELD": None, "ACTUAL_END_FIELD": None}
    data = vendor_files.c3d(positions, names, groups={"TRIAL": no_more_counts})
    path.write_bytes(data + bytes(extra * BLOCK))
    return path


@pytest.mark.parametrize(
    ("n_frames", "extra"),
    [
        (65_600, 0),  # 192 bytes each end with a block
        (65_600, 1),  # a further block, as some writers add
        (65_601, 0),  # 320 bytes are left in the last block: room for one more frame
    ],
)
def test_zeros_behind_the_last_frame_are_no_frames(tmp_path, n_frames, extra):
    path = long_and_only_counted_in_16_bits(tmp_path / "a.c3d", n_frames, extra=extra)
    again = read_c3d(path)
    assert len(again.time) == n_frames
    assert np.isfinite(again.positions).all()
    assert f"{n_frames} frames counted from the size" in again.remarks[-1]
    n_filling = -n_frames * 192 % BLOCK + extra * BLOCK
    told = f"the {n_filling} bytes of 0 after them fill up a block"
    assert (told in again.remarks[-1]) == (n_filling > 0)


@pytest.mark.parametrize("unseen", [1, 2])
def test_unseen_frames_at_the_end_are_frames(tmp_path, unseen):
    """Their residual is -1, so that they are no zeros."""
    n_frames = 65_601
    path = long_and_only_counted_in_16_bits(tmp_path / "a.c3d", n_frames, unseen=unseen)
    again = read_c3d(path)
    assert len(again.time) == n_frames
    assert np.isnan(again.positions[-unseen:]).all()
    assert np.isfinite(again.positions[:-unseen]).all()


def test_another_library_fills_up_a_long_file_with_zeros(tmp_path):
    ezc3d = pytest.importorskip("ezc3d")
    theirs = ezc3d.c3d()
    theirs["parameters"]["POINT"]["RATE"]["value"] = [250.0]
    theirs["parameters"]["POINT"]["LABELS"]["value"] = [f"m{i}" for i in range(12)]
    theirs["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    theirs["data"]["points"] = np.full((4, 12, 65_600), 3.0)
    theirs.write(str(tmp_path / "b.c3d"))
    assert len(read_c3d(tmp_path / "b.c3d").time) == 65_600


def test_a_block_more_than_the_frames_fill_is_no_contradiction(tmp_path):
    path = written(tmp_path, raw(n_frames=128))  # exactly whole blocks
    path.write_bytes(path.read_bytes() + bytes(512))
    again = read_c3d(path)
    assert len(again.time) == 128
    assert not again.remarks
    least = 182_640 - 512 // 48  # leaves no more than a block
    assert counted(path, 182_640, last=least % 65_536)[0] == least
    with pytest.raises(RecordingError, match="found room for 182640"):
        counted(path, 182_640, last=(least - 1) % 65_536)


def test_any_other_count_that_is_not_the_size_is_refused(tmp_path):
    path = written(tmp_path)
    with pytest.raises(
        RecordingError, match=r"expected 30000 .* found room for 182611"
    ):
        counted(path, 182_611, last=30_000)
    with pytest.raises(RecordingError, match="cut short"):
        counted(path, 100, last=30_000)


def test_one_wrong_count_beside_a_right_one_is_a_remark(tmp_path):
    path = written(tmp_path)
    changed(path, value_at(path, b"LONG_FRAMES"), np.array([17], "<f4").tobytes())
    again = read_c3d(path)
    assert len(again.time) == 20
    assert "POINT:LONG_FRAMES says 17 frames, the file holds 20" in again.remarks[0]


def test_a_truncated_file_is_refused(tmp_path):
    path = written(tmp_path, raw(n_frames=200))
    path.write_bytes(path.read_bytes()[:-1024])
    with pytest.raises(
        RecordingError, match=r"expected 200 .* found room for .*cut short"
    ):
        read_c3d(path)


@pytest.mark.parametrize("whole_numbers", [True, False])
def test_another_library_reads_the_same(tmp_path, whole_numbers):
    ezc3d = pytest.importorskip("ezc3d")
    content = raw(n_frames=64, events=(Event("a", 0.1),))
    content.positions[5, 1] = np.nan
    path = written(tmp_path, content, whole_numbers=whole_numbers)
    theirs = ezc3d.c3d(str(path))
    points = np.moveaxis(theirs["data"]["points"][:3], 0, -1).transpose(1, 0, 2)[:64]
    ours = read_c3d(path)
    np.testing.assert_allclose(points, ours.positions, rtol=1e-6)
    assert theirs["parameters"]["POINT"]["LABELS"]["value"] == list(ours.markers)
    assert theirs["header"]["points"]["frame_rate"] == ours.rate_hz


def test_a_file_of_another_library_is_read(tmp_path):
    ezc3d = pytest.importorskip("ezc3d")
    theirs = ezc3d.c3d()
    theirs["parameters"]["POINT"]["RATE"]["value"] = [120.0]
    theirs["parameters"]["POINT"]["LABELS"]["value"] = ["hip", "toe"]
    theirs["parameters"]["POINT"]["UNITS"]["value"] = ["m"]
    points = np.ones((4, 2, 50))
    points[:3] = np.random.default_rng(1).uniform(-1, 1, (3, 2, 50))
    theirs["data"]["points"] = points
    theirs.write(str(tmp_path / "b.c3d"))
    ours = read_c3d(tmp_path / "b.c3d")
    assert (ours.markers, ours.rate_hz, ours.unit) == (("hip", "toe"), 120.0, "m")
    np.testing.assert_allclose(ours.positions, points[:3].transpose(2, 1, 0), atol=1e-7)


def test_the_two_files_of_one_run_are_the_same_recording(same_run):
    c3d, text = (read_raw(path) for path in same_run)
    assert c3d.stated_up == "y"
    assert c3d.rate_hz == text.rate_hz == 150
    assert set(c3d.markers) == set(text.markers)
    order = [text.markers.index(name) for name in c3d.markers]
    np.testing.assert_allclose(
        text.positions[:, order], c3d.positions, rtol=0, atol=1e-3
    )
    np.testing.assert_allclose(text.time, c3d.time, rtol=0, atol=1e-9)
    assert "time stamps run evenly at 149.9667 Hz" in text.remarks[0]


# Analog channels of C3D files: scale, offset, clock, and mistakes.

C3D_ANALOGS_INTEL = PROCESSORS[84]
N_FRAMES, PER_FRAME, RATE_HZ, FIRST = 40, 5, 100.0, 3
TIME = (FIRST - 1) / RATE_HZ + np.arange(N_FRAMES * PER_FRAME) / (RATE_HZ * PER_FRAME)
FORCE = np.column_stack(
    [5.0 * np.cos(9 * TIME), -np.maximum(0, 800 * np.sin(20 * TIME)), 2 + 0 * TIME]
)


def written_c3d_analogs(
    path,
    *,
    kind=C3D_ANALOGS_INTEL,
    whole=False,
    offset=(0, 10, 0),
    scale=(1, 0.5, 1),
    n_points=1,
    **changed,
):
    """Write one marker (or none) at (1, 2, 3), and three channels of five samples per frame."""
    analog = {
        "USED": 3,
        "LABELS": ["Fx", "Fz", "EMG"],
        "UNITS": ["N", "N", "V"],
        "OFFSET": np.asarray(offset),
        "SCALE": np.asarray(scale, dtype=np.float32),
        "GEN_SCALE": np.float32(0.1),
        "RATE": np.float32(RATE_HZ * PER_FRAME),
        **changed,
    }
    stored = FORCE / (0.1 * np.asarray(scale)) + np.asarray(offset)
    point = np.tile([1.0, 2.0, 3.0, 0.0][: 4 * n_points], (N_FRAMES, 1))
    frames = np.hstack([point, stored.reshape(N_FRAMES, -1)])
    data = (
        from_whole(kind, np.round(frames).ravel())
        if whole
        else from_floats(kind, frames)
    )
    point_scale = 1.0 if whole else -1.0

    def groups(start):
        point = {
            "USED": n_points,
            "SCALE": np.float32(point_scale),
            "RATE": np.float32(RATE_HZ),
            "DATA_START": start,
            "FRAMES": N_FRAMES,
            "UNITS": ["mm"],
            "LABELS": ["a"][:n_points],
        }
        return {"POINT": point, "ANALOG": analog}  # fmt: skip

    start = 2 + len(parameter_bytes(kind, groups(0))) // BLOCK
    words = [n_points, 3 * PER_FRAME, FIRST, FIRST + N_FRAMES - 1, 0]
    head = bytes([2, 0x50]) + from_whole(kind, words) + from_floats(kind, [point_scale])
    head += from_whole(kind, [start, PER_FRAME]) + from_floats(kind, [RATE_HZ])
    content = head.ljust(BLOCK, b"\0") + parameter_bytes(kind, groups(start)) + data
    path.write_bytes(content + b"\0" * (-len(content) % BLOCK))
    return path


@pytest.mark.parametrize("kind", PROCESSORS.values(), ids=lambda kind: kind.name)
def test_values_times_and_units(tmp_path, kind):
    analogs = read_analogs(written_c3d_analogs(tmp_path / "a.c3d", kind=kind))
    assert analogs.names == ("Fx", "Fz", "EMG")
    assert analogs.units == ("N", "N", "V")
    np.testing.assert_allclose(analogs.time, TIME)
    np.testing.assert_allclose(analogs.values, FORCE, atol=1e-3)


def test_whole_numbers_are_scaled(tmp_path):
    analogs = read_analogs(written_c3d_analogs(tmp_path / "a.c3d", whole=True))
    np.testing.assert_allclose(
        analogs.values[:, 1], FORCE[:, 1], atol=0.5 * 0.05 + 1e-9
    )


def test_forces_of_a_plate(tmp_path):
    file = str(written_c3d_analogs(tmp_path / "a.c3d"))
    given = {"file": file, "columns": columns(Fz=["heel", "toe"]), "inverted": True}
    (signal,) = read_force_signals(
        block("forces", **given, offset_s=1.0), feet=("heel", "toe")
    )
    np.testing.assert_allclose(signal.time, TIME + 1.0)
    np.testing.assert_allclose(signal.force, -FORCE[:, 1], atol=1e-3)
    for options, part in (({"unit": "kN"}, "unit: N as the file states, found kN"),
                          ({"rate_hz": 1000}, "stated by forces.rate_hz: 1000")):  # fmt: skip
        with pytest.raises(RecordingError, match=part):
            read_force_signals(
                block("forces", **given, **options), feet=("heel", "toe")
            )


@pytest.mark.parametrize("unit", ["V", "mV", "Nmm", "kg", "N/A"])
def test_a_channel_in_another_unit_is_not_a_force(tmp_path, unit):
    file = str(written_c3d_analogs(tmp_path / "a.c3d", UNITS=["N", unit, "V"]))
    given = {"file": file, "columns": columns(Fz=["toe"]), "inverted": True}
    with pytest.raises(
        RecordingError, match=f"'Fz': expected a unit of force .* found '{unit}'"
    ):
        read_force_signals(block("forces", **given), feet=("toe",))


@pytest.mark.parametrize("unit", ["", "N", "nt", "Newtons"])
def test_newtons_have_several_spellings(tmp_path, unit):
    file = str(written_c3d_analogs(tmp_path / "a.c3d", UNITS=["N", unit, "V"]))
    given = {"file": file, "columns": columns(Fz=["toe"]), "inverted": True}
    (signal,) = read_force_signals(block("forces", **given), feet=("toe",))
    np.testing.assert_allclose(signal.force, -FORCE[:, 1], atol=1e-3)


MISTAKES = {
    "no channels": ({"USED": 0}, ["ANALOG:USED: expected channels, found none"]),
    "another number": ({"USED": 4}, ["a divisor of the 15 analog numbers", "found 4"]),
    "few scales": (
        {"SCALE": np.ones(2, np.float32)},
        ["ANALOG:SCALE: expected 3", "found 2"],
    ),
    "unknown channel": (
        {"LABELS": ["Fx", "FZ", "EMG"]},
        ["'Fz' once among Fx, FZ, EMG"],
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(tmp_path, mistake):
    changed, parts = MISTAKES[mistake]
    file = written_c3d_analogs(tmp_path / "a.c3d", **changed)
    with pytest.raises(RecordingError) as caught:
        read_analogs(file).channel("Fz")
    for part in (str(file), "expected", "found", *parts):
        assert part in str(caught.value)


def test_analog_channels_need_no_points_and_points_no_analog_channels(tmp_path):
    path = written_c3d_analogs(tmp_path / "plate.c3d", n_points=0)
    np.testing.assert_allclose(read_analogs(path).values, FORCE, atol=1e-3)
    with pytest.raises(RecordingError, match="expected markers, found none"):
        read_raw(path)
    assert read_raw(written_c3d_analogs(tmp_path / "both.c3d")).markers == ("a",)


def test_parameters_of_many_channels_go_on_in_further_ones(tmp_path):
    scale, offset = np.array([1, 0.5, 1], np.float32), np.array([0, 10, 0])
    more = {
        "SCALE": scale[:2],
        "SCALE2": scale[2:],
        "OFFSET": offset[:1],
        "OFFSET2": offset[1:],
    }
    path = written_c3d_analogs(
        tmp_path / "many.c3d", LABELS=["Fx"], LABELS2=["Fz"], LABELS3=["EMG"], **more
    )
    found = read_analogs(path)
    assert found.names == ("Fx", "Fz", "EMG")
    np.testing.assert_allclose(found.values, FORCE, atol=1e-3)


def test_residuals_that_are_all_below_0_are_not_believed(tmp_path):
    positions = np.random.default_rng(3).uniform(100, 900, (20, 2, 3)).round(2)
    path = tmp_path / "trial.c3d"
    write_c3d(
        path, RawRecording(("a", "b"), np.arange(20) / 100, positions, 100.0, "mm")
    )
    data = bytearray(path.read_bytes())
    start = 512 * (int.from_bytes(data[16:18], "little") - 1)
    numbers = np.frombuffer(data, "<f4", 20 * 2 * 4, start).reshape(-1, 4)
    numbers[:, 3] = -1.0
    path.write_bytes(data)
    found = read_raw(path)
    np.testing.assert_allclose(found.positions, positions, atol=1e-3)
    assert "all residuals are below 0" in found.remarks[0]


def unsigned_plate(folder, *, offset, **changed):
    """Write whole numbers about 32768 and return the channel Fz as it is read, N."""
    file = written_c3d_analogs(folder / "a.c3d", whole=True, offset=offset, **changed)
    return read_analogs(file).values[:, 1]


def test_offsets_of_unsigned_samples_are_unsigned(tmp_path):
    words = {"offset": (32768, 32768, 32768), "FORMAT": ["UNSIGNED"]}
    found = unsigned_plate(tmp_path, **words)
    np.testing.assert_allclose(found, FORCE[:, 1], atol=0.5 * 0.05 + 1e-9)
    signed = unsigned_plate(tmp_path, offset=(-100, -100, -100), FORMAT=["SIGNED"])
    np.testing.assert_allclose(signed, FORCE[:, 1], atol=0.5 * 0.05 + 1e-9)


def test_only_whole_words_lose_their_sign():
    parameters = Parameters(Path("a.c3d"), INTEL)
    parameters.groups["ANALOG"] = {
        "OFFSET": np.array([-32768, 100], np.int16),
        "OFFSET2": np.array([-2.5], np.float32),
    }
    assert parameters.unsigned_numbers("ANALOG", "OFFSET") == [32768, 100, -2.5]
    assert parameters.numbers("ANALOG", "OFFSET") == [-32768, 100, -2.5]


def with_residuals(path, words):
    """Write residual words (N, M) into a file of floats."""
    header = read_c3d_header(path.read_bytes()[:BLOCK], INTEL)
    content = bytearray(path.read_bytes())
    n_numbers = words.size * 4
    numbers = np.frombuffer(content, "<f4", n_numbers, header.data_start)
    numbers.reshape(*words.shape, 4)[:, :, 3] = words
    path.write_bytes(content)
    return path


def test_a_mask_of_eight_cameras_does_not_hide_a_point(tmp_path):
    words = np.zeros((20, 3))
    eight_cameras, unseen = np.int16(0x8305 - 65536), -1
    words[4, 0] = eight_cameras
    words[5, 1] = unseen
    words[6, 2] = 65535  # -1 without a sign
    words[7, 0] = -2  # below 0, and no mask of some cameras
    found = read_c3d(with_residuals(written(tmp_path), words))
    hidden = np.argwhere(np.isnan(found.positions).all(axis=2)).tolist()
    assert hidden == [[5, 1], [6, 2], [7, 0]]
    assert "1 of 60 residual words are below -256" in found.remarks[0]


def test_the_count_of_points_that_fills_the_file_is_believed(tmp_path):
    path = written(tmp_path, raw(n_frames=200))
    changed(path, value_at(path, b"USED"), np.array([5], "<i2").tobytes())
    found = read_c3d(path)
    np.testing.assert_array_equal(found.positions, raw(n_frames=200).positions)
    assert (
        "expected 3 points as in the header, found 5; 3 fit the size"
        in found.remarks[0]
    )
    path = written(tmp_path, raw(n_frames=200))
    changed(path, 2, np.array([5], "<i2").tobytes())  # now the header's count is wrong
    assert "found 3; 3 fit the size" in read_c3d(path).remarks[0]
    changed(path, value_at(path, b"USED"), np.array([4], "<i2").tobytes())
    with pytest.raises(RecordingError, match=r"POINT:USED: expected 5 .* found 4"):
        read_c3d(path)


def test_two_counts_of_points_that_both_fill_the_file_are_refused(tmp_path):
    path = written(tmp_path, raw(n_frames=2))
    changed(path, value_at(path, b"USED"), np.array([5], "<i2").tobytes())
    with pytest.raises(RecordingError, match=r"POINT:USED: expected 3 .* found 5"):
        read_c3d(path)


def test_a_last_block_that_was_not_written_costs_its_frames_and_is_said(tmp_path):
    path = written(tmp_path, raw(n_frames=200))
    frame_bytes = 48
    end = (
        read_c3d_header(path.read_bytes()[:BLOCK], INTEL).data_start + 200 * frame_bytes
    )
    path.write_bytes(path.read_bytes()[: end - 100])
    found = read_c3d(path)
    np.testing.assert_array_equal(found.positions, raw(n_frames=200).positions[:197])
    assert "200 frames are stated" in found.remarks[0]
    assert "the 197 that are whole are read" in found.remarks[0]
    path.write_bytes(path.read_bytes()[: end - BLOCK - 1])
    with pytest.raises(RecordingError, match="cut short"):
        read_c3d(path)


def test_data_start_where_the_parameters_say_if_the_header_does_not(tmp_path):
    path = written(tmp_path)
    changed(path, 16, b"\0\0")
    np.testing.assert_array_equal(read_c3d(path).positions, raw().positions)
    changed(path, value_at(path, b"DATA_START"), b"\0\0")
    with pytest.raises(RecordingError, match="byte 16: data"):
        read_c3d(path)


def test_a_parameter_without_a_group_is_left_out_and_said(tmp_path):
    path = written(tmp_path)
    content = path.read_bytes()
    at = content.index(b"LONG_FRAMES") - 1
    found = read_c3d(changed(path, at, bytes([77])))
    np.testing.assert_array_equal(found.positions, raw().positions)
    assert "parameter LONG_FRAMES: expected a group of number 77" in found.remarks[0]


@pytest.mark.parametrize(
    "n_rows", [70, 140]
)  # 35,700 and 71,400 bytes: past 15 and 16 bits
def test_parameters_larger_than_their_count_are_read_to_the_end(
    with_parameters, n_rows
):
    table = np.arange(n_rows * 255).reshape(n_rows, 255) % 1000
    path = with_parameters(raw(), VALUES=table, LAST=1)
    parameters = open_c3d(path)[1]
    found = parameters.groups["POINT"]["VALUES"]
    np.testing.assert_array_equal(found, table.ravel())
    assert parameters.number("POINT", "LAST") == 1
    np.testing.assert_array_equal(read_c3d(path).positions, raw().positions)


def test_parameters_beyond_the_stated_blocks_are_read(with_parameters):
    path = with_parameters(raw(), VALUES=np.arange(20 * 255).reshape(20, 255), LAST=7)
    n_blocks = path.read_bytes()[BLOCK + 2]
    assert n_blocks > 10
    changed(path, BLOCK + 2, bytes([n_blocks - 10]))
    assert open_c3d(path)[1].number("POINT", "LAST") == 7
