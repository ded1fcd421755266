"""Rigid bodies by `motioncapture`: its mock type, and a module with the same calls.

The mock type of the library gives frames without bodies, so bodies come from a module
that is called in the same way.
"""

import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hopdata.errors import ConfigError
from hopdata.steering.live.packets import (
    ClientAbsentError,
    ConnectionLostError,
    LabelError,
    SettingsError,
)  # fmt: skip
from hopdata.steering.live.sources import stream_of
from hopdata.steering.live.sources.rigid_bodies import ARM_M, RigidBodyStream
from hopdata.steering.live.stream import Patience

LABELS = ("hopper.o", "hopper.x", "hopper.y", "boom.o")
QUICK = Patience(answer_s=0.3, reconnect_s=0.3, retry_s=0.05)
TURN = Rotation.from_euler("zyx", [0.7, -0.2, 0.4])


def body(position, turn=TURN):
    x, y, z, w = turn.as_quat()
    rotation = SimpleNamespace(x=x, y=y, z=z, w=w)
    return SimpleNamespace(position=np.array(position), rotation=rotation)


class Capture:
    """Gives a frame every 5 ms, in every fourth of them without the boom."""

    def __init__(self, *, frames=10**6, names=("hopper", "boom")):
        self._frames = frames
        self._names = names
        self._count = -1

    def waitForNextFrame(self):  # noqa: N802 - the library's name
        time.sleep(0.005)
        self._count += 1
        if self._count >= self._frames:
            raise RuntimeError("the connection is closed")

    @property
    def rigidBodies(self):  # noqa: N802 - the library's name
        bodies = {name: body([self._count, 2.0, 3.0]) for name in self._names}
        if self._count % 4 == 3:
            bodies.pop("boom", None)
        return bodies


@pytest.fixture
def library(monkeypatch):
    """Return a function that puts a module in place of the library."""

    def put(connect):
        monkeypatch.setitem(
            sys.modules, "motioncapture", SimpleNamespace(connect=connect)
        )

    return put


def stream(host="vicon:10.0.0.2", labels=LABELS):
    return RigidBodyStream(labels, host=host, rate_hz=200.0, patience=QUICK)


def test_points_of_bodies_are_where_the_bodies_are(library):
    asked = []

    def connect(system, options):
        asked.append((system, options))
        return Capture()

    library(connect)
    with stream() as reader:
        reader.wait_until_streaming(10.0)
        assert reader.buffer.wait(8, 10.0)
    assert asked == [("vicon", {"hostname": "10.0.0.2"})]
    for frame in reader.buffer.since(0):
        origin = np.array([frame.number, 2.0, 3.0])
        axes = ARM_M * TURN.as_matrix()
        wanted = [origin, origin + axes[:, 0], origin + axes[:, 1], origin]
        if frame.number % 4 == 3:
            wanted[3] = [np.nan] * 3
        np.testing.assert_allclose(frame.markers, wanted, atol=1e-12)
    assert reader.counts.hidden_markers >= 1


def test_a_system_that_goes_is_lost_and_asked_again(library):
    connections = []

    def connect(system, options):
        connections.append(system)
        if len(connections) == 2:
            raise RuntimeError("no route to host")
        return Capture(frames=5)

    library(connect)
    with stream() as reader:
        reader.wait_until_streaming(10.0)
        assert reader.buffer.wait(5, 10.0)
    told = [state.message for state in reader.states.history() if state.state == "lost"]
    assert any("the connection is closed" in message for message in told)
    assert any("vicon at 10.0.0.2: no route to host" in message for message in told)
    assert len({frame.epoch for frame in reader.buffer.since(0)}) == 2


def test_a_system_that_falls_silent_is_stale_then_lost_and_closes_at_once(library):
    silent = threading.Event()

    class Silent(Capture):
        def waitForNextFrame(self):  # noqa: N802 - the library's name
            super().waitForNextFrame()
            if self._count == 3:
                silent.wait(30.0)

    library(lambda *_: Silent())
    with stream() as reader:
        reader.wait_until_streaming(10.0)
        assert reader.states.wait_for("stale", timeout_s=10.0)
        assert reader.states.wait_for("lost", timeout_s=10.0)
        begun = time.monotonic()
    assert time.monotonic() - begun < 5.0
    silent.set()


def test_a_body_that_never_comes_is_named(library):
    library(lambda *_: Capture(names=("hoper",)))
    with stream(labels=("hopper.o",)) as reader:
        assert reader.states.wait_for("lost", timeout_s=10.0)
    told = [state.message for state in reader.states.history()]
    assert any(
        "'hopper' is not among those of the system (hoper)" in one for one in told
    )


@pytest.mark.parametrize(
    ("host", "labels", "error", "message"),
    [
        ("vicom:10.0.0.2", LABELS, SettingsError, "did you mean 'vicon'"),
        ("10.0.0.2", LABELS, SettingsError, "expected SYSTEM:ADDRESS"),
        ("vicon:a", ("hopper",), LabelError, "expected BODY.POINT"),
        ("vicon:a", ("hopper.z",), LabelError, "one of the points o, x, y"),
    ],
)
def test_what_cannot_be_read_is_refused(host, labels, error, message):
    with pytest.raises(error, match=message):
        stream(host, labels)


def test_without_the_library_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "motioncapture", None)
    options = {"host": "vicon:a", "port": 0, "rate_hz": 100.0}
    with pytest.raises(
        ClientAbsentError, match=r"pip install 'hopdata\[motioncapture\]'"
    ):
        stream_of("motioncapture", LABELS, **options).start()
    with pytest.raises(
        ConfigError, match="--source: expected one of qualisys, motioncapture, lsl"
    ):
        stream_of("vicon", LABELS, **options)


def test_the_library_itself_gives_frames_of_its_mock_type():
    pytest.importorskip(
        "motioncapture", reason="the extra `motioncapture` is not installed"
    )
    with stream("mock:", LABELS) as reader:
        reader.wait_until_streaming(10.0)
        assert reader.buffer.wait(3, 10.0)
        assert np.isnan(reader.buffer.newest().markers).all()  # it has no bodies
        assert reader.states.wait_for("lost", timeout_s=10.0)
    told = [state.message for state in reader.states.history()]
    assert any("'boom' is not among those of the system (none)" in one for one in told)
    assert not isinstance(reader.failure, ConnectionLostError)
