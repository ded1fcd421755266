"""The environment of gymnasium: its own checker, its rules, and the same bytes again."""

import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

# ruff: noqa: E402
gymnasium = pytest.importorskip("gymnasium", reason="the extra `gym` is not installed")

from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from hopdata.commands.doctor import USES
from hopdata.errors import AnalysisError, ArgumentError, ConfigError
from hopdata.steering import environment as module
from hopdata.steering.environment import (
    ARRIVED_M,
    FENCE_M,
    ID,
    MOST_STRIDES,
    TASKS,
    SteeredHopperEnv,
)  # fmt: skip
from hopdata.steering.robot import SteeredHopper, released, steer_hop
from hopdata.synthesis.trial import Kicks

WILD = SteeredHopper(kicks=Kicks(velocity_m_s=0.8, angular_velocity_rad_s=3.0))
RELEASED_UPRIGHT = {"pose": (2.0, 0.0, 0.0)}


def episode(environment, seed, swings):
    """Return everything that an episode has told, as numbers."""
    first, about = environment.reset(seed=seed)
    told = [*first, *about["pose"]]
    for swing in swings:
        seen, reward, terminated, truncated, about = environment.step(np.array([swing]))
        told += [*seen, reward, terminated, truncated, *about["pose"], about["time_s"]]
        if terminated or truncated:
            break
    return np.array(told)


@pytest.mark.parametrize("task", TASKS)
def test_gymnasiums_own_checker_accepts_it(task):
    environment = gymnasium.make(ID, task=task)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # A swing is in rad, as everywhere here, and not normalised.
        warnings.filterwarnings("ignore", ".*symmetric and normalized space.*")
        check_env(environment.unwrapped)


def test_the_same_seed_gives_the_same_bytes_and_another_one_others():
    swings = [0.5, -1.0, 0.3, 9.0]
    one = episode(SteeredHopperEnv(), 3, swings)
    assert episode(SteeredHopperEnv(), 3, swings).tobytes() == one.tobytes()
    assert not np.array_equal(episode(SteeredHopperEnv(), 4, swings), one)


def test_a_step_is_a_hop_of_the_robot():
    """With the tolerance of the experiments, to the bit."""
    robot = SteeredHopper()
    environment = SteeredHopperEnv(rtol=1e-10)
    _, about = environment.reset(seed=5, options={"pose": (0.5, 0.2, 1.0)})
    rng = np.random.default_rng(np.random.SeedSequence(5))
    landed = steer_hop(robot, released(robot, (0.5, 0.2, 1.0)), 0.0, rng=rng)
    assert about["pose"].tobytes() == landed.stance.pose.tobytes()
    _, _, _, _, about = environment.step(np.array([0.7]))
    hop = steer_hop(robot, landed.end, 0.7, rng=rng)
    assert about["pose"].tobytes() == hop.stance.pose.tobytes()
    assert about["boom_angle_rad"] == hop.stance.boom_angle_rad
    loose = SteeredHopperEnv()
    loose.reset(seed=5, options={"pose": (0.5, 0.2, 1.0)})
    _, _, _, _, seen = loose.step(np.array([0.7]))
    np.testing.assert_allclose(seen["pose"], hop.stance.pose, atol=1e-6)
    assert not np.array_equal(seen["pose"], hop.stance.pose)


def test_the_observation_is_where_the_goal_is_from_the_hopper():
    environment = SteeredHopperEnv()
    seen, about = environment.reset(seed=1, options={"pose": (1.0, 0.5, 0.8)})
    x, y, heading = about["pose"]
    back = np.array(
        [[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]]
    )
    np.testing.assert_allclose(seen[:2], back @ [-x, -y], atol=1e-12)
    np.testing.assert_allclose(np.arctan2(seen[3], seen[2]), -heading, atol=1e-12)
    np.testing.assert_allclose(seen[4:], [-1.0, 0.0], atol=1e-9)  # neutral: pi
    seen, reward, *_, after = environment.step(np.array([0.4]))
    assert np.arctan2(seen[5], seen[4]) % (2 * np.pi) == pytest.approx(np.pi + 0.4)
    progress = np.hypot(x, y) - np.hypot(*after["pose"][:2])
    assert reward == pytest.approx(progress - 0.01)


