"""What moves the boom: an interface for the robot's own, and one line of text over UDP for ours."""

from __future__ import annotations

import math
import socket
from types import TracebackType
from typing import Protocol, Self

from hopdata.steering.live.connections import LOOPBACK
from hopdata.steering.live.errors import PortError

LONGEST_LINE = 200
PORTS = 1 << 16


class Boom(Protocol):
    """Whatever swings the boom in the next flight."""

    def swing(self, rad: float) -> None:
        """Change the boom angle by so much, rad, in the next flight; 0 keeps it where it is."""


class UdpBoom:
    """Sends each swing as a line, `swing <number> <rad>`, in a datagram of its own.

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
        self._address, self._sent = _address(host, port), 0  # looked up once, not in each flight
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def swing(self, rad: float) -> None:
        """Send a swing."""
        self._sent += 1
        self._socket.sendto(f"swing {self._sent} {rad!r}\n".encode(), self._address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.close()


class UdpSwings:
    """Receives the lines of `UdpBoom`, on the loopback address unless told otherwise.

    Lines that cannot be read are left out and counted in `garbled`.

    Raises
    ------
    PortError
        If the port cannot be listened on.
    """

    def __init__(self, port: int = 0, *, host: str = LOOPBACK) -> None:
        self.garbled = 0
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
            self.garbled += found is None
            swing = swing if found is None else found

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


def _swing(line: bytes) -> float | None:
    words = line.split()
    if len(words) != 3 or words[0] != b"swing" or not words[1].isdigit():
        return None
    try:
        rad = float(words[2])
    except ValueError:
        return None
    return rad if math.isfinite(rad) else None
