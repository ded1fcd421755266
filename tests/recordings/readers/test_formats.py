"""Files that would take far more memory than their size, or refer to other files, are refused."""

import tracemalloc
import zlib

import h5py
import numpy as np
import pytest
from mat_files import qtm_struct, write_mat5, write_mat73
from qtm_files import NAMES, standing

from hopdata.errors import RecordingError
from hopdata.foreign import budget
from hopdata.recording import Recording
from hopdata.recordings.readers.formats import read_raw
from hopdata.recordings.readers.hdf5 import write_recording

N_BYTES = 60_000_000


def sound(path):
    positions = standing(20) * 1e-3
    roles = ("body", "body", "body", "foot", "foot")
    write_recording(
        path, Recording("a", np.arange(20) / 100, positions, NAMES, roles, 100.0)
    )
    return path


def mat5(path, dtype):
    struct = {**qtm_struct(standing(20), NAMES), "More": np.zeros(N_BYTES // 8, dtype)}
    return write_mat5(path.with_suffix(".mat"), struct, compressed=True)


def mat73(path, dtype):
    path = write_mat73(path.with_suffix(".mat"), qtm_struct(standing(20), NAMES))
    with h5py.File(path, "r+") as file:
        file["trial"].create_dataset(
            "More", data=np.zeros(N_BYTES // 8, dtype), compression=9
        )
    return path


def hdf5(path, dtype):
    with h5py.File(sound(path.with_suffix(".h5")), "r+") as file:
        del file["time"]
        file.create_dataset("time", data=np.zeros(N_BYTES // 8, dtype), compression=9)
    return path.with_suffix(".h5")


@pytest.mark.parametrize(
    "dtype", ["f8", "i1"]
)  # the latter needs an eighth of the memory at first
@pytest.mark.parametrize("make", [mat5, mat73, hdf5])
def test_a_small_file_that_unpacks_to_too_much_is_refused_before_memory_is_asked_for(
    tmp_path, make, dtype, monkeypatch, read_here
):
    monkeypatch.setattr(budget, "LEAST_UNPACKED", 30_000_000)
    path = make(tmp_path / "bomb", dtype)
    assert path.stat().st_size < N_BYTES / 50
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError) as caught:
            read_raw(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    for part in (
        str(path),
        "expected at most 30 MB once it is unpacked",
        "found 6",
        "export it in parts",
    ):
        assert part in str(caught.value)
    assert peak < (N_BYTES if make is mat5 and dtype == "i1" else 5e6)


def test_a_mat_file_that_claims_gigabytes_is_refused_by_the_default(tmp_path):
    path = mat5(tmp_path / "bomb", "f8")
    content = bytearray(path.read_bytes())
    stream = zlib.decompressobj()
    whole = bytearray(stream.decompress(bytes(content[136:])))
    whole[4:8] = np.array([4_200_000_000], "<u4").tobytes()
    packed = zlib.compress(bytes(whole))
    content[132:] = np.array([len(packed)], "<u4").tobytes() + packed
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"at most 250 MB .* found 4200 MB"):
        read_raw(path)


def linked(file, other):
    file["time"] = h5py.ExternalLink(str(other), "time")


def stored_elsewhere(file, other):
    file.create_dataset("time", (20,), "f8", external=[(str(other), 0, 160)])


def virtual(file, other):
    layout = h5py.VirtualLayout((20,), "f8")
    layout[:] = h5py.VirtualSource(str(other), "time", (20,))
    file.create_virtual_dataset("time", layout)


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
@pytest.mark.parametrize("reach", [linked, stored_elsewhere, virtual])
def test_data_in_another_file_are_refused_by_name(tmp_path, reach, suffix):
    other = sound(tmp_path / "other.h5")
    path = tmp_path / f"here{suffix}"
    if suffix == ".h5":
        sound(path)
    else:
        write_mat73(path, qtm_struct(standing(20), NAMES))
    with h5py.File(path, "r+") as file:
        inside = file if suffix == ".h5" else file["trial"]
        if "time" in inside:
            del inside["time"]
        reach(inside, other)
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    for part in (
        str(path),
        "time'",
        "expected all data in the file itself",
        str(other),
    ):
        assert part in str(caught.value)
