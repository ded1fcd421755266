"""From the blocks of the configuration to the robot, the camera and the excitation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hopdata.errors import chosen
from hopdata.steering.excitation import (
    ControlGrid,
    Excitation,
    eulerian_excitation,
    random_excitation,
)
from hopdata.steering.models.options import PRINTED, RECOMMENDED, ProcessOptions
from hopdata.steering.plant.robot import SteeredHopper
from hopdata.synthesis.options import FloorOptions, GapOptions, Kicks, MarkerOptions, from_mapping
from hopdata.synthesis.simulate import MotionCapture

Options = Mapping[str, Any]

EXCITATIONS: dict[str, Callable[[ControlGrid, np.random.Generator], Excitation]] = {
    "eulerian": eulerian_excitation,
    "random": random_excitation,
}
KERNELS = {"recommended": RECOMMENDED, "printed": PRINTED}


def robot_of(options: Options, camera: MotionCapture) -> SteeredHopper:
    """Return the robot of the block ``steering.robot``, with the markers of the camera."""
    standard = SteeredHopper()
    return replace(
        standard,
        hopper=replace(standard.hopper, **options["hopper"]),
        preload_shares=tuple(options["preload_shares"]),
        kicks=from_mapping(Kicks, options["kicks"], "steering.robot.kicks"),
        markers=camera.markers,
        **{key: options[key] for key in ("swing_limit_rad", "release_height_m", "hop_limit_s")},
    )


def camera_of(options: Options) -> MotionCapture:
    """Return the camera of the block ``motion_capture``."""
    return MotionCapture(
        floor=from_mapping(FloorOptions, options["floor"], "motion_capture.floor"),
        gaps=from_mapping(GapOptions, options["gaps"], "motion_capture.gaps"),
        markers=from_mapping(MarkerOptions, options["markers"], "motion_capture.markers"),
        **{key: options[key] for key in ("rate_hz", "noise_m", "resolution_m")},
    )


def excitation_of(options: Options, rng: np.random.Generator) -> Excitation:
    """Draw the excitation of the block ``steering.excitation``."""
    grid = ControlGrid(**{key: options[key] for key in ("n_angles", "n_steps", "repeats")})
    return chosen("steering.excitation.method", options["method"], EXCITATIONS)(grid, rng)


def process_of(options: Options) -> ProcessOptions:
    """Return the set-up of the processes that the block ``steering.model`` names."""
    return chosen("steering.model.kernel", options["kernel"], KERNELS)
