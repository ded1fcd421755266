"""The trial that a model is learned from, where nobody has recorded one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.blas import one_blas_thread
from hopdata.recordings.recording import Recording
from hopdata.steering.plant.trial import SteeredTrial, record_trial
from hopdata.steering.stages.options import camera_of, excitation_of, robot_of
from hopdata.steering.streams import EXCITATION, TRIAL

if TYPE_CHECKING:
    import pandas as pd

NAME = "excitation"


@one_blas_thread()
def simulate_excitation(
    steering: Mapping[str, Any], motion_capture: Mapping[str, Any], *, seed: int
) -> tuple[Recording, pd.DataFrame, pd.DataFrame]:
    """Let the simulated robot execute an excitation, seen by motion capture.

    Parameters
    ----------
    steering, motion_capture : mapping
        These blocks of the configuration.
    seed : int
        The study's.

    Returns
    -------
    recording : Recording
    stances, motion : DataFrame
        The truth: one row a stance (``frame, time_s, x_m, y_m, heading_rad, boom_angle_rad,
        follows``) and one row a frame (``time_s``, pose, ``boom_angle_rad, tilt_rad``).
    """
    camera = camera_of(motion_capture)
    robot = robot_of(steering["robot"], camera)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(EXCITATION,)))
    swings = excitation_of(steering["excitation"], rng).swings
    trial = record_trial(robot, swings, seed=(seed, TRIAL), camera=camera, name=NAME)
    return trial.recording, _stances(trial), _motion(trial)


def _stances(trial: SteeredTrial) -> pd.DataFrame:
    import pandas as pd

    true = trial.stances
    x, y, heading = true.pose.T
    return pd.DataFrame(
        {
            "frame": true.frame, "time_s": true.time_s, "x_m": x, "y_m": y, "heading_rad": heading,
            "boom_angle_rad": true.boom_angle_rad, "follows": true.follows,
        }
    )  # fmt: skip


def _motion(trial: SteeredTrial) -> pd.DataFrame:
    import pandas as pd

    x, y, heading = trial.poses.T
    return pd.DataFrame(
        {
            "time_s": trial.recording.time, "x_m": x, "y_m": y, "heading_rad": heading,
            "boom_angle_rad": trial.boom_angle_rad, "tilt_rad": trial.tilt_rad,
        }
    )  # fmt: skip
