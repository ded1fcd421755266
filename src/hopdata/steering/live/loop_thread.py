"""A thread with an event loop of its own that runs one coroutine until it is told to stop."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from typing import Any

from hopdata.steering.live.errors import LiveError

JOIN_S = 10.0


class LoopThread:
    """Runs `main` in a thread; `failure` is the exception that ended it, if any."""

    def __init__(self, name: str, main: Callable[[], Coroutine[Any, Any, None]]) -> None:
        self.failure: BaseException | None = None
        self._main, self._begun = main, threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[Any] | None = None
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Start the thread, and return when its loop runs."""
        self._thread.start()
        self._begun.wait()

    def call(self, function: Callable[..., object], *arguments: object) -> None:
        """Call a function in the thread, soon; nothing happens if the thread has ended."""
        try:
            if self._loop is not None:
                self._loop.call_soon_threadsafe(function, *arguments)
        except RuntimeError:  # the loop is closed
            return

    def stop(self) -> None:
        """Cancel the coroutine and wait for the end of the thread; a second call does nothing.

        Raises
        ------
        LiveError
            If the thread does not end.
        """
        if self._thread.ident is None:
            return
        if self._task is not None:
            self.call(self._task.cancel)
        self._thread.join(JOIN_S)
        if self._thread.is_alive():
            raise LiveError(f"thread {self._thread.name!r} has not ended within {JOIN_S:g} s")

    def _run(self) -> None:
        try:
            asyncio.run(self._watched())
        except asyncio.CancelledError:
            return
        except BaseException as error:
            self.failure = error
        finally:
            self._begun.set()

    async def _watched(self) -> None:
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        self._begun.set()
        await self._main()
