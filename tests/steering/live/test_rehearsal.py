"""Acts of a rehearsal, and what the loop tells of markers and swings, on a simulated clock."""

import itertools
import os
import re
from dataclasses import replace

import numpy as np
import pytest

from hopdata.messages import Message
from hopdata.steering.live import rehearsal
from hopdata.steering.live.actuator import NoBoom
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import LEAST_SWING_RAD
from hopdata.steering.live.machine import (
    DriveState,
    Event,
    Machine,
    Step,
    Told,
    Transition,
)
from hopdata.steering.live.rehearsal import SimulatedDrive
from hopdata.steering.live.rehearsed_acts import Act, Performed, acts
from hopdata.steering.live.watch import Watch

NAMES = ("body1", "body2", "body3", "boom")
LIMITS = Limits()
ACTS = {act.name: act for act in acts(NAMES, LIMITS)}
SIMULATED = [name for name, act in ACTS.items() if act.in_real_time is None]
# The loop itself sends these rests, as it observes and decides.
BY_LOOKS = {
    "the cable of the cameras is pulled",
    "a plan is late",
    "the boom acknowledges no heartbeats",
}


@pytest.fixture(scope="module")
def geometry():
    return rehearsal.simulated_geometry()


@pytest.mark.parametrize("name", SIMULATED)
def test_each_act_brings_the_boom_to_rest_until_it_is_armed(name, geometry):
    done = rehearsal._on_simulated_clock(ACTS[name], geometry, LIMITS)
    assert done.is_right, done


@pytest.mark.parametrize("name", sorted(BY_LOOKS))
def test_an_act_that_shows_in_no_frame_needs_the_looks(name, geometry, monkeypatch):
    monkeypatch.setattr(Watch, "look", lambda _: None)
    assert not rehearsal._on_simulated_clock(ACTS[name], geometry, LIMITS).is_right


@pytest.mark.parametrize(
    "name",
    ["the controller fails", "the markers are mirrored", "the boom is dead"],
)
def test_an_act_needs_the_machine(name, geometry, monkeypatch):
    """A machine that never leaves running is found out."""

    def stays(machine, event, at_s, cause, **_):
        told = Told.SWING if event is Event.STANCE else Told.NOTHING
        machine.state = DriveState.RUNNING
        return Step(
            at_s, Transition(DriveState.RUNNING, event, DriveState.RUNNING, told), cause
        )

    monkeypatch.setattr(Machine, "_make", stays)
    assert not rehearsal._on_simulated_clock(ACTS[name], geometry, LIMITS).is_right


def test_a_drive_that_goes_on_by_itself_is_found_out(geometry, monkeypatch):
    """As the loop did before it had a state: it went on once the cause was gone."""
    report = Machine.report

    def report_and_resume(machine, source, cause, at_s):
        step = report(machine, source, cause, at_s)
        if machine.state is DriveState.RESTING and not machine.lasting:
            machine.state = DriveState.RUNNING
        return step

    monkeypatch.setattr(Machine, "report", report_and_resume)
    act = ACTS["marker body1 is covered"]
    done = rehearsal._on_simulated_clock(act, geometry, LIMITS)
    assert done.resumed
    assert not done.is_right


def test_an_act_in_real_time_needs_the_end(geometry, monkeypatch):
    monkeypatch.setattr(rehearsal, "REAL_S", 2.0)
    monkeypatch.setattr(Watch, "end", lambda *_: None)
    assert not rehearsal._in_real_time(ACTS["SIGTERM comes"], geometry).is_right


def test_what_brings_nothing_to_rest_is_not_right(geometry):
    nothing = Act("nothing", "", "no frame for", "steering.no_frame", 1.0)
    done = rehearsal._on_simulated_clock(nothing, geometry, LIMITS)
    assert (done.cause, done.is_right) == (None, False)
    act = ACTS["the hopper tips over"]
    cause = Message("steering.tips_over", {"tilt_deg": 60.0})
    other = Message("steering.operators_key")
    assert Performed(act, cause, act.within_s).is_right
    assert not Performed(act, other, act.within_s).is_right
    assert not Performed(act, cause, act.within_s + 0.01).is_right
    assert not Performed(act, cause, act.within_s, moved=True).is_right
    assert not Performed(act, cause, act.within_s, resumed=True).is_right
    assert not Performed(act, cause, act.within_s, obeyed=False).is_right


