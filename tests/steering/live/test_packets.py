import numpy as np
import pytest
from qtm_rt.packet import QRTComponentType, QRTPacket

from hopdata.steering.live import packets
from hopdata.steering.live.packets import (
    DATA,
    EVENT,
    HEADER,
    XML,
    StreamFrame,
    frame_3d,
    header_fault,
    payload_fault,
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
    assert np.isnan(markers[1]).all()  # a marker is seen as a whole or not at all
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


def test_a_sound_frame_has_no_fault():
    assert payload_fault(DATA, frame_3d(FRAME)[HEADER.size :]) == ""
    assert payload_fault(DATA, frame_3d(FRAME, residuals=True)[HEADER.size :]) == ""


def test_a_frame_cut_anywhere_has_a_fault():
    payload = frame_3d(FRAME)[HEADER.size :]
    assert all(payload_fault(DATA, payload[:k]) for k in range(len(payload)))
    assert payload_fault(DATA, payload + b"x")


def test_what_passes_the_check_can_be_read_by_the_client():
    """Any byte of a frame replaced: either it is refused, or the client reads it without error."""
    payload = frame_3d(FRAME)[HEADER.size :]
    refused = 0
    for place in range(len(payload)):
        for flip in (1, 0x80, 0xFF):
            damaged = bytearray(payload)
            damaged[place] ^= flip
            if payload_fault(DATA, bytes(damaged)):
                refused += 1
            else:
                QRTPacket(bytes(damaged)).get_3d_markers()
    assert refused > 40  # all of the counts, sizes and types, at least


def test_events_and_texts_are_checked():
    assert payload_fault(EVENT, b"\x03") == ""
    assert payload_fault(EVENT, b"\x63") == "an unknown event"
    assert payload_fault(EVENT, b"") == "an unknown event"
    assert payload_fault(XML, b"<a/>") == "text without its end"
    assert payload_fault(XML, b"<a/>\0") == ""
