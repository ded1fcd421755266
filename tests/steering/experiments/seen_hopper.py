"""A calibrated hopper to steer in tests, without running a calibration."""

import numpy as np

from hopdata.steering.control.interface import Plan
from hopdata.steering.experiments.run import Sight
from hopdata.steering.experiments.tasks import Start
from hopdata.steering.observation.geometry import BoomCircle, HopperGeometry
from hopdata.steering.robot import SteeredHopper
from hopdata.synthesis.camera import MotionCapture, draw_floor
from hopdata.synthesis.trial import FloorOptions, GapOptions

ROBOT = SteeredHopper()
FLAT = FloorOptions(bowl_depth_m=0.0, waves=0)


def sight(**options):
    """Return how a hopper with known markers is seen; by default over a flat floor."""
    camera = MotionCapture(floor=FLAT, **options)
    body = np.array(camera.markers.body_m)
    boom = np.array([ROBOT.hopper.boom_offset_m, 0.0, ROBOT.hopper.boom_height_m])
    geometry = HopperGeometry(
        body_names=("body1", "body2", "body3"),
        body_m=body - body.mean(axis=0),
        noise_m=max(camera.noise_m, 1e-5),
        stance_below_m=0.34,
        flight_above_m=0.42,
        boom_name="boom",
        circle=BoomCircle(
            boom - body.mean(axis=0),
            np.array([0.0, 0.0, 1.0]),
            ROBOT.hopper.boom_radius_m,
        ),
    )
    floor = draw_floor(FLAT, np.random.default_rng(np.random.SeedSequence(0)))
    return Sight(camera, geometry, floor)


def gaps(rate_per_min, mean_s=0.1):
    return GapOptions(rate_per_min=rate_per_min, mean_s=mean_s)


def start(pose=(1.0, 0.0, np.pi), seed=5):
    return Start(0, np.array(pose, dtype=float), np.random.SeedSequence(seed))


class Swings:
    """A controller that makes the given swings, and records what it was told."""

    def __init__(self, *swings):
        self.swings, self.told = swings, []

    def plan(self, pose, boom_angle_rad, previous_swing_rad=None):
        self.told.append((np.array(pose), boom_angle_rad, previous_swing_rad))
        swing = self.swings[(len(self.told) - 1) % len(self.swings)]
        ahead = np.array(pose) + np.array([0.05, 0.0, 0.0])
        return Plan(np.array([swing]), np.stack([pose, ahead]), 0.0)
