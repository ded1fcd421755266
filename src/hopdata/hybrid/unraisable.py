"""Catch what a compiled callback raises: machine code has no way to pass it on."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def caught_exceptions() -> Iterator[list[BaseException]]:
    """Collect exceptions that cannot propagate, in the order in which they were raised."""
    caught: list[BaseException] = []

    def keep(unraisable: Any) -> None:
        if unraisable.exc_value is not None:
            caught.append(unraisable.exc_value)

    previous, sys.unraisablehook = sys.unraisablehook, keep
    try:
        yield caught
    finally:
        sys.unraisablehook = previous
