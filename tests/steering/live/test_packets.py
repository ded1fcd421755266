import asyncio
import struct

import numpy as np
import pytest
from loopback_server import StreamFrame, event, frame_3d, packet, parameters_xml
from qtm_rt.packet import QRTComponentType, QRTPacket
from qtm_rt.protocol import QTMProtocol

from hopdata.steering.live import packets
from hopdata.steering.live.packets import (
    DATA,
    EVENT,
    HEADER,
    XML,
    GarbageError,
    LabelError,
    Line,
    SettingsError,
    StreamParameters,
    check_settings,
    find_labels,
    header_fault,
    parts_fault,
    payload_fault,
    read_parameters,
)

MARKERS = np.array([[0.1, -0.2, 0.3], [np.nan, 1.0, 2.0], [1.25, 2.5, -0.125]])
FRAME = StreamFrame(12.34, 56, MARKERS)


def test_the_client_reads_back_a_frame():
    whole = frame_3d(FRAME)
    assert HEADER.unpack_from(whole) == (len(whole), DATA)
    packet = QRTPacket(whole[HEADER.size :])
    assert (packet.timestamp, packet.framenumber) == (12_340_000, 56)
    header, markers = packet.get_3d_markers()
    assert header.marker_count == 3
    np.testing.assert_allclose(markers[0], [100, -200, 300], rtol=1e-6)
    assert np.isnan(markers[1]).all()  # a marker is seen completely or not at all
    assert list(markers[2]) == [1250.0, 2500.0, -125.0]


def test_the_client_reads_back_residuals():
    packet = QRTPacket(frame_3d(FRAME, residuals=True)[HEADER.size :])
    assert set(packet.components) == {QRTComponentType.Component3dRes}
    _, markers = packet.get_3d_markers_residual()
    assert markers[0].residual == 0
    assert markers[0].x == pytest.approx(100)


@pytest.mark.parametrize(
    ("size", "kind", "sound"),
    [
        (8, DATA, True),
        (0, DATA, False),  # the client would read it for ever
        (7, DATA, False),
        (packets.LONGEST, DATA, True),
        (packets.LONGEST + 1, DATA, False),
        (packets.LONGEST + 1, XML, True),
        (100, 10, False),
    ],
)
def test_headers_are_checked(size, kind, sound):
    assert (header_fault(size, kind) == "") is sound


def test_sound_frames_and_events_have_no_fault():
    assert payload_fault(DATA, frame_3d(FRAME)[HEADER.size :]) == ""
    assert payload_fault(DATA, frame_3d(FRAME, residuals=True)[HEADER.size :]) == ""
    assert payload_fault(EVENT, b"\x03") == ""


def test_a_frame_cut_anywhere_has_a_fault():
    payload = frame_3d(FRAME)[HEADER.size :]
    assert all(payload_fault(DATA, payload[:k]) for k in range(len(payload)))


def test_unknown_events_have_a_fault():
    assert payload_fault(EVENT, b"\x63").startswith("an event that cannot be read: 99")
    assert payload_fault(EVENT, b"").startswith("an event that cannot be read")


def test_labels_and_rate_come_back():
    document = parameters_xml(["body <1>", "boom"], 99.5, parts=["general", "3d"])
    parameters = read_parameters(document)
    assert parameters.labels == ("body <1>", "boom")
    assert parameters.rate_hz == 99.5


def test_only_the_parts_asked_for_are_sent():
    assert read_parameters(parameters_xml(["a"], 100, parts=["general"])).labels == ()
    assert read_parameters(parameters_xml(["a"], 100, parts=["3d"])).rate_hz is None


def test_what_is_not_xml_is_an_error():
    with pytest.raises(GarbageError, match="expected XML"):
        read_parameters(b"<QTM")


def test_our_own_settings_are_sound():
    parameters = read_parameters(parameters_xml(["a"], 100, parts=["all"]))
    assert parameters.upwards == "+Z"
    check_settings(parameters, 100.0)
    check_settings(parameters, None)
    check_settings(StreamParameters(("a",), None), 100.0)  # no remark


