"""A run in which the model stands in for the hopper: what would happen were it right."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hopdata.steering.control.plan import Controller
from hopdata.steering.experiments.run import Run
from hopdata.steering.experiments.tasks import Task, decided, errors_of

if TYPE_CHECKING:
    import pandas as pd


def simulated(controller: Controller, task: Task, start: ArrayLike, run: Run) -> pd.DataFrame:
    """Let controller and model go on alone from the first measured stance of a run.

    Parameters
    ----------
    controller : Controller
        Its own predictions are taken for what happens.
    task : Task
        Ends it, when it is decided.
    start : (3,) array
        Pose at the release, for the goal.
    run : Run
        Gives the first stance, and the time that a hop takes (its mean).

    Returns
    -------
    DataFrame
        ``curve`` ("pure"), ``stance, time_s, x_m, y_m, heading_rad``.
    """
    import pandas as pd

    seen = np.isfinite(run.measured[:, 0])
    pose = np.array(run.measured[seen][0] if seen.any() else start, dtype=float)
    boom = float(run.boom_angle_rad[seen][0]) if seen.any() else np.pi
    hop_s = float(np.diff(run.time_s).mean()) if len(run.time_s) > 1 else np.nan
    poses, errors, swing = [pose], [float(errors_of(task.manoeuvre, start, pose))], None
    while not decided(task, errors):
        plan = controller.plan(pose, boom, swing)
        pose, swing = plan.poses[1], plan.swing_rad
        boom += swing
        poses.append(pose)
        errors.append(float(errors_of(task.manoeuvre, start, pose)))
    stances = np.arange(len(poses))
    table = pd.DataFrame(np.array(poses), columns=["x_m", "y_m", "heading_rad"])
    return table.assign(curve="pure", stance=stances, time_s=stances * hop_s)
