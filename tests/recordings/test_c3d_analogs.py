"""Analog channels of C3D files: scale, offset, clock, and mistakes."""

import numpy as np
import pytest
from external_blocks import block, columns

from hopdata.errors import RecordingError
from hopdata.recordings.c3d_analogs import read_analogs
from hopdata.recordings.c3d_numbers import PROCESSORS
from hopdata.recordings.c3d_parameter_writing import parameter_bytes
from hopdata.recordings.c3d_parameters import BLOCK
from hopdata.recordings.force_signals import read_force_signals
from hopdata.recordings.formats import read_raw

INTEL = PROCESSORS[84]
N_FRAMES, PER_FRAME, RATE_HZ, FIRST = 40, 5, 100.0, 3
TIME = (FIRST - 1) / RATE_HZ + np.arange(N_FRAMES * PER_FRAME) / (RATE_HZ * PER_FRAME)
FORCE = np.column_stack(
    [5.0 * np.cos(9 * TIME), -np.maximum(0, 800 * np.sin(20 * TIME)), 2 + 0 * TIME]
)


def written(
    path, *, kind=INTEL, whole=False, offset=(0, 10, 0), scale=(1, 0.5, 1), n_points=1, **changed
):
    """One marker (or none) at (1, 2, 3) and three channels of five samples a frame."""
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
    data = kind.from_whole(np.round(frames).ravel()) if whole else kind.from_floats(frames)
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
    head = bytes([2, 0x50]) + kind.from_whole(words) + kind.from_floats([point_scale])
    head += kind.from_whole([start, PER_FRAME]) + kind.from_floats([RATE_HZ])
    content = head.ljust(BLOCK, b"\0") + parameter_bytes(kind, groups(start)) + data
    path.write_bytes(content + b"\0" * (-len(content) % BLOCK))
    return path


@pytest.mark.parametrize("kind", PROCESSORS.values(), ids=lambda kind: kind.name)
def test_values_times_and_units(tmp_path, kind):
    analogs = read_analogs(written(tmp_path / "a.c3d", kind=kind))
    assert analogs.names == ("Fx", "Fz", "EMG")
    assert analogs.units == ("N", "N", "V")
    np.testing.assert_allclose(analogs.time, TIME)
    np.testing.assert_allclose(analogs.values, FORCE, atol=1e-3)


def test_whole_numbers_are_scaled(tmp_path):
    analogs = read_analogs(written(tmp_path / "a.c3d", whole=True))
    np.testing.assert_allclose(analogs.values[:, 1], FORCE[:, 1], atol=0.5 * 0.05 + 1e-9)


def test_forces_of_a_plate(tmp_path):
    file = str(written(tmp_path / "a.c3d"))
    given = {"file": file, "columns": columns(Fz=["heel", "toe"]), "inverted": True}
    (signal,) = read_force_signals(block("forces", **given, offset_s=1.0), feet=("heel", "toe"))
    np.testing.assert_allclose(signal.time, TIME + 1.0)
    np.testing.assert_allclose(signal.force, -FORCE[:, 1], atol=1e-3)
    for options, part in (({"unit": "kN"}, "unit: N as the file states, found kN"),
                          ({"rate_hz": 1000}, "forces.rate_hz: 1000 says")):  # fmt: skip
        with pytest.raises(RecordingError, match=part):
            read_force_signals(block("forces", **given, **options), feet=("heel", "toe"))


MISTAKES = {
    "no channels": ({"USED": 0}, ["ANALOG:USED: expected channels, found none"]),
    "another number": ({"USED": 4}, ["a divisor of the 15 analog numbers", "found 4"]),
    "few scales": ({"SCALE": np.ones(2, np.float32)}, ["ANALOG:SCALE: expected 3", "found 2"]),
    "unknown channel": ({"LABELS": ["Fx", "FZ", "EMG"]}, ["'Fz' once among Fx, FZ, EMG"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_told(tmp_path, mistake):
    changed, parts = MISTAKES[mistake]
    file = written(tmp_path / "a.c3d", **changed)
    with pytest.raises(RecordingError) as caught:
        read_analogs(file).channel("Fz")
    for part in (str(file), "expected", "found", *parts):
        assert part in str(caught.value)


def test_analog_channels_need_no_points_and_points_no_analog_channels(tmp_path):
    path = written(tmp_path / "plate.c3d", n_points=0)
    np.testing.assert_allclose(read_analogs(path).values, FORCE, atol=1e-3)
    with pytest.raises(RecordingError, match="expected markers, found none"):
        read_raw(path)
    assert read_raw(written(tmp_path / "both.c3d")).markers == ("a",)


def test_parameters_of_many_channels_go_on_in_further_ones(tmp_path):
    scale, offset = np.array([1, 0.5, 1], np.float32), np.array([0, 10, 0])
    more = {"SCALE": scale[:2], "SCALE2": scale[2:], "OFFSET": offset[:1], "OFFSET2": offset[1:]}
    path = written(tmp_path / "many.c3d", LABELS=["Fx"], LABELS2=["Fz"], LABELS3=["EMG"], **more)
    found = read_analogs(path)
    assert found.names == ("Fx", "Fz", "EMG")
    np.testing.assert_allclose(found.values, FORCE, atol=1e-3)
