"""Stances as the robot's motors and as the cameras notice them."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.steering import robot as plant
from hopdata.steering.loaded_stances import all_loaded_s, noticed_stances
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.trial import record_trial

ROBOT = plant.SteeredHopper()


@pytest.fixture(scope="module")
def geometry():
    swings = [0.9, 0.9, 0.9, -0.9, -0.9] * 4
    return calibrate(record_trial(ROBOT, swings, seed=1).recording)


@pytest.fixture(scope="module")
def hop():
    apex = plant.released(ROBOT, np.zeros(3))
    return plant.steer_hop(ROBOT, apex, 0.3, rng=np.random.default_rng(1)).hop


def test_all_legs_are_loaded_from_the_last_touchdown_on(hop):
    assert all_loaded_s(hop) == hop.event_time[2]
    two = replace(hop, event_leg=hop.event_leg[:2], event_down=hop.event_down[:2])
    assert np.isnan(all_loaded_s(two))


def test_a_leg_that_leaves_too_early_is_waited_for(hop):
    """Legs 1 and 2 land, 1 leaves, 3 lands, 1 lands again: only then all stand."""
    bouncing = replace(
        hop,
        event_time=np.array([0.1, 0.2, 0.3, 0.4, 0.5]),
        event_leg=np.array([0, 1, 0, 2, 0]),
        event_down=np.array([True, True, False, True, True]),
    )
    assert all_loaded_s(bouncing) == 0.5


def test_both_ways_notice_every_stance(geometry):
    noticed = noticed_stances(ROBOT, geometry, hops=12, seed=2)
    table = noticed.stances.iloc[:-1]
    assert noticed.n_false == 0
    assert len(table) == 11
    # In the order of a stance: all are loaded, it is lowest, the cameras tell.
    assert (table["loaded_s"] < table["lowest_s"]).all()
    assert (table["lowest_s"] < table["recognised_s"]).all()
    assert (table["found_s"] - table["lowest_s"]).abs().max() < 0.01
    assert (table["recognised_s"] - table["lowest_s"]).max() < 0.05


def test_stances_that_are_too_high_are_not_found(geometry):
    """The threshold decides: below all stances, the cameras find none."""
    low = replace(geometry, stance_below_m=geometry.stance_below_m - 0.5)
    noticed = noticed_stances(ROBOT, low, hops=4, seed=2)
    assert noticed.stances["found_s"].isna().all()
    assert noticed.stances["loaded_s"].notna().all()
