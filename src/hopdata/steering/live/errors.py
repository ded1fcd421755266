"""What can go wrong with a live stream."""

from __future__ import annotations

from hopdata.errors import HopdataError


class LiveError(HopdataError):
    """Base of all errors of a live stream."""


class ClientAbsentError(LiveError):
    """The client of the motion-capture system's protocol is not installed."""


class ConnectionLostError(LiveError):
    """The other side cannot be reached, has gone, or has fallen silent."""


class GarbageError(LiveError):
    """The bytes that came are not of the protocol, and where the next packet begins is unknown."""


class SettingsError(LiveError):
    """The camera system is set up otherwise than it must be."""


class LabelError(SettingsError):
    """A marker that is needed is not among those that the system has labelled."""


class PortError(LiveError):
    """The address is none, or cannot be listened on."""
