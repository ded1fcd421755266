import asyncio
import socket
import struct

import numpy as np
import pytest
import qtm_rt
from loopback import LABELS, LONG_S, our_threads, ramp, wait_until
from loopback_server import Faults, FrameRequest, LoopbackServer, Outage, answer, text
from qtm_rt.packet import QRTPacketType

from hopdata.errors import ConfigError
from hopdata.steering.live.packets import COMMAND, HEADER, LiveError, PortError

FAST = float("inf")


async def stream(server, n_frames, frames="allframes", components=("3d",)):
    """Return the frames that the unmodified client reads: number, time in us, markers in mm."""
    got, enough = [], asyncio.Event()

    def keep(packet):
        _, markers = packet.get_3d_markers()
        got.append((packet.framenumber, packet.timestamp, np.array(markers)))
        if len(got) >= n_frames:
            enough.set()

    connection = await qtm_rt.connect("127.0.0.1", port=server.port)
    await connection.stream_frames(frames, components=list(components), on_packet=keep)
    await asyncio.wait_for(enough.wait(), LONG_S)
    connection.disconnect()
    return got[:n_frames]


def run(work):
    return asyncio.run(asyncio.wait_for(work, LONG_S))


def test_the_unmodified_client_reads_what_the_source_gave():
    with LoopbackServer(ramp(50), LABELS, speed=FAST) as server:
        frames = run(stream(server, 50))
    for k, (number, microseconds, markers) in enumerate(frames):
        assert (number, microseconds) == (k + 1, 10_000 * k)
        np.testing.assert_allclose(markers[:, 0], k + np.arange(4) / 10, rtol=1e-6)
        np.testing.assert_allclose(markers[:, 2], 300, rtol=1e-6)


@pytest.mark.parametrize("frames", ["frequency:25", "frequencydivisor:4"])
def test_every_fourth_frame_can_be_asked_for(frames):
    with LoopbackServer(ramp(80), LABELS, speed=FAST) as server:
        assert [f[0] for f in run(stream(server, 10, frames))] == list(range(4, 44, 4))


def test_the_client_s_other_questions_are_answered():
    async def ask(server):
        connection = await qtm_rt.connect("127.0.0.1", port=server.port)
        answers = [await connection.qtm_version(), await connection.byte_order()]
        state = await connection.get_state()
        xml = await connection.get_parameters(["all"])
        with pytest.raises(qtm_rt.QRTCommandException, match="Parse error"):
            await connection.get_current_frame(components=["6d"])
        connection.disconnect()
        return answers, state, xml

    with LoopbackServer(ramp(1), LABELS) as server:
        answers, state, xml = run(ask(server))
    assert answers[0].startswith(b"QTM Version")
    assert answers[1] == b"Byte order is little endian"
    assert state is qtm_rt.QRTEvent.EventCaptureStarted
    assert b"<Name>boom</Name>" in xml


def test_the_current_frame_can_be_asked_for():
    async def ask(server):
        await stream(server, 3)
        connection = await qtm_rt.connect("127.0.0.1", port=server.port)
        packet = await connection.get_current_frame(components=["3d"])
        connection.disconnect()
        return packet.framenumber

    with LoopbackServer(ramp(5), LABELS, speed=FAST) as server:
        assert 3 <= run(ask(server)) <= 5


def test_another_version_is_refused():
    with LoopbackServer(ramp(1), LABELS) as server:
        assert run(qtm_rt.connect("127.0.0.1", port=server.port, version="1.8")) is None


def test_several_clients_get_the_same_frames():
    async def both(server):
        return await asyncio.gather(stream(server, 30), stream(server, 30))

    with LoopbackServer(ramp(400), LABELS, speed=5) as server:
        one, two = run(both(server))
    by_number = {f[0]: f[2] for f in one}
    common = [f for f in two if f[0] in by_number]
    assert len(common) > 10
    assert all(np.array_equal(by_number[f[0]], f[2]) for f in common)


def test_frames_come_in_real_time():
    async def clocked(server):
        loop = asyncio.get_running_loop()
        start = loop.time()
        await stream(server, 41)
        return loop.time() - start

    with LoopbackServer(ramp(60), LABELS, rate_hz=200.0) as server:
        assert run(clocked(server)) >= 40 / 200 - 0.01


def test_faults_are_those_of_the_seed():
    faults = Faults(dropped=0.1, hidden=0.1)

    def one_run(seed):
        with LoopbackServer(
            ramp(200), LABELS, speed=FAST, faults=faults, seed=seed
        ) as server:
            frames = run(stream(server, 150))
        return [f[0] for f in frames], np.isnan([f[2] for f in frames])

    first, again, other = one_run(1), one_run(1), one_run(2)
    assert first[0] == again[0] != other[0]
    assert np.array_equal(first[1], again[1])
    assert first[0][-1] > 150  # some were dropped
    assert first[1].any()


def test_a_port_in_use_is_a_clear_error():
    with (
        LoopbackServer(ramp(1), LABELS) as server,
        pytest.raises(
            PortError, match=f"cannot listen on 127.0.0.1, port {server.port}"
        ),
    ):
        LoopbackServer(ramp(1), LABELS, port=server.port).start()


