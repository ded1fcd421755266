"""The interface to the boom, the limits of the loop, and the watch that brings the boom to rest."""

import logging
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from hopdata.errors import require
from hopdata.steering.live.buffer import Worker
from hopdata.steering.live.packets import LOOPBACK, PortError

PORTS = 1 << 16


class Boom(Protocol):
    """Swings the boom in the next flight."""

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

    Numbers increase by one, starting with the milliseconds since 1970, so those of a later drive
    are higher.

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
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def swing(self, rad: float) -> None:
        """Send a swing."""
        self._number += 1
        self._socket.sendto(f"swing {self._number} {rad!r}\n".encode(), self._address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _address(host: str, port: int) -> tuple[str, int]:
    if not (isinstance(port, int) and 0 < port < PORTS):
        raise PortError(f"port: expected a whole number from 1 to {PORTS - 1}, found {port!r}")
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
        Largest age of a pose or boom angle used for planning. If there is no frame for this long,
        the boom is brought to rest.
    command_s : float
        Latest time after its stance at which a plan is sent: after that, the flight it was made for
        has begun.
    swing_rad : float
        Largest swing that is sent.
    hop_s : float
        Longest time between two stances that are taken for consecutive; if it is longer, the swing
        between them is unknown.
    fence_m : float
        The drive ends when the hopper is farther than this from the world's origin.
    tilt_rad : float
        The drive ends when the hopper leans by more; in normal hops it leans by a tenth of this.

    Raises
    ------
    ConfigError
        If a time or the fence is not above 0, or swing or tilt is not from 0 to pi. A limit that is
        not a number, or is in degrees, would let every swing or tilt pass.
    """

    pose_age_s: float = 0.1
    command_s: float = 0.2
    swing_rad: float = 3 * np.pi / 8
    hop_s: float = 1.0
    fence_m: float = 3.0
    tilt_rad: float = np.pi / 4

    def __post_init__(self) -> None:
        for name in ("pose_age_s", "command_s", "hop_s", "fence_m"):
            require(getattr(self, name) > 0, name, "more than 0", getattr(self, name))
        for name in ("swing_rad", "tilt_rad"):
            require(0 <= getattr(self, name) <= np.pi, name, "0 to pi", getattr(self, name))


# Bringing the boom to rest.

LOOK_S = 0.01
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Rest:
    """A command to rest: when the cause was seen, when it was sent, monotonic s; and the cause."""

    seen_s: float
    sent_s: float
    cause: str


class Watch(Worker):
    """Guards the boom, and brings it to rest when there is a cause.

    A thread of its own asks for a cause every `LOOK_S`, so that neither a silent stream nor a
    controller that does not return can delay it. While there is a cause, no swing is passed on. If
    the boom fails to rest, it is commanded again at every look.

    Parameters
    ----------
    boom : Boom
    ask : callable
        Returns the cause for which the boom must rest, or an empty string.
    clock : callable
        Returns the time, s.

    Attributes
    ----------
    cause : str
        The current cause to rest; empty if there is none.
    rests : list of Rest
    """

    def __init__(
        self, boom: Boom, ask: Callable[[], str], clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__("hopdata-watch", self._run)
        self.cause, self.rests = "", list[Rest]()
        self._boom, self._ask, self._clock, self._lock = boom, ask, clock, threading.Lock()

    def swing(self, rad: float) -> str:
        """Send a swing and return an empty string, or return why it was not sent."""
        with self._lock:
            if not self.cause:
                self._boom.swing(rad)
            return self.cause

    def look(self) -> None:
        """Ask for a cause, and command the boom to rest if there was none before."""
        with self._lock:  # includes asking: an older answer must not replace a newer one
            try:
                cause = self._ask()
            except Exception as error:
                cause = f"the watch failed: {error!r}"
            seen_s = self._clock()
            new, self.cause = bool(cause) and not self.cause, cause
            if not new:
                return
            try:
                self._boom.swing(0.0)
            except Exception as error:
                self.cause = ""  # so that the command is repeated
                logger.error("the boom failed to rest: %r", error)
                return
            self.rests.append(Rest(seen_s, self._clock(), cause))
        logger.warning("the boom rests: %s", cause)

    def _run(self) -> None:
        while not self._stop.wait(LOOK_S):
            self.look()
