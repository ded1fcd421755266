"""The steered hopper as an environment of gymnasium; importing this registers it.

    import gymnasium

    name = "hopdata.steering.environment:hopdata/SteeredHopper-v0"
    environment = gymnasium.make(name, task="origin")

gymnasium imports the module before the colon. It loads no entry points, so that it
knows the environment by ``hopdata/SteeredHopper-v0`` alone only after an import.

Nothing else of hopdata needs gymnasium (``pip install 'hopdata[gym]'``).
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError, ArgumentError, require_choice
from hopdata.rigid import wrapped
from hopdata.steering.goals import ARRIVED_M, FENCE_M, MOST_STRIDES, TURNED_RAD
from hopdata.steering.robot import Apex, SteeredHopper, released, steer_hop

ID = "hopdata/SteeredHopper-v0"

# What the hopper has to do, named as in the experiments.
ORIGIN = "origin"
TURN = "turn"
TASKS = (ORIGIN, TURN)

#: Distance from the goal at which the hopper starts.
#: Unit: m. Origin: chosen: as in the experiments of the study.
START_M = 1.0
#: Bound of the observed coordinates; a hop is shorter than 1 m.
#: Unit: m. Origin: derived: the fence, the start and one hop, rounded up.
FARTHEST_M = 10.0
#: Parts of the reward besides the progress: of a hop, of an arrival, and of a fall or
#: the fence.
#: Unit: 1. Origin: chosen.
OF_HOP = -0.01
OF_ARRIVAL = 1.0
OF_FAILURE = -1.0
#: Relative tolerance of the integrator; the absolute one is a hundredth. The
#: experiments use 1e-10.
#: Unit: 1. Origin: measured: benchmarks/steering/environment_speed.py.
RTOL = 1e-6
#: Releases in a row that each end with a fall at the first landing, after which the
#: hopper is taken for one that cannot hop.
#: Unit: 1. Origin: chosen.
MOST_RELEASES = 100


class SteeredHopperEnv(gymnasium.Env[FloatArray, FloatArray]):
    """A hopper that is steered, hop by hop, by a boom that swings in its flight.

    One step is one hop: the swing is executed in the flight before the landing, and the
    observation is that of the landing, at the lowest point (the stance). Contacts are
    exact: the instants at which single feet touch and leave the floor are events of the
    hybrid integrator. Each hop is kicked at random at its apex.

    **Action** (1,): swing of the boom, rad, within +-`SteeredHopper.swing_limit_rad`.

    **Observation** (6,): at the stance,

    - 0, 1: where the goal is, m, in the hopper's horizontal axes: ahead (along its
      heading, towards its first leg) and to the left;
    - 2, 3: cosine and sine of the goal's heading minus the hopper's;
    - 4, 5: cosine and sine of the boom angle in the hopper's axes; at pi the boom is
      neutral.

    The world's z is up and yaw is counted anticlockwise from its x-axis. The goal of
    "origin" is the pose (0, 0, 0), of which only the place matters; that of "turn" is
    the heading opposite to that of the start.

    **Reward**: the progress in the hop (by how much the distance to the goal, m, or the
    error of the heading, rad, has shrunk), -0.01 for the hop, 1 for an arrival, and -1
    for a fall or for leaving the fence.

    **End**: an episode is terminated by an arrival ("origin": within 0.11 m, "turn":
    within 15 degrees), a fall, or 3 m of distance from the origin. After a fall, which
    has no stance, the observation is the previous one. `gymnasium.make` truncates an
    episode after 50 hops (its ``max_episode_steps``).

    **Start**: "origin" begins 1 m from the goal in a random direction, "turn" at the
    origin, both with a random heading and the boom in neutral. The hopper is released
    and lands once, unsteered, before the first observation. The options of `reset` may
    give the ``pose`` (x m, y m, heading rad) of the release.

    **Information**: ``pose`` (3,) at the stance, m and rad (unwrapped),
    ``boom_angle_rad`` (unwrapped), ``time_s`` of the stance since the release, and
    ``ending``: "arrived", "fell", "left", or "" while the episode goes on.

    The same seed and actions give the same episode, bit by bit on the same machine.

    Parameters
    ----------
    task : {"origin", "turn"}
        What the hopper has to do.
    robot : SteeredHopper, optional
        The hopper, its kicks and the limit of its swings.
    rtol : float
        Relative tolerance of the integrator.
    render_mode : None
        Nothing is drawn.

    Raises
    ------
    ConfigError
        If there is no such task.
    """

    # gymnasium declares it as an attribute of objects.
    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        *,
        task: str = ORIGIN,
        robot: SteeredHopper | None = None,
        rtol: float = RTOL,
        render_mode: str | None = None,
    ) -> None:
        require_choice("task", task, TASKS)
        self.task = task
        self.robot = robot or SteeredHopper()
        self.rtol = rtol
        self.render_mode = render_mode
        limit = self.robot.swing_limit_rad
        self.action_space = Box(-limit, limit, (1,), np.float64)
        self._largest = np.array([FARTHEST_M, FARTHEST_M, 1.0, 1.0, 1.0, 1.0])
        self.observation_space = Box(-self._largest, self._largest, dtype=np.float64)
        self._apex: Apex | None = None  # of the next hop; None outside of an episode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin an episode: release the hopper and let it land once.

        Parameters
        ----------
        seed : int, optional
            Seed of starts and kicks, from now on.
        options : dict, optional
            ``pose``: (x m, y m, heading rad) of the release instead of a random one.

        Raises
        ------
        ArgumentError
            If an option is unknown, or the pose not three finite numbers.
        AnalysisError
            If the hopper falls at each of many first landings.
        """
        super().reset(seed=seed)
        pose = _given_pose(options or {})
        if pose is None:
            pose = self._random_pose()
        self._goal = np.zeros(3)
        if self.task == TURN:
            self._goal[2] = pose[2] + np.pi
        for _ in range(MOST_RELEASES):
            apex = released(self.robot, pose, self.robot.hopper.boom_angle_rad)
            if not self._fell_in_hop(apex, 0.0):
                self._error = self._error_now()
                return self._observation(), self._information("")
        falls = f"a fall at each of {MOST_RELEASES} releases"
        raise AnalysisError.at("robot", "a hopper that lands on its feet", falls)

    def step(
        self, action: FloatArray
    ) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Make one hop; see the class.

        Raises
        ------
        ArgumentError
            If the action is not one finite number.
        gymnasium.error.ResetNeeded
            If no episode has begun, or the last one has ended.
        """
        if self._apex is None:
            raise gymnasium.error.ResetNeeded("no episode has begun: call reset first")
        swing = np.asarray(action, dtype=float)
        if swing.shape != (1,) or not np.isfinite(swing[0]):
            raise ArgumentError.at("action", "one finite number, rad", action)
        ending = ""
        progress = 0.0
        if self._fell_in_hop(self._apex, float(swing[0])):
            ending = "fell"
        else:
            error = self._error_now()
            progress = self._error - error
            self._error = error
            ending = self._ending(error)
        reward = progress + OF_HOP
        if ending == "arrived":
            reward += OF_ARRIVAL
        elif ending:
            reward += OF_FAILURE
        if ending:
            self._apex = None
        information = self._information(ending)
        return self._observation(), float(reward), bool(ending), False, information

    def _random_pose(self) -> FloatArray:
        bearing, heading = self.np_random.uniform(-np.pi, np.pi, 2)
        pose = np.array([0.0, 0.0, heading])
        if self.task == ORIGIN:
            pose[:2] = START_M * np.array([np.cos(bearing), np.sin(bearing)])
        return pose

    def _fell_in_hop(self, apex: Apex, swing_rad: float) -> bool:
        """Make a hop and keep its stance; return whether it fell instead."""
        hop = steer_hop(self.robot, apex, swing_rad, rng=self.np_random, rtol=self.rtol)
        self._apex = hop.end
        if hop.stance.fell:
            return True
        self._stance = hop.stance
        return False

    def _error_now(self) -> float:
        """Return the distance to the goal, m, or the error of the heading, rad."""
        x, y, heading = self._stance.pose
        if self.task == TURN:
            return abs(float(wrapped(self._goal[2] - heading)))
        return float(np.hypot(x - self._goal[0], y - self._goal[1]))

    def _ending(self, error: float) -> str:
        near = TURNED_RAD if self.task == TURN else ARRIVED_M
        if error <= near:
            return "arrived"
        x, y, _ = self._stance.pose
        return "left" if np.hypot(x, y) > FENCE_M else ""

    def _observation(self) -> FloatArray:
        x, y, heading = self._stance.pose
        cosine = np.cos(heading)
        sine = np.sin(heading)
        to_x = self._goal[0] - x
        to_y = self._goal[1] - y
        turn = self._goal[2] - heading
        boom = self._stance.boom_angle_rad
        seen = np.array(
            [
                cosine * to_x + sine * to_y,
                cosine * to_y - sine * to_x,
                np.cos(turn),
                np.sin(turn),
                np.cos(boom),
                np.sin(boom),
            ]
        )
        return np.clip(seen, -self._largest, self._largest)

    def _information(self, ending: str) -> dict[str, Any]:
        stance = self._stance
        return {
            "pose": stance.pose.copy(),
            "boom_angle_rad": stance.boom_angle_rad,
            "time_s": stance.time_s,
            "ending": ending,
        }


def _given_pose(options: dict[str, Any]) -> FloatArray | None:
    """Return the pose in the options of `reset`, (3,), or None without one."""
    unknown = ", ".join(sorted(set(options) - {"pose"}))
    if unknown:
        raise ArgumentError.at("options", "pose, or nothing", unknown)
    if "pose" not in options:
        return None
    pose = np.asarray(options["pose"], dtype=float)
    if pose.shape != (3,) or not np.isfinite(pose).all():
        wanted = "three finite numbers: x m, y m, heading rad"
        raise ArgumentError.at("options: pose", wanted, options["pose"])
    return pose


def register() -> None:
    """Make the environment known to gymnasium; a second call does nothing."""
    if ID not in gymnasium.registry:
        gymnasium.register(
            id=ID,
            entry_point="hopdata.steering.environment:SteeredHopperEnv",
            max_episode_steps=MOST_STRIDES,
        )


register()
