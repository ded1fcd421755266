"""A few seeded events of `make chaos`, so that each change meets some of them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.workflow,
    pytest.mark.skipif(sys.platform != "linux", reason="forks and mounts as on Linux"),
]
PROGRAM = Path(__file__).with_name("chaos.py")
N_EVENTS = 6


def test_a_disturbed_study_comes_right_by_the_same_command(tmp_path):
    ask = [sys.executable, str(PROGRAM), "--events", str(N_EVENTS), "--seed", "5"]
    ask += ["--folder", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(PROGRAM.parents[2] / "src")}
    options = {
        "capture_output": True,
        "text": True,
        "env": environment,
        "timeout": 1200,
    }
    run = subprocess.run(ask, check=False, **options)
    assert run.returncode == 0, run.stdout + run.stderr
    rows = [json.loads(x) for x in (tmp_path / "events.jsonl").read_text().splitlines()]
    assert [row["event"] for row in rows] == list(range(N_EVENTS))
    assert len({row["kind"] for row in rows}) >= 3
    assert not any("finding" in row for row in rows)
    # What was done is not done again.
    again = subprocess.run(ask, check=True, **options)
    assert f"all {N_EVENTS} events are done" in again.stdout
