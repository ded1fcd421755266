"""What moves the boom, what the loop will not go beyond, and the watch that brings it to rest."""

from __future__ import annotations

import logging
import math
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from hopdata.errors import ConfigError
from hopdata.steering.live.packets import LOOPBACK, PortError

LONGEST_LINE = 200
PORTS = 1 << 16


class Boom(Protocol):
    """Whatever swings the boom in the next flight."""

    def swing(self, rad: float) -> None:
        """Change the boom angle by so much, rad, in the next flight; 0 keeps it where it is.

        It takes the place of a swing that was sent before and has not begun.
        """


class UdpBoom:
    """Sends each swing as a line, `swing <number> <rad>`, in a datagram of its own.

    Numbers grow by one, from the milliseconds since 1970 on: those of a later drive are higher.

    Parameters
    ----------
    port, host : int, str
        Where the robot listens; on the loopback address unless told otherwise.

    Raises
    ------
    PortError
        If the port is none, or the host has no address.
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


class UdpSwings:
    """Receives the lines of `UdpBoom`, on the loopback address unless told otherwise.

    Lines that cannot be read are left out and counted in `garbled`; those whose number is not above
    all before, since they come late, twice or out of order, in `outdated`.

    Raises
    ------
    PortError
        If the port cannot be listened on.
    """

    def __init__(self, port: int = 0, *, host: str = LOOPBACK) -> None:
        self.garbled = self.outdated = 0
        self._number = -1  # of the newest so far
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise PortError(f"cannot listen on {host}, port {port}: {error}") from error
        self.port: int = self._socket.getsockname()[1]

    def newest(self) -> float | None:
        """Return the last swing that has come since the last call, rad, or None; never waits."""
        swing = None
        while True:
            try:
                line = self._socket.recv(LONGEST_LINE)
            except BlockingIOError:
                return swing
            found = _swing(line)
            if found is None:
                self.garbled += 1
            elif found[0] <= self._number:
                self.outdated += 1
            else:
                self._number, swing = found

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _address(host: str, port: int) -> tuple[str, int]:
    if not (isinstance(port, int) and 0 < port < PORTS):
        raise PortError(f"port: expected a whole number from 1 to {PORTS - 1}, found {port!r}")
    try:
        found = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        raise PortError(
            f"host: expected an IPv4 address or the name of one, found {host!r}: {error}"
        ) from error
    return str(found[0][4][0]), port


def _swing(line: bytes) -> tuple[int, float] | None:
    """Return number and swing, rad, of a line."""
    words = line.split()
    if len(words) != 3 or words[0] != b"swing" or not words[1].isdigit():
        return None
    try:
        rad = float(words[2])
    except ValueError:
        return None
    return (int(words[1]), rad) if math.isfinite(rad) else None


# What the control loop will not go beyond.


@dataclass(frozen=True)
class Limits:
    """What the loop will not go beyond.

    Parameters
    ----------
    pose_age_s : float
        A pose or boom angle older than this is not planned with, and with no frame for so long the
        boom is brought to rest.
    command_s : float
        A plan that is made later than this after its stance is not sent: the flight that it was
        meant for has begun.
    swing_rad : float
        Largest swing that is sent.
    hop_s : float
        Two stances farther apart than this are not of two hops in a row; the swing between them
        is not known then.
    fence_m : float
        The drive is over when the hopper is farther from the world's origin.
    tilt_rad : float
        The drive is over when the hopper leans by more; it leans by a tenth of it as it hops.

    Raises
    ------
    ConfigError
        If a time is not above 0, or the swing is not one from 0 to half a turn: a limit that is
        not a number, or in degrees, would let every swing through.
    """

    pose_age_s: float = 0.1
    command_s: float = 0.2
    swing_rad: float = 3 * np.pi / 8
    hop_s: float = 1.0
    fence_m: float = 3.0
    tilt_rad: float = np.pi / 4

    def __post_init__(self) -> None:
        for name in ("pose_age_s", "command_s", "hop_s", "fence_m", "tilt_rad"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name}: expected more than 0, found {getattr(self, name)}")
        if not 0 <= self.swing_rad <= np.pi:
            raise ConfigError(f"swing_rad: expected 0 to pi, found {self.swing_rad}")


# Bringing the boom to rest.

LOOK_S = 0.01
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Rest:
    """The boom was told to rest: when the cause was seen, when it was sent, monotonic s; why."""

    seen_s: float
    sent_s: float
    cause: str


class Watch:
    """Stands before the boom, and brings it to rest when there is a cause.

    A thread of its own asks every `LOOK_S` for a cause, so that neither a silent stream nor a
    controller that does not return holds it up. While there is one, no swing gets through. A boom
    that fails is told again at every look.

    Parameters
    ----------
    boom : Boom
    ask : callable
        Returns why the boom must rest, or an empty string.

    Attributes
    ----------
    cause : str
        Why it rests now; empty if it does not.
    rests : list of Rest
    """

    def __init__(self, boom: Boom, ask: Callable[[], str]) -> None:
        self.cause, self.rests = "", list[Rest]()
        self._boom, self._ask, self._lock = boom, ask, threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hopdata-watch", daemon=True)

    def swing(self, rad: float) -> str:
        """Send a swing, and return an empty string, or why it was not sent."""
        with self._lock:
            if not self.cause:
                self._boom.swing(rad)
            return self.cause

    def look(self) -> None:
        """Ask, and tell the boom to rest if there is a cause that was not there before."""
        try:
            cause = self._ask()
        except Exception as error:
            cause = f"the watch failed: {error!r}"
        seen_s = time.monotonic()
        with self._lock:
            new, self.cause = bool(cause) and not self.cause, cause
            if not new:
                return
            try:
                self._boom.swing(0.0)
            except Exception as error:
                self.cause = ""  # so that it is told again
                logger.error("the boom failed to rest: %r", error)
                return
            self.rests.append(Rest(seen_s, time.monotonic(), cause))
        logger.warning("the boom rests: %s", cause)

    def start(self) -> None:
        """Start to look."""
        self._thread.start()

    def close(self) -> None:
        """Look no more."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(LOOK_S):
            self.look()
