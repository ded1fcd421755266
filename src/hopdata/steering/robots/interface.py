"""What steering asks of a robot, and the log of its strides.

A robot that is steered (`Robot`) tells its `axes`, yields its `stances` (the pose
source) and takes a `command` (the actuator). A robot that is simulated
(`SimulatedRobot`) tells its `axes` and how well it is seen (`seen_sd`), can be put down
(`release`) and makes one `stride`; `Simulation` makes the first kind of it. Excitation,
learning, controllers, log and replay use nothing else of a robot.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import AnalysisError, require
from hopdata.steering.control.interface import Controller, PlanningError
from hopdata.steering.strides import StrideAxes, Strides, at_rest, recorded_strides


@dataclass(frozen=True)
class Stance:
    """Where a stride ends and the next begins.

    Parameters
    ----------
    time_s : float
    pose : (3,) array
        Place and heading in the world, m, m, rad.
    state : (S,) array
        The states of the robot's axes.
    fell : bool
        Whether the stride ended in a fall; the pose is then where it began.
    follows : bool
        Whether the robot came here by a stride, and was not put down.
    inner : object
        What a simulation goes on from; nobody else looks at it.
    """

    time_s: float
    pose: FloatArray
    state: FloatArray
    fell: bool = False
    follows: bool = True
    inner: Any = None


class Robot(Protocol):
    """A robot that is commanded once a stride."""

    @property
    def axes(self) -> StrideAxes:
        """Names of the states, and the inputs with their limits."""
        ...

    def stances(self) -> Iterator[Stance]:
        """Yield each stance as soon as it is seen: the pose source."""
        ...

    def command(self, inputs: FloatArray, /) -> None:
        """Send the inputs (U,) of the next stride: the actuator."""
        ...


class SimulatedRobot(Protocol):
    """A robot of which one stride can be computed."""

    @property
    def axes(self) -> StrideAxes:
        """Names of the states, and the inputs with their limits."""
        ...

    @property
    def seen_sd(self) -> Sequence[float]:
        """Deviations with which pose and states are seen, (3 + S,)."""
        ...

    def release(self, pose: ArrayLike, /) -> Stance:
        """Put the robot down at a pose (3,)."""
        ...

    def stride(
        self, stance: Stance, inputs: FloatArray, rng: np.random.Generator
    ) -> Stance:
        """Make one stride with these inputs (U,)."""
        ...


class PathRobot(ABC):
    """A simulated robot that tells its path, as cameras need it: a `SimulatedRobot`."""

    axes: ClassVar[StrideAxes]
    seen_sd: ClassVar[tuple[float, ...]]

    @abstractmethod
    def release(self, pose: ArrayLike, /) -> Stance:
        """Put the robot down at a pose (3,)."""

    @abstractmethod
    def path(
        self,
        stance: Stance,
        inputs: FloatArray,
        rng: np.random.Generator,
        times_s: FloatArray,
    ) -> tuple[Stance, FloatArray]:
        """Make one stride with inputs (U,).

        Return the next stance, and the robot's own states (K, N) at the times after the
        first stance, up to the next. Cameras see twelve states or more as a body: its
        place (x, y, z), m, and attitude (yaw, pitch, roll), rad, come first. Of fewer,
        the first two are x and the height of a body that keeps its heading.
        """

    def stride(
        self, stance: Stance, inputs: FloatArray, rng: np.random.Generator
    ) -> Stance:
        """Make one stride with these inputs (U,)."""
        return self.path(stance, inputs, rng, np.empty(0))[0]


class Simulation:
    """A simulated robot in place of a real one; a `Robot`.

    If it falls, an operator puts it down again where it was.

    Parameters
    ----------
    robot : SimulatedRobot
    pose : (3,)
        Pose at the first release.
    seed : int, sequence of int or SeedSequence
        Seed of what disturbs the strides and of what disturbs the sight of them.

    Attributes
    ----------
    true_pose : (3,) array
        Pose in the newest stance, as nobody sees it.

    Raises
    ------
    ConfigError
        If `seen_sd` has not one number for x, y, the heading, and each state.
    """

    def __init__(
        self, robot: SimulatedRobot, pose: ArrayLike = (0.0, 0.0, 0.0), *, seed: Any = 0
    ) -> None:
        n_numbers = 3 + len(robot.axes.states)
        n_found = np.size(robot.seen_sd)
        wanted = f"{n_numbers} numbers: of x, y, the heading, and each state"
        require(n_found == n_numbers, "seen_sd", wanted, n_found)
        self._robot = robot
        self._pose = np.asarray(pose, dtype=float)
        self.true_pose = self._pose
        root = seed
        if not isinstance(seed, np.random.SeedSequence):
            root = np.random.SeedSequence(seed)
        kicks, sight = (np.random.default_rng(one) for one in root.spawn(2))
        self._kicks = kicks
        self._sight = sight
        self._inputs = at_rest(robot.axes)

    @property
    def axes(self) -> StrideAxes:
        """Axes of the robot."""
        return self._robot.axes

    def stances(self) -> Iterator[Stance]:
        """Put the robot down, and let it make strides for ever.

        Raises
        ------
        AnalysisError
            If the robot returns no `Stance`, one with a state too many or too few, or a
            pose or state that is no number, and in no fall.
        """
        stance = self._released(self._pose)
        while True:
            yield self._seen(stance)
            after = self._robot.stride(stance, self._inputs, self._kicks)
            _require_stance("stride", after)
            if after.fell:
                yield self._seen(replace(after, pose=stance.pose, state=stance.state))
                after = self._released(stance.pose)
            else:
                _require_numbers("stride", after, len(self.axes.states))
            stance = replace(after, time_s=max(after.time_s, stance.time_s))

    def _released(self, pose: FloatArray) -> Stance:
        """Put the robot down, and return where it stands."""
        stance = self._robot.release(pose)
        _require_stance("release", stance)
        _require_numbers("release", stance, len(self.axes.states))
        return replace(stance, follows=False)

    def command(self, inputs: FloatArray, /) -> None:
        """Keep the inputs for the next strides, cut to their limits."""
        axes = self._robot.axes
        self._inputs = np.clip(inputs, axes.lower, axes.upper)

    def _seen(self, stance: Stance) -> Stance:
        """Return the stance as it is seen, without what only the simulation knows."""
        self.true_pose = stance.pose
        n_numbers = 3 + len(self.axes.states)
        error = self._robot.seen_sd * self._sight.standard_normal(n_numbers)
        pose = stance.pose + error[:3]
        state = self.axes.wrapped(stance.state + error[3:])
        return replace(stance, pose=pose, state=state, inner=None)


def _require_stance(method: str, found: Any) -> None:
    """Raise an error if a method of the robot returns something else."""
    if not isinstance(found, Stance):
        raise AnalysisError.at(method, "a Stance", type(found).__name__)


def _require_numbers(method: str, stance: Stance, n_states: int) -> None:
    """Raise an error if a pose is not of three numbers, or the state not of its own."""
    shapes = np.shape(stance.pose), np.shape(stance.state)
    if shapes != ((3,), (n_states,)):
        wanted = f"a pose of 3 numbers and a state of {n_states}, as the axes have it"
        raise AnalysisError.at(method, wanted, f"the shapes {shapes[0]}, {shapes[1]}")
    numbers = [*stance.pose, *stance.state]
    if not np.isfinite(numbers).all():
        wanted = "a pose and a state of numbers, or fell=True"
        raise AnalysisError.at(method, wanted, [float(one) for one in numbers])


@dataclass(frozen=True)
class Log:
    """Log of a robot: its stances, and what was commanded in each.

    Parameters
    ----------
    axes : StrideAxes
    stances : tuple of Stance
        The K stances, as they were seen.
    inputs : (K, U) array
        Inputs commanded in each; NaN in the last one.
    cut : (K,) bool array
        Where what was chosen was beyond the limits of the inputs, and was cut to them.
    failure : str
        Why it ended early: what the robot or the controller raised. Empty if neither
        did. The robot was then commanded to rest.
    """

    axes: StrideAxes
    stances: tuple[Stance, ...]
    inputs: FloatArray
    cut: BoolArray
    failure: str = ""

    @property
    def fell(self) -> bool:
        """Whether the robot fell."""
        return any(stance.fell for stance in self.stances)

    @property
    def poses(self) -> FloatArray:
        """The poses, (K, 3), m, m, rad."""
        return np.array([stance.pose for stance in self.stances])

    def strides(self) -> Strides:
        """Return the strides from stance to stance; a fall is none.

        Those after a fall of which the robot does not tell are not used. A line on the
        screen says how many they are (see `strides.is_still`).
        """
        follows = [one.follows and not one.fell for one in self.stances]
        second = np.flatnonzero(follows)
        made = recorded_strides(
            self.axes,
            time_s=np.array([one.time_s for one in self.stances]),
            pose=self.poses,
            state=np.array([one.state for one in self.stances]),
            inputs=self.inputs,
            pairs=np.column_stack([second - 1, second]),
        )
        if made.fall():
            logger.warning("%s", made.fall())
        return made


logger = logging.getLogger(__name__)

# What is commanded in a stance, by it and by the inputs of the stride that led to it;
# None ends the log.
Choice: TypeAlias = Callable[[Stance, FloatArray | None], FloatArray | None]


def excited(robot: Robot, inputs: ArrayLike) -> Log:
    """Let a robot execute an excitation, and return the log.

    Parameters
    ----------
    robot : Robot
    inputs : (n, U) array
        What is commanded, stride by stride; (n,) for a robot with one input.

    Raises
    ------
    ConfigError
        If one is beyond its limits, or no number, or a stride has not a number for each
        input of the robot; nothing has moved by then.
    """
    wanted = np.asarray(inputs, dtype=float)
    n_inputs = len(robot.axes.inputs)
    if wanted.ndim == 1 and n_inputs == 1:
        wanted = wanted[:, np.newaxis]
    is_table = wanted.ndim == 2 and wanted.shape[1] == n_inputs
    require(is_table, "inputs", f"the shape (strides, {n_inputs})", wanted.shape)
    is_within = (robot.axes.lower <= wanted) & (wanted <= robot.axes.upper)
    place = f"inputs of stride {int(np.argmin(is_within.all(axis=1)))}"
    limits = f"from {robot.axes.lower.tolist()} to {robot.axes.upper.tolist()}"
    found = wanted[~is_within.all(axis=1)][:1].tolist()
    require(bool(is_within.all()), place, limits, found)
    remaining = iter(wanted)
    return _logged(robot, lambda _stance, _previous: next(remaining, None))


def steered(
    robot: Robot,
    controller: Controller,
    *,
    strides: int,
    arrived: Callable[[FloatArray], bool] = lambda _pose: False,
) -> Log:
    """Let a controller steer a robot until it has arrived or fallen.

    Where the controller cannot plan, or plans what is no number, the inputs are those
    at rest.

    Parameters
    ----------
    robot : Robot
    controller : Controller
    strides : int
        Largest number of strides.
    arrived : callable
        Takes the pose (3,) in a stance; if true, it is the last.
    """
    stances = count()

    def planned(stance: Stance, previous: FloatArray | None) -> FloatArray | None:
        if stance.fell or next(stances) == strides or arrived(stance.pose):
            return None
        return _planned(controller, stance, previous, robot.axes)

    return _logged(robot, planned)


def replayed(log: Log, controller: Controller) -> FloatArray:
    """Plan again in each stance of a log, and return the inputs, (K, U).

    The same controller plans the same inputs. They are NaN where the log has none.
    """
    again = np.full_like(log.inputs, np.nan)
    previous = None
    for k, stance in enumerate(log.stances):
        if np.isfinite(log.inputs[k]).all():
            planned = _planned(controller, stance, previous, log.axes)
            again[k] = np.clip(planned, log.axes.lower, log.axes.upper)
            previous = log.inputs[k]
    return again


def _planned(
    controller: Controller,
    stance: Stance,
    previous: FloatArray | None,
    axes: StrideAxes,
) -> FloatArray:
    """Return the next inputs that a controller plans, or those at rest."""
    try:
        planned = controller.plan(stance.pose, stance.state, previous).inputs[0]
    except PlanningError:
        return at_rest(axes)
    return planned if np.isfinite(planned).all() else at_rest(axes)


def _logged(robot: Robot, chosen: Choice) -> Log:
    """Command in each stance what is chosen there, until nothing is.

    What is chosen is cut to the limits of the inputs. If the robot or what chooses
    fails, the robot is commanded to rest, and the log ends there.
    """
    stances: list[Stance] = []
    commanded: list[FloatArray] = []
    cut: list[bool] = []
    failure = ""
    try:
        for stance in robot.stances():
            stances.append(stance)
            commanded.append(np.full(len(robot.axes.inputs), np.nan))
            cut.append(False)
            previous = commanded[-2] if len(commanded) > 1 else None
            inputs = chosen(stance, previous)
            if inputs is None:
                break
            within = np.clip(inputs, robot.axes.lower, robot.axes.upper)
            cut[-1] = bool((within != inputs).any())
            if cut[-1]:
                said = "stride %d: inputs %s cut to their limits: %s"
                logger.warning(said, len(stances), inputs, within)
            robot.command(within)
            commanded[-1] = within
    except AnalysisError:  # of a simulation that cannot go on
        _rest(robot)
        raise
    except Exception as error:
        failure = f"stride {len(stances)}: {error!r}"
        logger.error("the robot rests, and its log ends: %s", failure)
        _rest(robot)
    inputs_sent = np.array(commanded).reshape(-1, len(robot.axes.inputs))
    return Log(robot.axes, tuple(stances), inputs_sent, np.array(cut), failure)


def _rest(robot: Robot) -> None:
    """Command a robot to rest; one that is gone cannot."""
    try:
        robot.command(at_rest(robot.axes))
    except Exception as error:
        logger.error("the robot could not be commanded to rest: %r", error)
