import pytest
from qtm_rt.packet import QRTPacketType

from hopdata.steering.live.commands import FrameRequest, answer
from hopdata.steering.live.packets import HEADER


def reply(command):
    """Kind and text of the answer."""
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