def test_another_axis_or_rate_is_an_error():
    with pytest.raises(
        SettingsError, match=r"points up in the stream: expected \+Z, found \+Y"
    ):
        check_settings(StreamParameters(("a",), 100.0, "+Y"), 100.0)
    with pytest.raises(
        SettingsError, match=r"100 Hz \(rate_hz.*--rate\), found 300 Hz"
    ):
        check_settings(StreamParameters(("a",), 300.0, "+Z"), 100.0)


def test_markers_are_found_by_label():
    assert find_labels(["c", "a"], ["a", "b", "c"]) == [2, 0]


def test_a_missing_label_is_named_with_the_nearest():
    with pytest.raises(
        LabelError, match=r"marker 'bodi1' .*\(body1, boom\); did you mean 'body1'"
    ):
        find_labels(["boom", "bodi1"], ["body1", "boom"])


def test_a_label_that_stands_twice_is_refused():
    with pytest.raises(LabelError, match="more than once"):
        find_labels(["a"], ["a", "a"])


SOUND = [frame_3d(StreamFrame(k / 100, k, np.ones((2, 3)))) for k in range(1, 4)]


class Inner(asyncio.Protocol):
    def __init__(self):
        self.got = []

    def data_received(self, data):
        self.got.append(data)


class Transport(asyncio.Transport):
    aborted = False

    def abort(self):
        self.aborted = True


def push(pieces, client, on_garbled):
    """Push pieces of bytes through a line to a client; return what ended it, and whether it did."""
    line, transport = Line(on_garbled), Transport()
    line._client = client
    line.connection_made(transport)
    for piece in pieces:
        line.data_received(piece)
    return line.error, transport.aborted


def screened(pieces):
    inner, faults = Inner(), []
    return inner.got, faults, *push(pieces, inner, faults.append)


@pytest.mark.parametrize("step", [1, 7, 8, 50, 10_000])
def test_packets_are_whole_however_they_come(step):
    stream = b"".join(SOUND)
    pieces = [stream[k : k + step] for k in range(0, len(stream), step)]
    assert screened(pieces) == (SOUND, [], None, False)


def test_a_damaged_packet_is_left_out_and_those_after_it_come():
    damaged = [packet(DATA, b"short"), packet(EVENT, b"\x63"), event(3)]
    got, faults, error, aborted = screened([b"".join([SOUND[0], *damaged, SOUND[1]])])
    assert got == [SOUND[0], event(3), SOUND[1]]
    assert [fault.split(":")[0] for fault in faults] == [
        "a frame that cannot be read", "an event that cannot be read",
    ]  # fmt: skip
    assert (error, aborted) == (None, False)


@pytest.mark.parametrize(
    "header", [bytes(8), HEADER.pack(7, 3), HEADER.pack(2**32 - 1, 3)]
)
def test_a_header_that_cannot_be_ends_the_connection(header):
    got, _, error, aborted = screened([SOUND[0] + header, SOUND[1]])
    assert got == SOUND[:1]  # nothing follows it
    assert "the stream is not of the protocol: packet of" in str(error)
    assert aborted


def mangled(rng):
    """Return a stream of packets with bytes replaced, removed and inserted."""
    stream = bytearray(b"".join([*SOUND, event(3), *SOUND]))
    for _ in range(rng.integers(1, 6)):
        place, kind = rng.integers(len(stream)), rng.integers(3)
        if kind == 0:
            stream[place] = rng.choice([0, 1, 3, 6, 255, rng.integers(256)])
        elif kind == 1:
            del stream[place : place + rng.integers(1, 20)]
        else:
            stream[place:place] = rng.bytes(rng.integers(1, 20)) * rng.integers(
                0, 2
            ) or bytes(8)
    return bytes(stream)


