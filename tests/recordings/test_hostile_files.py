"""Files and readers that do harm: one clear line each, and the next file is read."""

import importlib
import struct
import sys
from dataclasses import fields
from importlib.metadata import EntryPoint
from pathlib import Path

import h5py
import numpy as np
import pytest
from damage import corpus, placed
from vendor_files import zipped

from hopdata.errors import RecordingError
from hopdata.foreign import budget, door, watch
from hopdata.recording import Event
from hopdata.recordings.readers import formats
from hopdata.recordings.readers.formats import read_raw
from hopdata.recordings.readers.hdf5 import read_recording


@pytest.fixture
def sound(tmp_path):
    """Return a recording as another program writes it, without a seal."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["time"] = np.arange(20) / 100
        file["positions"] = np.random.default_rng(3).normal(size=(20, 2, 3))
        file.attrs["markers"], file.attrs["roles"] = ["a", "b"], ["body", "foot"]
        file.attrs["rate_hz"] = 100.0
        file.attrs.update(name="a", source="", source_sha256="", vertical_axis="z")
    return path


@pytest.fixture
def endless(sound):
    """Return a file whose heap of texts ends in free space of size 0: the library stays there."""
    path = sound.with_name("endless.h5")
    content = bytearray(sound.read_bytes())
    at = content.index(b"GCOL") + 16
    number, size = struct.unpack("<H6xQ", content[at : at + 16])
    while number:
        at += 16 + (size + 7) // 8 * 8
        number, size = struct.unpack("<H6xQ", content[at : at + 16])
    content[at + 8 : at + 16] = bytes(8)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("read", [read_raw, read_recording])
def test_a_file_without_end_is_refused_and_the_next_one_is_read(
    sound, endless, served, monkeypatch, read
):
    with monkeypatch.context() as impatient:
        impatient.setattr(budget, "LEAST_S", 0.2)
        with pytest.raises(RecordingError, match=r"endless\.h5: .*goes on") as caught:
            read(endless)
    assert caught.value.code == "foreign.time"
    assert read(sound).markers == ("a", "b")


def test_what_is_read_apart_is_what_is_read_here(tmp_path, served):
    """All formats: the same bytes, in the same order of axes, and the same words."""
    n_read = 0
    for name, content in corpus().items():
        path = placed(tmp_path, name, content)
        if path.suffix == ".mot":
            continue
        apart = read_or_refused(path)
        with door.open_here():
            here = read_or_refused(path)
        assert type(apart) is type(here)
        if isinstance(here, RecordingError):
            assert str(apart) == str(here)
            continue
        n_read += 1
        for field in fields(here):
            one, other = getattr(apart, field.name), getattr(here, field.name)
            if isinstance(other, np.ndarray):
                assert one.tobytes() == other.tobytes()
                assert (one.dtype, one.shape) == (other.dtype, other.shape)
                if other.size:
                    assert one.strides == other.strides
            else:
                assert one == other
                assert type(one) is type(other)
        assert all(type(event) is Event for event in apart.events)
    assert n_read > 10


def read_or_refused(path):
    try:
        return read_raw(path)
    except RecordingError as error:
        return error


def workbook(rows):
    """Return a workbook of one sheet with these bytes as its rows."""
    kind = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    return zipped({"xl/worksheets/sheet1.xml": f'<worksheet xmlns="{kind}">{rows}'})


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        (
            "bomb.xlsx",
            lambda: workbook(" " * 200_000_000),
            "at most 750 MB once it is unpacked",
        ),
        (
            "line.tsv",
            lambda: b"NO_OF_FRAMES\t1\n" + b"a\t" * 2_000_000,
            "lines of at most",
        ),
        (
            "deep.mvnx",
            lambda: b"<mvnx>" + b"<a>" * 100_000,
            "at most 32 elements within",
        ),
        (
            "entities.mvnx",
            lambda: b'<!DOCTYPE x [<!ENTITY a "aa">]><mvnx>&a;',
            "an entity",
        ),
        (
            "deep.ktk.zip",
            lambda: zipped({"data.json": "[" * 9_000_000}),
            "at most 750 MB once",
        ),
    ],
)
def test_small_files_that_ask_for_much_are_refused(
    tmp_path, served, name, content, said
):
    path = tmp_path / name
    path.write_bytes(content())  # large ones are made when they are needed
    with pytest.raises(RecordingError, match=said) as caught:
        read_raw(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("chunks", [None, (10**6,)])
def test_a_claim_of_a_million_million_rows_is_refused(sound, served, chunks):
    with h5py.File(sound, "r+") as file:
        del file["time"]
        create = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        if chunks:
            create.set_chunk(chunks)
        else:
            create.set_alloc_time(h5py.h5d.ALLOC_TIME_LATE)
        space = h5py.h5s.create_simple((10**12,))
        h5py.h5d.create(file.id, b"time", h5py.h5t.NATIVE_DOUBLE, space, create)
    with pytest.raises(RecordingError, match="at most 250 MB once it is unpacked"):
        read_raw(sound)


def test_a_truth_in_a_file_without_a_seal_is_read_apart(sample_path, tmp_path, served):
    from hopdata.recordings.readers.hdf5 import holds_truth, read_truth, roles_of_truth

    copy = tmp_path / "copy.h5"
    copy.write_bytes(sample_path.read_bytes())
    with h5py.File(copy, "r+") as file:  # which cuts the seal off
        file.attrs["name"] = "copy"
    whole, apart = read_truth(sample_path), read_truth(copy)
    np.testing.assert_array_equal(whole.contact_times, apart.contact_times)
    assert whole.parameters_json == apart.parameters_json
    roles = roles_of_truth(sample_path)
    body = [name for name, role in roles.items() if role == "body"]
    feet = [name for name, role in roles.items() if role == "foot"]
    assert holds_truth(copy, body=body, feet=feet)
    assert not holds_truth(copy, body=feet, feet=body)


MODULE = "harmful_for_a_test"


@pytest.fixture
def plugin(tmp_path, monkeypatch, forked):
    """Return a function that reads a file with a reader of another package."""
    monkeypatch.syspath_prepend(tmp_path)

    def use(code):
        lines = "\n    ".join(code.splitlines())
        text = f"def read(path, rate_hz):\n    {lines}\n"
        Path(tmp_path, f"{MODULE}.py").write_text(text)
        entry = EntryPoint(".odd", f"{MODULE}:read", "hopdata.readers")
        monkeypatch.setattr(formats, "_others", lambda: {".odd": entry})
        monkeypatch.delitem(sys.modules, MODULE, raising=False)
        importlib.invalidate_caches()
        (tmp_path / "a.odd").write_text("content")
        return read_raw(tmp_path / "a.odd")

    return use


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("while True:\n    pass", "goes on and on"),
        ("import time\ntime.sleep(100)", "waits for something"),
        ("import numpy\nnumpy.ones(50 * 2**30)", "wants more"),
        ("kept = []\nwhile True:\n    kept.append(b'x' * 10**7)", "wants more"),
        ("raise SystemExit(2)", "SystemExit: 2"),
        ("raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
        ("print('x' * 10**6)\nreturn 3", "expected a RawRecording, found int"),
        ("import os\nos._exit(0)", "exit code 0"),
        ("import os\nos.abort()", "SIGABRT"),
        ("import socket\nsocket.create_connection(('127.0.0.1', 9))", "found socket"),
        ("import os\nos.system('true')", "found os.system"),
        ("open(str(path) + '.new', 'w')", "to be written"),
        ("import pickle\npickle.loads(pickle.dumps(print))", "pickle.find_class"),
    ],
)
def test_a_reader_that_does_harm_is_named_in_one_line(
    plugin, monkeypatch, tmp_path, code, said
):
    # Only where time is what ends it: on a busy computer memory takes long to fill.
    if said in ("goes on and on", "waits for something"):
        monkeypatch.setattr(budget, "LEAST_S", 0.5)
        monkeypatch.setattr(watch, "LONGEST_SLEEP_S", 0.5)
    with pytest.raises(RecordingError) as caught:
        plugin(code)
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "a.odd"))
    assert f"the reader ({MODULE}:read)" in message
    assert said in message
    assert "\n" not in message
    assert not (tmp_path / "a.odd.new").exists()
