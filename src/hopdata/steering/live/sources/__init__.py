"""Sources of markers; each besides Qualisys has a module here, and needs its library.

`SOURCES` has those of ``hopdata drive --source``. Each is a stream like
`hopdata.steering.live.stream.MarkerStream` (the source "qualisys"), with the same
checks of frames, the same states and the same patience.

To add one: a subclass of `threaded.ThreadedStream` whose `_samples` yields frames, and
its row here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pkgutil import resolve_name

from hopdata.errors import chosen
from hopdata.steering.live.buffer import CAPACITY
from hopdata.steering.live.stream import MarkerStream

QUALISYS = "qualisys"
#: Classes of the streams by the name of the source.
SOURCES = {
    QUALISYS: "hopdata.steering.live.stream:MarkerStream",
    "motioncapture": "hopdata.steering.live.sources.rigid_bodies:RigidBodyStream",
    "lsl": "hopdata.steering.live.sources.lsl:LslStream",
}


def require_client(source: str) -> None:
    """Require the client library of a source, before any work is done.

    Raises
    ------
    ConfigError
        If no source has this name.
    ClientAbsentError
        If its library is not installed.
    """
    resolve_name(chosen("--source", source, SOURCES)).client()


def stream_of(
    source: str,
    labels: Sequence[str],
    *,
    host: str,
    port: int,
    rate_hz: float,
    capacity: int = CAPACITY,
) -> MarkerStream:
    """Return the stream of a source.

    Parameters
    ----------
    source : str
        A name of `SOURCES`.
    labels : sequence of str
        Wanted markers.
    host : str
        Where the source is: an address; for "motioncapture" SYSTEM:ADDRESS; for "lsl"
        the name of the stream.
    port : int
        Port of a Qualisys system; others do not use it.
    rate_hz : float
        Frame rate, Hz.
    capacity : int
        Number of frames in the buffer.

    Raises
    ------
    ConfigError
        If no source has this name.
    SettingsError
        If the host or a label is not of the source's form.
    """
    kind = resolve_name(chosen("--source", source, SOURCES))
    stream: MarkerStream = kind(
        labels, host=host, port=port, rate_hz=rate_hz, capacity=capacity
    )
    return stream
