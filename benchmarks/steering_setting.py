"""What the benchmarks of steering share: excitation, maps, starts, trials, the best plan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult, minimize

from hopdata.arrays import BoolArray, FloatArray
from hopdata.rigid import composed, wrapped
from hopdata.steering.control.objectives import (
    Controller,
    Horizon,
    Objective,
    Plan,
    PlanningError,
    ToHeading,
    errors_left,
    objective_value,
)
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.excitation import ControlGrid, Excitation
from hopdata.steering.experiments.tasks import ORIGIN, board_for
from hopdata.steering.frame_changes import FrameChanges, frame_changes
from hopdata.steering.models.learning import random_split
from hopdata.steering.models.process import (
    FrameChangeProcess,
    embedded,
    embedded_scales,
    input_rows,
)
from hopdata.steering.models.tabulated import FrameChangeMap, TabulatedMap, tabulated
from hopdata.steering.models.training import RECOMMENDED, trained_process
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.observe import observe_stances
from hopdata.steering.robot import Board, Stance, SteeredHopper, released, steer_past
from hopdata.steering.trial import record_trial, true_frame_changes

# Derivatives of models in closed form.


def change_and_gradient(model: Any, *inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Frame changes (n, 3) of hops with these inputs, and derivatives (n, 3, d) by the inputs."""
    if isinstance(model, FrameChangeProcess):
        points = model._points(inputs)
        return model.mean_at(points), mean_slopes(model, points)
    if isinstance(model, TabulatedMap):
        angles, swings = input_rows(inputs, 2)
        points = np.stack([swings, angles % (2 * np.pi)], axis=-1)
        slopes = [model._spline(points, nu=nu) for nu in ((0, 1), (1, 0))]
        return model.change(*inputs), np.stack(slopes, axis=-1)
    return model.change_and_gradient(*inputs)


def correlation_slope(squared: FloatArray, smoothness: float) -> FloatArray:
    """Return the derivative of the kernel by the squared distance.

    At distance zero the kernel of smoothness 1/2 has a kink, and its derivative is given as 0.
    """
    if smoothness == np.inf:
        return np.asarray(-0.5 * np.exp(-0.5 * squared))
    r = np.sqrt(2 * smoothness * squared)
    with np.errstate(divide="ignore"):
        factor = {
            0.5: np.where(r > 0, -0.5 / r, 0.0), 1.5: -1.5, 2.5: -(5.0 / 6.0) * (1.0 + r)
        }[smoothness]  # fmt: skip
    return np.asarray(factor * np.exp(-r))


def mean_slopes(process: FrameChangeProcess, points: FloatArray) -> FloatArray:
    """Return the derivatives (n, 3, d) of a process's means at points (n, d)."""
    apart = points[:, None] - process.inputs  # (n, m, d)
    square, slope = apart**2, 2 * apart
    if process.periodic:
        square[..., 0] = 2 * (1 - np.cos(apart[..., 0]))
        slope[..., 0] = 2 * np.sin(apart[..., 0])
    inverse = 1 / process.length_scales**2
    kernel = correlation_slope(np.einsum("nmd,jd->jnm", square, inverse), process.smoothness)
    return np.einsum("jm,jnm,nmd,jd->njd", process.weights, kernel, slope, inverse, optimize=True)


# Plans with the gradient in closed form, and the best plan there is.

STARTS = ("several", "previous swing", "rest")


@dataclass(frozen=True, kw_only=True)
class GradientController(PrintedController):
    """The printed controller with the gradient of the model by the chain rule, and other starts.

    `start`: the search begins at "several" places, of which the best end counts, with the
    "previous swing" (half the limit if there was none), or at "rest".
    """

    start: str = "several"

    def first_swings(self, previous_swing_rad: float | None) -> tuple[float, ...]:
        """Return the swings of all hops at which the searches begin."""
        limit = self.horizon.swing_limit_rad
        known = previous_swing_rad and np.isfinite(previous_swing_rad)
        again = float(np.clip(previous_swing_rad, -limit, limit)) if known else limit / 2
        several = super().first_swings(previous_swing_rad)
        return {"several": several, "previous swing": (again,), "rest": (0.0,)}[self.start]

    def descended(
        self, pose: FloatArray, boom_angle_rad: float, first_rad: float
    ) -> OptimizeResult:
        """Search from the same swing in all hops."""
        limit, hops = self.horizon.swing_limit_rad, self.horizon.hops
        return minimize(
            lambda u: objective_and_gradient(self.model, self.objective, pose, boom_angle_rad, u),
            np.full(hops, first_rad),
            jac=True,
            method="L-BFGS-B",
            bounds=[(-limit, limit)] * hops,
        )


