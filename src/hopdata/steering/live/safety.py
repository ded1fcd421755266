"""The boom, the limits of the loop, and the watch that brings the boom to rest."""

import logging
import math
import queue
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np

from hopdata.errors import require
from hopdata.messages import Message
from hopdata.steering.live.buffer import Worker
from hopdata.steering.live.machine import Machine, Step, Told, Why
from hopdata.steering.live.packets import LOOPBACK, LiveError, PortError

#: Time without a line after which the robot itself keeps its boom where it is.
#: Unit: s. Origin: chosen: ten heartbeats, and the time of `Limits.heard_s`.
SILENCE_S = 0.2

PORTS = 1 << 16
ANSWER_BYTES = 64  # longest answer that is read
DIGITS = 18  # longest number that is read


class Boom(Protocol):
    """Swings the boom in the next flight.

    `swing` is all that a driver needs. What it can tell beside that is used if it has
    the methods: `acknowledged`, and both of `alive` and `heard`. Each must return at
    once.

    - ``acknowledged()``: whether the last swing has arrived. For a line that may lose a
      command; a rest is then sent until it has.
    - ``alive(number)``: sends a heartbeat with this number, every `Limits.alive_s`. The
      robot answers it, and rests by itself if it hears nothing for `SILENCE_S`.
    - ``heard()``: the highest number of a heartbeat that was answered; 0 if none was.
    """

    def swing(self, rad: float) -> None:
        """Change the boom angle by `rad` in the next flight; 0 keeps it where it is.

        Replaces a swing that was sent before and has not begun.
        """


class NoBoom:
    """Sends nothing."""

    def swing(self, rad: float) -> None:
        """Leave the boom alone."""


class UdpBoom:
    """Sends each swing as a line, `swing <number> <rad>`, in a datagram of its own.

    Numbers increase by one, starting with the milliseconds since 1970, so those of a
    later drive are higher. The robot answers each line to where it came from with
    `heard <number>`. A rest is sent until it is heard, since a datagram may be lost. A
    heartbeat is the line `alive <number>`, numbered for itself in the same way, and the
    robot answers it with the same line.

    Parameters
    ----------
    port, host : int, str
        Where the robot listens; the loopback address by default.

    Raises
    ------
    PortError
        If the port is invalid, or the host has no address.
    """

    def __init__(self, port: int, *, host: str = LOOPBACK) -> None:
        self._address = _address(host, port)  # looked up once, not in each flight
        self._number = time.time_ns() // 1_000_000
        self._first_alive = self._number
        self._number_alive = self._number
        self._heard_alive = self._number
        self._heard = 0  # highest number that the robot has answered
        # Number whose answer, or a later one, acknowledges the last swing.
        self._wanted = 0
        self._rests = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def swing(self, rad: float) -> None:
        """Send a swing."""
        self._number += 1
        is_repeated = rad == 0.0 and self._rests
        if not is_repeated:  # an answer to any of the rests in a row will do
            self._wanted = self._number
        self._rests = rad == 0.0
        self._socket.sendto(f"swing {self._number} {rad!r}\n".encode(), self._address)

    def alive(self, number: int) -> None:
        """Send a heartbeat."""
        self._number_alive = self._first_alive + number
        line = f"alive {self._number_alive}\n".encode()
        self._socket.sendto(line, self._address)

    def acknowledged(self) -> bool:
        """Return whether the robot has answered the last swing."""
        self._listen()
        return self._heard >= self._wanted

    def heard(self) -> int:
        """Return the highest number of a heartbeat that the robot has answered."""
        self._listen()
        return self._heard_alive - self._first_alive

    def _listen(self) -> None:
        """Read the answers that have come."""
        with suppress(OSError):  # no more answers, or none of a robot that is gone
            while True:
                answer, (host, *_) = self._socket.recvfrom(ANSWER_BYTES)
                if host != self._address[0]:
                    continue
                heard = _number_in(answer, b"heard", self._number)
                self._heard = max(self._heard, heard)
                alive = _number_in(answer, b"alive", self._number_alive)
                self._heard_alive = max(self._heard_alive, alive)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _number_in(answer: bytes, word: bytes, highest: int) -> int:
    """Return the number in an answer; 0 if it answers none of the lines sent."""
    words = answer.split()
    if len(words) != 2 or words[0] != word or not words[1].isdigit():
        return 0
    number = int(words[1][:DIGITS])
    return number if number <= highest else 0


