"""One experiment from the blocks of the configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hopdata.blas import one_blas_thread
from hopdata.errors import chosen
from hopdata.steering.experiments.policies import policies
from hopdata.steering.experiments.starts import floor_stream
from hopdata.steering.experiments.study import ExperimentTables, run_experiment
from hopdata.steering.experiments.tasks import EXPERIMENTS
from hopdata.steering.experiments.watched import Sight
from hopdata.steering.models.interface import FrameChangeMap
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.plant.true_map import TrueFrameChanges
from hopdata.steering.stages.options import camera_of, robot_of
from hopdata.synthesis.floor import draw_floor


@one_blas_thread()
def experiment_of(
    experiment: str,
    steering: Mapping[str, Any],
    motion_capture: Mapping[str, Any],
    *,
    models: Sequence[FrameChangeMap],
    truth: TrueFrameChanges,
    geometry: HopperGeometry,
    seed: int,
) -> ExperimentTables:
    """Run an experiment on the simulated robot.

    Parameters
    ----------
    experiment : str
        A name of `EXPERIMENTS`.
    steering, motion_capture : mapping
        These blocks of the configuration.
    models : sequence of FrameChangeMap
        What was learned, from one set of hops each; the starts take turns with them.
    truth : TrueFrameChanges
        For the policy that knows it.
    geometry : HopperGeometry
        From the calibration.
    seed : int
        The study's.
    """
    camera = camera_of(motion_capture)
    robot = robot_of(steering["robot"], camera)
    return run_experiment(
        experiment,
        steering["experiments"],
        policies(
            steering["control"],
            chosen("experiment", experiment, EXPERIMENTS)[0],
            models=models,
            truth=truth,
            swing_limit_rad=robot.swing_limit_rad,
        ),
        shown=steering["control"]["controller"],
        robot=robot,
        sight=Sight(camera, geometry, draw_floor(camera.floor, floor_stream(seed))),
        seed=seed,
    )
