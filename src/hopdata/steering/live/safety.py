"""The boom, the limits of the loop, and the watch that brings the boom to rest."""

import itertools
import logging
import math
import queue
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from hopdata.errors import require
from hopdata.steering.live.buffer import Worker
from hopdata.steering.live.packets import LOOPBACK, LiveError, PortError

PORTS = 1 << 16
ANSWER_BYTES = 64  # longest answer that is read
DIGITS = 18  # longest number that is read


class Boom(Protocol):
    """Swings the boom in the next flight."""

    def swing(self, rad: float) -> None:
        """Change the boom angle by `rad` in the next flight; 0 keeps it where it is.

        Replaces a swing that was sent before and has not begun. A boom whose line may
        lose a command also has a method `acknowledged()`, which returns at once whether
        the last swing has arrived; a rest is then sent until it has.
        """


class NoBoom:
    """Sends nothing."""

    def swing(self, rad: float) -> None:
        """Leave the boom alone."""


class UdpBoom:
    """Sends each swing as a line, `swing <number> <rad>`, in a datagram of its own.

    Numbers increase by one, starting with the milliseconds since 1970, so those of a
    later drive are higher. The robot answers each line to where it came from with
    `heard <number>`. A rest is sent until it is heard, since a datagram may be lost.

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
        self._heard = 0  # highest number that the robot has answered
        self._wanted = (
            0  # number whose answer, or a later one, acknowledges the last swing
        )
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

    def acknowledged(self) -> bool:
        """Return whether the robot has answered the last swing."""
        with suppress(OSError):  # no more answers, or none of a robot that is gone
            while True:
                answer, (host, *_) = self._socket.recvfrom(ANSWER_BYTES)
                if host == self._address[0]:
                    self._heard = max(self._heard, self._number_heard(answer))
        return self._heard >= self._wanted

    def _number_heard(self, answer: bytes) -> int:
        """Return the number in an answer; 0 if it answers none of the lines sent."""
        words = answer.split()
        if len(words) != 2 or words[0] != b"heard" or not words[1].isdigit():
            return 0
        number = int(words[1][:DIGITS])
        return number if number <= self._number else 0

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


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

    def __post_init__(self) -> None:
        for name in ("pose_age_s", "command_s", "hop_s", "fence_m"):
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
#: Longest time for the last rest to arrive.
#: Unit: s. Origin: chosen.
LAST_REST_S = 1.0

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Rest:
    """A command to rest: when its cause was seen and it was sent, monotonic, s; why."""

    seen_s: float
    sent_s: float
    cause: str


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
    """

    def __init__(self, boom: Boom, clock: Callable[[], float]) -> None:
        super().__init__("hopdata-boom", self._run)
        self._boom, self._clock = boom, clock
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
        """Send the last rest again, unless heard; for callers without a thread."""
        if self._thread.ident is None:
            self._insist()

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
    """Guards the boom, and brings it to rest when there is a cause.

    A thread of its own asks for a cause every `LOOK_S`, so that neither a silent stream
    nor a controller that does not return can delay it. While there is a cause, no swing
    is passed on. The boom is called by a `Sender`, whose thread begins with that of the
    watch. Once they run, no lock is held while code of others runs, so nothing that
    blocks can keep the boom's rest from being sent.

    Parameters
    ----------
    boom : Boom
    ask : callable
        Returns the cause for which the boom must rest, or an empty string.
    clock : callable
        Returns the time, s.
    patience_s : float
        Longest time for the boom's driver to return; a longer one is a cause to rest.

    Attributes
    ----------
    cause : str
        The current cause to rest; empty if there is none.
    rests : list of Rest
    """

    def __init__(
        self,
        boom: Boom,
        ask: Callable[[], str],
        clock: Callable[[], float] = time.monotonic,
        *,
        patience_s: float = 0.2,
    ) -> None:
        super().__init__("hopdata-watch", self._run)
        self.cause = ""
        self.rests: list[Rest] = []
        self._ask = ask
        self._clock = clock
        self._patience_s = patience_s
        self._sender = Sender(boom, clock)
        self._lock = threading.Lock()
        self._tickets = itertools.count()
        self._latest = -1  # ticket of the newest answer heeded
        self._resting: Command | None = None  # whose arrival is not recorded yet
        self._rest_cause = ""
        self._seen_s = math.nan

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

    def swing(self, rad: float) -> str:
        """Send a swing and return an empty string, or return why it was not sent.

        Raises
        ------
        Exception
            What the boom's driver raises.
        """
        with self._lock:
            if self.cause:
                return self.cause
            command = self._sender.put(rad)
        if not command.done.wait(self._patience_s):
            command.withdrawn = True
            with self._lock:
                if not self.cause:  # else a rest is on its way
                    self._sender.put(0.0)  # follows at once if the driver is at it
            return f"the boom's driver has not returned within {self._patience_s:g} s"
        if command.replaced:
            return self.cause or "a newer command came first"
        if command.error is not None:
            raise command.error
        return ""

    def look(self) -> None:
        """Ask for a cause, and command the boom to rest if there was none before."""
        ticket = next(self._tickets)
        try:
            cause = self._ask()
        except Exception as error:
            cause = f"the watch failed: {error!r}"
        blocked_s = self._sender.blocked_s()
        if not cause and blocked_s > self._patience_s:
            cause = f"the boom's driver has not returned for {blocked_s:.2f} s"
        seen_s = self._clock()
        with self._lock:  # held for a few assignments only
            if ticket < self._latest:  # an older answer must not replace a newer one
                return
            self._latest = ticket
            is_new = bool(cause) and not self.cause
            self.cause = cause
            if is_new:
                self._rest_cause = cause
                self._seen_s = seen_s
                self._resting = self._sender.put(0.0)
        if cause and not is_new:
            self._sender.again()
        self._record()

    def _record(self) -> None:
        """Note a rest once the boom's driver has returned without an error."""
        with self._lock:
            command = self._resting
            if (
                command is None
                or not command.done.is_set()
                or command.error is not None
            ):
                return
            self._resting = None
            if command.replaced:  # the cause was gone before the driver could be called
                return
            rest = Rest(self._seen_s, command.sent_s, self._rest_cause)
            self.rests.append(rest)
        logger.warning("the boom rests: %s", rest.cause)

    def _run(self) -> None:
        while not self._stop.wait(LOOK_S):
            self.look()