def _address(host: str, port: int) -> tuple[str, int]:
    if not (isinstance(port, int) and 0 < port < PORTS):
        raise PortError(
            f"port: expected a whole number from 1 to {PORTS - 1}, found {port!r}"
        )
    try:
        found = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        wanted = "an IPv4 address or the name of one"
        raise PortError.at("host", wanted, f"{host!r}: {error}") from error
    return str(found[0][4][0]), port


# Limits of the control loop.


@dataclass(frozen=True)
class Limits:
    """Limits of the control loop.

    Parameters
    ----------
    pose_age_s : float
        Largest age of a pose or boom angle used for planning. If there is no frame for
        this long, the boom is brought to rest.
    command_s : float
        Latest time after its stance at which a plan is sent: after that, the flight it
        was made for has begun.
    swing_rad : float
        Largest swing that is sent.
    hop_s : float
        Longest time between two stances that are taken for consecutive; if it is
        longer, the swing between them is unknown.
    fence_m : float
        The drive ends when the hopper is farther than this from the world's origin.
    tilt_rad : float
        The drive ends when the hopper leans by more; in normal hops it leans by a tenth
        of this.
    wrong_swings : int
        The drive ends after so many hops in a row whose swing, as measured, is not the
        one that was sent. A single one may have been sent too late for its flight.
    alive_s : float
        Time between two heartbeats to a boom that answers them.
    heard_s : float
        Longest time for a heartbeat to be answered; after that, the boom rests.

    Raises
    ------
    ConfigError
        If a time or the fence is not above 0, swing or tilt is not from 0 to pi, or
        `wrong_swings` is below 1. A limit that is not a number, or is in degrees, would
        let every swing or tilt pass.
    """

    pose_age_s: float = 0.1
    command_s: float = 0.2
    swing_rad: float = 3 * np.pi / 8
    hop_s: float = 1.0
    fence_m: float = 3.0
    tilt_rad: float = np.pi / 4
    wrong_swings: int = 2
    alive_s: float = 0.02
    heard_s: float = 0.2

    def __post_init__(self) -> None:
        times = ("pose_age_s", "command_s", "hop_s", "alive_s", "heard_s")
        for name in (*times, "fence_m"):
            value = getattr(self, name)
            require(value > 0, name, "more than 0", value)
        for name in ("swing_rad", "tilt_rad"):
            angle = getattr(self, name)
            require(0 <= angle <= np.pi, name, "0 to pi", angle)
        require(self.wrong_swings >= 1, "wrong_swings", "1 or more", self.wrong_swings)


# Bringing the boom to rest.

#: Time between looks for a cause to rest, and between rests that are sent again.
#: Unit: s. Origin: chosen.
LOOK_S = 0.01
#: Time after the last look of the watch in which heartbeats are still sent.
#: Unit: s. Origin: chosen: ten looks.
PERMITTED_S = 0.1
#: Heartbeats that wait for an answer, whose times are kept.
#: Unit: 1. Origin: chosen.
MOST_UNHEARD = 1000
#: Longest time for the last rest to arrive.
#: Unit: s. Origin: chosen.
LAST_REST_S = 1.0

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Rest:
    """A command to rest: when its cause was seen and it was sent, monotonic, s; why."""

    seen_s: float
    sent_s: float
    cause: Message


class Command:
    """A swing on its way to the boom, and what became of it.

    `done` is set once the boom's driver has returned, or a newer command came before it
    was called (`replaced`). `sent_s` is when the driver returned, s; `error` is what it
    raised, if anything. A command that nobody waits for any more is `withdrawn`: the
    driver is not called for it.
    """

    def __init__(self, rad: float) -> None:
        self.rad = rad
        self.done = threading.Event()
        self.replaced = False
        self.withdrawn = False
        self.sent_s = math.nan
        self.error: BaseException | None = None


