"""`hopdata drive --excite` on a simulated clock, `hopdata learn`, and what they refuse."""

import json
import threading
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from hopdata.__main__ import main
from hopdata.errors import ConfigError
from hopdata.steering.commands import excite
from hopdata.steering.control.forecast import NEIGHBOURS
from hopdata.steering.live import simulated_time
from hopdata.steering.live.log_reading import read_log
from hopdata.steering.models.process_file import load_process
from hopdata.steering.models.training import LEAST_HOPS
from hopdata.steering.observation.geometry import BoomCircle, HopperGeometry
from hopdata.steering.robot import SteeredHopper

FEWEST = LEAST_HOPS + NEIGHBOURS


@pytest.fixture(scope="module")
def geometry(tmp_path_factory):
    path = tmp_path_factory.mktemp("geometry") / "geometry.json"
    hopper = SteeredHopper()
    body = np.array(hopper.markers.body_m)
    middle = body.mean(axis=0)
    centre = np.array([hopper.hopper.boom_offset_m, 0, hopper.hopper.boom_height_m])
    circle = BoomCircle(centre - middle, np.array([0.0, 0.0, 1.0]), 0.25)
    names = ("body1", "body2", "body3")
    HopperGeometry(names, body - middle, 0.0006, 0.3, 0.4, "boom", circle).save(path)
    return str(path)


