"""Actuators: what takes the inputs of the next stride, and a driver over UDP."""

import socket
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol, Self, TypeAlias

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.steering.live.decisions import Numbers
from hopdata.steering.live.packets import LOOPBACK, PortError

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


class Actuator(Protocol):
    """Takes the inputs of the next stride, for a robot of any axes.

    It may have the methods `acknowledged`, `alive` and `heard`, as a `Boom`.
    """

    def command(self, inputs: FloatArray, /) -> None:
        """Let the next stride have these inputs (U,).

        They replace inputs that were sent before and have not been used.
        """


Driven: TypeAlias = Boom | Actuator


def driver_of(actuator: Driven) -> Callable[[Numbers], None]:
    """Return what sends inputs: an actuator's `command`, or a boom's `swing`."""
    whole: Any = actuator
    if hasattr(actuator, "command"):
        return lambda inputs: whole.command(np.array(inputs))
    return lambda inputs: whole.swing(inputs[0])


class NoBoom:
    """Sends nothing."""

    def swing(self, rad: float) -> None:
        """Leave the boom alone."""


class NoActuator:
    """Sends nothing to any robot."""

    def command(self, inputs: FloatArray, /) -> None:
        """Leave the robot alone."""


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
        self._send("swing", (rad,), is_rest=rad == 0.0)

    def _send(self, word: str, numbers: Numbers, *, is_rest: bool) -> None:
        """Send a line with a word, its number, and what is commanded."""
        self._number += 1
        is_repeated = is_rest and self._rests
        if not is_repeated:  # an answer to any of the rests in a row will do
            self._wanted = self._number
        self._rests = is_rest
        line = " ".join([word, str(self._number), *map(repr, numbers)])
        self._socket.sendto(f"{line}\n".encode(), self._address)

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


class UdpActuator(UdpBoom):
    """Sends the inputs of each stride as a line, `inputs <number> <u1> <u2> ...`.

    Answers and heartbeats are those of a `UdpBoom`.

    Parameters
    ----------
    port, host : int, str
        As of a `UdpBoom`.
    rest : tuple of float
        The inputs at rest.
    """

    def __init__(
        self, port: int, *, host: str = LOOPBACK, rest: Numbers = (0.0,)
    ) -> None:
        super().__init__(port, host=host)
        self._rest = rest

    def command(self, inputs: FloatArray, /) -> None:
        """Send inputs."""
        numbers = tuple(np.asarray(inputs, dtype=float).tolist())
        self._send("inputs", numbers, is_rest=numbers == self._rest)


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
