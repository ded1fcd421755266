"""Each transition of a drive, with its time, on a simulated clock."""

import itertools
from pathlib import Path

import pytest

from hopdata.messages import Message
from hopdata.steering.live import machine
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.machine import (
    REST_WITHIN_S,
    TRANSITIONS,
    DriveState,
    Event,
    Machine,
    Told,
)
from hopdata.steering.live.watch import WATCH_S, Watch

PAGE = Path(__file__).parents[3] / "docs" / "live.md"
FAULT = Message("steering.stream_lost", {"state": "lost", "reason": "hung up"})
OTHER = Message("steering.controller_failed", {"error": "no way out"})
KEY = Message("steering.operators_key")
# It rests by then, so these never happen.
IMPOSSIBLE = {
    (DriveState.ARMED, Event.ARM_IN_VAIN),
    (DriveState.RUNNING, Event.ARM_IN_VAIN),
}


class Clocked:
    """A watch on a simulated clock, with a boom that notes when it is told what."""

    def __init__(self, *, armed):
        self.now_s = 0.0
        self.told = []
        self.faults = {"outside": None}
        self.watch = Watch(
            self, Machine(is_armed=armed), lambda: self.faults, lambda: self.now_s
        )

    def swing(self, rad):
        self.told.append((self.now_s, rad))

    @property
    def state(self):
        return self.watch.machine.state

    def let_pass(self, seconds):
        """Let time pass; the watch looks every `WATCH_S`, halfway between events."""
        until_s = self.now_s + seconds
        look_s = (self.now_s // WATCH_S + 0.5) * WATCH_S
        while look_s <= until_s:
            if look_s > self.now_s:
                self.now_s = look_s
                self.watch.look()
            look_s += WATCH_S
        self.now_s = until_s


def brought_to(state):
    """Return a drive in a state."""
    drive = Clocked(armed=state not in (DriveState.WAITING, DriveState.STOPPED))
    drive.let_pass(1.0)
    if state is DriveState.RUNNING:
        drive.watch.stance()
    if state is DriveState.RESTING:
        drive.faults["outside"] = FAULT
        drive.let_pass(0.1)
        drive.faults["outside"] = None
        drive.let_pass(0.1)
    if state is DriveState.STOPPED:
        drive.watch.end(KEY)
    drive.told.clear()
    assert drive.state is state
    return drive


def make(drive, event):
    """Make an event happen."""
    if event is Event.ARM_IN_VAIN:
        drive.faults["outside"] = FAULT
        drive.let_pass(2 * WATCH_S)
        drive.told.clear()
        drive.watch.machine.steps.clear()
    begun_s = drive.now_s
    if event is Event.ARM:
        drive.watch.arm()
    elif event is Event.ARM_IN_VAIN:
        assert drive.watch.arm() is not None
    elif event is Event.STANCE:
        drive.watch.stance()
    elif event is Event.FAULT:
        drive.faults["outside"] = FAULT
        drive.let_pass(REST_WITHIN_S)
    else:
        drive.watch.end(KEY)
    return begun_s


@pytest.mark.parametrize(
    "row", TRANSITIONS, ids=lambda row: f"{row.source}-{row.event.name}"
)
def test_each_transition_is_made_and_the_boom_told_in_its_time(row):
    drive = brought_to(row.source)
    begun_s = make(drive, row.event)
    assert drive.state is row.target
    if row.told is Told.REST:
        assert drive.told
        assert {rad for _, rad in drive.told} == {0.0}
        assert drive.told[0][0] - begun_s <= REST_WITHIN_S
    else:
        assert drive.told == []  # a swing is sent by the loop, once it is planned
    assert (drive.watch.send((0.3,)) is None) == (
        row.target in (DriveState.ARMED, DriveState.RUNNING)
    )


def test_each_state_knows_each_event_once():
    rows = [(row.source, row.event) for row in TRANSITIONS]
    assert len(rows) == len(set(rows))
    assert set(rows) == set(itertools.product(DriveState, Event)) - IMPOSSIBLE


def test_only_the_operator_leads_out_of_rest_and_nothing_out_of_the_end():
    ways = {(row.event, row.target) for row in TRANSITIONS if row.source == "resting"}
    out = {way for way in ways if way[1] is not DriveState.RESTING}
    assert out == {(Event.ARM, DriveState.ARMED), (Event.END, DriveState.STOPPED)}
    ends = {row.target for row in TRANSITIONS if row.source is DriveState.STOPPED}
    assert ends == {DriveState.STOPPED}


def test_a_swing_is_due_only_where_the_drive_is_armed():
    due = {row.source for row in TRANSITIONS if row.told is Told.SWING}
    assert due == {DriveState.ARMED, DriveState.RUNNING}


def test_a_fault_that_is_gone_changes_nothing_but_that_it_may_be_armed():
    drive = Machine(is_armed=True)
    assert drive.report("outside", FAULT, 1.0).changes
    assert drive.report("outside", FAULT, 1.1) is None  # it lasts
    assert drive.arm(1.2).transition.event is Event.ARM_IN_VAIN
    assert drive.report("outside", None, 1.3) is None
    assert drive.state is DriveState.RESTING
    assert drive.cause == FAULT
    assert drive.arm(1.4).changes
    assert drive.cause is None


def test_of_two_faults_the_first_is_the_cause_and_both_must_be_gone():
    drive = Machine(is_armed=True)
    drive.report("one", FAULT, 1.0)
    drive.report("two", OTHER, 1.1)
    assert drive.cause == FAULT
    drive.report("one", None, 1.2)
    assert drive.arm(1.3).cause == OTHER
    drive.report("two", None, 1.4)
    assert drive.arm(1.5).changes
    assert [step.at_s for step in drive.steps] == [1.0, 1.1, 1.3, 1.5]


def test_a_fault_that_flickers_at_rest_is_noted_once():
    drive = Machine(is_armed=True)
    for k in range(1000):
        drive.report("markers", FAULT if k % 2 else None, float(k))
    assert len(drive.steps) == 1


def test_a_fault_that_is_over_at_once_does_not_forbid_to_arm():
    drive = Machine(is_armed=True)
    assert drive.fail("plan", OTHER, 1.0).told is Told.REST
    assert drive.arm(1.1).transition.target is DriveState.ARMED


def test_what_is_due_is_a_fault_from_then_on_until_it_has_come():
    drive = Machine(is_armed=True)
    drive.expect("frames", 1.0, lambda at_s: Message("x.y", {"at_s": at_s}))
    assert drive.tick(1.0) == []
    (step,) = drive.tick(1.01)
    assert step.cause.values == {"at_s": 1.01}
    assert drive.state is DriveState.RESTING
    drive.expect("frames", 2.0, lambda _: FAULT)
    drive.tick(1.5)
    assert not drive.lasting
    drive.tick(2.5)
    drive.met("frames")
    assert not drive.lasting
    assert drive.tick(9.0) == []


def test_a_fault_before_it_is_armed_is_told_and_nothing_else():
    drive = Machine()
    assert drive.report("frames", FAULT, 1.0).told is Told.NOTHING
    assert drive.state is DriveState.WAITING
    assert drive.arm(1.1).cause == FAULT
    assert drive.state is DriveState.WAITING


def test_the_page_has_the_table_of_the_code():
    rows = machine.table(Limits().command_s)
    lines = [f"| {' | '.join(row)} |" for row in rows]
    assert "\n".join(lines) in PAGE.read_text("utf-8")
