"""States of a live stream, with a log of when each began and why."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Literal

State = Literal["idle", "connecting", "streaming", "stale", "lost", "failed", "closed"]

LONGEST_LOG = 10_000


@dataclass(frozen=True)
class Status:
    """State of the stream from `at_s` on the monotonic clock, s, and what brought it about."""

    state: State
    at_s: float
    message: str = ""


class StatusLog:
    """The present state, and the last ones; safe to use from several threads."""

    def __init__(self) -> None:
        self._log: deque[Status] = deque([Status("idle", time.monotonic())], LONGEST_LOG)
        self._changed = threading.Condition()

    @property
    def status(self) -> Status:
        """The present state."""
        return self._log[-1]

    def history(self) -> tuple[Status, ...]:
        """Return all states so far, oldest first."""
        with self._changed:
            return tuple(self._log)

    def report(self, state: State, message: str = "") -> None:
        """Begin a state."""
        with self._changed:
            self._log.append(Status(state, time.monotonic(), message))
            self._changed.notify_all()

    def wait_for(self, *states: State, timeout_s: float) -> Status | None:
        """Wait until the state is one of these; None if that does not come about in time."""
        with self._changed:
            reached = self._changed.wait_for(lambda: self.status.state in states, timeout_s)
            return self.status if reached else None
