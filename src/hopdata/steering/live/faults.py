"""Faults put into a stream on purpose, the same for the same seed."""

from __future__ import annotations

import asyncio
import socket
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import require_choice
from hopdata.steering.live.packets import COMMAND, HEADER, PortError, header_fault

# Connections of the server: its clients, and the socket on which it waits for them.

MOST_WAITING = 1 << 20  # bytes that a client may leave unread before frames for it are skipped


class ServedClient:
    """One connection: which frames it wants (every so manieth, 0 for none), and how."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self.writer, self.every, self.residuals = writer, 0, False

    def send(self, data: bytes) -> bool:
        """Send, unless the client has left too much unread; say whether it was sent."""
        transport = self.writer.transport
        if transport.is_closing() or transport.get_write_buffer_size() > MOST_WAITING:
            return False
        self.writer.write(data)
        return True


async def next_command(reader: asyncio.StreamReader) -> str:
    """Read the next command of a client.

    Raises
    ------
    ValueError
        If what came is no command.
    IncompleteReadError
        If the client has gone.
    """
    size, kind = HEADER.unpack(await reader.readexactly(HEADER.size))
    fault = header_fault(size, kind)
    if fault or kind != COMMAND:
        raise ValueError(f"Parse error: {fault or f'packet of type {kind}'}")
    payload = await reader.readexactly(size - HEADER.size)
    return payload.rstrip(b"\0").decode("utf-8", errors="replace")


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens; port 0 for any free one.

    Raises
    ------
    PortError
        If the address cannot be listened on.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except (OSError, OverflowError) as error:
        raise PortError(f"cannot listen on {host}, port {port}: {error}") from error


OutageKind = Literal["stall", "vanish", "garbage"]


@dataclass(frozen=True)
class Faults:
    """Rates of faults that befall single frames.

    `dropped` is the share of frames that are not sent, in bursts of `burst_frames` on average (1:
    each by itself); `hidden` the share of markers not seen; `garbled` the share of frames with
    `garbled_bytes` random bytes behind the packet's header.
    """

    dropped: float = 0.0
    burst_frames: float = 1.0
    hidden: float = 0.0
    garbled: float = 0.0
    garbled_bytes: int = 4

    def __post_init__(self) -> None:
        for name in ("dropped", "hidden", "garbled"):
            share = getattr(self, name)
            if not 0 <= share < 1:
                raise ValueError(f"{name}: expected a share from 0 to below 1, found {share}")
        if self.burst_frames < 1:
            raise ValueError(f"burst_frames: expected at least 1, found {self.burst_frames}")


@dataclass(frozen=True)
class Outage:
    """A fault of the whole server, `at_s` after the first frame, for `for_s`.

    "stall": nothing is sent, and then all of it at once. "vanish": the server hangs up, refuses
    connections and comes back. "garbage": random bytes between two packets.
    """

    at_s: float
    for_s: float = 0.0
    kind: OutageKind = "vanish"

    def __post_init__(self) -> None:
        require_choice("kind", self.kind, ("stall", "vanish", "garbage"))


@dataclass(frozen=True)
class Fate:
    """What befalls one frame: dropped, some of its markers (M,) hidden, bytes garbled."""

    dropped: bool
    hidden: np.ndarray
    garbled: bool


class FaultSource:
    """Draws the fate of frame after frame from a seed."""

    def __init__(self, faults: Faults, n_markers: int, seed: int) -> None:
        frames, garbage = np.random.SeedSequence(seed).spawn(2)
        self._faults, self._n_markers = faults, n_markers
        self._rng, self._bytes = np.random.default_rng(frames), np.random.default_rng(garbage)
        self._in_burst = False

    def next_fate(self) -> Fate:
        """Return the fate of the next frame.

        Every frame takes equally many random numbers, so that its fate does not depend on that of
        others but for the bursts: a chain of two states with the given share and mean length.
        """
        faults = self._faults
        drop, garble, *hide = self._rng.random(2 + self._n_markers)
        begin = faults.dropped / (1 - faults.dropped) / faults.burst_frames
        self._in_burst = drop < (1 - 1 / faults.burst_frames if self._in_burst else begin)
        if faults.burst_frames == 1:
            self._in_burst = drop < faults.dropped
        hidden = np.asarray(hide) < faults.hidden
        return Fate(bool(self._in_burst), hidden, bool(garble < faults.garbled))

    def garbled(self, packet: bytes) -> bytes:
        """Return the packet with some bytes behind its header replaced."""
        damaged = np.frombuffer(packet, dtype=np.uint8).copy()
        count = min(self._faults.garbled_bytes, len(damaged) - HEADER.size)
        places = self._bytes.choice(np.arange(HEADER.size, len(damaged)), count, replace=False)
        damaged[places] ^= self._bytes.integers(1, 256, count, dtype=np.uint8)
        return damaged.tobytes()

    def garbage(self, count: int = 64) -> bytes:
        """Return random bytes."""
        return self._bytes.bytes(count)


def hide(markers: FloatArray, hidden: np.ndarray) -> FloatArray:
    """Return the markers (M, 3) with NaN for those that are hidden (M,)."""
    return np.where(hidden[:, None], np.nan, markers)
