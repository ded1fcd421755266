"""What a synthetic recording's truth says of the scene it was made with."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.recordings.truth import Truth
from hopdata.scenes.hopper_control import HopperControl
from hopdata.scenes.hopper_parameters import HopperParameters

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class KnownScene:
    """What landed, and where the body markers were.

    Parameters
    ----------
    hopper, control
        What landed; the boom is that of the first hop.
    body_points_m : (B, 3) array
        Body markers, body frame, m.
    """

    hopper: HopperParameters
    control: HopperControl
    body_points_m: FloatArray

    def points_of(self, body: Sequence[str]) -> FloatArray:
        """Places of the body markers with these names (``body1`` ...), body frame, (k, 3), m."""
        return self.body_points_m[[int(name.removeprefix("body")) - 1 for name in body]]

    def by_boom(self, count: int) -> Iterator[tuple[HopperParameters, NDArray[np.int64]]]:
        """Yield the hopper and the numbers of its hops, for each place of a boom that swings."""
        hops, swing = np.arange(count), self.hopper.boom_swing_rad
        if swing == 0:
            yield self.hopper, hops
            return
        yield self.hopper, hops[::2]
        back = self.hopper.boom_angle_rad + swing
        yield replace(self.hopper, boom_angle_rad=back, boom_swing_rad=-swing), hops[1::2]


def known_scene(truth: Truth) -> KnownScene:
    """Read the scene from the parameters that a truth keeps."""
    parameters = json.loads(truth.parameters_json)
    simulation, camera = parameters["simulation"], parameters["motion_capture"]
    return KnownScene(
        HopperParameters(**simulation["hopper"]),
        HopperControl(**simulation.get("control", {})),
        np.array(camera["markers"]["body_m"]),
    )


def common_scene(truths: Iterable[Truth]) -> KnownScene:
    """Return the scene that all recordings of a study share.

    Raises
    ------
    AnalysisError
        If there is none, or they differ.
    """
    scenes = [known_scene(truth) for truth in truths]
    same = {(s.hopper, s.control, s.body_points_m.tobytes()) for s in scenes}
    if len(same) != 1:
        raise AnalysisError(f"truth: expected recordings of one scene, found {len(same)}")
    return scenes[0]
