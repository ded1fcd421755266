"""An excitation through the live loop on a simulated clock, and what is learned from it."""

from dataclasses import replace

import numpy as np
import pytest
from test_drive import geometry

from hopdata.errors import ConfigError
from hopdata.steering.control.objectives import Horizon, ToPoint
from hopdata.steering.control.planner import planner
from hopdata.steering.excitation import excitation
from hopdata.steering.frame_changes import HOPPER, hopper_axes
from hopdata.steering.goals import ARRIVED_M
from hopdata.steering.live.clocked import ClockedDrive
from hopdata.steering.live.excited import Excitation, excited_strides
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import checks_of, observers_of
from hopdata.steering.live.simulated import LiveHopper, SimulatedBoom
from hopdata.steering.models.training import trained_process
from hopdata.steering.robot import SteeredHopper
from hopdata.steering.strides import FAR_INPUT, NO_POSE

LIMITS = Limits(fence_m=9.0)
GEOMETRY = geometry()
N_STRIDES = 60
SWINGS = excitation(hopper_axes(LIMITS.swing_rad), N_STRIDES, 1)


def drive_of(controller, *, limits=LIMITS, seed=1):
    boom = SimulatedBoom()
    hopper = LiveHopper(SteeredHopper(), boom.newest, pose=(1.0, 0.0, 0.0), seed=seed)
    drive = ClockedDrive(
        hopper,
        observers_of(GEOMETRY, 100.0),
        controller,
        boom,
        limits=limits,
        checks=checks_of(GEOMETRY, 100.0, limits),
    )
    return drive, hopper


@pytest.fixture(scope="module")
def excited():
    controller = Excitation(HOPPER, SWINGS, LIMITS)
    drive, hopper = drive_of(controller)
    drive.run(100.0, ended=lambda: controller.is_over)
    return drive.loop.decisions(), hopper


def test_the_strides_are_those_that_the_hopper_made(excited):
    decisions, hopper = excited
    strides = excited_strides(decisions, HOPPER, N_STRIDES, LIMITS, recording="one")
    assert len(strides) == len(strides.used()) == N_STRIDES
    stances = [hop.stance for hop in hopper.hops]
    true_s = np.array([one.time_s for one in stances])
    first = np.abs(true_s[:, None] - strides.time_s).argmin(axis=0)
    np.testing.assert_array_equal(np.diff(first), 1)
    np.testing.assert_allclose(strides.time_s, true_s[first], atol=0.02)
    swings = np.array([hopper.hops[k + 1].swing_rad for k in first])
    np.testing.assert_array_equal(swings, SWINGS[:, 0])
    np.testing.assert_allclose(strides.inputs, SWINGS, atol=0.03)
    assert np.abs(strides.inputs).max() <= LIMITS.swing_rad
    for row, k in enumerate(first):
        moved = stances[k + 1].pose - stances[k].pose
        distance = np.hypot(*strides.change[row, :2])
        assert distance == pytest.approx(np.hypot(*moved[:2]), abs=0.005)
        assert strides.change[row, 2] == pytest.approx(moved[2], abs=0.03)
    # Of the states, that at the second stance is the one at the first, and the swing.
    expected = HOPPER.next_state(strides.state, strides.inputs)
    assert np.abs(np.sin((strides.next_state - expected) / 2)).max() < 0.02


def test_a_model_learned_from_them_takes_the_hopper_to_a_point(excited):
    strides = excited_strides(excited[0], HOPPER, N_STRIDES, LIMITS)
    process = trained_process(strides)
    horizon = Horizon(hops=2, swing_limit_rad=LIMITS.swing_rad)
    drive, hopper = drive_of(planner(process, ToPoint(), horizon=horizon), seed=7)
    drive.run(30.0)
    left = [np.hypot(*hop.stance.pose[:2]) for hop in hopper.hops]
    assert left[0] > 0.9
    assert min(left) < ARRIVED_M
    at_rest, _ = drive_of(Excitation(HOPPER, np.zeros((60, 1)), LIMITS), seed=7)
    at_rest.run(30.0)
    poses = [one.pose for one in at_rest.loop.decisions()]
    assert min(np.hypot(*pose[:2]) for pose in poses) > 2 * ARRIVED_M


def test_after_a_rest_it_goes_on_where_it_stopped():
    controller = Excitation(HOPPER, SWINGS[:8], LIMITS)
    drive, _ = drive_of(controller)
    drive.run(3.0)
    drive.cameras = lambda _: None
    drive.run(3.5)
    drive.cameras = None
    drive.run(6.0)
    assert drive.loop.state == "resting"
    assert not controller.is_over
    drive.loop.arm()
    drive.run(20.0, ended=lambda: controller.is_over)
    assert controller.is_over
    sent = [one.command for one in drive.loop.decisions() if one.outcome == "planned"]
    assert sent == [*map(tuple, SWINGS[:8].tolist()), (0.0,)]
    strides = excited_strides(drive.loop.decisions(), HOPPER, 8, LIMITS)
    assert 6 <= len(strides) < 8  # one, or two, were made while nobody saw them
    for swing in strides.inputs:
        assert np.abs(SWINGS[:8] - swing).min() < 0.03


def test_beyond_the_fence_the_rest_of_it_is_missing():
    limits = replace(LIMITS, fence_m=1.02)
    controller = Excitation(HOPPER, SWINGS, limits)
    drive, _ = drive_of(controller, limits=limits)
    drive.run(60.0, ended=lambda: drive.loop.state == "stopped")
    assert not controller.is_over
    made = excited_strides(drive.loop.decisions(), HOPPER, N_STRIDES, limits)
    assert len(made) < N_STRIDES


def test_a_stride_that_was_not_seen_well_is_not_used(excited):
    decisions = list(excited[0])
    decisions[5] = replace(decisions[5], pose_age_s=1.0)
    decisions[20] = replace(decisions[20], previous=(2.0,))
    made = excited_strides(decisions, HOPPER, N_STRIDES, LIMITS)
    assert made.excluded() == {FAR_INPUT: 1, NO_POSE: 2}
    decisions[40] = replace(decisions[40], outcome="held")
    assert len(excited_strides(decisions, HOPPER, N_STRIDES, LIMITS)) == N_STRIDES - 1
    assert len(excited_strides(decisions, HOPPER, 10, LIMITS)) == 10
    assert len(excited_strides([], HOPPER, 10, LIMITS)) == 0


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        (np.zeros((0, 1)), "expected strides with 1 of swing each"),
        (np.zeros((5, 2)), "expected strides with 1 of swing each"),
        ("abc", "expected strides with 1 of swing each"),
        ([[0.1], [1.2]], "excitation, stride 2: expected swing_rad from -1.178 to 1.1"),
        ([[0.1], [np.nan]], "excitation, stride 2: .* found nan"),
        ([[-np.inf]], "excitation, stride 1: .* found -inf"),
    ],
)
def test_a_wrong_sequence_is_refused(inputs, message):
    with pytest.raises(ConfigError, match=message):
        Excitation(HOPPER, inputs, LIMITS)
    assert Excitation(HOPPER, SWINGS, LIMITS).inputs.shape == (N_STRIDES, 1)