def objective_and_gradient(
    model: FrameChangeMap,
    objective: Objective,
    pose: FloatArray,
    boom_angle_rad: float,
    swings_rad: FloatArray,
) -> tuple[float, FloatArray]:
    """Objective of swings (H,) and its gradient (H,), by the chain rule forwards."""
    hops = len(swings_rad)
    poses, slopes = [np.asarray(pose, dtype=float)], [np.zeros((3, hops))]
    boom, boom_slope = boom_angle_rad, np.zeros(hops)
    for k, swing in enumerate(swings_rad):
        change, by_inputs = (
            part[0] for part in change_and_gradient(model, np.array([boom]), np.array([swing]))
        )
        by_swings = np.outer(by_inputs[:, 0], boom_slope)
        by_swings[:, k] += by_inputs[:, 1]
        slopes.append(_composed_slopes(poses[-1], slopes[-1], change, by_swings))
        poses.append(composed(poses[-1], change))
        boom_slope[k] += 1.0
        boom += swing
    ahead, ahead_slopes = np.array(poses[1:]), np.array(slopes[1:])
    by_pose = _penalty_slopes(objective, ahead)
    return float(objective_value(objective, ahead)), np.einsum("kc,kch->h", by_pose, ahead_slopes)


def _composed_slopes(
    pose: FloatArray, slopes: FloatArray, change: FloatArray, by_swings: FloatArray
) -> FloatArray:
    """Return the derivatives (3, H) of a pose after a frame change."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    by_heading = np.array([-s * change[0] - c * change[1], c * change[0] - s * change[1], 0.0])
    return np.asarray(slopes + np.outer(by_heading, slopes[2]) + turn @ by_swings)


def _penalty_slopes(objective: Objective, poses: FloatArray) -> FloatArray:
    """Return the derivatives (H, 3) of the objective by the poses (H, 3) that it counts."""
    away = np.zeros_like(poses)
    if isinstance(objective, ToHeading):
        away[:, 2] = wrapped(poses[:, 2] - objective.heading_rad)
    else:
        away[:, :2] = poses[:, :2] - np.array(objective.point_m)
    size = errors_left(objective, poses)[:, None]
    return np.divide(away, size, out=np.zeros_like(away), where=size > 0)


# A dense grid in NumPy, then scipy's polish of its lowest dips.


def reference_objective(
    model: FrameChangeMap,
    objective: Objective,
    horizon: Horizon,
    pose: FloatArray,
    boom_angle_rad: float,
    *,
    swings: int = 41,
    polishes: int = 4,
) -> float:
    """Lowest objective over all sequences of swings.

    Parameters
    ----------
    model : FrameChangeMap
    objective, horizon
        As of a controller.
    pose : (3,) array
    boom_angle_rad : float
    swings : int
        Nodes of each swing.
    polishes : int
        Lowest dips of the grid that are polished by L-BFGS-B with the exact gradient.
    """
    limit = horizon.swing_limit_rad
    grid = np.linspace(-limit, limit, swings)
    values = _dense(model, objective, horizon.hops, pose, boom_angle_rad, grid)
    places = np.flatnonzero(_dips(values))
    lowest = places[np.argsort(values.ravel()[places])[:polishes]]
    best = float(values.min())
    for place in lowest:
        start = grid[list(np.unravel_index(place, values.shape))]
        solved = minimize(
            lambda u: objective_and_gradient(model, objective, pose, boom_angle_rad, u),
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(-limit, limit)] * horizon.hops,
        )
        best = min(best, float(solved.fun))
    return best


def _dense(
    model: FrameChangeMap,
    objective: Objective,
    hops: int,
    pose: FloatArray,
    boom_angle_rad: float,
    grid: FloatArray,
) -> FloatArray:
    """Objective of all sequences, (n, n, ...)."""
    poses, booms, total = np.asarray(pose, dtype=float), np.array(boom_angle_rad), np.zeros(())
    for _ in range(hops):
        shape = (*booms.shape, len(grid))
        boom, swing = np.broadcast_to(booms[..., None], shape), np.broadcast_to(grid, shape)
        change = model.change(boom.ravel(), swing.ravel()).reshape(*shape, 3)
        poses = composed(np.broadcast_to(poses[..., None, :], (*shape, 3)), change)
        booms = boom + swing
        total = total[..., None] + errors_left(objective, poses)
    return np.asarray(total)


def _dips(values: FloatArray) -> NDArray[np.bool_]:
    """Whether no neighbour along an axis is lower."""
    low = np.ones(values.shape, dtype=bool)
    for axis in range(values.ndim):
        rising = np.diff(values, axis=axis) >= 0
        ahead = [(0, 0)] * values.ndim
        ahead[axis] = (0, 1)
        behind = [(0, 0)] * values.ndim
        behind[axis] = (1, 0)
        low &= np.pad(rising, ahead, constant_values=True)
        low &= np.pad(~rising | (np.diff(values, axis=axis) == 0), behind, constant_values=True)
    return low


# One trial in closed loop: stance, pose, plan, swing, next stance.


#: Makes of a stance what is measured of it: the pose (3,) and the boom angle, rad.
Observe = Callable[[Stance, np.random.Generator], tuple[FloatArray, float]]


@dataclass(frozen=True, kw_only=True)
class PoseNoise:
    """Measurement noise of a stance.

    Parameters
    ----------
    position_m, heading_rad, boom_rad : float
        Standard deviations; by default those of three body markers seen with 0.6 mm of noise.
    """

    position_m: float = 0.6e-3
    heading_rad: float = 2.2e-3
    boom_rad: float = 5e-3

    def __call__(self, stance: Stance, rng: np.random.Generator) -> tuple[FloatArray, float]:
        """Return the measured pose (3,) and boom angle."""
        spread = np.array([self.position_m, self.position_m, self.heading_rad])
        pose = stance.pose + spread * rng.standard_normal(3)
        return pose, stance.boom_angle_rad + self.boom_rad * rng.standard_normal()


def exactly(stance: Stance, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Return the pose and the boom angle as they are."""
    del rng
    return stance.pose.copy(), stance.boom_angle_rad


