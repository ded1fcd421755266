"""Chunks of a job in threads, with progress shown."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

CHUNK = 64  # numbers that a thread takes at a time: results do not depend on it


def run_in_threads(
    run: Callable[[int, int], int], done: int, total: int, workers: int | None, progress: bool
) -> None:
    """Run a job on the numbers from `done` on below `total`, a chunk at a time in each thread.

    One worker is this thread: to start another would take as long as a hundred small integrations.

    Parameters
    ----------
    run : callable
        ``run(first, last)`` does the numbers from first on below last, and returns how many.
    done, total : int
        How many are done already, and how many there are.
    workers : int, optional
        Threads; by default one for each core that this process may use.
    progress : bool
        Whether to say on stderr how far it is.
    """
    chunks = [(first, min(first + CHUNK, total)) for first in range(done, total, CHUNK)]
    shown = _Progress(total) if progress else None
    for count in _counts(run, chunks, min(workers or available_cores(), len(chunks))):
        done += count
        if shown is not None:
            shown.show(done)


def _counts(
    run: Callable[[int, int], int], chunks: list[tuple[int, int]], workers: int
) -> Iterator[int]:
    """Run the chunks; yield how many numbers are done, as each chunk ends."""
    if workers <= 1:
        yield from (run(*chunk) for chunk in chunks)
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from _in_any_order(pool, [pool.submit(run, *chunk) for chunk in chunks])


def _in_any_order(pool: ThreadPoolExecutor, jobs: list[Future[int]]) -> Iterator[int]:
    """Yield results as they come; after an exception or Ctrl-C, start no more jobs."""
    waiting = set(jobs)
    try:
        while waiting:
            ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            yield from (job.result() for job in ready)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Progress:
    """A line on stderr that says how many are done, at most ten times a second."""

    def __init__(self, total: int) -> None:
        self._total, self._start, self._last = total, time.monotonic(), 0.0

    def show(self, done: int) -> None:
        now = time.monotonic()
        if done < self._total and now - self._last < 0.1:
            return
        self._last = now
        line = f"\r{done} of {self._total} integrations, {now - self._start:.1f} s"
        print(line, end="\n" if done == self._total else "", file=sys.stderr, flush=True)
