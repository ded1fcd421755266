"""A file that differs from what its job wrote is noticed, and none is that does not."""

import shutil
import subprocess

import pytest

from hopdata import digests
from hopdata.errors import DamagedError


@pytest.fixture
def files(tmp_path):
    """Return two files with their digests, the second in a folder."""
    made = [tmp_path / "a.csv", tmp_path / "tables" / "b c.csv"]
    for file in made:
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"{file.name}\n1\n")
    digests.keep([*made, tmp_path / "absent.csv", tmp_path / "tables"])
    return made


def test_what_was_written_is_whole(files, tmp_path):
    assert not any(digests.is_changed(file) for file in files)
    digests.require_unchanged(files)
    assert digests.changed_in(tmp_path) == {}


@pytest.mark.parametrize("content", [b"", b"a.csv", b"a.csv\n3\n", b"\0" * 8])
def test_damage_is_noticed_and_named(files, tmp_path, content):
    files[0].write_bytes(content)
    assert digests.changed_in(tmp_path) == {files[0]: files[0]}
    with pytest.raises(DamagedError, match=r"a\.csv: expected the bytes that were"):
        digests.require_unchanged(files)


def test_each_bit_of_a_file_and_of_its_digest_counts(files):
    for place in (files[0], digests.place_of(files[0])):
        whole = place.read_bytes()
        for byte in range(min(len(whole), 64)):
            for bit in range(8):
                damaged = bytearray(whole)
                damaged[byte] ^= 1 << bit
                place.write_bytes(damaged)
                assert digests.is_changed(files[0]), (place, byte, bit)
        place.write_bytes(whole)
    assert not digests.is_changed(files[0])


def test_a_file_without_a_digest_or_without_itself_is_nobodys_fault(files, tmp_path):
    (tmp_path / "other.csv").write_text("1\n")
    files[1].unlink()
    assert digests.changed_in(tmp_path) == {}
    digests.require_unchanged([tmp_path / "other.csv", files[1], tmp_path / "tables"])


@pytest.fixture
def further(files, tmp_path):
    """Let a job with the output a.csv also have written two files of no rule."""
    made = [tmp_path / "figures" / "one two.svg", tmp_path / "other.csv"]
    for file in made:
        file.parent.mkdir(exist_ok=True)
        file.write_text(f"{file.name}\n")
    digests.keep_further(files[0], made)
    return made


def test_further_files_of_a_job_are_whole_as_written(files, further, tmp_path):
    assert digests.further_change(files[0]) is None
    assert digests.changed_in(tmp_path) == {}


@pytest.mark.parametrize("number", [0, 1])
def test_a_changed_or_lost_further_file_is_told_of_the_output(
    files, further, tmp_path, number
):
    further[number].write_text("changed")
    assert digests.changed_in(tmp_path) == {files[0]: further[number]}
    further[number].unlink()
    assert digests.changed_in(tmp_path) == {files[0]: further[number]}
    # A job that reads the output itself is not concerned.
    assert not digests.is_changed(files[0])
    digests.require_unchanged(files)


def test_each_bit_of_the_digests_of_further_files_counts(files, further, tmp_path):
    place = digests.place_of(files[0])
    whole = place.read_bytes()
    begin = whole.index(b"\n") + 1
    for byte in range(begin, len(whole) - 1):
        damaged = bytearray(whole)
        damaged[byte] ^= 4
        place.write_bytes(damaged)
        assert [*digests.changed_in(tmp_path)] == [files[0]], byte
    # When the output is written anew, its digest is alone again.
    digests.keep(files)
    assert whole.startswith(place.read_bytes())
    assert len(place.read_bytes()) == begin


def test_a_copy_of_what_lies_in_object_storage_has_no_digest(tmp_path):
    """Another machine may replace the original, of which a digest here would not know."""
    copy = tmp_path / ".snakemake" / "storage" / "s3" / "a.csv"
    copy.parent.mkdir(parents=True)
    copy.write_text("1")
    digests.keep([copy])
    assert not digests.place_of(copy).exists()
    copy.write_text("2")
    digests.require_unchanged([copy])


def test_another_program_checks_the_same_digests(files):
    if shutil.which("sha256sum") is None:
        pytest.skip("no sha256sum here")
    folder = files[1].parent
    check = ["sha256sum", "--check", str(digests.place_of(files[1]))]
    assert (
        subprocess.run(check, cwd=folder, capture_output=True, check=False).returncode
        == 0
    )
    files[1].write_text("other")
    assert (
        subprocess.run(check, cwd=folder, capture_output=True, check=False).returncode
        == 1
    )
