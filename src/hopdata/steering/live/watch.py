"""The watch: looks for a cause to rest, and has the boom told so."""

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self

from hopdata.messages import Message
from hopdata.steering.live.actuator import Driven
from hopdata.steering.live.buffer import Worker
from hopdata.steering.live.decisions import Numbers
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.machine import Machine, Step, Told, Why
from hopdata.steering.live.sender import Command, Sender

#: Time between looks for a cause to rest.
#: Unit: s. Origin: chosen.
WATCH_S = 0.01

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Rest:
    """A command to rest: when its cause was seen and it was sent, monotonic, s; why."""

    seen_s: float
    sent_s: float
    cause: Message


class Watch(Worker):
    """Guards the boom: tells the machine what happens, and the boom what that means.

    A thread of its own looks every `WATCH_S`, so that neither a silent stream nor a
    controller that does not return can delay a rest. The boom is called by a `Sender`,
    whose thread begins with that of the watch. Once they run, no lock is held while
    code of others runs, so nothing that blocks can keep the boom's rest from being
    sent.

    Parameters
    ----------
    boom : Boom or Actuator
    machine : Machine
        The state of the drive.
    ask : callable
        Returns what is wrong now: cause by source, None for a source that is well.
    clock : callable
        Returns the time, s.
    limits : Limits
        Of these, `command_s` is also the longest time for the boom's driver to return.
    on_stop : callable, optional
        Called when the drive is over, from the thread in which it ended.
    rest : tuple of float
        The inputs at rest.
    what : str
        What messages call the part that the boom or actuator moves.

    Attributes
    ----------
    machine : Machine
    rests : list of Rest
    what : str
    """

    def __init__(
        self,
        boom: Driven,
        machine: Machine,
        ask: Callable[[], Mapping[str, Message | None]] = dict,
        clock: Callable[[], float] = time.monotonic,
        *,
        limits: Limits | None = None,
        on_stop: Callable[[], None] = lambda: None,
        rest: Numbers = (0.0,),
        what: str = "boom",
    ) -> None:
        super().__init__("hopdata-watch", self._run)
        self.machine = machine
        self.rests: list[Rest] = []
        self._ask = ask
        self._clock = clock
        self._limits = limits or Limits()
        self._on_stop = on_stop
        self.what = what
        self._sender = Sender(boom, clock, self._limits.alive_s, rest)
        self._lock = threading.RLock()
        # The rest that may not have arrived yet, and what brought it about.
        self._rest: Command | None = None
        self._unrecorded: list[Step] = []
        # The last command whose driver did not return in time.
        self._given_up: Command | None = None
        self._n_logged = 0

    @property
    def cause(self) -> Message | None:
        """Why the boom rests, or why the drive could not be armed; None if neither."""
        lasting = list(self.machine.lasting.values())
        return self.machine.cause or (lasting[0] if lasting else None)

    @property
    def is_acknowledging(self) -> bool:
        """Whether the boom answers heartbeats."""
        return self._sender.is_acknowledging

    def says_of_boom(self) -> Message:
        """Return whether the boom acknowledges anything, in words."""
        if self.is_acknowledging:
            return Message("steering.acknowledging", {"what": self.what})
        return Message("steering.acknowledging_nothing", {"what": self.what})

    def start(self) -> Self:
        """Start the threads of the watch and of the boom."""
        self._sender.start()
        return super().start()

    def close(self) -> None:
        """Stop the threads; a rest that is on its way arrives before that."""
        super().close()
        try:
            self._sender.close()
        finally:
            self._record()
            self._tell()

    # What happens.

    def arm(self) -> Message | None:
        """Arm the drive; return the fault that lasts if it cannot be armed."""
        self.look()
        with self._lock:
            step = self.machine.arm(self._clock())
            self._obey(step)
            return None if self.machine.may_swing else step.cause or self.cause

    def stance(self) -> Told:
        """Note a stance for which there is time to swing; return what is due then."""
        with self._lock:
            step = self.machine.stance(self._clock())
            self._obey(step)
            return step.told

    def report(self, source: str, cause: Message | None) -> None:
        """Note that a fault lasts, or is gone."""
        with self._lock:
            step = self.machine.report(source, cause, self._clock())
            if step is not None:
                self._obey(step)
        self._record()

    def fail(self, source: str, cause: Message) -> None:
        """Note a fault that is over at once."""
        with self._lock:
            self._obey(self.machine.fail(source, cause, self._clock()))
        self._record()

    def end(self, cause: Message) -> None:
        """End the drive."""
        with self._lock:
            self._obey(self.machine.end(cause, self._clock()))
        self._record()
        self._on_stop()

    def expect(self, source: str, due_s: float, why: Why) -> None:
        """Set when something is due."""
        with self._lock:
            self.machine.expect(source, due_s, why)

    def met(self, source: str) -> None:
        """Note that what was due has come."""
        with self._lock:
            self.machine.met(source)

    def send(self, inputs: Numbers) -> Message | None:
        """Send inputs and return None, or return why they were not sent.

        Raises
        ------
        Exception
            What the boom's driver raises.
        """
        with self._lock:
            if not self.machine.may_swing:
                return self.cause or Message("steering.not_armed")
            command = self._sender.put(inputs)
        if not command.done.wait(self._limits.command_s):
            command.withdrawn = True
            self._given_up = command
            values = {"what": self.what, "for_s": self._limits.command_s}
            blocked = Message("steering.boom_blocked", values)
            self.fail("driver", blocked)  # its rest follows at once
            return blocked
        if command.replaced:
            return self.cause or Message("steering.newer_command")
        if command.error is not None:
            raise command.error
        return None

    def look(self) -> None:
        """Look at the time and at everything that may be wrong."""
        self._sender.permit()
        try:
            asked = dict(self._ask())
            asked["watch"] = None
        except Exception as error:
            asked = {"watch": Message("steering.watch_failed", {"error": repr(error)})}
        asked["driver"] = self._blocked()
        asked["acknowledgement"] = self._unacknowledged()
        with self._lock:  # held for a few assignments only
            now = self._clock()
            lasting = self.machine.lasting
            for source, cause in asked.items():
                if cause is None and source not in lasting:
                    continue
                step = self.machine.report(source, cause, now)
                if step is not None:
                    self._obey(step)
            for step in self.machine.tick(now):
                self._obey(step)
        self._sender.again()
        self._record()
        self._tell()

    def _blocked(self) -> Message | None:
        for_s = self._sender.blocked_s()
        given_up = self._given_up
        is_waiting = given_up is not None and not given_up.done.is_set()
        if for_s <= self._limits.command_s and not is_waiting:
            return None
        values = {"what": self.what, "for_s": for_s}
        return Message("steering.boom_blocked", values)

    def _unacknowledged(self) -> Message | None:
        for_s = self._sender.unheard_s()
        limit_s = self._limits.heard_s
        if for_s <= limit_s:
            return None
        values = {"what": self.what, "for_s": for_s, "limit_s": limit_s}
        return Message("steering.unacknowledged", values)

    def _obey(self, step: Step) -> None:
        """Tell the boom to rest if a step asks for it; the lock is held."""
        if step.told is not Told.REST:
            return
        self._record()
        self._rest = self._sender.put(self._sender.rest)
        if step.changes:
            self._unrecorded.append(step)

    def _record(self) -> None:
        """Note rests once the boom's driver has returned without an error."""
        if self._rest is None:  # as in almost every look
            return
        with self._lock:
            command = self._rest
            if command is None or not command.done.is_set():
                return
            if command.error is not None:  # it is sent again
                return
            self._rest = None
            steps = self._unrecorded
            self._unrecorded = []
            if command.replaced:  # it was armed before the driver could be called
                return
            for step in steps:
                cause = step.cause or Message("steering.the_end")
                self.rests.append(Rest(step.at_s, command.sent_s, cause))

    def _tell(self) -> None:
        """Log new rests, each once; without the lock, since logging may block."""
        if len(self.rests) == self._n_logged:
            return
        with self._lock:
            new = self.rests[self._n_logged :]
            self._n_logged += len(new)
        for rest in new:
            logger.warning("the %s rests: %s", self.what, rest.cause)

    def _run(self) -> None:
        while not self._stop.wait(WATCH_S):
            self.look()
