"""Exceptions of the user's functions, collected, as machine code cannot pass them on.

Each thread collects its own, so that integrations in threads do not see each other's
exceptions.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextvars import ContextVar, Token
from typing import Any


class Caught(list[BaseException]):
    """Exceptions of the functions called by this thread in a ``with`` block, in order.

    Functions called through Python append their exceptions. Those of machine code,
    which Numba can only print, arrive through ``sys.unraisablehook``. All others go to
    the previous hook.
    """

    __slots__ = ("_token", "witness")

    def __init__(self, witness: Callable[[], None] | None = None) -> None:
        # Called at the first exception, since machine code may continue after it.
        self.witness = witness

    def append(self, error: BaseException) -> None:
        """Add an exception."""
        if not self and self.witness is not None:
            self.witness()
        super().append(error)

    def __enter__(self) -> Caught:
        self._token = catch(self)
        return self

    def __exit__(self, *_: object) -> None:
        stop_catching(self._token)


def catch(caught: Caught) -> Token[Caught | None]:
    """Start catching as a ``with`` block would, but faster; `stop_catching` ends it."""
    if sys.unraisablehook is not _hook:
        _hook.install()
    return _caught.set(caught)


class _Hook:
    """Replacement of ``sys.unraisablehook`` from the first integration on.

    It is never removed: removing it after each integration would require a lock among
    threads.
    """

    def __init__(self) -> None:
        self._previous: Any = sys.unraisablehook
        self._passing_on = False

    def install(self) -> None:
        self._previous = sys.unraisablehook
        sys.unraisablehook = self

    def __call__(self, unraisable: Any) -> None:
        caught = current()
        error = unraisable.exc_value
        # For Numba the object is a string; an exception in a destructor comes with the
        # object.
        by_numba = isinstance(unraisable.object, str)
        if caught is not None and error is not None and by_numba:
            caught.append(error)
        elif self._passing_on:  # the previous hook has called this one
            sys.__unraisablehook__(unraisable)
        else:
            self._passing_on = True
            try:
                self._previous(unraisable)
            finally:
                self._passing_on = False


_caught: ContextVar[Caught | None] = ContextVar("caught", default=None)
_hook = _Hook()
current = _caught.get
stop_catching = _caught.reset