def test_the_real_client_survives_whatever_comes_through():
    """Mangled streams end in sound packets or an error, not in an exception or endless loop."""
    rng = np.random.default_rng(np.random.SeedSequence(17))

    async def push_all():
        read, errors = 0, 0
        for _ in range(1000):
            got = []
            client = QTMProtocol(loop=asyncio.get_running_loop())
            client.set_on_packet(
                lambda packet, got=got: got.append(packet.get_3d_markers())
            )
            error, _ = push([mangled(rng)], client, [].append)
            read, errors = read + len(got), errors + (error is not None)
        return read, errors

    read, errors = asyncio.run(asyncio.wait_for(push_all(), 30))
    assert read > 2000
    assert errors > 200


# Lengths are checked before the client of the protocol sees them.


def data(stated, *components):
    """Return the payload of a frame that states so many components, and holds these."""
    return struct.pack("<qII", 10_000, 1, stated) + b"".join(components)


def component(body, *, kind=1, size=None):
    return HEADER.pack(HEADER.size + len(body) if size is None else size, kind) + body


def markers(stated, count, *, bytes_each=12):
    return struct.pack("<Ihh", stated, 0, 0) + bytes(bytes_each * count)


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"", "expected 16 bytes before the components, found 0"),
        (data(2**32 - 1, component(markers(0, 0), size=0)), "room for the 4294967295 components"),
        (data(1), "expected room for the 1 components stated, found room for 0"),
        (data(1, component(markers(0, 0), size=0)), "component at byte 16, found 0"),
        (data(1, component(markers(0, 0), size=7)), "component at byte 16, found 7"),
        (data(1, component(markers(0, 0), size=17)), "component at byte 16, found 17"),
        (data(2, component(markers(0, 0)), b""), "expected a component at byte 32, found the end"),
        (data(1, component(b"1234567")), "16 bytes before the markers at byte 16, found 15"),
        (data(1, component(markers(2, 1))), "2 markers stated at byte 16, found room"),
        (data(1, component(markers(2**32 - 1, 1))), "the 4294967295 markers stated at byte 16"),
        (data(1, component(markers(3, 3), kind=9)), "3 markers stated at byte 16, found room"),
        (data(1, component(markers(2, 2), kind=10)), "16, found room for 1"),
    ],
)  # fmt: skip
def test_a_length_that_does_not_fit_the_bytes_is_told(payload, words):
    assert words in parts_fault(payload)
    assert payload_fault(DATA, payload).startswith(
        "a frame that cannot be read: expected "
    )


def test_lengths_that_fit_have_no_fault():
    assert parts_fault(data(0)) == ""
    assert parts_fault(data(1, component(markers(3, 3)))) == ""
    assert parts_fault(data(1, component(markers(3, 3, bytes_each=16), kind=9))) == ""
    assert (
        parts_fault(data(2, component(b"abc", kind=4), component(markers(1, 1)))) == ""
    )
    assert parts_fault(data(1, component(b"", kind=4))) == ""
    for residuals in (False, True):
        assert parts_fault(frame_3d(FRAME, residuals=residuals)[HEADER.size :]) == ""


def test_the_work_is_bounded_by_the_bytes_whatever_a_packet_states(monkeypatch):
    read = []

    class Counted:
        """Counts how often a header is read."""

        size = HEADER.size

        def unpack_from(self, *arguments):
            read.append(1)
            return HEADER.unpack_from(*arguments)

    monkeypatch.setattr(packets, "HEADER", Counted())
    forty_bytes = data(2**32 - 1, component(markers(0, 0), size=0))
    assert len(forty_bytes) == 40 - HEADER.size
    assert parts_fault(forty_bytes)
    assert not read
    rng = np.random.default_rng(np.random.SeedSequence(19))
    passed = 0
    for _ in range(3000):
        payload = bytearray(
            data(2, component(markers(3, 3)), component(b"x" * 20, kind=4))
        )
        for place in rng.integers(8, len(payload), size=rng.integers(0, 4)):
            payload[place] = rng.choice([0, 1, 8, 255, rng.integers(256)])
        del payload[rng.integers(16, 2 * len(payload)) :]
        read.clear()
        passed += parts_fault(bytes(payload)) == ""
        assert len(read) <= len(payload) / HEADER.size
    assert 300 < passed < 2700
