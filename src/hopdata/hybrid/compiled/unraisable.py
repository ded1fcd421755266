"""Catch what a user's function raises: machine code has no way to pass it on.

Each thread collects its own, so that integrations in threads do not see each other's exceptions.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any


class Caught(list[BaseException]):
    """Exceptions of the functions called by this thread within a ``with`` block, in their order.

    Functions called through Python append theirs; those of machine code, which Numba can only
    print, arrive through ``sys.unraisablehook``. All others are left to the hook that was there.
    """

    def __enter__(self) -> Caught:
        self._outer = current()
        _here.caught = self
        _hook.use()
        return self

    def __exit__(self, *_: object) -> None:
        _hook.leave()
        _here.caught = self._outer


class _Hook:
    """Stands in as ``sys.unraisablehook`` while any thread catches."""

    def __init__(self) -> None:
        self._lock, self._users = threading.Lock(), 0
        self._previous: Callable[[Any], Any] = sys.unraisablehook
        self._own = self.__call__  # one bound method, to be recognised

    def use(self) -> None:
        with self._lock:
            self._users += 1
            if self._users == 1:
                self._previous, sys.unraisablehook = sys.unraisablehook, self._own

    def leave(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0 and sys.unraisablehook is self._own:
                sys.unraisablehook = self._previous

    def __call__(self, unraisable: Any) -> None:
        caught, error = current(), unraisable.exc_value
        # Numba names itself in a string; what a destructor raises comes with the object.
        if caught is None or error is None or not isinstance(unraisable.object, str):
            self._previous(unraisable)
        else:
            caught.append(error)


def current() -> Caught | None:
    """Return what this thread is catching into, None if it is not."""
    return getattr(_here, "caught", None)


_here, _hook = threading.local(), _Hook()
