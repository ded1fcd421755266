"""Recordings for the tests: the bundled sample, and real ones that are not in git."""

import gc
import os
import signal
from pathlib import Path

import pytest

# One test process runs per core. If each had a BLAS thread per core, they would only
# wait for one another. This is set before anything imports NumPy, and inherited by
# processes that tests start.
for library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# Processes that tests start fail at NumPy's warnings too, as tests do
# (`pyproject.toml`).
os.environ.setdefault("PYTHONWARNINGS", "error::RuntimeWarning")


def pytest_collection_modifyitems(items):
    """Start with whole studies, so that the longest files are not the last in one process."""
    items.sort(key=lambda item: item.get_closest_marker("workflow") is None)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Look for garbage less often, and never in the modules that are imported."""
    gc.disable()
    found = yield
    gc.freeze()
    gc.set_threshold(10_000, 20)
    gc.enable()
    return found


ROOT = Path(__file__).parents[1]
EXTERNAL = "RBDS001runT25markers.tsv"
EXTERNAL_FORCES = "RBDS001runT25forces.txt"
SAME_RUN = ("RBDS001runT35.c3d", "RBDS001runT35_markers.txt")
EXTERNAL_FOLDERS = (
    ROOT / "data/external",
    ROOT.parent / "shared/recordings/treadmill_running",
)


@pytest.fixture
def interruptible():
    """Enable SIGINT as in a terminal; tests in the background inherit that it is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def read_here():
    """Let files be read in the process of the test, where it can look and change things."""
    from hopdata.foreign import door

    with door.open_here():
        yield


@pytest.fixture
def forked(monkeypatch):
    """Let files be read in forks of the process of the test, with what it has changed.

    Its other threads, if there are any, only wait for messages of pytest.
    """
    from hopdata.foreign import apart

    if not hasattr(os, "fork"):
        pytest.skip("this system has no forks")
    monkeypatch.setattr(apart, "may_fork", lambda: True)


@pytest.fixture
def served(monkeypatch):
    """Let files be read by one server, which is quick for many of them."""
    from hopdata.foreign import apart

    monkeypatch.setattr(apart, "may_fork", lambda: False)


@pytest.fixture
def impatient(monkeypatch):
    """Give a file little time: on some damaged files the HDF5 library hangs.

    A sound file may need more, as its reader imports a library first.
    """
    from hopdata.foreign import budget

    monkeypatch.setattr(budget, "LEAST_S", 0.2)


def external(name):
    """Return the path of a treadmill recording; skip the test if it has not been fetched."""
    for folder in EXTERNAL_FOLDERS:
        if (folder / name).is_file():
            return folder / name
    return pytest.skip(f"{name} is in none of {', '.join(map(str, EXTERNAL_FOLDERS))}")


@pytest.fixture(scope="session")
def external_recording():
    """Return the markers of the runner at 2.5 m/s."""
    return external(EXTERNAL)


@pytest.fixture(scope="session")
def quick_runner():
    """Return the markers of another runner, who lands on the heel."""
    return external("RBDS032runT35markers.txt")


@pytest.fixture(scope="session")
def forefoot_runner(same_run):
    """Return the C3D file of a runner who lands on the forefoot."""
    return same_run[0]


@pytest.fixture(scope="session")
def external_forces():
    """Return the forces of the same run."""
    return external(EXTERNAL_FORCES)


@pytest.fixture(scope="session")
def same_run():
    """Return the paths of the C3D and the text file of one run."""
    return tuple(external(name) for name in SAME_RUN)


@pytest.fixture(scope="session")
def opensim_files():
    """Return the TRC files of OpenSim's public test data, if they have been fetched."""
    folder = ROOT.parent / "shared/recordings/opensim_trc"
    return sorted(folder.glob("*.trc")) or pytest.skip(f"no TRC files in {folder}")


@pytest.fixture(scope="session")
def sample_path():
    """Return the path of the bundled synthetic recording."""
    return ROOT / "data/sample/hopper.h5"