@dataclass(frozen=True)
class ClosedLoopTrial:
    """A trial of H planned hops, fewer if the hopper fell.

    Parameters
    ----------
    time_s : (H + 1,) array
        Time of the stances, s; the first is that before the first plan.
    poses : (H + 1, 3) array
        True poses at the stances; m, m, rad, headings not wrapped.
    measured_poses : (H + 1, 3) array
        Poses that were planned from; the last is not.
    boom_angles_rad : (H + 1,) array
        True boom angles at the stances, not wrapped.
    swings_rad : (H,) array
        Swings between the stances.
    plans : tuple of Plan
        The plans, None where there could be none and the boom was held.
    board_m : (H + 1,) array
        Place of the board at the stances, m; NaN without a board.
    fell : bool
        Whether the hopper fell in the hop after the last stance.
    """

    time_s: FloatArray
    poses: FloatArray
    measured_poses: FloatArray
    boom_angles_rad: FloatArray
    swings_rad: FloatArray
    plans: tuple[Plan | None, ...]
    board_m: FloatArray
    fell: bool

    @property
    def pushed(self) -> BoolArray:
        """Whether each hop moved the board, (H,)."""
        return np.diff(self.board_m) > 0

    @property
    def held(self) -> int:
        """Number of hops without a plan, in which the boom was held."""
        return sum(plan is None for plan in self.plans)


