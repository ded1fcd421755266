"""Catch what a user's function raises: machine code has no way to pass it on.

Each thread collects its own, so that integrations in threads do not see each other's exceptions.
"""

from __future__ import annotations

import sys
from contextvars import ContextVar, Token
from typing import Any


class Caught(list[BaseException]):
    """Exceptions of the functions called by this thread within a ``with`` block, in their order.

    Functions called through Python append theirs; those of machine code, which Numba can only
    print, arrive through ``sys.unraisablehook``. All others are left to the hook that was there.
    """

    __slots__ = ("_token",)

    def __enter__(self) -> Caught:
        self._token = catch(self)
        return self

    def __exit__(self, *_: object) -> None:
        stop_catching(self._token)


def catch(caught: Caught) -> Token[Caught | None]:
    """Begin what a ``with`` block would, for a caller in a hurry; `stop_catching` ends it."""
    if sys.unraisablehook is not _hook:
        _hook.install()
    return _caught.set(caught)


class _Hook:
    """Stands in as ``sys.unraisablehook`` from the first integration on.

    It stays there: to take it away after each integration would need a lock among the threads.
    """

    def __init__(self) -> None:
        self._previous: Any = sys.unraisablehook
        self._passing_on = False

    def install(self) -> None:
        self._previous = sys.unraisablehook
        sys.unraisablehook = self

    def __call__(self, unraisable: Any) -> None:
        caught, error = current(), unraisable.exc_value
        # Numba names itself in a string; what a destructor raises comes with the object.
        if caught is not None and error is not None and isinstance(unraisable.object, str):
            caught.append(error)
        elif self._passing_on:  # the hook that was there has called this one
            sys.__unraisablehook__(unraisable)
        else:
            self._pass_on(unraisable)

    def _pass_on(self, unraisable: Any) -> None:
        self._passing_on = True
        try:
            self._previous(unraisable)
        finally:
            self._passing_on = False


_caught: ContextVar[Caught | None] = ContextVar("caught", default=None)  # one for each thread
_hook = _Hook()
current, stop_catching = _caught.get, _caught.reset