class Sender(Worker):
    """Calls the boom in a thread of its own; a driver that blocks delays nobody else.

    Only the newest command counts: it replaces those that the driver has not been
    given. A rest is sent again every `LOOK_S` until the driver returns without an error
    and the boom, if it can tell, has heard it. Before `start` commands are sent in the
    caller's thread, as on a simulated clock.

    Heartbeats are sent as long as somebody says that the loop is alive (`permit`); a
    loop that hangs must not look alive to the robot.
    """

    def __init__(
        self, boom: Boom, clock: Callable[[], float], alive_s: float = 0.02
    ) -> None:
        super().__init__("hopdata-boom", self._run)
        self._boom: Any = boom
        self._clock = clock
        self._alive_s = alive_s
        # Numbers and times of heartbeats that are not answered yet.
        self._unheard: deque[tuple[int, float]] = deque()
        self._beats = 0
        self._next_beat_s = -math.inf
        self._permitted_s = math.inf
        names = ("alive", "heard")
        self.is_acknowledging = all(hasattr(boom, name) for name in names)
        self._waiting: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._last: Command | None = None
        self._rest: Command | None = None  # not heard yet
        self._called_s = math.inf  # when the driver was called that has not returned
        self._fails_to_tell = False

    def put(self, rad: float) -> Command:
        """Give the boom a swing; returns at once if the thread runs."""
        command = Command(rad)
        self._last = command
        if self._thread.ident is None:
            self._send(command)
        else:
            self._waiting.put(command)
        return command

    def again(self) -> None:
        """Send what is due again: a rest that is not heard, and the next heartbeat.

        For callers without a thread.
        """
        if self._thread.ident is None:
            self._insist()
            self._beat()

    def permit(self) -> None:
        """Say that the loop is alive; heartbeats go on for `PERMITTED_S`."""
        self._permitted_s = self._clock()

    def unheard_s(self) -> float:
        """Return for how long the oldest heartbeat has not been answered, s."""
        with suppress(IndexError):
            return max(0.0, self._clock() - self._unheard[0][1])
        return 0.0

    def blocked_s(self) -> float:
        """Return for how long the driver has not returned, s; 0 if it is not called."""
        return max(0.0, self._clock() - self._called_s)

    def close(self) -> None:
        """Stop the thread, after `LAST_REST_S` at most for the last command to arrive.

        Raises
        ------
        LiveError
            If the driver does not return.
        """
        if self._thread.ident is None or self._stop.is_set():
            return
        until_s = time.monotonic() + LAST_REST_S
        if self._last is not None:
            self._last.done.wait(LAST_REST_S)
        while self._rest is not None and time.monotonic() < until_s:
            time.sleep(0.1 * LOOK_S)
        self._stop.set()
        self._thread.join(LAST_REST_S)
        if self._thread.is_alive():
            raise LiveError(
                f"the boom's driver has not returned for {self.blocked_s():.1f} s"
            )
        if self._rest is not None:
            logger.error("the boom did not acknowledge the last rest")

    def _run(self) -> None:
        while not self._stop.is_set():
            command = self._newest()
            if command is None:
                self._insist()
            else:
                self._send(command)
            self._beat()

    def _newest(self) -> Command | None:
        """Return the newest command within `LOOK_S`, if any; it replaces the others."""
        newest: Command | None = None
        with suppress(queue.Empty):
            newest = self._waiting.get(timeout=LOOK_S)
            while True:
                following = self._waiting.get_nowait()
                newest.replaced = True
                newest.done.set()
                newest = following
        return newest

    def _insist(self) -> None:
        """Send a rest again that failed, or that the boom has not heard."""
        rest = self._rest
        if rest is None:
            return
        if rest.error is None and self._is_heard():
            self._rest = None
        else:
            self._send(rest)

    def _beat(self) -> None:
        """Send the next heartbeat if it is due, and see which were answered."""
        if not self.is_acknowledging:
            return
        now = self._clock()
        self._called_s = now
        try:
            heard = int(self._boom.heard())
            while self._unheard and self._unheard[0][0] <= heard:
                self._unheard.popleft()
            is_alive = now - self._permitted_s <= PERMITTED_S
            if now >= self._next_beat_s and is_alive:
                self._beats += 1
                self._next_beat_s = now + self._alive_s
                if len(self._unheard) < MOST_UNHEARD:  # the oldest one counts
                    self._unheard.append((self._beats, now))
                self._boom.alive(self._beats)
        except BaseException as error:  # whatever it is, the thread goes on
            if not self._fails_to_tell:
                logger.error("the boom cannot tell whether it has heard: %r", error)
            self._fails_to_tell = True
        finally:
            self._called_s = math.inf

    def _is_heard(self) -> bool:
        """Ask a boom that can tell; one that fails to tell has not heard."""
        asked = getattr(self._boom, "acknowledged", None)
        if asked is None:
            return True
        self._called_s = self._clock()
        try:
            return bool(asked())
        except BaseException as error:  # whatever it is, the thread goes on
            if not self._fails_to_tell:
                logger.error("the boom cannot tell whether it has heard: %r", error)
            self._fails_to_tell = True
            return False
        finally:
            self._called_s = math.inf

    def _send(self, command: Command) -> None:
        if command.withdrawn:
            command.done.set()
            return
        self._rest = command if command.rad == 0.0 else None
        failed_before = command.error is not None
        self._called_s = self._clock()
        try:
            self._boom.swing(command.rad)
            failure: BaseException | None = None
        except BaseException as error:  # whatever it is, the thread goes on
            failure = error
            if command.rad == 0.0 and not failed_before:
                logger.error("the boom failed to rest: %r", error)
        self._called_s = math.inf
        if math.isnan(command.sent_s) and failure is None:
            command.sent_s = self._clock()
        command.error = failure  # last, since others look at it meanwhile
        command.done.set()


