"""Markers from the Lab Streaming Layer, by `pylsl`, whose wheels bring liblsl.

The stream describes its channels as the specification of motion capture for XDF says:
each has a ``marker`` (else a ``label``, without its last part: ``body1.X``), a ``type``
PositionX, PositionY or PositionZ, and a ``unit``. It has no entry for the axis that
points up: it must be z.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.steering.live import packets
from hopdata.steering.live.sources.threaded import Sample, ThreadedStream

#: Type of the streams that are looked for if none is named.
MOCAP = "MoCap"
AXES = ("PositionX", "PositionY", "PositionZ")
# Length of each unit, m, by the names that streams give it.
METRES = {
    "meters": 1.0,
    "metres": 1.0,
    "meter": 1.0,
    "metre": 1.0,
    "m": 1.0,
    "millimeters": 1e-3,
    "millimetres": 1e-3,
    "millimeter": 1e-3,
    "mm": 1e-3,
}
#: Longest wait for a sample, after which the reader looks whether it is to end.
#: Unit: s. Origin: chosen.
PULL_S = 0.05


class LslStream(ThreadedStream):
    """Reads markers from a stream of the Lab Streaming Layer.

    `host` is the stream's name; with an empty one, it is the only stream of the type
    "MoCap". A marker at exactly (0, 0, 0), or with a coordinate that is no number, is
    hidden. Frames are numbered by their times and the nominal rate, so that those that
    are missing are counted.
    """

    library = "pylsl"
    extra = "lsl"

    def _samples(self, ended: threading.Event) -> Iterator[Sample]:
        inlet, channels, rate_hz = self._open()
        number = -1
        first_s = None
        try:
            while not ended.is_set():
                values, time_s = inlet.pull_sample(timeout=PULL_S)
                arrival_s = time.monotonic()
                if values is None:
                    continue
                first_s = time_s if first_s is None else first_s
                number += 1
                if rate_hz is not None:
                    number = max(number, round((time_s - first_s) * rate_hz))
                markers = placed(values, channels)
                yield Sample(number, time_s, arrival_s, markers)
        except self._client.util.LostError as error:
            raise packets.ConnectionLostError("the LSL stream is lost") from error
        finally:
            inlet.close_stream()

    def _open(self) -> tuple[Any, tuple[Any, FloatArray], float | None]:
        """Return an inlet, the channels of the markers and their scale, and the rate.

        Raises
        ------
        ConnectionLostError
            If there is no such stream.
        SettingsError
            If there are several, or it lacks a marker, a unit or the frame rate.
        """
        pylsl = self._client
        by = ("name", self.host) if self.host else ("type", MOCAP)
        found = pylsl.resolve_byprop(*by, timeout=self.patience.answer_s)
        wanted = f"an LSL stream with the {by[0]} {by[1]}"
        if not found:
            raise packets.ConnectionLostError(f"{wanted}: none is there")
        if len(found) > 1:
            names = ", ".join(sorted(one.name() for one in found))
            raise packets.SettingsError.at(
                "--host", f"the name of one: {names}", wanted
            )
        inlet = pylsl.StreamInlet(found[0], max_buflen=1, recover=False)
        try:
            info = inlet.info(timeout=self.patience.answer_s)
        except pylsl.util.TimeoutError as error:
            raise packets.ConnectionLostError(f"{wanted}: no answer") from error
        channels = channels_of(described(info), self.labels)
        rate_hz = info.nominal_srate() or None
        told = packets.StreamParameters(
            labels=tuple(self.labels), rate_hz=rate_hz, upwards=""
        )
        packets.check_settings(told, self.rate_hz)
        return inlet, channels, rate_hz


def described(info: Any) -> list[dict[str, str]]:
    """Return what the description of a stream says of each channel."""
    entries = []
    channel = info.desc().child("channels").child("channel")
    while not channel.empty():
        keys = ("marker", "label", "type", "unit")
        entries.append({key: channel.child_value(key) for key in keys})
        channel = channel.next_sibling("channel")
    return entries


def channels_of(
    entries: Sequence[Mapping[str, str]], labels: Sequence[str]
) -> tuple[Any, FloatArray]:
    """Return the channels (M, 3) of the markers, and their lengths (M, 3) of 1, m.

    Raises
    ------
    LabelError
        If a marker or an axis of it is missing, or is there twice.
    SettingsError
        If a unit is no known length.
    """
    by_axis: list[list[int]] = []
    for axis in AXES:
        at = [k for k, one in enumerate(entries) if one["type"] == axis]
        names = [_marker_of(entries[k]) for k in at]
        by_axis.append([at[k] for k in packets.find_labels(labels, names)])
    channels = np.array(by_axis).T
    scales = np.empty(channels.shape)
    for place, channel in np.ndenumerate(channels):
        unit = entries[channel]["unit"].lower()
        if unit not in METRES:
            wanted = f"one of the units {', '.join(METRES)}"
            of = f"LSL channel {channel + 1} ({_marker_of(entries[channel])})"
            raise packets.SettingsError.at(of, wanted, f"{unit!r}")
        scales[place] = METRES[unit]
    return channels, scales


def _marker_of(entry: Mapping[str, str]) -> str:
    return entry["marker"] or entry["label"].rpartition(".")[0]


def placed(values: Sequence[float], channels: tuple[Any, FloatArray]) -> FloatArray:
    """Return the markers (M, 3), m, of a sample; NaN if not seen."""
    at, scales = channels
    markers = np.asarray(values, dtype=float)[at] * scales
    markers[~np.isfinite(markers).all(axis=1)] = np.nan
    markers[(markers == 0.0).all(axis=1)] = np.nan
    return markers
