"""Bytes are screened before the client of the protocol sees them.

The client trusts what it is sent: a header that says "0 bytes" makes it read that packet for ever,
an unknown event or a damaged component ends its connection, and an absurd size makes it wait for
data that never come. So whole packets are cut out here and checked, and it gets sound ones only.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from hopdata.steering.live.errors import GarbageError
from hopdata.steering.live.packets import HEADER, header_fault, payload_fault

LOOK_AGAIN_S = 0.02


class Screen(asyncio.Protocol):
    """Stands between a connection and the protocol that reads it.

    A damaged payload is left out and reported; when it is lost where packets begin, the connection
    is closed, and `error` says why.

    Parameters
    ----------
    inner : asyncio.Protocol
        Gets whole, sound packets.
    on_garbled : callable
        Called with what is wrong with each packet that is left out.
    """

    def __init__(self, inner: asyncio.Protocol, on_garbled: Callable[[str], None]) -> None:
        self.error: GarbageError | None = None
        self.lost = asyncio.Event()
        self._inner, self._on_garbled = inner, on_garbled
        self._transport: asyncio.BaseTransport | None = None
        self._bytes = bytearray()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Pass on that the connection stands."""
        self._transport = transport
        self._inner.connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass on that the connection is gone."""
        self._transport = None
        self._inner.connection_lost(exc)
        self.lost.set()

    def data_received(self, data: bytes) -> None:
        """Cut out whole packets, check them and pass on the sound ones."""
        if self.error is not None:
            return
        self._bytes += data
        while self.error is None and len(self._bytes) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._bytes)
            fault = header_fault(size, kind)
            if fault:
                self._give_up(fault)
            elif len(self._bytes) < size:
                return
            else:
                whole = bytes(self._bytes[:size])
                del self._bytes[:size]
                self._pass_on(kind, whole)

    def close(self) -> None:
        """Close the connection at once."""
        if isinstance(self._transport, asyncio.Transport):
            self._transport.abort()

    def _pass_on(self, kind: int, whole: bytes) -> None:
        fault = payload_fault(kind, whole[HEADER.size :])
        if fault:
            self._on_garbled(fault)
            return
        try:
            self._inner.data_received(whole)
        except Exception as error:  # the client keeps what it could not read, and is of no more use
            self._give_up(f"a packet that the client cannot read ({error!r})")

    def _give_up(self, fault: str) -> None:
        self.error = GarbageError(f"the stream is not of the protocol: {fault}")
        self._bytes.clear()
        self.close()


class ScreenedLoop:
    """What the client asks of an event loop: futures, and a connection, which is screened.

    After `create_connection`, `screen` is the screen, or `failure` says why there is none.
    """

    def __init__(self, on_garbled: Callable[[str], None]) -> None:
        self.screen: Screen | None = None
        self.failure: OSError | None = None
        self._on_garbled = on_garbled

    async def until_lost(self) -> None:
        """Wait until there is no connection any more, if there ever was one."""
        while self.screen is None:
            await asyncio.sleep(LOOK_AGAIN_S)
        await self.screen.lost.wait()

    def close(self) -> None:
        """Close the connection at once, if there is one."""
        if self.screen is not None:
            self.screen.close()

    def create_future(self) -> asyncio.Future[Any]:
        """Return a future of the running loop."""
        return asyncio.get_running_loop().create_future()

    async def create_connection(
        self, factory: Callable[[], asyncio.Protocol], host: str, port: int
    ) -> tuple[asyncio.BaseTransport, asyncio.Protocol]:
        """Connect, with a screen in front of the protocol that the factory makes."""
        inner = factory()
        self.screen = Screen(inner, self._on_garbled)
        screen = self.screen
        try:
            loop = asyncio.get_running_loop()
            transport, _ = await loop.create_connection(lambda: screen, host, port)
        except OSError as error:
            self.failure = error
            raise
        return transport, inner
