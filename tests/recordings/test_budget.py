"""What a file may cost is known before it is read: no small file takes much time or memory."""

import pickle
import resource
import subprocess
import sys
import time
import tracemalloc
import zlib

import h5py
import numpy as np
import pytest
from keypoint_files import columns, pandas_rows, table
from mat_files import qtm_struct, write_mat5, write_mat73
from qtm_files import NAMES, standing

from hopdata.errors import RecordingError
from hopdata.recordings import budget, raw
from hopdata.recordings.readers import mat, text
from hopdata.recordings.readers.formats import read_raw

# Reads a file and prints the most memory that this took beyond the imports, MB.
READ = """
import resource, sys
import pandas, scipy.io
from hopdata.errors import HopdataError
from hopdata.recordings.readers.formats import read_raw

def used_mb():
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    of_child = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return max(own, of_child) / 1024

before = used_mb()
try:
    read_raw(sys.argv[1])
    said = "read"
except HopdataError as error:
    said = str(error)
print(used_mb() - before, said)
"""


def memory_mb(path):
    """Return the memory that a process takes to read a file, MB, and what it says."""
    command = [sys.executable, "-c", READ, str(path)]
    said = subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=120
    ).stdout
    number, _, words = said.partition(" ")
    return float(number), words.strip()


@pytest.mark.parametrize(("compressed", "most"), [(True, 1.4), (False, 2.4)])
def test_a_mat_file_is_held_once_and_not_several_times(tmp_path, compressed, most):
    """SciPy itself copies what it does not unpack."""
    positions = np.random.default_rng(4).normal(size=(80_000, len(NAMES), 3))
    path = write_mat5(
        tmp_path / "a.mat", qtm_struct(positions, NAMES), compressed=compressed
    )
    content = positions.size // 3 * 4 * 8
    read_raw(path)  # imports
    tracemalloc.start()
    try:
        assert mat.read_mat(path, 2000.0)["trial"]["Frames"].item() == len(positions)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert content < peak < most * content


def test_a_variable_of_another_size_than_it_states_is_refused(tmp_path):
    path = write_mat5(
        tmp_path / "a.mat", qtm_struct(standing(20), NAMES), compressed=True
    )
    whole = path.read_bytes()
    content = zlib.decompress(whole[136:])
    for wrong in (content + b"x", content[:-1]):
        packed = zlib.compress(wrong)
        path.write_bytes(
            whole[:132] + np.array([len(packed)], "<u4").tobytes() + packed
        )
        with pytest.raises(
            RecordingError, match="bytes compressed, found more or less"
        ):
            read_raw(path)


def test_matrices_of_a_mat_file_are_counted(tmp_path, monkeypatch, read_here):
    path = write_mat5(tmp_path / "a.mat", qtm_struct(standing(20), NAMES))
    assert read_raw(path).markers == NAMES
    monkeypatch.setattr(mat, "MOST_MATRICES", 10)
    with pytest.raises(RecordingError, match="at most 10 matrices, found more"):
        read_raw(path)


def complex_5(path):
    return write_mat5(
        path, qtm_struct(standing(20), NAMES) | {"FrameRate": 100.0 + 1.0j}
    )


def complex_73(path):
    write_mat73(path, qtm_struct(standing(20), NAMES))
    with h5py.File(path, "r+") as file:
        del file["trial/FrameRate"]
        file["trial/FrameRate"] = np.array([[100.0 + 1.0j]])
    return path


@pytest.mark.parametrize("write", [complex_5, complex_73])
def test_a_rate_that_is_a_complex_number_is_refused(tmp_path, write):
    with pytest.raises(
        RecordingError, match=r"expected (a number|numbers), found .*complex128"
    ):
        read_raw(write(tmp_path / "a.mat"))


def pickled(path, content):
    """Write a table of keypoints whose names are these bytes."""
    heads = columns(NAMES, score="")
    pandas_rows(path, heads, table(standing(5)))
    with h5py.File(path, "r+") as file:
        file["df_with_missing/table"].attrs["values_block_0_kind"] = np.bytes_(content)
    return path


