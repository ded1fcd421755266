"""Settings and modules that lie in the working folder: neither read nor imported."""

import os
import subprocess
import sys

import pytest

SHOW = """
import sys
from hopdata.foreign.settings import leave_unread
{before}
import matplotlib, numba, os
from numba.core import config
config.reload_config()
print(matplotlib.rcParamsOrig["font.size"], config.DISABLE_JIT, os.getcwd())
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "matplotlibrc").write_text("font.size: 41\n")
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n")
    return tmp_path


def shown(folder, before):
    run = subprocess.run(
        [sys.executable, "-P", "-c", SHOW.format(before=before)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        env={k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")},
    )
    return run.stdout.split()


def test_settings_of_the_working_folder_are_left_unread(folder):
    size, off, where = shown(folder, "leave_unread()")
    assert (size, off) == ("10.0", "0")
    assert where == str(folder)


def test_the_libraries_would_read_them(folder, monkeypatch):
    """Without this the test above could not fail."""
    code = SHOW.format(before="").replace(
        "from hopdata.foreign.settings import leave_unread", ""
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.split()[:2] == ["41.0", "1"]


def test_nothing_is_imported_where_no_such_file_lies(tmp_path):
    code = "import sys, hopdata; print({'matplotlib', 'numba'} & {*sys.modules})"
    run = subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout == "set()\n"


def test_a_pipe_in_their_place_keeps_nobody_waiting(tmp_path):
    os.mkfifo(tmp_path / "matplotlibrc")
    code = "import hopdata, matplotlib; print('done')"
    run = subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert run.stdout == "done\n"