def test_an_episode_ends_with_an_arrival_a_fall_or_the_fence():
    environment = SteeredHopperEnv()
    environment.reset(seed=1, options={"pose": (0.0, 0.0, 0.0)})
    seen, reward, ended, cut, about = environment.step(np.zeros(1))
    assert (about["ending"], ended, cut) == ("arrived", True, False)
    assert reward > 0.9
    assert np.hypot(*seen[:2]) <= ARRIVED_M
    with pytest.raises(ResetNeeded):
        environment.step(np.zeros(1))
    environment.reset(seed=1, options={"pose": (FENCE_M + 0.5, 0.0, 0.0)})
    _, reward, ended, _, about = environment.step(np.zeros(1))
    assert (about["ending"], ended) == ("left", True)
    assert reward < -0.5
    environment = SteeredHopperEnv(robot=WILD)
    seen, _ = environment.reset(seed=2)
    for _ in range(60):
        before = seen
        seen, reward, ended, _, about = environment.step(np.zeros(1))
        if about["ending"] == "fell":
            break
        if ended:
            seen, _ = environment.reset()
    assert (about["ending"], ended) == ("fell", True)
    assert reward == pytest.approx(-1.01)
    assert seen.tobytes() == before.tobytes()


def test_time_cuts_an_episode_off_without_an_end():
    made = gymnasium.make(ID, max_episode_steps=2)
    made.reset(seed=1, options=RELEASED_UPRIGHT)
    assert made.step(np.zeros(1))[2:4] == (False, False)
    assert made.step(np.zeros(1))[2:4] == (False, True)
    assert gymnasium.spec(ID).max_episode_steps == MOST_STRIDES


def test_a_half_turn_is_a_task_of_its_own():
    environment = SteeredHopperEnv(task="turn")
    seen, _ = environment.reset(seed=6)
    assert seen[2] < -0.8  # the goal is behind, but for the turn of the first landing
    with pytest.raises(ConfigError, match="task: expected one of origin, turn"):
        SteeredHopperEnv(task="truns")


@pytest.mark.parametrize("action", [[np.nan], [0.1, 0.2], 0.1, []])
def test_an_action_that_is_no_swing_is_refused(action):
    environment = SteeredHopperEnv()
    environment._apex = released(environment.robot, (0.0, 0.0, 0.0))
    with pytest.raises(ArgumentError, match="action: expected one finite number, rad"):
        environment.step(action)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pose": (1.0, 2.0)}, "options: pose: expected three finite numbers"),
        ({"pose": (1.0, 2.0, np.inf)}, "options: pose: expected three finite numbers"),
        ({"poses": 1}, "options: expected pose, or nothing, found poses"),
    ],
)
def test_options_of_reset_are_checked(options, message):
    with pytest.raises(ArgumentError, match=message):
        SteeredHopperEnv().reset(options=options)


def test_a_hopper_that_never_lands_is_told(monkeypatch):
    monkeypatch.setattr(module, "MOST_RELEASES", 2)
    heavy = replace(SteeredHopper().hopper, preload_n=0.1, stiffness_n_m=1.0)
    environment = SteeredHopperEnv(robot=SteeredHopper(hopper=heavy))
    with pytest.raises(AnalysisError, match="a fall at each of 2 releases"):
        environment.reset(seed=1)


def test_the_example_in_the_page_on_steering_arrives(capsys):
    page = Path(__file__).parents[2] / "docs/steering.md"
    (block,) = re.findall(
        r"```python\n(import gymnasium.*?)```", page.read_text(), re.DOTALL
    )
    exec(compile(block.replace("episodes=5", "episodes=2"), str(page), "exec"), {})
    told = capsys.readouterr().out.splitlines()
    assert told == ["at random: 0 of 5", "against the bearing: 2 of 5"]


def test_nothing_else_loads_gymnasium_and_an_import_makes_it_known():
    program = (
        "import sys, hopdata.steering.robot, hopdata.steering.commands.drive\n"
        "assert 'gymnasium' not in sys.modules\n"
        "import gymnasium\n"
        "assert 'hopdata/SteeredHopper-v0' not in gymnasium.registry\n"
        "import hopdata.steering.environment as environment\n"
        "environment.register()\n"
        "print(gymnasium.spec('hopdata/SteeredHopper-v0').entry_point)\n"
    )
    assert _run(program) == "hopdata.steering.environment:SteeredHopperEnv"


def test_the_name_on_the_page_makes_the_environment_at_once():
    page = Path("docs/steering.md").read_text("utf-8")
    (name,) = set(re.findall(r'ID = "([^"]+)"', page))
    assert name.endswith(f":{ID}")
    program = "import gymnasium\nprint(gymnasium.make({!r}).unwrapped.task)\n"
    assert _run(program.format(name)) == "origin"
    assert f'"{name}"' in USES["extras"]["gym"]  # `hopdata doctor` says the same
    # The bare name is known to no one who has not imported the module.
    with pytest.raises(subprocess.CalledProcessError):
        _run(program.format(ID))


def _run(program):
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()
