"""A watch over a process that reads, for what no limit of the system can see.

A process that sleeps takes no CPU time, and some systems limit neither time nor memory
of a process. So a thread looks at it some times a second, and ends it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

from hopdata.foreign.budget import LONGEST_SLEEP_S, Budget

# Time between two looks, s.
_LOOK_S = 0.25

# Time after the last look from which on this process was halted, s: by Ctrl-Z or by a
# batch system that suspends jobs, and the other with it. What is beyond does not count.
_HALTED_S = 20 * _LOOK_S

# What a watch can say, which is the name of the message too.
TIME, WAITS, MEMORY = "time", "waits", "memory"


class Watch:
    """Watches a process while a block runs, and ends it if it is beyond its budget.

    Attributes
    ----------
    found
        Why the process was ended: `TIME`, `WAITS`, `MEMORY`, or empty if it was not.
    """

    def __init__(self, pid: int, kill: Callable[[], None], budget: Budget) -> None:
        self.found = ""
        self._pid = pid
        self._kill = kill
        self._budget = budget
        self._is_over = threading.Event()
        self._asleep_s = 0.0
        self._cpu_s = 0.0
        self._n_received = 0
        self._seen_received = 0
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._is_over.set()
        self._thread.join()

    def received(self) -> None:
        """Say that the process has sent something, and does not only sleep."""
        self._n_received += 1

    def _look(self) -> None:
        if self._is_over.wait(_LOOK_S):  # most files are read before the first look
            return
        import psutil

        with suppress(psutil.Error):  # it has ended, or may not be seen
            self._look_until_over(psutil.Process(self._pid))

    def _look_until_over(self, process: Any) -> None:
        """Look again and again; end the process once it is beyond its budget."""
        import psutil

        first_s = _cpu_s(process)
        first_bytes = process.memory_info().rss
        took_s = 0.0
        last_s = time.monotonic()
        while not self._is_over.wait(_LOOK_S):
            now_s = time.monotonic()
            took_s += min(now_s - last_s, _HALTED_S)
            last_s = now_s
            used_s = _cpu_s(process)
            n_bytes = process.memory_info().rss
            self._count_sleep(process.status() == psutil.STATUS_SLEEPING, used_s)
            if n_bytes - first_bytes > self._budget.memory:
                self._end(MEMORY)
            elif self._asleep_s > LONGEST_SLEEP_S:
                self._end(WAITS)
            elif self._is_late(used_s - first_s, took_s):
                self._end(TIME)
            if self.found:
                return

    def _is_late(self, cpu_s: float, wall_s: float) -> bool:
        """Tell whether it has taken too long; the system's own limit comes first."""
        return cpu_s > self._budget.cpu_s + 1.0 or wall_s > self._budget.wall_s

    def _count_sleep(self, is_asleep: bool, cpu_s: float) -> None:
        """Add a look to the time asleep, or begin it anew if the process has worked."""
        is_idle = cpu_s == self._cpu_s and self._n_received == self._seen_received
        if is_asleep and is_idle:
            self._asleep_s += _LOOK_S
        else:
            self._asleep_s = 0.0
        self._cpu_s = cpu_s
        self._seen_received = self._n_received

    def _end(self, found: str) -> None:
        self.found = found
        self._kill()


def _cpu_s(process: Any) -> float:
    """Return the CPU time of a process, s."""
    times = process.cpu_times()
    return float(times.user + times.system)
