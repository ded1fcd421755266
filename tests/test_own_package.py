"""A user's package provides a reader, a scene, a method and a figure, which hopdata finds once it is installed."""

import os
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "docs/examples/own_package"
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
"""


def test_the_example_is_installed_and_found(tmp_path):
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps")
    packages, study = tmp_path / "packages", tmp_path / "study"
    study.mkdir()
    where = ("--no-build-isolation", "--target", str(packages), str(PACKAGE))
    subprocess.run([*pip, *where], check=True)
    paths = os.pathsep.join([str(packages), *filter(None, sys.path)])
    command = [sys.executable, "-c", USED]
    # Nothing in the working folder is imported, so a package lies elsewhere.
    subprocess.run(
        command, check=True, cwd=study, env=os.environ | {"PYTHONPATH": paths}
    )
    command[-1] = "import hopdata as hd; hd.synthesize('stiff_quadruped')"
    without = subprocess.run(
        command, check=False, cwd=tmp_path.parent, capture_output=True
    )
    assert b"simulation.scene" in without.stderr  # fails without the package