def closed_loop(
    robot: SteeredHopper,
    controller: Controller,
    start: ArrayLike,
    *,
    hops: int,
    seed: int | Sequence[int],
    boom_angle_rad: float = np.pi,
    board: Board | None = None,
    observe: Observe = exactly,
) -> ClosedLoopTrial:
    """Let the hopper go, and steer it from its first stance on.

    Parameters
    ----------
    robot : SteeredHopper
    controller : Controller
        Asked once a stance. If it can make no plan (`PlanningError`) the boom is held.
    start : (3,) array
        Pose at which the hopper is released; m, m, rad.
    hops : int
        Hops that are planned.
    seed : int or sequence of int
        Seed of the kicks and of the measurement, which have streams of their own.
    boom_angle_rad : float
        Boom angle at the release.
    board : Board, optional
        What stands in the way.
    observe : callable
        What is measured of a stance; `PoseNoise`, say.
    """
    kicks, noise = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    apex = released(robot, start, boom_angle_rad)
    hop, board = steer_past(robot, apex, 0.0, board, rng=kicks)
    stances, measured, boards = [hop.stance], [], [board]
    swings: list[float] = []
    plans: list[Plan | None] = []
    while True:
        pose, boom = observe(hop.stance, noise)
        measured.append(pose)
        if len(plans) == hops or hop.stance.fell:
            break
        plan = _plan(controller, pose, boom, swings[-1] if swings else 0.0)
        swing = 0.0 if plan is None else plan.swing_rad
        hop, board = steer_past(robot, hop.end, swing, board, rng=kicks)
        if hop.stance.fell:
            break
        plans.append(plan)
        swings.append(hop.swing_rad)
        stances.append(hop.stance)
        boards.append(board)
    return ClosedLoopTrial(
        time_s=np.array([stance.time_s for stance in stances]),
        poses=np.array([stance.pose for stance in stances]),
        measured_poses=np.array(measured),
        boom_angles_rad=np.array([stance.boom_angle_rad for stance in stances]),
        swings_rad=np.array(swings),
        plans=tuple(plans),
        board_m=np.array([np.nan if one is None else one.place_m for one in boards]),
        fell=hop.stance.fell,
    )


def _plan(
    controller: Controller, pose: FloatArray, boom_angle_rad: float, previous_swing_rad: float
) -> Plan | None:
    try:
        return controller.plan(pose, boom_angle_rad, previous_swing_rad)
    except PlanningError:
        return None


ROBOT = SteeredHopper()
LIMIT = ROBOT.swing_limit_rad
HOPS = 100
EXCITATIONS = 3
COPIES = replace(RECOMMENDED, periodic=False)


def random_excitation(
    grid: ControlGrid, rng: np.random.Generator, *, start: int = 0, limit: int | None = None
) -> Excitation:
    """Draw moves at random until all are made (Algorithm 1).

    The next angle is drawn with the weight ``1 / n_steps + its number of moves still to make``,
    among those to which a move is still wanted, or among all in reach if there are none. Put right
    are what the print leaves out or mistakes: the size of its matrix, the draw itself, the copy of
    the matrix, and the last angle, without which the last move would not be commanded.

    Parameters
    ----------
    grid : ControlGrid
    rng : numpy Generator
    start : int
        Index of the first boom angle.
    limit : int, optional
        Stop after so many hops; `Excitation.coverage` then tells what is missing.
    """
    wanted = np.full((grid.n_angles, len(grid.steps)), grid.repeats)
    made: list[int] = []
    k, left = start % grid.n_angles, wanted.sum()
    while left > 0 and (limit is None or len(made) < limit):
        choices = np.flatnonzero(wanted[k]) if wanted[k].any() else np.arange(len(grid.steps))
        ends = (k + grid.steps[choices]) % grid.n_angles
        weights = wanted[ends].sum(axis=1) + 1.0 / grid.n_steps
        move = rng.choice(choices, p=weights / weights.sum())
        if wanted[k, move] > 0:
            wanted[k, move] -= 1
            left -= 1
        made.append(int(grid.steps[move]))
        k = int((k + grid.steps[move]) % grid.n_angles)
    return Excitation(grid, start % grid.n_angles, np.array(made, dtype=int))


