"""A few seeded events of `make chaos`, so that each change meets some of them."""

import importlib
import json
import os
import random
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

pytestmark = [
    pytest.mark.workflow,
    pytest.mark.skipif(sys.platform != "linux", reason="forks and mounts as on Linux"),
]
PROGRAM = Path(__file__).with_name("chaos.py")
N_EVENTS = 4 if "ALL" in os.environ else 1
#: With this seed the first four events are of four kinds: a folder that cannot be written,
#: a kill, too little memory, a file damaged meanwhile.
SEED = 6


@pytest.fixture
def chaos(monkeypatch):
    monkeypatch.syspath_prepend(str(PROGRAM.parent))
    return importlib.import_module("chaos")


@pytest.mark.parametrize("limit", [0, 70_000])
def test_a_limit_is_told_as_it_was_set(chaos, limit):
    limits = []
    driver = SimpleNamespace(rlimit=lambda _, both: limits.append(both))
    server = SimpleNamespace(
        start=lambda *_: None, driver=lambda: [driver], end=lambda: chaos.Run(0, "")
    )
    place = SimpleNamespace(server=server, seconds=0.0, command=list)
    told, undo = chaos.limited(place, random.Random(1), 1, limit)
    assert limits == [(limit, limit)]
    assert told == f"limit of {limit}: 0"
    assert undo is None


def test_some_events_ask_for_the_page_too(chaos, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = chaos.RESULTS / "report.html"
    page.parent.mkdir(parents=True)
    asked = []
    for number in range(100):
        page.touch()
        place = chaos.Place(tmp_path, tmp_path)
        chaos.ask_for_page(place, random.Random(number))
        asked.append(place.has_page)
        assert (str(page) in place.command()) == place.has_page
        assert page.exists() != place.has_page
    assert 5 <= sum(asked) <= 30


@pytest.mark.parametrize(
    ("has_page", "damaged", "is_found"),
    [
        (False, "quality.json", False),
        (True, "quality.json", True),
        (False, "units.json", True),
        (True, "units.json", True),
        (False, "", False),
    ],
)
def test_only_what_is_asked_for_must_come_right(
    chaos, tmp_path, has_page, damaged, is_found
):
    """What is damaged and not asked for is made again once it is."""
    place = chaos.Place(tmp_path, tmp_path, has_page=has_page)
    place.whole = {"units.json": b"a", "quality.json": b"b"}
    place.without_page = {"units.json"}
    now = {name: b"?" if name == damaged else it for name, it in place.whole.items()}
    place.files = lambda: now
    place.server = SimpleNamespace(run=lambda *_: chaos.Run(0, ""))
    if is_found:
        with pytest.raises(chaos.FindingError, match=f"other bytes: {damaged}"):
            chaos.require_whole(place)
    else:
        chaos.require_whole(place)


def test_a_disturbed_study_comes_right_by_the_same_command(tmp_path):
    ask = [sys.executable, str(PROGRAM), "--events", str(N_EVENTS), "--seed", str(SEED)]
    # To compile all anew would take longer than the events.
    ask += ["--folder", str(tmp_path), "--packages-code"]
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
    assert len({row["kind"] for row in rows}) == N_EVENTS
    assert not any("finding" in row for row in rows)
    # What was done is not done again.
    again = subprocess.run(ask, check=True, **options)
    assert f"all {N_EVENTS} events are done" in again.stdout
