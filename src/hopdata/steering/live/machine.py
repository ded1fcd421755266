"""The state machine of a drive: what each event does in each state, as a table.

It has neither threads nor a clock of its own: each event comes with its time. So a
drive in real time, one on a simulated clock, and a rehearsal use the same machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias

from hopdata.messages import Message


class DriveState(StrEnum):
    """State of a drive.

    Waiting: the operator has not armed it yet. Armed: the first swing is sent at the
    next stance. Running: a swing is sent at each stance. Resting: a fault came, and
    nothing but rest is sent until the operator arms it again. Stopped: it is over.
    """

    WAITING = "waiting"
    ARMED = "armed"
    RUNNING = "running"
    RESTING = "resting"
    STOPPED = "stopped"


class Event(StrEnum):
    """What may happen to a drive.

    It is ended by the operator's key, a signal, the end of its time, or a fault that
    ends it, such as a robot that leaves the arena.
    """

    ARM = "the operator arms it"
    ARM_IN_VAIN = "the operator arms it while a fault lasts"
    STANCE = "a stance is seen"
    FAULT = "a fault begins"
    END = "the drive is ended"


class Told(StrEnum):
    """What the actuator is told."""

    NOTHING = "nothing"
    SWING = "the swing planned"
    REST = "rest: a swing of 0"


#: Longest time from when a fault can be known until the actuator is told to rest.
#: Unit: s. Origin: chosen: a twelfth of a hop.
REST_WITHIN_S = 0.05


@dataclass(frozen=True)
class Transition:
    """A row of the table: what an event does in a state."""

    source: DriveState
    event: Event
    target: DriveState
    told: Told


def _stays(state: DriveState, told: Told, *events: Event) -> tuple[Transition, ...]:
    return tuple(Transition(state, event, state, told) for event in events)


TRANSITIONS = (
    Transition(DriveState.WAITING, Event.ARM, DriveState.ARMED, Told.NOTHING),
    *_stays(
        DriveState.WAITING, Told.NOTHING, Event.ARM_IN_VAIN, Event.STANCE, Event.FAULT
    ),
    Transition(DriveState.WAITING, Event.END, DriveState.STOPPED, Told.REST),
    *_stays(DriveState.ARMED, Told.NOTHING, Event.ARM),
    Transition(DriveState.ARMED, Event.STANCE, DriveState.RUNNING, Told.SWING),
    Transition(DriveState.ARMED, Event.FAULT, DriveState.RESTING, Told.REST),
    Transition(DriveState.ARMED, Event.END, DriveState.STOPPED, Told.REST),
    *_stays(DriveState.RUNNING, Told.NOTHING, Event.ARM),
    *_stays(DriveState.RUNNING, Told.SWING, Event.STANCE),
    Transition(DriveState.RUNNING, Event.FAULT, DriveState.RESTING, Told.REST),
    Transition(DriveState.RUNNING, Event.END, DriveState.STOPPED, Told.REST),
    Transition(DriveState.RESTING, Event.ARM, DriveState.ARMED, Told.NOTHING),
    *_stays(
        DriveState.RESTING, Told.REST, Event.ARM_IN_VAIN, Event.STANCE, Event.FAULT
    ),
    Transition(DriveState.RESTING, Event.END, DriveState.STOPPED, Told.REST),
    *_stays(
        DriveState.STOPPED,
        Told.REST,
        Event.ARM,
        Event.ARM_IN_VAIN,
        Event.STANCE,
        Event.FAULT,
        Event.END,
    ),
)

# There is no row for "arm in vain" in the states armed and running: a drive in them
# rests as soon as a fault begins, so none lasts when the operator arms it.
_TABLE = {(one.source, one.event): one for one in TRANSITIONS}


def within_s(told: Told, command_s: float) -> float | None:
    """Return the time within which the actuator is told, s; None if it is not.

    Parameters
    ----------
    told : Told
    command_s : float
        Latest time after its stance at which a swing is sent, s; see `Limits`.
    """
    return {Told.NOTHING: None, Told.SWING: command_s, Told.REST: REST_WITHIN_S}[told]


@dataclass(frozen=True)
class Step:
    """A transition that was made: when, s, and for which cause, if for one."""

    at_s: float
    transition: Transition
    cause: Message | None = None

    @property
    def changes(self) -> bool:
        """Whether the state is another one after it."""
        return self.transition.source is not self.transition.target

    @property
    def told(self) -> Told:
        """What the actuator is told."""
        return self.transition.told


Why: TypeAlias = Callable[[float], Message]


@dataclass(frozen=True)
class _Deadline:
    """When something is due, s, and the cause to rest if it has not come by then."""

    due_s: float
    why: Why


@dataclass
class Machine:
    """The state of a drive.

    A fault has a source, such as ``"frames"``, and a cause. One that lasts is reported
    until it is gone, and the drive cannot be armed in the meantime. That it is gone
    changes nothing else: only the operator arms a drive that rests.

    Parameters
    ----------
    is_armed : bool
        Whether the drive begins armed, as experiments do on a simulated robot.

    Attributes
    ----------
    state : DriveState
    cause : Message or None
        Why it rests or is over: the fault that brought it there.
    lasting : dict
        Faults that last now: cause by source, oldest first.
    steps : list of Step
        What has happened: each change of the state, and each fault.
    """

    is_armed: bool = False
    state: DriveState = field(init=False)
    cause: Message | None = field(default=None, init=False)
    lasting: dict[str, Message] = field(default_factory=dict, init=False)
    steps: list[Step] = field(default_factory=list, init=False)
    _deadlines: dict[str, _Deadline] = field(default_factory=dict, init=False)
    # Sources whose faults are noted since the state changed; a marker that flickers
    # must not fill the memory.
    _noted: set[str] = field(default_factory=set, init=False)

    def __post_init__(self) -> None:
        self.state = DriveState.ARMED if self.is_armed else DriveState.WAITING

    @property
    def may_swing(self) -> bool:
        """Whether a swing may be sent."""
        return self.state in (DriveState.ARMED, DriveState.RUNNING)

    def arm(self, at_s: float) -> Step:
        """Arm the drive, unless a fault lasts."""
        if self.lasting:
            first = next(iter(self.lasting.values()))
            return self._make(Event.ARM_IN_VAIN, at_s, first)
        return self._make(Event.ARM, at_s, None)

    def stance(self, at_s: float) -> Step:
        """Note that a stance was seen for which there is time to swing."""
        return self._make(Event.STANCE, at_s, self.cause)

    def end(self, cause: Message, at_s: float) -> Step:
        """End the drive."""
        return self._make(Event.END, at_s, cause)

    def fail(self, source: str, cause: Message, at_s: float) -> Step:
        """Note a fault that is over at once, such as a plan that fails."""
        return self._fault(source, cause, at_s)

    def report(self, source: str, cause: Message | None, at_s: float) -> Step | None:
        """Note whether a fault lasts; return what it does if it has just begun."""
        if cause is None:
            self.lasting.pop(source, None)
            return None
        is_new = source not in self.lasting
        self.lasting[source] = cause
        if not is_new and not self.may_swing:
            return None
        return self._fault(source, cause, at_s)

    def expect(self, source: str, due_s: float, why: Why) -> None:
        """Set when something is due; if it is not `met` by then, that is a fault."""
        self._deadlines[source] = _Deadline(due_s, why)

    def met(self, source: str) -> None:
        """Note that what was due has come; a fault of its lateness is gone."""
        self._deadlines.pop(source, None)
        self.lasting.pop(source, None)

    def tick(self, at_s: float) -> list[Step]:
        """Look at the time, and return what that does."""
        steps = []
        for source, deadline in list(self._deadlines.items()):
            is_due = at_s > deadline.due_s
            if not is_due and source not in self.lasting:
                continue
            cause = deadline.why(at_s) if is_due else None
            step = self.report(source, cause, at_s)
            if step is not None:
                steps.append(step)
        return steps

    def _fault(self, source: str, cause: Message, at_s: float) -> Step:
        is_noted = source in self._noted
        step = self._make(Event.FAULT, at_s, cause, is_kept=not is_noted)
        self._noted.add(source)
        return step

    def _make(
        self, event: Event, at_s: float, cause: Message | None, *, is_kept: bool = True
    ) -> Step:
        """Make the transition that the table has for an event."""
        transition = _TABLE[self.state, event]
        step = Step(at_s, transition, cause)
        self.state = transition.target
        if step.changes:
            self._noted.clear()
            is_resting = self.state in (DriveState.RESTING, DriveState.STOPPED)
            self.cause = cause if is_resting else None
        is_fault = event is Event.FAULT
        if step.changes or event is Event.ARM_IN_VAIN or (is_fault and is_kept):
            self.steps.append(step)
        return step


def table(command_s: float) -> list[tuple[str, str, str, str, str]]:
    """Return the transitions in words: state, event, next state, told, within.

    Parameters
    ----------
    command_s : float
        As in `within_s`.
    """
    rows = []
    for one in TRANSITIONS:
        limit_s = within_s(one.told, command_s)
        within = "-" if limit_s is None else f"{1e3 * limit_s:.0f} ms"
        words = (str(one.source), str(one.event), str(one.target), str(one.told))
        rows.append((*words, within))
    return rows
