"""Damaged files of all formats: a sample of what benchmarks/reading.py reads."""

import warnings
from contextlib import nullcontext
from pathlib import Path

import pytest
from damage import case, corpus, placed, read

from hopdata.foreign import door
from hopdata.recordings.readers.formats import READERS, suffix_of

SEED, N_FILES = 5, 1050


@pytest.fixture(scope="module")
def sound():
    return corpus()


def test_the_files_are_sound_before_they_are_damaged(sound, tmp_path):
    readers = {suffix_of(Path(name)) for name in sound}
    lacking = set(READERS) - readers - {".hdf5"}  # read as .h5
    assert not lacking, f"no sound file in tests/recordings/damage.py: {lacking}"
    for name, data in sound.items():
        recording = read(placed(tmp_path, name, data))
        assert not isinstance(recording, str), f"{name}: {recording}"
        assert len(recording.time) == 24


@pytest.mark.parametrize("part", range(5))
def test_a_damaged_file_gives_a_recording_or_a_message(
    sound, tmp_path, part, served, impatient
):
    names, refused = list(sound), 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # includes warnings of other libraries
        for number in range(part, N_FILES, 5):
            name, data = case(sound, names, SEED, number)
            path = placed(tmp_path, name, data)
            # Any other error fails the test. The HDF5 library hangs on some files.
            way = door.open_here()
            if path.suffix in (".h5", ".mat"):
                way = nullcontext()
            with way:
                refused += isinstance(read(path), str)
    assert 0 < refused < N_FILES / 5


def test_the_same_seed_gives_the_same_damage(sound):
    names = list(sound)
    assert corpus() == sound
    assert case(sound, names, SEED, 7) == case(corpus(), names, SEED, 7)
    assert case(sound, names, SEED, 7) != case(sound, names, SEED + 1, 7)


def test_one_more_sound_file_leaves_the_damage_of_the_others(sound):
    names = list(sound)
    more = ["one_more.csv", *names]
    larger = {**sound, "one_more.csv": sound["motive.csv"]}

    def deal(files, names, n_turns=3):
        cases = [case(files, names, SEED, k) for k in range(n_turns * len(names))]
        return {(name, data) for name, data in cases if name != "one_more.csv"}

    assert deal(larger, more) == deal(sound, names)
    assert len(deal(sound, names)) > 2 * len(names)  # the turns differ
    _, of_one = case(larger, more, SEED, 0)
    assert of_one != case(sound, names, SEED, names.index("motive.csv"))[1]