def regressor_of(process: FrameChangeProcess, component: int) -> Any:
    """Return scikit-learn's regressor of one component with the hyper-parameters of a process.

    It predicts the output as modelled, for embedded inputs: a peer to compare with.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    j = component
    lengths = embedded_scales(process.length_scales[j], process.periodic)
    matern = Matern(lengths, nu=process.smoothness)
    kernel = ConstantKernel(process.variance[j]) * matern + WhiteKernel(process.noise[j])
    target = (process.outputs[:, j] - process.offset[j]) / process.unit[j]
    regressor = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None)
    return regressor.fit(embedded(process.inputs, process.periodic), target)


class SklearnMap:
    """Three of scikit-learn's regressors, as printed: asked with `predict`, without a gradient."""

    def __init__(self, process: FrameChangeProcess) -> None:
        self._process = process
        self._regressors = [regressor_of(process, j) for j in range(3)]

    def change(self, boom_angle: ArrayLike, swing: ArrayLike) -> FloatArray:
        """Return the frame changes (n, 3)."""
        points = embedded(np.column_stack([np.asarray(boom_angle) % (2 * np.pi), swing]), False)
        modelled = np.column_stack([one.predict(points) for one in self._regressors])
        return np.asarray(self._process.offset + self._process.unit * modelled)


@dataclass(frozen=True)
class Maps:
    """The true map, and those learned from noisy hops of several excitations.

    `learned` are periodic, as tables; `copies` have copies of the hops, `sklearn` the same by
    scikit-learn.
    """

    true: TabulatedMap
    learned: list[TabulatedMap]
    copies: list[FrameChangeProcess]
    sklearn: list[SklearnMap]


def excited(seed: int, number: int, robot: SteeredHopper = ROBOT) -> FrameChanges:
    """`HOPS` hops as motion capture sees them, drawn at random from those of a printed excitation.

    So the dissertation draws them (Sec. 3.4.2).
    """
    stream = np.random.SeedSequence([seed, number, 1])
    swings = random_excitation(ControlGrid(), np.random.default_rng(stream)).swings
    trial = record_trial(robot, swings, seed=[seed, number, 2])
    states = observe_stances(trial.recording, calibrate(trial.recording))
    seen = frame_changes(
        states.time_s, states.pose, states.boom_angle_rad, states.pairs, swing_limit_rad=LIMIT
    ).used()
    draw = np.random.default_rng(np.random.SeedSequence([seed, number, 3]))
    return seen.rows(random_split(len(seen), HOPS, draw)[0])


def maps(seed: int) -> Maps:
    """Learn from the excitations, and measure the truth."""
    hops = [excited(seed, number) for number in range(EXCITATIONS)]
    copies = [trained_process(some, COPIES) for some in hops]
    true = true_frame_changes(ROBOT, boom_angles=24, swings=7)
    return Maps(
        true=TabulatedMap(true.average(), LIMIT),
        learned=[tabulated(trained_process(some), LIMIT) for some in hops],
        copies=copies,
        sklearn=[SklearnMap(process) for process in copies],
    )


def start_facing(number: int, off_rad: float | None, seed: int) -> FloatArray:
    """Pose (3,) a metre from the origin, in any direction, heading off the origin by an angle.

    None: any heading.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, number, 0]))
    bearing, any_turn = rng.uniform(-np.pi, np.pi, 2)
    turn = any_turn if off_rad is None else off_rad
    return np.array([np.cos(bearing), np.sin(bearing), bearing + np.pi + turn])


def start_turning(number: int, seed: int) -> FloatArray:
    """Pose (3,) at the origin with any heading."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, number, 0]))
    return np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)])


def board_before(start: FloatArray, ahead_m: float = 0.3) -> Board:
    """Board across the way to the origin, met `ahead_m` after the start; drag 4 N."""
    return board_for(ORIGIN, start, drag_n=4.0, ahead_m=ahead_m)
