"""The bundled runner is the file that its page names, and its licence is beside it."""

import hashlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "data/sample"
SOURCE = (SAMPLE / "RBDS001_source.txt").read_text("utf-8")
DIGESTS = dict(re.findall(r"\| `(\S+)` \| `([0-9a-f]{64})` \|", SOURCE))


def test_every_file_of_the_runner_has_a_digest():
    files = {path.name for path in SAMPLE.glob("RBDS001*") if "source" not in path.name}
    assert files == set(DIGESTS)
    assert len(files) == 2


@pytest.mark.parametrize("name", sorted(DIGESTS))
def test_a_file_is_as_it_came(name):
    content = (SAMPLE / name).read_bytes()
    assert hashlib.sha256(content).hexdigest() == DIGESTS[name]
    assert hashlib.sha256(content + b" ").hexdigest() != DIGESTS[name]


@pytest.mark.parametrize("study", ["runner", "runner_forces"])
def test_its_studies_read_the_bundled_files(study):
    text = (ROOT / "config" / f"{study}.yaml").read_text("utf-8")
    named = re.findall(r"file: (\S+)", text)
    assert named
    assert all((ROOT / name).is_file() for name in named)
