"""A drive of the simulated hopper from the command line, and the replay of its log."""

import numpy as np
import pytest

from hopdata.__main__ import main
from hopdata.steering.live.log import read_log
from hopdata.steering.models.process import FrameChangeProcess, save_process
from hopdata.steering.observation.geometry import BoomCircle, HopperGeometry
from hopdata.steering.robot import SteeredHopper


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Write what would have been learned from a recording: the marker positions and a few hops."""
    folder, hopper = tmp_path_factory.mktemp("model"), SteeredHopper()
    body = np.array(hopper.markers.body_m)
    centre = np.array([hopper.hopper.boom_offset_m, 0, hopper.hopper.boom_height_m])
    circle = BoomCircle(centre - body.mean(axis=0), np.array([0.0, 0.0, 1.0]), 0.25)
    names = ("body1", "body2", "body3")
    HopperGeometry(
        names, body - body.mean(axis=0), 0.0006, 0.3, 0.4, "boom", circle
    ).save(folder / "geometry.json")  # fmt: skip
    rng = np.random.default_rng(np.random.SeedSequence(1))
    inputs = np.column_stack([rng.uniform(0, 2 * np.pi, 30), rng.uniform(-1.1, 1.1, 30)])
    outputs = np.column_stack([0.05 + 0 * inputs[:, 0], 0.02 * np.sin(inputs[:, 0]), inputs[:, 1]])
    process = FrameChangeProcess(
        smoothness=1.5, periodic=True, inputs=inputs, outputs=outputs, offset=np.zeros(3),
        unit=np.array([0.02, 0.02, 0.5]), variance=np.ones(3), noise=np.full(3, 0.05),
        length_scales=np.ones((3, 2)),
    )  # fmt: skip
    save_process(folder / "model.npz", process)
    return folder


def test_a_simulated_drive_says_so_and_its_log_gives_the_same_plans(model, tmp_path, capsys):
    log = tmp_path / "drive.h5"
    options = ["--model", str(model), "--seconds", "3", "--to=-0.5,0", "--adaptive", "--fence", "9"]
    assert main(["drive", *options, "--log", str(log)]) == 0
    out = capsys.readouterr().out
    assert "SIMULATED hopper; there is no robot" in out
    assert "hop 1 x" in out
    assert "\n  the end\n" in out  # one of the reasons for rest
    assert read_log(log).setup["to"] == [-0.5, 0]
    assert main(["replay", str(log)]) == 0
    out = capsys.readouterr().out
    assert "the same to the bit" in out
    assert "simulated hopper" in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--host", "h"], "--model: expected the folder"),
        (["--host", "h", "--model", "."], "--host: expected either --boom HOST:PORT or --dry-run"),
        (["--boom", "h:5"], "--boom: expected --host with it"),
        (["--host", "h", "--model", ".", "--boom", "h"], "--boom: expected HOST:PORT, found 'h'"),
        (["--model", "nowhere"], "nowhere/geometry.json: expected a hopper geometry"),
    ],
)
def test_what_cannot_work_is_refused_before_anything_moves(options, message, tmp_path, capsys):
    assert main(["drive", *options, "--log", str(tmp_path / "drive.h5")]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "drive.h5").exists()


def test_what_is_no_log_is_refused(tmp_path, capsys):
    assert main(["replay", str(tmp_path / "none.h5")]) == 1
    assert "expected the log of a drive" in capsys.readouterr().err
