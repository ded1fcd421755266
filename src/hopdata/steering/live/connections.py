"""Connections of the server: its clients, and the socket on which it waits for them."""

from __future__ import annotations

import asyncio
import socket

from hopdata.steering.live.errors import PortError
from hopdata.steering.live.packets import COMMAND, HEADER, header_fault

LOOPBACK = "127.0.0.1"  # heard on this computer alone

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
