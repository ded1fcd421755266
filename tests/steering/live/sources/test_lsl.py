"""Markers from an LSL outlet in a process of its own, on this machine."""

import subprocess
import sys
import threading

import numpy as np
import pytest

from hopdata.steering.live.packets import (
    ClientAbsentError,
    ConnectionLostError,
    LabelError,
    SettingsError,
)  # fmt: skip
from hopdata.steering.live.sources import stream_of
from hopdata.steering.live.sources.lsl import LslStream, channels_of, placed
from hopdata.steering.live.stream import Patience

LABELS = ("body2", "boom")
QUICK = Patience(answer_s=3.0, reconnect_s=1.0, retry_s=0.05)

# Sends frame k with body1 at (k, 0.5, 1), body2 at (k, -0.5, 2), m, and the boom at
# (1000 k, 0, 3000), mm; frame 5 of each ten is left out, and in frame 7 body2 is hidden.
OUTLET = """
import sys, time
import pylsl
info = pylsl.StreamInfo(sys.argv[1], "MoCap", 9, 100.0, pylsl.cf_double64, sys.argv[1])
channels = info.desc().append_child("channels")
for marker in ("body1", "body2", "boom"):
    for axis in "XYZ":
        channel = channels.append_child("channel")
        channel.append_child_value("label", f"{marker}.{axis}")
        if marker != "boom":
            channel.append_child_value("marker", marker)
        channel.append_child_value("type", f"Position{axis}")
        channel.append_child_value("unit", "millimeters" if marker == "boom" else "meters")
outlet = pylsl.StreamOutlet(info)
print("ready", flush=True)
assert outlet.wait_for_consumers(60.0)
begun = pylsl.local_clock()
for k in range(int(sys.argv[2])):
    due = begun + k / 100
    time.sleep(max(0.0, due - pylsl.local_clock()))
    if k % 10 != 5:
        hidden = float("nan") if k % 10 == 7 else -0.5
        outlet.push_sample([k, 0.5, 1, k, hidden, 2, 1000 * k, 0, 3000], due)
"""


def pylsl():
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:
        pytest.skip(f"pylsl: {error}")
    return pylsl


@pytest.fixture
def outlet(tmp_path, monkeypatch):
    """Return a function that starts an outlet of a name, found on this machine only."""
    pylsl()
    settings = tmp_path / "lsl_api.cfg"
    settings.write_text("[multicast]\nResolveScope = machine\n")
    monkeypatch.setenv("LSLAPICFG", str(settings))
    begun = []

    def start(name, frames):
        process = subprocess.Popen(
            [sys.executable, "-c", OUTLET, name, str(frames)],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        begun.append(process)
        assert process.stdout.readline() == "ready\n"

    yield start
    for process in begun:
        process.kill()
        process.wait()
        process.stdout.close()


def stream(name, labels=LABELS, rate_hz=100.0):
    return LslStream(labels, host=name, rate_hz=rate_hz, patience=QUICK)


def test_frames_of_another_process_are_those_that_it_sent(outlet):
    outlet("hopdata-test-frames", 40)
    with stream("hopdata-test-frames") as reader:
        reader.wait_until_streaming(30.0)
        lost = reader.states.wait_for("lost", timeout_s=30.0)
        assert lost is not None
        assert "the LSL stream is lost" in lost.message
    frames = reader.buffer.since(0)
    assert len(frames) >= 30
    first = frames[0]
    for frame in frames:
        k = round(frame.markers[1, 0])  # the boom's, mm
        assert k % 10 != 5
        seen = [k, -0.5, 2.0] if k % 10 != 7 else [np.nan] * 3
        np.testing.assert_allclose(frame.markers, [seen, [k, 0.0, 3.0]], rtol=1e-12)
        # A frame that was left out has its number.
        assert frame.number - first.number == k - round(first.markers[1, 0])
        assert frame.time_s - first.time_s == pytest.approx(
            0.01 * (frame.number - first.number)
        )
        assert frame.captured_s <= frame.arrival_s
    n_missing = frames[-1].number - first.number + 1 - len(frames)
    assert reader.counts.missing == n_missing >= 3
    assert reader.counts.hidden_markers >= 3
    assert reader.counts.garbled == 0
    alive = {thread.name for thread in threading.enumerate()}
    assert "hopdata-stream" not in alive


@pytest.mark.parametrize(
    ("labels", "rate_hz", "error", "message"),
    [
        (("body2", "bom"), 100.0, LabelError, "'bom' is not one of .*boom"),
        (LABELS, 250.0, SettingsError, "frame rate of the stream: expected 250 Hz"),
    ],
)
def test_a_stream_that_is_set_up_differently_is_refused(
    outlet, labels, rate_hz, error, message
):
    outlet("hopdata-test-refused", 1)
    with (
        stream("hopdata-test-refused", labels, rate_hz) as reader,
        pytest.raises(error, match=message),
    ):
        reader.wait_until_streaming(30.0)


def test_without_a_stream_it_says_so():
    pylsl()
    patience = Patience(answer_s=0.2, retry_s=0.05)
    reader = LslStream(LABELS, host="nobody-sends-this", patience=patience)
    with (
        reader,
        pytest.raises(ConnectionLostError, match="nobody-sends-this: none is there"),
    ):
        reader.wait_until_streaming(1.0)


def test_without_the_library_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(ClientAbsentError, match=r"pip install 'hopdata\[lsl\]'"):
        stream_of("lsl", LABELS, host="", port=0, rate_hz=100.0).start()


def entries(unit="m"):
    rows = [("body2", axis) for axis in "XYZ"] + [("boom", axis) for axis in "ZYX"]
    return [
        {"marker": marker, "label": "", "type": f"Position{axis}", "unit": unit}
        for marker, axis in rows
    ]


def test_axes_may_come_in_any_order_and_units_are_lengths():
    channels, scales = channels_of(entries("mm"), ["boom", "body2"])
    assert channels.tolist() == [[5, 4, 3], [0, 1, 2]]
    assert (scales == 1e-3).all()
    markers = placed([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], (channels, scales))
    np.testing.assert_allclose(markers, [[6e-3, 5e-3, 4e-3], [1e-3, 2e-3, 3e-3]])
    for unit in ("", "inch"):
        with pytest.raises(
            SettingsError, match=r"LSL channel 1 \(body2\): expected one of"
        ):
            channels_of(entries(unit), ["body2"])
    with pytest.raises(LabelError, match="'boom' is not one of"):
        channels_of(entries()[:5], ["boom"])


def test_a_marker_at_the_origin_to_the_bit_is_hidden():
    channels, scales = channels_of(entries(), ["body2", "boom"])
    markers = placed([0.0, 0.0, 0.0, 0.0, 0.1, 0.0], (channels, scales))
    assert np.isnan(markers[0]).all()
    assert markers[1].tolist() == [0.0, 0.1, 0.0]
