"""What the benchmarks of steering share: printed excitation, maps, starts, and the board."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.steering.excitation import ControlGrid, Excitation
from hopdata.steering.experiments.tasks import ORIGIN, board_for
from hopdata.steering.frame_changes import FrameChanges, frame_changes
from hopdata.steering.models.learning import random_split
from hopdata.steering.models.process import FrameChangeProcess, embedded, embedded_scales
from hopdata.steering.models.tabulated import TabulatedMap, tabulated
from hopdata.steering.models.training import RECOMMENDED, trained_process
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.observe import observe_stances
from hopdata.steering.robot import Board, SteeredHopper
from hopdata.steering.trial import record_trial, true_frame_changes

FloatArray = NDArray[np.float64]

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
