"""What is counted on the way."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class ServerCounts:
    """What the server has done so far, in frames, markers and connections."""

    frames: int = 0
    dropped: int = 0
    hidden_markers: int = 0
    garbled: int = 0
    skipped: int = 0
    connections: int = 0
    refused_packets: int = 0


@dataclass
class StreamCounts:
    """What came, in frames, markers, packets and connections, and what did not.

    `missing` frames are those whose numbers were skipped; `outdated` ones came twice, or after one
    with a higher number, and were left out; `garbled` packets were damaged and left
    out, and so were frames with implausible numbers, times or positions; in `broken` connections
    it was lost where packets begin.
    """

    frames: int = 0
    missing: int = 0
    outdated: int = 0
    late: int = 0
    hidden_markers: int = 0
    garbled: int = 0
    connections: int = 0
    losses: int = 0
    broken: int = 0


@dataclass
class LoopCounts:
    """Frames read, frames that were overwritten before, and frames that could not be understood."""

    frames: int = 0
    overrun: int = 0
    failed: int = 0
