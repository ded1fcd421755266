"""What the benchmarks of control share: the learned and the true map, starts, and the board."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.steering.excitation import ControlGrid, random_excitation
from hopdata.steering.experiments.tasks import ORIGIN, board_for
from hopdata.steering.frame_changes import FrameChanges, frame_changes
from hopdata.steering.models.learning import random_split
from hopdata.steering.models.process import FrameChangeProcess, embedded
from hopdata.steering.models.tabulated import TabulatedMap, tabulated
from hopdata.steering.models.training import RECOMMENDED, regressor_of, trained_process
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
