"""What another package brings by entry points is found, used, and blamed if it fails."""

import os
import subprocess
import sys

import pytest

# A package is a folder with its code, and one that says what it brings.
PACKAGES = {
    "kind/__init__.py": """
import numpy as np

from hopdata.recordings.raw import RawRecording
from hopdata.scenes.quadruped import Quadruped as Heavy


def read(path, rate_hz):
    time = np.arange(20) / 100
    return RawRecording(("toe",), time, np.ones((20, 1, 3)), 100.0, "m")


def middles(time, heights, transitions, *, noise_m):
    middle = 0.5 * (transitions.t_pre + transitions.t_post)
    instants = np.repeat(middle[:, None], heights.shape[1], axis=1)
    return instants, np.full(instants.shape, 1e-3)


def too_few(time, heights, transitions, *, noise_m):
    return np.zeros(3), np.zeros(3)


def count(touchdowns):
    from matplotlib.figure import Figure

    figure = Figure()
    figure.subplots().plot(touchdowns["touchdown"], touchdowns["spread_s"])
    return figure


count.files = ("tables/touchdowns.csv",)


def nothing():
    raise KeyError("of its own")
""",
    "kind_product/__init__.py": "",
    "kind_product/commands/__init__.py": """
def greet(options):
    print("greetings from", options.name)
    return 0
""",
    "kind_product/commands/commands.toml": """
[commands.greet]
run = "kind_product.commands:greet"
summary = "Greet."
description = "Greet."
examples = "hopdata greet Anna"
options = [{ flags = ["name"], help = "whom" }]
""",
    "kind-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: kind\nVersion: 1.0\n",
    "kind-1.0.dist-info/entry_points.txt": """
[hopdata.readers]
.kind = kind:read
.c3d = kind:read

[hopdata.scenes]
heavy = kind:Heavy

[hopdata.labelling]
middles = kind:middles
too_few = kind:too_few

[hopdata.figures]
count = kind:count
nothing = kind:nothing

[hopdata.products]
greeter = kind_product
""",
    "late-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: late\nVersion: 1.0\n",
    "late-1.0.dist-info/entry_points.txt": "[hopdata.labelling]\nmiddles = late:no\n",
}
# One process for all of it: to start Python and to compile a scene takes most time.
USED = """
import warnings
import numpy as np
warnings.simplefilter("always")
with warnings.catch_warnings(record=True) as caught:
    import hopdata as hd
    recording = hd.read("a.kind")
    from hopdata.landings.contacts import timing
    from hopdata.scenes import scene_class
assert recording.markers == ("toe",)
told = " ".join(str(one.message) for one in caught)
assert "(kind:read) is not used, since hopdata's own has the same name" in told, told
assert "(late:no) is not used, since the labelling method 'middles' of" in told, told

assert scene_class("heavy").__name__ == "Quadruped"

transitions = type("T", (), {"__len__": lambda self: 4})()
transitions.t_pre = np.arange(4.0)
transitions.t_post = transitions.t_pre + 0.2
heights = np.zeros((9, 2))
instant, se = timing.METHODS["middles"](np.arange(9.0), heights, transitions, 1e-3)
assert instant.tolist()[1] == [1.1, 1.1]
try:
    timing.METHODS["too_few"](np.arange(9.0), heights, transitions, 1e-3)
except hd.HopdataError as error:
    assert "of shape (4, 2) by the labelling method 'too_few' of" in str(error), error
else:
    raise AssertionError
from hopdata.config.loading import load_config
markers = {"body": ["body1", "body2", "body3"], "feet": ["foot1", "foot2"]}
config = {"study": "s", "markers": markers, "recordings": [{"name": "r"}]}
assert load_config({**config, "touchdowns": {"method": "middles"}})

import pandas as pd
from hopdata.walk import Study
study = Study(load_config(config))
study._results["touchdowns"] = pd.DataFrame({"touchdown": [0, 1], "spread_s": [0.1, 0.2]})
assert "count" in dir(study.figures)
assert study.figures.count().axes[0].lines[0].get_ydata().tolist() == [0.1, 0.2]
try:
    study.plot("nothing")
except hd.HopdataError as error:
    assert "the figure 'nothing' of the package kind (kind:nothing)" in str(error), error
else:
    raise AssertionError

from hopdata.__main__ import main
assert main(["greet", "Anna"]) == 0
"""


@pytest.fixture
def packages(tmp_path):
    for name, content in PACKAGES.items():
        path = tmp_path / "packages" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    return tmp_path / "packages"


def test_all_that_a_package_brings_is_used_and_what_clashes_is_told(packages):
    # Nothing in the working folder is imported, so a package lies elsewhere.
    folder = packages.parent / "study"
    folder.mkdir()
    (folder / "a.kind").write_text("")
    paths = os.pathsep.join([str(packages), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", USED],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "greetings from Anna\n"
