import asyncio

import numpy as np
import pytest
from qtm_rt.protocol import QTMProtocol

from hopdata.steering.live.packets import (
    DATA,
    EVENT,
    HEADER,
    StreamFrame,
    event,
    frame_3d,
    packet,
)
from hopdata.steering.live.screening import Screen

SOUND = [frame_3d(StreamFrame(k / 100, k, np.ones((2, 3)))) for k in range(1, 4)]


class Inner(asyncio.Protocol):
    def __init__(self, fail=False):
        self.got, self.fail = [], fail

    def data_received(self, data):
        self.got.append(data)
        if self.fail:
            raise KeyError("unheard of")


class Transport(asyncio.Transport):
    aborted = False

    def abort(self):
        self.aborted = True


def screened(pieces, inner=None):
    """Push pieces of bytes through a screen."""

    async def push():
        inner_ = inner or Inner()
        faults, transport = [], Transport()
        screen = Screen(inner_, faults.append)
        screen.connection_made(transport)
        for piece in pieces:
            screen.data_received(piece)
        return inner_.got, faults, screen.error, transport.aborted

    return asyncio.run(push())


@pytest.mark.parametrize("step", [1, 7, 8, 50, 10_000])
def test_packets_are_whole_however_they_come(step):
    stream = b"".join(SOUND)
    pieces = [stream[k : k + step] for k in range(0, len(stream), step)]
    assert screened(pieces) == (SOUND, [], None, False)


def test_a_damaged_packet_is_left_out_and_those_after_it_come():
    damaged = [packet(DATA, b"short"), packet(EVENT, b"\x63"), event(3)]
    got, faults, error, aborted = screened([b"".join([SOUND[0], *damaged, SOUND[1]])])
    assert got == [SOUND[0], event(3), SOUND[1]]
    assert faults == ["a frame cut short", "an unknown event"]
    assert (error, aborted) == (None, False)


@pytest.mark.parametrize("header", [bytes(8), HEADER.pack(7, 3), HEADER.pack(2**32 - 1, 3)])
def test_a_header_that_cannot_be_ends_the_connection(header):
    got, _, error, aborted = screened([SOUND[0] + header, SOUND[1]])
    assert got == SOUND[:1]  # and nothing after it
    assert "the stream is not of the protocol: packet of" in str(error)
    assert aborted


def test_a_packet_that_the_client_cannot_read_ends_the_connection():
    _, _, error, aborted = screened(SOUND, Inner(fail=True))
    assert "KeyError('unheard of')" in str(error)
    assert aborted


def mangled(rng):
    """A stream of packets with bytes replaced, taken out and put in."""
    stream = bytearray(b"".join([*SOUND, event(3), *SOUND]))
    for _ in range(rng.integers(1, 6)):
        place, kind = rng.integers(len(stream)), rng.integers(3)
        if kind == 0:
            stream[place] = rng.choice([0, 1, 3, 6, 255, rng.integers(256)])
        elif kind == 1:
            del stream[place : place + rng.integers(1, 20)]
        else:
            stream[place:place] = rng.bytes(rng.integers(1, 20)) * rng.integers(0, 2) or bytes(8)
    return bytes(stream)


def test_the_real_client_survives_whatever_comes_through():
    """Mangled streams end in sound packets or an error, never in an exception or for ever."""
    rng = np.random.default_rng(np.random.SeedSequence(17))

    async def push():
        read, errors = 0, 0
        for _ in range(1000):
            got = []
            client = QTMProtocol(loop=asyncio.get_running_loop())
            client.set_on_packet(lambda packet, got=got: got.append(packet.get_3d_markers()))
            screen = Screen(client, [].append)
            screen.connection_made(Transport())
            screen.data_received(mangled(rng))
            assert "client cannot read" not in str(screen.error)
            read, errors = read + len(got), errors + (screen.error is not None)
        return read, errors

    read, errors = asyncio.run(asyncio.wait_for(push(), 30))
    assert read > 2000
    assert errors > 200