def test_a_drive_that_is_at_rest_before_the_act_is_not_right(geometry):
    narrow = replace(LIMITS, fence_m=0.5)
    done = rehearsal._on_simulated_clock(ACTS["the hopper tips over"], geometry, narrow)
    assert not done.is_right
    assert done.cause.code == "steering.before_the_act"


# Markers that are needed and not seen.


def hidden(geometry, *indices, spans=((3.0, np.inf),)):
    """Return a drive of 8 s whose cameras do not see some markers in some spans, s."""
    drive = SimulatedDrive(geometry, LIMITS)

    def shown(markers):
        if any(begin <= drive.now_s < end for begin, end in spans):
            markers[list(indices)] = np.nan
        return markers

    drive.cameras = shown
    drive.run(8.0)
    return drive


def test_all_markers_that_are_hidden_are_named(geometry):
    drive = hidden(geometry, 0, 1, 2, 3)
    (rest,) = drive.loop.watch.rests
    assert all(f"marker '{name}' is not seen" in str(rest.cause) for name in NAMES)
    assert 3.1 <= rest.seen_s < 3.15
    assert not any(rad for at_s, rad in drive.swings if at_s > rest.sent_s)


def test_no_swing_is_sent_while_a_marker_that_is_needed_is_hidden(geometry):
    drive = hidden(geometry, 1)
    last = drive.loop.decisions()[-1]
    assert last.told_s > 3.2  # with two markers, stances are still seen for a while
    assert (last.outcome, last.command_rad) == ("held", 0.0)
    assert str(last.reason).startswith("marker 'body2' is not seen (for ")
    assert not any(rad for at_s, rad in drive.swings if at_s > 3.2)


def test_the_drive_does_not_go_on_when_they_are_seen_again_but_when_it_is_armed(
    geometry,
):
    drive = hidden(geometry, 1, spans=((3.0, 3.5),))
    (rest,) = drive.loop.watch.rests
    assert "marker 'body2' is not seen" in str(rest.cause)
    assert "body1" not in str(rest.cause)
    assert not drive.has_swung_since(3.2)
    assert drive.loop.arm() is None
    drive.run(10.0)
    assert drive.has_swung_since(8.0)


def test_markers_that_are_hidden_shorter_than_a_pose_may_be_old_are_no_rest(geometry):
    spans = [(at_s, at_s + 0.08) for at_s in np.arange(1.0, 8.0, 0.2)]
    assert not hidden(geometry, 3, spans=spans).loop.watch.rests
    assert not hidden(geometry, 0, spans=spans).loop.watch.rests


def test_single_markers_hidden_at_random_are_no_rest(geometry):
    drive = SimulatedDrive(geometry, LIMITS)
    chance = np.random.default_rng(np.random.SeedSequence(7))

    def shown(markers):
        markers[chance.random(len(markers)) < 0.01] = np.nan
        return markers

    drive.cameras = shown
    drive.run(20.0)
    assert not drive.loop.watch.rests
    assert sum(made.outcome == "planned" for made in drive.loop.decisions()) > 25


def test_a_fourth_body_marker_is_not_needed(geometry):
    middle = geometry.body_m.mean(axis=0)
    four = replace(
        geometry,
        body_names=(*geometry.body_names, "body4"),
        body_m=np.vstack([geometry.body_m, middle]),
    )

    def seen_with(lost):
        drive = SimulatedDrive(four, LIMITS)

        def shown(markers):
            whole = np.vstack([markers[:3], markers[:3].mean(axis=0), markers[3:]])
            if drive.now_s > 3.0:
                whole[lost] = np.nan
            return whole

        drive.cameras = shown
        drive.run(5.0)
        return drive.loop.watch.rests

    assert not seen_with([0])
    assert "marker 'body1' is not seen" in str(seen_with([0, 1])[0].cause)


# Swings sent and swings measured.


@pytest.mark.parametrize("seed", [1, 2, 3] if "ALL" in os.environ else [1])
def test_a_boom_that_follows_is_never_told(seed, geometry):
    drive = SimulatedDrive(geometry, replace(LIMITS, fence_m=100.0), seed=seed)
    chance = np.random.default_rng(np.random.SeedSequence(seed))
    drive.plan = lambda _: chance.choice([0.0, chance.uniform(-1.1, 1.1)], p=[0.2, 0.8])
    drive.run(np.inf, ended=lambda: len(drive.hopper.hops) > 100)
    assert not drive.loop.watch.rests
    made = drive.loop.decisions()
    off_rad = [
        after.swung_rad - one.command_rad for one, after in itertools.pairwise(made)
    ]
    assert len(off_rad) >= 98
    assert np.nanmax(np.abs(off_rad)) < LEAST_SWING_RAD / 2  # of noise alone


