"""Arrays from an archive: those that are asked for, and no more memory than they need."""

import io
import resource
import zipfile

import numpy as np
import pytest

from hopdata.errors import RecordingError
from hopdata.foreign.npz import arrays_of

MOST = 10_000


def read(path, *names):
    return arrays_of(path, names, wanted="a model", most=MOST)


def archive(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


def stored(array):
    content = io.BytesIO()
    np.lib.format.write_array(content, np.asanyarray(array), allow_pickle=True)
    return content.getvalue()


def claiming(shape, descr="<f8"):
    """Return the head of an array without its numbers."""
    content = io.BytesIO()
    head = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(content, head)
    return content.getvalue()


def test_arrays_of_numbers_come_back(tmp_path):
    path = tmp_path / "a.npz"
    x = np.arange(6.0).reshape(2, 3)
    np.savez(path, x=x, y=np.array(True), other=np.zeros(3))
    found = read(path, "x", "y")
    assert {*found} == {"x", "y"}
    np.testing.assert_array_equal(found["x"], x)
    assert found["y"].dtype == bool


class Runs:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was loaded",))


@pytest.mark.parametrize(
    "content",
    [
        stored(np.array([Runs()], dtype=object)),
        claiming((10**15,)),
        claiming((3, 2**62)),
        claiming((-1,)),
        claiming((), "|O"),
        b"\x93NUMPY\x09\x00",
        b"",
        stored(np.zeros(MOST)),
    ],
)
def test_what_is_no_small_array_of_numbers_is_refused(tmp_path, content):
    path = archive(tmp_path / "a.npz", x=content)
    with pytest.raises(RecordingError, match=r"a\.npz: expected a model") as caught:
        read(path, "x")
    assert caught.value.code == "foreign.other_file"


def test_a_bomb_is_not_unpacked(tmp_path):
    path = tmp_path / "a.npz"
    # 8 MB of zeros in less than 10 kB.
    archive(path, x=bytes(8 << 20))
    assert path.stat().st_size < MOST
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(RecordingError, match="once it is unpacked"):
        read(path, "x")
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown_kb < 4_000


def test_a_missing_array_or_file_is_told(tmp_path):
    path = archive(tmp_path / "a.npz", x=stored(np.zeros(2)))
    with pytest.raises(RecordingError, match="y"):
        read(path, "x", "y")
    with pytest.raises(RecordingError, match="No such file"):
        read(tmp_path / "b.npz", "x")


def test_a_lack_of_memory_is_no_fault_of_the_file(tmp_path, monkeypatch):
    path = archive(tmp_path / "a.npz", x=stored(np.zeros(2)))

    def lacks(*_, **__):
        raise MemoryError

    with monkeypatch.context() as without:
        without.setattr(np.lib.format, "read_array", lacks)
        with pytest.raises(MemoryError):
            read(path, "x")
    assert {*read(path, "x")} == {"x"}
