"""Catch what a compiled callback raises: machine code has no way to pass it on."""

from __future__ import annotations

from typing import Any


class Caught(list[BaseException]):
    """Exceptions that could not propagate, in the order in which they were raised.

    Its method `keep` is to stand in as ``sys.unraisablehook``.
    """

    def keep(self, unraisable: Any) -> None:
        """Keep an exception."""
        if unraisable.exc_value is not None:
            self.append(unraisable.exc_value)
