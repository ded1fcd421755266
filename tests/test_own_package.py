"""A user's package brings something of each kind, which hopdata finds once it is installed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "docs/examples/own_package"
USED = """
import numpy as np, hopdata as hd


time = np.arange(50) / 100
np.savez("a.npz", time=time, positions=np.random.rand(50, 4, 3), markers=["a", "b", "c", "d"])
recording = hd.read("a.npz", feet=["a"], body=["b"])
assert abs(recording.rate_hz - 100) < 1e-6
made, truth = hd.synthesize("stiff_quadruped", simulation={"hops": 2})
assert len(made.names("foot")) == 4
assert '"side_stiffness_n_m": 90.0' in truth.parameters_json
made, _ = hd.synthesize("hopper", simulation={"hops": 30}, seed=1)
printed = hd.study(made, touchdowns={"method": "velocity_minimum"}).touchdowns
own = hd.study(made, touchdowns={"method": "lowest_speed"})
apart = own.touchdowns["contact_foot1_s"] - printed["contact_foot1_s"]
assert apart.count() > 20 and apart.abs().median() < 0.03, apart.describe()
assert own.figures.spreads().axes[0].patches

# The robot, on a simulated clock.
from clocked_drive import on_a_simulated_clock
from hopdata.__main__ import main
from hopdata.steering.live import drive
drive.drive = on_a_simulated_clock
excited = ["--excite", "25", "--fence", "20", "--armed", "--log", "drive.h5"]
assert main(["drive", "--robot", "heavy-hopper", *excited]) == 0
import pandas as pd
strides = pd.read_csv("drive-strides/frame_changes.csv")
assert len(strides) > 20 and "leg_angle_rad" in strides

# The product: its block of the configuration, and its command.
from hopdata.config.loading import load_config
assert own.config["close_landings"] == {"at_most_ms": 5}
try:
    load_config(own.config | {"close_landings": {"at_most_ms": -1}})
except hd.HopdataError as error:
    assert "close_landings.at_most_ms" in str(error), error
else:
    raise AssertionError
from pathlib import Path
tables = Path("results/own/tables")
tables.mkdir(parents=True)
own.touchdowns.to_csv(tables / "touchdowns.csv")
spread_ms = 1e3 * own.touchdowns["spread_s"].dropna()
longest = str(spread_ms.median())
assert main(["close-landings", "results/own", "--at-most", longest]) == 0
"""
STUDY = """
study: own
recordings: [{name: simulated}]
markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3]}
simulation: {hops: 30}
close_landings: {at_most_ms: 20}
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Install the example, and return the environment in which it is found."""
    packages = tmp_path_factory.mktemp("packages")
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps")
    where = ("--no-build-isolation", "--target", str(packages), str(PACKAGE))
    subprocess.run([*pip, *where], check=True)
    paths = os.pathsep.join([str(packages), *filter(None, sys.path)])
    return os.environ | {"PYTHONPATH": paths}


def test_the_example_is_installed_and_found(installed, tmp_path):
    # Nothing in the working folder is imported, so a package lies elsewhere.
    command = [sys.executable, "-c", USED]
    done = subprocess.run(
        command, check=True, cwd=tmp_path, env=installed, capture_output=True, text=True
    )
    assert "SIMULATED heavy-hopper" in done.stdout
    found = re.search(r"^(\d+) of 30 landings within", done.stdout, re.MULTILINE)
    assert 0 < int(found[1]) < 30
    for wanted in (
        "import hopdata as hd; hd.synthesize('stiff_quadruped')",
        "from hopdata.__main__ import main; main(['close-landings', '.'])",
    ):
        command[-1] = wanted
        without = subprocess.run(
            command, check=False, cwd=tmp_path, capture_output=True
        )
        named = wanted.split("'")[1].encode()
        assert named in without.stderr  # fails without the package


@pytest.mark.skipif("ALL" not in os.environ, reason="runs a study of its own")
def test_the_rule_of_its_product_makes_its_table(installed, tmp_path):
    config = tmp_path / "own.yaml"
    config.write_text(STUDY, "utf-8")
    command = [sys.executable, "-m", "hopdata", "run", str(config), "--"]
    subprocess.run(
        [*command, "close_landings"], check=True, cwd=tmp_path, env=installed
    )
    tables = tmp_path / "results/own/tables"
    landings = pd.read_csv(tables / "touchdowns.csv")
    close = pd.read_csv(tables / "close_landings.csv")
    assert 0 < len(close) < len(landings)
    assert close["spread_s"].max() <= 0.020


def test_the_page_shows_each_file_of_the_example():
    page = (ROOT / "docs/plugins.md").read_text("utf-8")
    files = [file for file in PACKAGE.rglob("*") if file.is_file()]
    assert len(files) > 8
    for file in files:
        if "__pycache__" in file.parts:
            continue
        name = file.relative_to(PACKAGE).as_posix()
        shown = re.search(
            rf"`{re.escape(name)}`:?\n\n```\w+\n(.*?)^```$",
            page,
            re.MULTILINE | re.DOTALL,
        )
        assert shown, name
        assert shown[1] == file.read_text("utf-8"), name