def test_it_listens_on_the_loopback_address_only():
    with LoopbackServer(ramp(1), LABELS) as server:
        assert server._socket.getsockname()[0] == "127.0.0.1"


def test_a_client_that_leaves_in_the_middle_of_a_packet_harms_nobody():
    with LoopbackServer(ramp(2000), LABELS, speed=FAST) as server:
        with socket.create_connection(("127.0.0.1", server.port)) as rude:
            rude.sendall(text(COMMAND, "version 1.25")[:11])
        with socket.create_connection(("127.0.0.1", server.port)) as rude:
            rude.sendall(
                text(COMMAND, "version 1.25")
                + text(COMMAND, "streamframes allframes 3d")
            )
            rude.recv(40)
            rude.setsockopt(
                socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
            )
        assert len(run(stream(server, 20))) == 20


@pytest.mark.parametrize(
    "garbage", [HEADER.pack(0, 0), HEADER.pack(1 << 31, COMMAND), b"GET / HTTP/1.1"]
)
def test_a_client_that_sends_garbage_is_told_and_dropped(garbage):
    with LoopbackServer(ramp(2000), LABELS, speed=FAST) as server:
        with socket.create_connection(
            ("127.0.0.1", server.port), timeout=LONG_S
        ) as rude:
            rude.sendall(garbage)
            said = b"".join(iter(lambda: rude.recv(1000), b""))
        assert b"Parse error" in said
        assert server.counts.refused_packets == 1
        assert len(run(stream(server, 20))) == 20


def test_a_client_that_does_not_read_does_not_hold_up_the_others():
    with (
        LoopbackServer(ramp(10**6), LABELS, speed=20) as server,
        socket.create_connection(("127.0.0.1", server.port)) as lazy,
    ):
        lazy.sendall(text(COMMAND, "streamframes allframes 3d"))
        assert len(run(stream(server, 200))) == 200


def test_closing_leaves_no_thread_behind():
    server = LoopbackServer(ramp(10**6), LABELS, speed=10).start()
    connected = socket.create_connection(("127.0.0.1", server.port))
    wait_until(lambda: server.counts.connections == 1)
    server.begin(Outage(0, 60, "vanish"))
    server.close()
    server.close()
    connected.close()
    assert our_threads() == []


def test_a_server_that_was_never_started_can_be_closed():
    LoopbackServer(ramp(1), LABELS).close()


def test_a_source_that_fails_is_reported():
    def source():
        yield from ramp(3)
        raise RuntimeError("fell over")

    server = LoopbackServer(source(), LABELS, speed=FAST).start()
    with socket.create_connection(("127.0.0.1", server.port)) as client:
        client.sendall(text(COMMAND, "streamframes allframes 3d"))
        wait_until(lambda: not server._thread._thread.is_alive())
    with pytest.raises(LiveError, match="fell over"):
        server.close()


def test_the_end_of_the_source_is_noted():
    with LoopbackServer(ramp(20), LABELS, speed=FAST) as server:
        run(stream(server, 20))
        assert server.ended.wait(LONG_S)
        assert server.counts.frames == 20


@pytest.mark.parametrize(
    "wrong", [{"rate_hz": 0}, {"rate_hz": FAST}, {"speed": 0}, {"speed": -1}]
)
def test_a_server_without_a_pace_is_refused(wrong):
    with pytest.raises(ConfigError, match=f"{next(iter(wrong))}: expected more than 0"):
        LoopbackServer(ramp(1), LABELS, **wrong)


def reply(command):
    """Return kind and text of the answer."""
    whole = answer(command, ("a", "b"), 100.0)
    size, kind = HEADER.unpack_from(whole)
    assert size == len(whole)
    return QRTPacketType(kind), whole[HEADER.size :].rstrip(b"\0").decode()


@pytest.mark.parametrize(
    ("command", "wanted"),
    [
        ("StreamFrames AllFrames 3D", FrameRequest(1)),
        ("streamframes frequency:50 3d", FrameRequest(2)),
        ("streamframes frequency:500 3d", FrameRequest(1)),
        ("streamframes frequencydivisor:7 3dres", FrameRequest(7, residuals=True)),
        ("streamframes stop", FrameRequest(-1)),
        ("getcurrentframe 3d", FrameRequest(0)),
    ],
)
def test_requests_for_frames(command, wanted):
    assert answer(command, ("a",), 100.0) == wanted


@pytest.mark.parametrize(
    "command",
    [
        "",
        "reboot",
        "streamframes",
        "streamframes allframes",
        "streamframes allframes 6d",
        "streamframes allframes 3d analog",
        "streamframes frequency:0 3d",
        "streamframes frequency:x 3d",
        "streamframes sometimes:3 3d",
    ],
)
def test_what_is_not_understood_is_an_error(command):
    assert reply(command) == (QRTPacketType.PacketError, "Parse error")


def test_versions():
    assert reply("version") == (QRTPacketType.PacketCommand, "Version is 1.25")
    assert reply("version 1.25") == (QRTPacketType.PacketCommand, "Version set to 1.25")
    assert reply("version 1.8")[0] is QRTPacketType.PacketError


def test_parameters_are_xml():
    kind, words = reply("getparameters 3d")
    assert kind is QRTPacketType.PacketXML
    assert "<Labels>2</Labels>" in words
