"""Answers of the server to the commands of a client, as the client of version 1.25 expects them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hopdata.steering.live.packets import (
    COMMAND,
    ERROR,
    EVENT_CAPTURE_STARTED,
    VERSION,
    XML,
    event,
    text,
)
from hopdata.steering.live.parameters import parameters_xml

COMPONENTS = ("3d", "3dres")


@dataclass(frozen=True)
class FrameRequest:
    """Frames are wanted: one (`every` 0), or a stream of every so manieth frame (-1: no more)."""

    every: int
    residuals: bool = False


def answer(command: str, labels: Sequence[str], rate_hz: float) -> bytes | FrameRequest:
    """Return the packet to send, or what is to be streamed; a stream has no other answer."""
    verb, *words = command.lower().split() or [""]
    if verb == "version":
        return _version(words)
    if verb == "qtmversion":
        return text(COMMAND, "QTM Version is 2024.3 (hopdata loopback server)")
    if verb == "byteorder":
        return text(COMMAND, "Byte order is little endian")
    if verb == "getstate":
        return event(EVENT_CAPTURE_STARTED)
    if verb == "getparameters":
        return text(XML, parameters_xml(labels, rate_hz, parts=words))
    if verb == "getcurrentframe":
        return _frames(0, words)
    if verb == "streamframes" and words == ["stop"]:
        return FrameRequest(-1)
    if verb == "streamframes" and words:
        every = _every(words[0], rate_hz)
        return _frames(every, words[1:]) if every > 0 else _not_understood()
    return _not_understood()


def _version(words: list[str]) -> bytes:
    if not words:
        return text(COMMAND, f"Version is {VERSION}")
    if words != [VERSION]:
        return text(ERROR, "Version NOT supported")
    return text(COMMAND, f"Version set to {VERSION}")


def _frames(every: int, components: list[str]) -> bytes | FrameRequest:
    if len(components) != 1 or components[0] not in COMPONENTS:
        return _not_understood()
    return FrameRequest(every, residuals=components[0] == "3dres")


def _every(which: str, rate_hz: float) -> int:
    """Return which frames a client wants: every n-th; 0 if its words make no sense."""
    kind, _, number = which.partition(":")
    if which == "allframes":
        return 1
    if not number.isdigit() or int(number) < 1:
        return 0
    if kind == "frequency":
        return max(1, round(rate_hz / int(number)))
    return int(number) if kind == "frequencydivisor" else 0


def _not_understood() -> bytes:
    return text(ERROR, "Parse error")