def nest(depth):
    names = ("x",)
    for _ in range(depth):
        names = (names, names)
    return [names]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\x80\x02]r\x80\xd1\xf0\x08.", "with an entry 150000000"),
        (b"(lp150000000\n.", "with an entry 150000000"),
        (b"\x80\x05\x96\xff\xff\xff\xff\xff\xff\xff\x0f.", "in a bytearray8"),
        (pickle.dumps([{"x": 1}], 2), r"more \(EMPTY_DICT\)"),
        (pickle.dumps(nest(18), 2), "found tuple"),
    ],
)
def test_a_pickle_asks_for_no_memory_by_number(tmp_path, content, said, read_here):
    path = pickled(tmp_path / "a.h5", content)
    most_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.process_time()
    with pytest.raises(RecordingError, match=said):
        read_raw(path, rate_hz=50.0)
    assert time.process_time() - begin < 2.0
    # Earlier tests of this process may have taken more.
    more_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - most_kib
    assert more_kib < 1 << 20


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_names_pickled_by_any_protocol_are_read(tmp_path, protocol):
    content = pickle.dumps(columns(NAMES, score=""), protocol)
    if b"\0" in content[-1:]:
        pytest.fail("HDF5 would cut the zero off")
    path = pickled(tmp_path / "a.h5", content)
    assert read_raw(path, rate_hz=50.0).markers == NAMES


def one_line(file, n_bytes):
    file.write(b"NO_OF_FRAMES\t1\n")
    for _ in range(n_bytes // 2000):
        file.write(b"a\t" * 1000)


def wide_utf16(file, n_bytes):
    file.write(b"\xff\xfe" + "NO_OF_FRAMES\t1\n".encode("utf-16-le"))
    for _ in range(n_bytes // 2000):
        file.write("a\t".encode("utf-16-le") * 500)


@pytest.mark.parametrize("write", [one_line, wide_utf16])
def test_a_line_of_many_megabytes_is_refused_before_it_is_split(tmp_path, write):
    path = tmp_path / "a.tsv"
    with path.open("wb") as file:
        write(file, 20_000_000)
    took_mb, said = memory_mb(path)
    assert "expected lines of at most 1,500,000 bytes, found a longer one" in said
    assert took_mb < 150  # a UTF-16 text is converted as a whole


def test_a_long_line_between_short_ones_is_found_and_a_shorter_one_is_not(tmp_path):
    path = tmp_path / "a.csv"
    short = b"1,2,3\n" * 200_000
    for n_bytes, is_refused in ((1_499_998, False), (1_500_001, True)):
        path.write_bytes(short + b"9" * n_bytes + b"\n" + short)
        if is_refused:
            with (
                pytest.raises(RecordingError, match="lines of at most"),
                text.readable(path),
            ):
                pass
        else:
            with text.readable(path) as file:
                assert file.read(6) == b"1,2,3\n"


def test_old_line_ends_are_still_line_ends(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b"a,b\r1,2\r3,4")
    with text.readable(path) as file:
        assert list(file) == [b"a,b\n", b"1,2\n", b"3,4"]
    path.write_bytes("a,b\r\n1,2\r\n".encode("utf-16"))
    with text.readable(path) as file:
        assert list(file) == [b"a,b\n", b"1,2\n"]


def wide_table(path, n_markers):
    names = "\t".join("a" * n_markers)
    head = f"NO_OF_FRAMES\t2\nNO_OF_MARKERS\t{n_markers}\nFREQUENCY\t100\nMARKER_NAMES\t{names}\n"
    path.write_text(head + ("\t".join("1" * 3 * n_markers) + "\n") * 2)
    return path


def test_as_many_columns_as_no_system_has_are_refused_and_a_thousand_markers_are_read(
    tmp_path, read_here
):
    found = read_raw(wide_table(tmp_path / "a.tsv", 1000))
    assert found.positions.shape == (2, 1000, 3)
    assert sum(len(str(remark)) for remark in found.remarks) < 1000
    path = wide_table(tmp_path / "b.tsv", 60_000)
    begin = time.process_time()
    with pytest.raises(RecordingError, match="at most 60,100 columns, found 180,000"):
        read_raw(path)
    assert time.process_time() - begin < 5.0


def test_equal_names_are_numbered_in_linear_time():
    names = [f"n{k}" for k in range(8000)] * 2
    begin = time.process_time()
    distinct, remarks = raw.distinct_names("a", names)
    assert time.process_time() - begin < 2.0
    assert len(set(distinct)) == 16_000
    (remark,) = remarks
    assert len(remark.values["shared"]) == 8000
    assert len(str(remark)) < 1000
    with pytest.raises(RecordingError, match="at most 20,000 markers, found 20,001"):
        raw.distinct_names("a", ["x"] * 20_001)


def test_the_limits_leave_room_for_ten_million_frames_of_a_large_system(tmp_path):
    """Frames are rows: no limit of names, links or lines grows with them."""
    n_markers, n_digits = 500, 14
    assert n_markers * 3 * n_digits < budget.LONGEST_LINE
    assert 3 * n_markers + 2 < budget.MOST_COLUMNS
    assert n_markers < budget.MOST_MARKERS
    assert budget.MOST_COLUMNS * 25 > budget.LONGEST_LINE > 3 * budget.MOST_MARKERS