def wrong_after(boom, geometry, limits=LIMITS, *, plan=None, until_s=12.0):
    """Return the drive's rests, and how many hops began with the boom as it is then."""
    drive = SimulatedDrive(geometry, limits)
    if plan is not None:
        drive.plan = plan
    drive.run(4.0)
    drive.boom = boom
    hops = len(drive.hopper.hops)
    drive.run(until_s, ended=lambda: bool(drive.loop.watch.rests))
    return drive, len(drive.hopper.hops) - hops


@pytest.mark.parametrize(
    ("boom", "words"),
    [
        (lambda rad: -rad, r"it turns the other way \("),
        (lambda _: 0.0, r"it does not move \("),
        (lambda rad: 0.5 * rad, r"it moves by (4|5)\d % of its swings \("),
        (lambda rad: 2.0 * rad, r"it moves by (19|20)\d % of its swings \("),
    ],
)
def test_a_boom_that_does_not_follow_is_told_within_two_hops_and_it_is_over(
    boom, words, geometry
):
    drive, hops = wrong_after(boom, geometry)
    (rest,) = drive.loop.watch.rests
    assert re.match(f"the boom does not follow: {words}", str(rest.cause))
    assert hops <= 3  # two, and the one of which a part has passed
    drive.run(drive.now_s + 2.0)
    assert not any(rad for at_s, rad in drive.swings if at_s > rest.sent_s)  # for good
    assert drive.loop._drive_is_over.is_set()


@pytest.mark.parametrize("gain", [0.8, 1.2])
def test_a_gain_that_is_a_fifth_off_is_let_pass(gain, geometry):
    drive, hops = wrong_after(lambda rad: gain * rad, geometry)
    assert not drive.loop.watch.rests
    assert hops > 10


def test_a_single_swing_that_comes_too_late_is_let_pass(geometry):
    late = iter([0.0])
    drive, _ = wrong_after(lambda rad: next(late, rad), geometry)
    assert not drive.loop.watch.rests


def test_wrong_swings_that_are_not_in_a_row_are_let_pass(geometry):
    turns = iter(range(100))
    drive, hops = wrong_after(lambda rad: rad if next(turns) % 2 else 0.0, geometry)
    assert not drive.loop.watch.rests
    assert hops > 10


def test_how_many_wrong_swings_end_the_drive_is_a_limit(geometry):
    drive, hops = wrong_after(lambda _: 0.0, geometry, replace(LIMITS, wrong_swings=5))
    assert 5 <= hops <= 6
    assert str(drive.loop.watch.rests[0].cause).count(" sent and ") == 5
    drive, hops = wrong_after(lambda _: 0.0, geometry, replace(LIMITS, wrong_swings=1))
    assert hops <= 2


def test_a_boom_that_moves_though_it_is_told_to_stay_is_told(geometry):
    drive, _ = wrong_after(lambda rad: rad + 0.2, geometry, plan=lambda _: 0.0)
    cause = str(drive.loop.watch.rests[0].cause)
    assert "it moves though it was told to stay (" in cause
    drive, _ = wrong_after(lambda rad: rad, geometry, plan=lambda _: 0.0)
    assert not drive.loop.watch.rests


def test_where_nothing_is_sent_nothing_has_to_follow(geometry):
    drive = SimulatedDrive(geometry, LIMITS)
    dry = SimulatedDrive(geometry, LIMITS)
    dry.loop = type(dry.loop)(
        dry._buffer, drive.loop._observers, drive.loop._controller, NoBoom(), limits=LIMITS,
        clock=lambda: dry.now_s, machine=Machine(is_armed=True),
    )  # fmt: skip
    dry.run(8.0)
    assert not dry.loop.watch.rests
    assert sum(made.outcome == "planned" for made in dry.loop.decisions()) > 8
    assert not dry.swings


def test_a_swing_that_follows_the_rest_is_not_right(geometry, monkeypatch):
    run = SimulatedDrive.run

    def run_and_swing(drive, *arguments, **options):
        run(drive, *arguments, **options)
        if drive.loop.watch.rests:
            drive.swings.append((drive.now_s, 0.3))

    monkeypatch.setattr(SimulatedDrive, "run", run_and_swing)
    done = rehearsal._on_simulated_clock(ACTS["the hopper tips over"], geometry, LIMITS)
    assert done.cause.code == "steering.tips_over"
    assert done.moved
    assert not done.is_right