def rest_within(boom: Boom, seconds: float) -> bool:
    """Command a boom to rest from a thread of its own.

    Return whether its driver has returned. For the end of a drive, where the sender's
    thread may never have begun, or is blocked.
    """
    returned = threading.Event()

    def send() -> None:
        with suppress(Exception):  # the robot may be gone
            boom.swing(0.0)
        returned.set()

    threading.Thread(target=send, name="hopdata-last-rest", daemon=True).start()
    return returned.wait(seconds)


class Watch(Worker):
    """Guards the boom: tells the machine what happens, and the boom what that means.

    A thread of its own looks every `LOOK_S`, so that neither a silent stream nor a
    controller that does not return can delay a rest. The boom is called by a `Sender`,
    whose thread begins with that of the watch. Once they run, no lock is held while
    code of others runs, so nothing that blocks can keep the boom's rest from being
    sent.

    Parameters
    ----------
    boom : Boom
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

    Attributes
    ----------
    machine : Machine
    rests : list of Rest
    """

    def __init__(
        self,
        boom: Boom,
        machine: Machine,
        ask: Callable[[], Mapping[str, Message | None]] = dict,
        clock: Callable[[], float] = time.monotonic,
        *,
        limits: Limits | None = None,
        on_stop: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__("hopdata-watch", self._run)
        self.machine = machine
        self.rests: list[Rest] = []
        self._ask = ask
        self._clock = clock
        self._limits = limits or Limits()
        self._on_stop = on_stop
        self._sender = Sender(boom, clock, self._limits.alive_s)
        self._lock = threading.RLock()
        # The rest that may not have arrived yet, and what brought it about.
        self._rest: Command | None = None
        self._unrecorded: list[Step] = []
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
            return Message("steering.acknowledging")
        return Message("steering.acknowledging_nothing")

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

    def swing(self, rad: float) -> Message | None:
        """Send a swing and return None, or return why it was not sent.

        Raises
        ------
        Exception
            What the boom's driver raises.
        """
        with self._lock:
            if not self.machine.may_swing:
                return self.cause or Message("steering.not_armed")
            command = self._sender.put(rad)
        if not command.done.wait(self._limits.command_s):
            command.withdrawn = True
            for_s = self._limits.command_s
            blocked = Message("steering.boom_blocked", {"for_s": for_s})
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
            for source, cause in asked.items():
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
        if for_s <= self._limits.command_s:
            return None
        return Message("steering.boom_blocked", {"for_s": for_s})

    def _unacknowledged(self) -> Message | None:
        for_s = self._sender.unheard_s()
        limit_s = self._limits.heard_s
        if for_s <= limit_s:
            return None
        values = {"for_s": for_s, "limit_s": limit_s}
        return Message("steering.unacknowledged", values)

    def _obey(self, step: Step) -> None:
        """Tell the boom to rest if a step asks for it; the lock is held."""
        if step.told is not Told.REST:
            return
        self._record()
        self._rest = self._sender.put(0.0)
        if step.changes:
            self._unrecorded.append(step)

    def _record(self) -> None:
        """Note rests once the boom's driver has returned without an error."""
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
        """Log new rests; without the lock, since that may block."""
        for rest in self.rests[self._n_logged :]:
            self._n_logged += 1
            logger.warning("the boom rests: %s", rest.cause)

    def _run(self) -> None:
        while not self._stop.wait(LOOK_S):
            self.look()
