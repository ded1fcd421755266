"""`hopdata drive --robot`: excited, learned, driven, replayed and rehearsed, on a simulated clock."""

import json
import os
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from clocked_drive import on_a_simulated_clock

from hopdata.__main__ import main
from hopdata.errors import ConfigError
from hopdata.steering.control import planner as planning
from hopdata.steering.live import drive as live_drive
from hopdata.steering.live import rehearsal, rehearsed_acts
from hopdata.steering.live.log_reading import read_log
from hopdata.steering.live.robots import (
    ROBOTS,
    DrivenRobot,
    driven_robot,
    planar_hopper,
    quadruped,
)
from hopdata.steering.live.seen_robots import DECIDED_S

# Strides of the excitation, seconds of the drive, and the columns of state and inputs.
CASES = {
    "planar-hopper": (25, 8.0, ["speed_m_s", "leg_angle_rad"]),
    "quadruped": (60, 22.0, ["last_difference_m", "difference_m"]),
}
ACTS = (
    "steering.no_frame",
    "steering.markers_unseen",
    "steering.plan_late",
    "steering.boom_failed",
)


@pytest.fixture(autouse=True)
def without_waiting(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(live_drive, "drive", on_a_simulated_clock)
    quick = partial(planning.planner, few_nodes=True)
    monkeypatch.setattr(planning, "planner", quick)


# The quadruped takes ten seconds more, by the same path.
@pytest.mark.parametrize("robot", CASES if "ALL" in os.environ else ["planar-hopper"])
def test_a_robot_is_excited_learned_driven_to_a_point_and_replayed(robot, capsys):
    strides, seconds, columns = CASES[robot]
    named = ["drive", "--robot", robot, "--armed", "--fence", "20"]
    assert main([*named, "--excite", str(strides)]) == 0
    out = capsys.readouterr().out
    assert f"SIMULATED {robot}; there is no robot" in out
    assert f"{strides} of {strides} strides" in out
    assert list(pd.read_csv("drive-strides/frame_changes.csv"))[2:4] == columns
    assert main(["learn", "drive-strides"]) == 0
    out = capsys.readouterr().out
    assert "model.npz: learned from" in out
    scores = pd.read_csv("drive-strides/model_scores.csv", index_col="component")
    is_planar = robot == "planar-hopper"  # it never leaves its line
    assert ("dy       does not move" in out) == is_planar
    assert "dx       r2 " in out
    assert (scores["moves"] == scores["r2"].notna()).all()
    assert scores["moves"].tolist()[:2] == [True, not is_planar]
    assert "hopdata drive --robot NAME --model drive-strides drives with it" in out
    assert main(["drive", "--armed", "--model", "drive-strides"]) == 1
    wanted = f"--model: expected --robot with a model of {', '.join(columns)}, which"
    assert wanted in capsys.readouterr().err
    drive = [*named, "--model", "drive-strides", "--seconds", str(seconds)]
    assert main([*drive, "--to=0,0", "--log", "to.h5"]) == 0
    log = read_log("to.h5")
    x, y, _ = np.array(log.decisions["pose"].tolist()).T
    assert np.hypot(x[0], y[0]) > 0.8
    assert np.hypot(x, y).min() < 0.11
    assert log.axes.columns == tuple(columns)
    capsys.readouterr()
    assert main(["replay", "to.h5"]) == 0
    assert (
        f"{len(log.decisions)} of {len(log.decisions)} plans" in capsys.readouterr().out
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_what_is_wrong_brings_another_robot_to_rest_by_the_name_of_its_input(name):
    robot = driven_robot(name)
    what = robot.axes.input_names[0].replace("_", " ")
    acts = rehearsed_acts.all_acts(robot.geometry, robot.limits, robot)
    tried = [act for act in acts if act.code in ACTS]
    assert len(tried) == len(ACTS)
    for act in tried:
        done = rehearsal._on_simulated_clock(act, robot.geometry, robot.limits, robot)
        assert done.is_right, (act.name, str(done.cause))
        assert "boom" not in act.name + act.rest + str(done.cause)
        if act.code == "steering.boom_failed":
            assert str(done.cause).startswith(f"the {what} failed")


def test_a_robot_without_its_own_name_is_found_in_a_module(monkeypatch):
    assert (
        driven_robot("hopdata.steering.live.robots:planar_hopper").limits.command_s
        == DECIDED_S
    )
    for name, said in (
        ("quadrupd", "quadruped"),
        ("hopdata.steering.live.robots:GROUP", "DrivenRobot"),
        ("no.such_module:robot", "no.py in"),
        (":robot", "neither"),
    ):
        with pytest.raises(ConfigError, match=said):
            driven_robot(name)
    bare = DrivenRobot(axes=planar_hopper().axes)
    with pytest.raises(ConfigError, match="simulation"):
        bare.simulation()
    unseen = DrivenRobot(axes=planar_hopper().axes, simulated=object)
    with pytest.raises(ConfigError, match="found object without release and path"):
        unseen.simulation()


def test_a_robot_is_found_in_a_file_of_the_working_folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    source = (
        "from hopdata.steering.live.robots import quadruped\nrunner = quadruped()\n"
    )
    Path("my_lab_of_a_test.py").write_text(source, "utf-8")
    path = list(sys.path)
    assert driven_robot("my_lab_of_a_test:runner").axes == quadruped().axes
    assert sys.path == path
    # No file of the folder stands in for a module that is installed.
    Path("json.py").write_text("runner = 1\n", "utf-8")
    with pytest.raises(ConfigError, match="runner"):
        driven_robot("json:runner")


def test_a_log_runs_no_module_that_the_user_has_not_named(capsys):
    place = "hopdata.steering.live.robots:planar_hopper"
    options = ["--armed", "--seconds", "2", "--excite", "25", "--log", "own.h5"]
    assert main(["drive", "--robot", place, *options]) == 0
    again = f"hopdata replay own.h5 --robot {place} plays it again"
    assert again in capsys.readouterr().out
    assert json.loads(json.dumps(read_log("own.h5").setup))["robot"] == place
    assert main(["replay", "own.h5"]) == 1
    assert f"--robot {place} in the command" in capsys.readouterr().err
    assert main(["replay", "own.h5", "--robot", place]) == 0