@pytest.fixture
def excited(geometry, tmp_path, monkeypatch):
    """Return what runs an excitation in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*options):
        fence = () if "--fence" in options else ("--fence", "9")
        excite = ("--excite", "40", "--armed", "--geometry", geometry)
        return main(["drive", *excite, *fence, *options])

    return run


def test_an_excitation_gives_a_table_a_model_and_a_log_that_is_played_again(
    excited, capsys
):
    assert excited() == 0
    out = capsys.readouterr().out
    assert "SIMULATED hopper; there is no robot; excitation of 40 strides" in out
    assert "the excitation is over" in out
    assert "40 of 40 strides in drive-strides/frame_changes.csv\n" in out
    assert "missing" not in out
    table = pd.read_csv("drive-strides/frame_changes.csv")
    assert list(table) == [
        *("recording", "time_s", "boom_angle_rad", "swing_rad"),
        *("dx_m", "dy_m", "dtheta_rad", "reason"),
    ]
    sent = np.array(read_log("drive.h5").setup["excitation"])[:, 0]
    np.testing.assert_allclose(table["swing_rad"], sent, atol=0.03)
    assert main(["replay", "drive.h5"]) == 0
    assert "41 of 41 plans the same to the bit" in capsys.readouterr().out
    last = "learn the model from them: hopdata learn drive-strides"
    assert out.splitlines()[-1] == last
    assert main(["learn", "drive-strides"]) == 0
    out = capsys.readouterr().out
    assert "model.npz: learned from 32 strides, tested on 8" in out
    assert "hopdata drive --model drive-strides drives with it" in out
    assert load_process("drive-strides/model.npz").axes.input_names == ("swing",)
    scores = pd.read_csv("drive-strides/model_scores.csv")
    assert scores.component.tolist() == ["dx", "dy", "dtheta"]
    assert scores.training_hops.eq(32).all()
    assert scores.expected_arrivals.between(0, 1).all()
    assert main(["learn", "drive-strides"]) == 1
    assert "model.npz: expected a new file" in capsys.readouterr().err
    # A log of another sequence is not the same, or is refused.
    for swing, said in ((0.123, "40 of 41 plans"), (1.2, "excitation, stride 4: exp")):
        with h5py.File("drive.h5", "r+") as file:
            setup = json.loads(file.attrs["setup"])
            setup["excitation"][3] = [swing]
            file.attrs["setup"] = json.dumps(setup)
        assert main(["replay", "drive.h5"]) == 1
        assert said in "".join(capsys.readouterr())


def test_one_that_is_cut_short_says_how_many_strides_are_missing(excited, capsys):
    assert excited("--fence", "1.02") == 0
    out = capsys.readouterr().out
    made = len(pd.read_csv("drive-strides/frame_changes.csv"))
    assert made < FEWEST
    assert f"{made} of 40 strides in" in out
    assert f"missing: {40 - made} strides\n" in out
    assert f"hopdata drive --excite {40 - made} --excite-seed 2" in out
    assert f"too few to learn from: {FEWEST} are needed" in out
    assert main(["learn", "drive-strides"]) == 1
    wanted = f"expected at least {FEWEST} strides that can be used, found {made} ("
    assert wanted in capsys.readouterr().err
    # The rest comes with another drive.
    assert excited("--excite-seed", "2") == 0
    first, second = (
        pd.read_csv(f"{name}/frame_changes.csv").swing_rad
        for name in ("drive-strides", "drive-2-strides")
    )
    assert np.abs(first - second[: len(first)]).max() > 0.3
    both = excite._strides_of([Path("drive-strides"), Path("drive-2-strides")])
    assert len(both) == 40 + made
    assert both.axes.upper[0] == pytest.approx(1.178, abs=1e-3)


def test_a_drive_that_is_killed_leaves_its_strides(excited, tmp_path, monkeypatch):
    drive = simulated_time.drive_in_simulated_time

    def killed(*parts, **options):
        drive(*parts, **options | {"seconds": 5.0})
        raise SystemExit(143)

    monkeypatch.setattr(simulated_time, "drive_in_simulated_time", killed)
    with pytest.raises(SystemExit):
        excited()
    assert 5 < len(pd.read_csv(tmp_path / "drive-strides/frame_changes.csv")) < 10


def test_a_rest_that_nobody_can_end_ends_it(excited, monkeypatch, capsys):
    drive = simulated_time.drive_in_simulated_time

    def blind(geometry, controller, *parts, **options):
        controller.plan = lambda *_: 1 / 0
        return drive(geometry, controller, *parts, **options)

    monkeypatch.setattr(simulated_time, "drive_in_simulated_time", blind)
    assert excited() == 0
    out = capsys.readouterr().out
    assert "it rests, and nobody is there to arm it again" in out
    assert "missing: 40 strides" in out


def test_one_that_could_not_begin_leaves_no_folder(excited, monkeypatch, capsys):
    def refused(*_given, **_options):
        raise ConfigError.at("simulated", "a simulation with path", "none")

    monkeypatch.setattr(simulated_time, "drive_in_simulated_time", refused)
    assert excited() == 1
    said = capsys.readouterr()
    assert "expected a simulation with path" in said.err
    assert "missing" not in said.out
    assert not Path("drive-strides").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--excite", "12"], f"--excite: expected at least {FEWEST} strides"),
        (["--excite", "-3"], f"--excite: expected at least {FEWEST} strides"),
        (["--excite", "40", "--model", "."], "--excite: expected the excitation alone"),
        (["--excite", "40", "--rehearse"], "found --rehearse with it"),
        (["--excite", "40", "--adaptive"], "found --adaptive with it"),
        (["--excite", "40", "--heading", "0"], "found --heading with it"),
        (["--excite", "40", "--excite-seed", "-1"], "--excite-seed: expected 0 or"),
        (["--excite", "40", "--host", "h"], "--geometry: expected geometry.json"),
        (
            ["--excite", "40", "--host", "h", "--geometry", "g"],
            "--host: expected either --boom HOST:PORT or --dry-run",
        ),
        (["--geometry", "g"], "--geometry: expected --excite with it"),
        (["--excite-seed", "3"], "--excite-seed: expected --excite with it"),
        (
            ["--excite", "40", "--armed", "--geometry", "nowhere.json"],
            "nowhere.json: expected a hopper geometry",
        ),
        (["--excite", "40", "--swing-limit", "4"], "swing_rad: expected 0 to pi"),
    ],
)
def test_what_cannot_work_is_refused_in_one_line_before_the_work(
    options, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    threads = threading.active_count()
    armed = [] if "--host" in options else ["--armed"]
    assert main(["drive", *options, *armed]) == 1
    err = capsys.readouterr().err
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
    assert threading.active_count() == threads


def test_a_folder_that_exists_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive-strides").mkdir()
    assert main(["drive", "--excite", "40", "--armed"]) == 1
    assert "folder drive-strides: expected a new one" in capsys.readouterr().err
    assert main(["learn", "drive-strides"]) == 1
    assert "drive-strides: expected geometry.json and" in capsys.readouterr().err


def test_strides_of_another_geometry_are_not_joined(tmp_path, capsys):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "geometry.json").write_text(name)
        (tmp_path / name / "frame_changes.csv").write_text("")
    assert main(["learn", str(tmp_path / "one"), str(tmp_path / "two")]) == 1
    assert "expected the geometry of" in capsys.readouterr().err
