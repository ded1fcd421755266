"""Where the tests find recordings: the bundled sample, and a real one that is not in git."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXTERNAL = "RBDS001runT25markers.tsv"
EXTERNAL_FOLDERS = (ROOT / "data/external", ROOT.parent / "shared/recordings/treadmill_running")


@pytest.fixture(scope="session")
def external_recording():
    """Path of the treadmill recording; tests are skipped where nobody has fetched it."""
    for folder in EXTERNAL_FOLDERS:
        if (folder / EXTERNAL).is_file():
            return folder / EXTERNAL
    pytest.skip(f"{EXTERNAL} is in none of {', '.join(map(str, EXTERNAL_FOLDERS))}")


@pytest.fixture(scope="session")
def sample_path():
    """Path of the bundled synthetic recording."""
    return ROOT / "data/sample/hopper.h5"
