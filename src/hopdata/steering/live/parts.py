"""The parts of the live loop, and what passes between them: Fig. 3.4 as a declaration.

The drawing and the documentation read it; a test compares it with a drive that runs:
each thread that is alive is declared, and each flow is a method that exists.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["outside", "thread", "store"]


@dataclass(frozen=True)
class Part:
    """A part of the loop.

    Parameters
    ----------
    name : str
        Name of the thread; of a store, its class.
    kind : {"outside", "thread", "store"}
        Something outside of the program, a thread, or what threads share.
    owner : str
        Class that runs or is the part, as ``module:class`` in
        `hopdata.steering.live`; empty for one outside.
    does : str
        What it does.
    printed : bool
        Whether it is in the dissertation's Fig. 3.4.
    """

    name: str
    kind: Kind
    owner: str
    does: str
    printed: bool


@dataclass(frozen=True)
class Flow:
    """Something that passes from one part to another.

    Parameters
    ----------
    source, target : str
        Names of the parts.
    carries : str
        What passes.
    by : str
        Method that passes it, as ``module:class.method``; empty if it comes from
        outside.
    printed : bool
        Whether it is in the dissertation's Fig. 3.4.
    """

    source: str
    target: str
    carries: str
    by: str
    printed: bool


CAMERAS = "cameras"
ROBOT = "boom of the robot"
STREAM = "hopdata-stream"
BUFFER = "FrameBuffer"
CONTROL = "hopdata-control"
WATCH = "hopdata-watch"
SENDER = "hopdata-boom"
LOG = "hopdata-log"
# Stands for the stream's thread where the robot is simulated.
SIMULATED = "hopdata-simulated"

PARTS = (
    Part(CAMERAS, "outside", "", "send markers, 100 frames a second", printed=True),
    Part(
        STREAM,
        "thread",
        "stream:MarkerStream",
        "waits for each frame, checks it, converts its time, writes it",
        printed=True,
    ),
    Part(
        BUFFER,
        "store",
        "buffer:FrameBuffer",
        "keeps the newest frames; neither side waits for the other",
        printed=True,
    ),
    Part(
        CONTROL,
        "thread",
        "loop:ControlLoop",
        "follows pose, boom angle and height; at each stance plans a swing",
        printed=True,
    ),
    Part(
        WATCH,
        "thread",
        "watch:Watch",
        "every 10 ms looks for a cause to rest; then lets no swing pass until armed",
        printed=False,
    ),
    Part(
        SENDER,
        "thread",
        "sender:Sender",
        "calls the boom's driver, which may block; heartbeats; insists on a rest",
        printed=False,
    ),
    Part(LOG, "thread", "log:DriveLog", "writes the drive to a file", printed=False),
    Part(ROBOT, "outside", "", "swings in the next flight", printed=True),
)

FLOWS = (
    Flow(CAMERAS, STREAM, "packets", "", printed=True),
    Flow(STREAM, BUFFER, "Frame", "buffer:FrameBuffer.write", printed=True),
    Flow(BUFFER, CONTROL, "frames since", "buffer:FrameBuffer.since", printed=True),
    Flow(BUFFER, WATCH, "frames since", "buffer:FrameBuffer.since", printed=False),
    Flow(CONTROL, WATCH, "swing", "watch:Watch.send", printed=False),
    Flow(WATCH, SENDER, "swing or rest", "sender:Sender.put", printed=False),
    Flow(SENDER, ROBOT, "swing", "actuator:Boom.swing", printed=True),
    Flow(CONTROL, LOG, "frames, decisions", "log:DriveLog.decision", printed=False),
)


def threads(*, simulated: bool = False, log: bool = True) -> tuple[str, ...]:
    """Return the names of the threads of a drive.

    Parameters
    ----------
    simulated : bool
        Whether the robot is simulated.
    log : bool
        Whether the drive is logged.
    """
    names = []
    for part in PARTS:
        if part.kind != "thread" or (part.name == LOG and not log):
            continue
        name = part.name
        if simulated and name == STREAM:
            name = SIMULATED
        names.append(name)
    return tuple(names)
