"""The checksum at the end of a file tells damaged bytes from changed ones."""

import h5py
import numpy as np
import pytest

from hopdata.seal import Seal, seal_for, seal_of, sealed


@pytest.fixture
def file(tmp_path):
    """Return a sealed HDF5 file."""
    path = tmp_path / "a.h5"
    with sealed(path), h5py.File(path, "w") as content:
        content["numbers"] = np.arange(50.0)
        content.attrs["name"] = "one"
    return path


def test_a_sealed_file_is_whole_and_other_programs_read_it(file):
    assert seal_of(file) is Seal.WHOLE
    with h5py.File(file) as content:
        assert content["numbers"][:].sum() == 1225
    assert seal_of(file) is Seal.WHOLE


def test_each_flipped_bit_breaks_the_seal_or_is_in_its_mark(file):
    whole = file.read_bytes()
    n_seal = len(seal_for(file))
    for place in [
        *range(0, len(whole) - n_seal, 37),
        *range(len(whole) - n_seal, len(whole) - 1),
    ]:
        damaged = bytearray(whole)
        damaged[place] ^= 4
        file.write_bytes(damaged)
        is_in_mark = len(whole) - n_seal <= place < len(whole) - 65
        assert seal_of(file) is (Seal.NONE if is_in_mark else Seal.BROKEN), place


def test_a_change_through_the_library_cuts_the_seal_off(file):
    with h5py.File(file, "r+") as content:
        content.attrs["name"] = "two"
    assert seal_of(file) is Seal.NONE
    with h5py.File(file) as content:
        assert content.attrs["name"] == "two"


@pytest.mark.parametrize("content", [b"", b"short", b"x" * 500])
def test_another_file_has_no_seal(tmp_path, content):
    (tmp_path / "b").write_bytes(content)
    assert seal_of(tmp_path / "b") is Seal.NONE


def test_bytes_behind_the_seal_or_lost_before_it_are_noticed(file):
    whole = file.read_bytes()
    file.write_bytes(whole[:100] + whole[101:])
    assert seal_of(file) is Seal.BROKEN
    file.write_bytes(whole + b"x")
    assert seal_of(file) is Seal.NONE
