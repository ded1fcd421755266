"""Sustained turns, turning radius, and falls by the size of the swings."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.steering import robot as plant
from hopdata.steering import turning

ROBOT = plant.SteeredHopper()
EVEN = replace(ROBOT.still(), preload_shares=(1.0, 1.0, 1.0))


def test_the_radius_is_the_distance_per_turned_radian():
    turn = turning.SustainedTurn(swing_rad=0.5, turn_rad=-0.1, step_m=0.05)
    assert turn.radius_m == pytest.approx(0.5)


def test_the_body_turns_against_the_boom_and_alike_to_both_sides():
    right = turning.sustained_turn(EVEN, 0.8, hops=16)
    left = turning.sustained_turn(EVEN, -0.8, hops=16)
    assert right.turn_rad < -0.08
    assert left.turn_rad == pytest.approx(-right.turn_rad, rel=1e-6)
    assert left.radius_m == pytest.approx(right.radius_m, rel=1e-6)


def test_the_radius_is_that_of_the_circle_of_the_stances():
    """The stances of a long turn lie on a circle, apart from a wobble of the steps."""
    turn = turning.sustained_turn(EVEN, np.pi / 4, hops=32)
    # With 45 degrees a hop the boom is back after eight hops, so every eighth stance is
    # on one circle. Four laps of the boom are measured.
    apex = plant.released(EVEN, np.zeros(3))
    poses = []
    for _ in range(turning.SETTLING_HOPS + 33):
        hop = plant.steer_hop(EVEN, apex, np.pi / 4, rng=np.random.default_rng(0))
        poses.append(hop.stance.pose)
        apex = hop.end
    eighth = np.array(poses[turning.SETTLING_HOPS :: 8])[:4]
    chord = np.hypot(*np.diff(eighth[:, :2], axis=0).T).mean()
    angle = abs(np.diff(eighth[:, 2]).mean())
    assert chord / (2 * np.sin(angle / 2)) == pytest.approx(turn.radius_m, rel=0.15)


def test_swings_are_cut_to_the_limit():
    turn = turning.sustained_turn(EVEN, 3.0, hops=2)
    assert turn.swing_rad == ROBOT.swing_limit_rad


def test_a_heavy_counterweight_tips_the_hopper_over_and_a_light_one_does_not():
    free = replace(ROBOT, swing_limit_rad=np.pi)
    heavy = replace(free, hopper=replace(ROBOT.hopper, counterweight_mass_kg=0.7))
    swing = np.radians(135)
    light_falls = turning.falls_by_swing(free, swing, seed=1, hops=15)
    assert light_falls.fell == 0
    assert light_falls.share == 0.0
    falls = turning.falls_by_swing(heavy, swing, seed=1, hops=15)
    assert falls.share > 0.5
    assert falls.hops == 15
    with pytest.raises(AnalysisError, match="tipped over"):
        turning.sustained_turn(heavy, swing, seed=1, hops=15)
