"""The page from parts that tests make up, as a user makes it: also with faults, and killed."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from checkouts import completed, copy_checkout, edit_config, planned_rules, snakemake
from made_up import SOUND, SOUND_ITEMS, item, without_parts, write_part

pytestmark = pytest.mark.workflow

# It ends its own process, as the system does when the memory is full.
CRASHES = "import os\ndef make(seeds): os.kill(os.getpid(), 9)\n"
LACKS = "def make(seeds):\n    raise ModuleNotFoundError('x', name='mujoco')\n"
BUILT = "from hopdata.dissertation.rows import Agreement, Made, Row\n"
MENDED = BUILT + (
    "def make(seeds): return Made([Row(94, Agreement.BUILT, {'error': 1.0})])\n"
)
WAITS = f"""import time
from pathlib import Path
{BUILT}
def make(seeds):
    begun = Path("begun")
    if not begun.exists():
        begun.touch()
        time.sleep(600)
    return Made([Row(50, Agreement.BUILT, {{"error": 1.0}})])
"""
# One of its rows and its figure are missing.
GAPS = MENDED.replace("94", "96")
GAP_ITEMS = (
    item(96, ours="{error:.0f} mm", figure="fig4_4", figure_printed="time")
    + item(97)
)  # fmt: skip


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Return a checkout with parts that work, that lack something, and that crash."""
    folder = copy_checkout(tmp_path_factory.mktemp("dissertation"))
    without_parts(folder)
    write_part(folder, "sound", SOUND, SOUND_ITEMS)
    write_part(folder, "lacks", LACKS, item(94, ours="{error:.0f} mm"))
    write_part(folder, "crashes", CRASHES, item(95, ours="{error:.0f} mm"))
    write_part(folder, "gaps", GAPS, GAP_ITEMS)
    return folder


@pytest.fixture(scope="module")
def first(checkout):
    """Run it for the first time."""
    return checkout, snakemake(checkout, "dissertation")


def test_what_cannot_be_made_is_named_and_the_rest_is_made(first):
    folder, run = first
    assert run.returncode != 0
    said = [line for line in run.stderr.splitlines() if line.startswith("hopdata:")]
    assert said[0].startswith("hopdata: results/dissertation/index.html: Of 2 results")
    assert said[1:5] == [
        "hopdata: crashes (item 95): cannot be made: its process ended by the signal "
        "SIGKILL; python -m hopdata.dissertation crashes shows more",
        "hopdata: item 96: fig4_4: cannot be drawn: the part gaps drew no figure of this name",
        "hopdata: item 97 (Item 97): cannot be made: the part gaps returned no row for it",
        "hopdata: lacks (item 94): cannot be made: mujoco is not installed; "
        "make dissertation, or pip install 'hopdata[dissertation]'",
    ]
    # The job says it, and the run again below Snakemake's own words.
    assert len({*said[5:]}) == 1
    assert "found 3 with a cause above; the same command makes them again" in said[-1]
    page = (folder / "results/dissertation/index.html").read_text()
    assert "slope 4.20" in page
    assert page.count("data:image/svg+xml") == 1
    assert "mujoco is not installed" in page


def test_exactly_what_could_not_be_made_is_made_again(first):
    folder, _ = first
    planned = planned_rules(folder, "dissertation")
    parts = {f"dissertation_{name}" for name in ("lacks", "crashes", "gaps")}
    assert planned == {*parts, "dissertation_page", "dissertation"}


def test_a_part_runs_again_for_its_own_code_and_the_page_for_its_words(first):
    """Parts that are mended, and a sentence that is changed."""
    folder, _ = first
    write_part(folder, "lacks", MENDED, item(94, ours="{error:.0f} mm"))
    mended = MENDED.replace("94", "95")
    write_part(folder, "crashes", mended, item(95, ours="{error:.0f} mm"))
    gaps = (
        BUILT + "from hopdata.figures import style\n"
        "def make(seeds):\n"
        "    return Made([Row(n, Agreement.BUILT, {'error': 2.0}) for n in (96, 97)])\n"
        "def draw(tables): return {'fig4_4': style.message_figure('drawn')}\n"
    )
    write_part(folder, "gaps", gaps, GAP_ITEMS)
    told = completed(folder, "dissertation")
    assert "dissertation_sound" not in told
    assert "cannot be" not in told
    assert planned_rules(folder, "dissertation") == {"dissertation"}
    write_part(folder, "sound", SOUND, SOUND_ITEMS.replace("Affine", "Linear"))
    assert planned_rules(folder, "dissertation") == {
        "dissertation",
        "dissertation_page",
    }
    found = json.loads((folder / "results/dissertation/found.json").read_text())
    assert found["faults"] == []
    assert len(found["standings"]) == 7


def test_a_killed_run_goes_on(first):
    """The part waits when it is made for the first time, and not in the run after it."""
    folder, _ = first
    write_part(folder, "waits", WAITS, item(50, ours="{error:.0f} mm"))
    environment = {**os.environ, "PYTHONPATH": str(folder / "src")}
    run = subprocess.Popen(
        [sys.executable, "-m", "snakemake", "--cores", "2", "dissertation"],
        cwd=folder, env=environment, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    until = time.monotonic() + 60
    while not (folder / "begun").exists() and time.monotonic() < until:
        time.sleep(0.05)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    assert (folder / "begun").exists()
    completed(folder, "--unlock")
    told = completed(folder, "dissertation")
    assert "dissertation_waits" in told
    assert "dissertation_sound" not in told
    assert "Item 50" in (folder / "results/dissertation/index.html").read_text()


def test_a_key_repeats_what_depends_on_it(first):
    folder, _ = first
    config = edit_config(folder, lambda keys: keys.update(dissertation={"seeds": 2}))
    planned = planned_rules(folder, "dissertation", "--configfile", config)
    assert "dissertation_sound" in planned
