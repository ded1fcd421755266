"""What the checks say of frames that are wrong, and of frames that are not."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from test_drive import geometry as simple_geometry

from hopdata.steering.live.buffer import Frame
from hopdata.steering.live.checks import IN_A_ROW, FrameChecks
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.simulated import LiveHopper
from hopdata.steering.observation.tracking import HopperTracker
from hopdata.steering.robot import SteeredHopper

NAMES = ("body1", "body2", "body3", "boom")
PAIRS = list(itertools.combinations(range(4), 2))
LIMITS = Limits(fence_m=100.0)
RATE_HZ = 100.0


def hopper(n, *, noise_m=0.0006, pose=(1.0, 0.5, 0.3), seed=1):
    """Return the times and markers of a hopper that hops about."""
    source = LiveHopper(
        SteeredHopper(), lambda: 0.3, pose=pose, noise_m=noise_m, seed=seed
    )
    return list(itertools.islice(source, n))


@cache
def flight():
    """Return the frames of a second and a half, which are simulated by the first test."""
    return hopper(160)


def found(frames, *, geometry=None, rate_hz=RATE_HZ, limits=LIMITS, step=1):
    """Return what the checks find in frames: the cause of each source, if any."""
    geometry = geometry or simple_geometry()
    checks = FrameChecks(limits, geometry, NAMES, rate_hz)
    tracker = HopperTracker(geometry, NAMES)
    causes, overs, usable = {}, [], []
    for k, (time_s, markers) in enumerate(frames):
        frame = Frame(0, step * k, time_s, time_s, time_s, np.array(markers))
        seen = tracker.feed(time_s, frame.markers)
        findings = checks.feed(frame, seen)
        usable.append(findings.is_usable)
        if findings.over is not None:
            overs.append(findings.over)
        for source, cause in findings.lasting.items():
            if cause is not None:
                causes.setdefault(source, (k, cause))
    return causes, overs, usable


def wrong_from(at, change, frames=None):
    """Return frames that are changed from one of them on."""
    return [
        (time_s, change(markers) if k >= at else markers)
        for k, (time_s, markers) in enumerate(frames or flight())
    ]


def test_frames_of_a_hopper_that_hops_are_right():
    assert found(flight()) == ({}, [], [True] * len(flight()))


@pytest.mark.parametrize("pair", PAIRS)
def test_any_two_markers_that_are_exchanged_are_named_at_the_third_frame(pair):
    order = np.arange(4)
    order[list(pair)] = pair[::-1]
    causes, overs, usable = found(wrong_from(100, lambda m: m[order]))
    at, cause = causes["fit"]
    assert at == 100 + IN_A_ROW - 1
    assert cause.code == "steering.markers_exchanged"
    assert cause.values == {"first": NAMES[pair[0]], "second": NAMES[pair[1]]}
    assert overs == []
    assert not any(usable[100:])  # no pose is taken from the first two either


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_markers_that_are_mirrored_are_named(axis):
    signs = np.ones(3)
    signs[axis] = -1.0
    causes, overs, usable = found(wrong_from(100, lambda m: m * signs))
    assert causes["fit"][0] == 100 + IN_A_ROW - 1
    assert causes["fit"][1].code == "steering.markers_mirrored"
    assert overs == []
    assert not any(usable[100:])


def test_which_axis_is_mirrored_is_told_by_where_the_robot_was():
    for axis, sign in (("x", [-1, 1, 1]), ("y", [1, -1, 1]), ("z", [1, 1, -1])):
        causes, _, _ = found(wrong_from(100, lambda m, sign=sign: m * np.array(sign)))
        assert causes["fit"][1].values == {"axis": axis}


@pytest.mark.parametrize(
    ("factor", "unit"), [(1000.0, "mm, not m"), (0.001, "m, not mm")]
)
@pytest.mark.parametrize("at", [0, 100])
def test_markers_in_other_units_are_named(factor, unit, at):
    causes, overs, _ = found(wrong_from(at, lambda m: m * factor))
    assert causes["fit"][0] == at + IN_A_ROW - 1
    assert causes["fit"][1].code == "steering.markers_scaled"
    assert causes["fit"][1].values["unit"] == unit
    assert overs == []


@pytest.mark.parametrize("n_wrong", [1, 2])
def test_fewer_wrong_frames_are_left_out_and_are_no_fault(n_wrong):
    frames = wrong_from(100, lambda m: m[[3, 1, 2, 0]])
    frames[100 + n_wrong :] = flight()[100 + n_wrong :]
    causes, overs, usable = found(frames)
    assert (causes, overs) == ({}, [])
    assert usable.count(False) == n_wrong


def test_markers_that_fit_in_no_known_way_are_told_with_how_far_they_are_off():
    def bent(markers):
        markers = markers.copy()
        markers[0] += [0.05, 0.0, 0.0]
        return markers

    causes, _, _ = found(wrong_from(100, bent))
    cause = causes["fit"][1]
    assert cause.code == "steering.markers_misfit"
    assert cause.values["residual_mm"] > cause.values["limit_mm"] == pytest.approx(3.0)


def test_a_robot_that_tips_over_is_not_taken_for_mixed_up_markers():
    def tilted(markers):
        turn = np.array([[1, 0, 0], [0, 0.5, -np.sqrt(0.75)], [0, np.sqrt(0.75), 0.5]])
        middle = markers.mean(axis=0)
        return middle + (markers - middle) @ turn.T

    causes, overs, _ = found(wrong_from(100, tilted))
    assert causes == {}
    assert overs[0].code == "steering.tips_over"


# Coordinates that freeze.


def frozen_from(at, frames, n=20):
    return [*frames[:at], *((t, frames[at][1]) for t, _ in frames[at : at + n])]


@pytest.mark.parametrize("at", range(60, 130, 7))
@pytest.mark.parametrize("noise_m", [0.0, 0.0006])
def test_coordinates_that_freeze_while_frames_come_are_named(at, noise_m):
    """Wherever in the hop they freeze, and though the simulation has no noise."""
    frames = frozen_from(at, hopper(160, noise_m=noise_m))
    exact = replace(simple_geometry(), noise_m=noise_m or 1e-9)
    if noise_m == 0.0:  # a tolerance for the fit, not the noise of the coordinates
        exact = replace(exact, noise_m=5e-7)
    causes, _, _ = found(frames, geometry=exact)
    k, cause = causes["frozen"]
    assert k == at + IN_A_ROW
    assert cause.code == "steering.markers_frozen"
    assert cause.values["frames"] == IN_A_ROW


def test_a_robot_that_stands_in_a_simulation_without_noise_is_not_frozen():
    time_s, markers = hopper(1, noise_m=0.0)[0]
    frames = [(time_s + k / RATE_HZ, markers) for k in range(100)]
    quiet = replace(simple_geometry(), noise_m=5e-7)
    assert "frozen" not in found(frames, geometry=quiet)[0]
    noisy = found(frames)[0]["frozen"]  # a real one that stands has noise
    assert noisy[0] == IN_A_ROW


def test_a_robot_that_stands_before_real_cameras_is_not_frozen():
    rng = np.random.default_rng(np.random.SeedSequence(5))
    _, markers = hopper(1)[0]
    frames = [
        (k / RATE_HZ, np.float32(1e3 * markers + rng.normal(0, 0.1, (4, 3))) / 1e3)
        for k in range(1000)
    ]
    assert found(frames)[0] == {}


def test_two_frames_that_are_the_same_are_no_fault():
    frames = [one for one in flight() for _ in range(IN_A_ROW)]
    frames = [(k / RATE_HZ, markers) for k, (_, markers) in enumerate(frames)]
    assert "frozen" not in found(frames)[0]


# Frames of another rate.


@pytest.mark.parametrize(
    ("rate_hz", "is_told"), [(100, 0), (103, 0), (60, 1), (500, 1)]
)
def test_frames_of_another_rate_are_named(rate_hz, is_told):
    frames = [(k / rate_hz, markers) for k, (_, markers) in enumerate(flight())]
    causes, _, _ = found(frames)
    assert ("rate" in causes) == bool(is_told)
    if is_told:
        cause = causes["rate"][1]
        assert cause.values["found_hz"] == pytest.approx(rate_hz)
        assert "hopdata drive --rate" in str(cause)


def test_frames_that_are_missing_are_not_another_rate():
    assert "rate" not in found(flight()[::3], step=3)[0]
