"""Readers of other packages: what they raise or return wrongly is told in one line."""

import importlib
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from hopdata.errors import RecordingError
from hopdata.recordings.readers import formats
from hopdata.recordings.readers.formats import read_raw

MODULE = "theirs_for_a_test"


@pytest.fixture
def read(tmp_path, monkeypatch, forked):
    """Return a function that reads a file with another package's reader, given as Python code."""
    monkeypatch.syspath_prepend(tmp_path)

    def use(code):
        Path(tmp_path, f"{MODULE}.py").write_text(code)
        plugin = EntryPoint(".odd", f"{MODULE}:read", "hopdata.readers")
        monkeypatch.setattr(formats, "_others", lambda: {".odd": plugin})
        monkeypatch.delitem(sys.modules, MODULE, raising=False)
        importlib.invalidate_caches()
        (tmp_path / "a.odd").write_text("content")
        return read_raw(tmp_path / "a.odd")

    return use


SOUND = """
import numpy as np
from hopdata.recordings.raw import RawRecording

def read(path, rate_hz):
    found = RawRecording(("a", "b"), np.arange(5) / 100, np.zeros((5, 2, 3)), 100.0, "mm")
"""


def test_a_sound_reader_is_used(read):
    assert read(SOUND + "    return found").markers == ("a", "b")


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("def read(path, rate_hz):\n    return {}['time']", "KeyError: 'time'"),
        (
            "def read(path, rate_hz):\n    raise SystemError('two\\nlines')",
            "SystemError: two lines",
        ),
        (
            "def read(path):\n    return 1",
            "TypeError: read() takes 1 positional argument",
        ),
        (
            "import no_such_module",
            "ModuleNotFoundError: No module named 'no_such_module'",
        ),
        ("def write():\n    pass", "AttributeError"),
        (
            "def read(path, rate_hz):\n    return 1",
            "expected a RawRecording, found int",
        ),
    ],
)
def test_any_error_names_the_reader_the_file_and_the_error(read, code, said):
    with pytest.raises(RecordingError) as caught:
        read(code)
    for part in ("a.odd", f"the reader ({MODULE}:read)", said):
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "positions=found.positions[:4]",
            "positions: expected float64 of (5, 2, 3), found",
        ),
        (
            "positions=found.positions.astype(int)",
            "positions: expected float64 of (5, 2, 3), fo",
        ),
        ("time=list(found.time)", "time: expected float64 of (5,), found list"),
        ("unit='furlong'", "unit: expected mm or m, found 'furlong'"),
    ],
)
def test_parts_that_do_not_fit_are_told(read, change, said):
    with pytest.raises(RecordingError) as caught:
        read(
            f"from dataclasses import replace\n{SOUND}    return replace(found, {change})"
        )
    assert said in str(caught.value)


def test_its_own_hopdata_error_is_left_as_it_is(read):
    code = "from hopdata.errors import RecordingError\n\ndef read(path, rate_hz):\n"
    with pytest.raises(RecordingError, match=r"^theirs: no feet$"):
        read(code + "    raise RecordingError('theirs: no feet')")
