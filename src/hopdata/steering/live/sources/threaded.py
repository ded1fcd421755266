"""A stream whose library waits for samples: a thread does, and passes them on."""

from __future__ import annotations

import asyncio
import importlib
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.steering.live import packets
from hopdata.steering.live.stream import CameraClock, MarkerStream, Timeline

#: Largest coordinate of a marker: no camera system sees one a kilometre away.
#: Unit: m. Origin: chosen.
FARTHEST_M = 1e3


@dataclass(frozen=True)
class Sample:
    """A frame as a library gives it.

    Parameters
    ----------
    number : int
        Number of the frame, as far as the library tells it.
    time_s : float
        Time on the source's clock, s.
    arrival_s : float
        Arrival on the monotonic clock, s.
    markers : (M, 3) array
        Positions of the wanted markers, m; NaN if not seen.
    """

    number: int
    time_s: float
    arrival_s: float
    markers: FloatArray


class ThreadedStream(MarkerStream, ABC):
    """Reads frames that a library waits for; options are those of `MarkerStream`.

    A subclass says which library it needs, and yields the frames in `_samples`, which
    runs in a thread of its own. A library that waits for ever holds only that thread,
    which does not keep the process alive.
    """

    library: ClassVar[str]
    extra: ClassVar[str]

    @classmethod
    def client(cls) -> Any:
        """Return the library of the source.

        Raises
        ------
        ClientAbsentError
            If it is not installed.
        """
        try:
            return importlib.import_module(cls.library)
        except (ImportError, RuntimeError) as error:  # pylsl raises it without liblsl
            raise packets.ClientAbsentError(
                f"this source needs {cls.library} ({error}): "
                f"pip install 'hopdata[{cls.extra}]'"
            ) from error

    @abstractmethod
    def _samples(self, ended: threading.Event) -> Iterator[Sample]:
        """Connect, then yield each frame until `ended` is set.

        Raises
        ------
        LiveError
            If the source is set up differently, cannot be reached, or is lost.
        """

    async def _session(self) -> None:
        """Connect and read until the connection is lost, which raises an exception."""
        self.states.report("connecting")
        news: asyncio.Queue[Sample | Exception] = asyncio.Queue()
        loop = asyncio.get_running_loop()
        ended = threading.Event()

        def read() -> None:
            # The loop is closed when the stream is; what comes then is not wanted.
            with suppress(RuntimeError):
                try:
                    for sample in self._samples(ended):
                        loop.call_soon_threadsafe(news.put_nowait, sample)
                except Exception as error:
                    loop.call_soon_threadsafe(news.put_nowait, error)

        # The order alone counts: the sources' times are those of sending.
        self._timeline = Timeline(None)
        self._clock = CameraClock()
        self._epoch += 1
        self._last_good_s = time.monotonic() + self.patience.answer_s
        name = f"hopdata-{self.library}"
        threading.Thread(target=read, name=name, daemon=True).start()
        is_first = True
        try:
            while True:
                try:
                    async with asyncio.timeout(self.patience.stale_s / 2):
                        found = await news.get()
                except TimeoutError:
                    self._look_at_age()
                    continue
                if isinstance(found, Exception):
                    raise found
                if is_first:
                    self.counts.connections += 1
                    is_first = False
                self._take(found)
        finally:
            ended.set()

    def _take(self, sample: Sample) -> None:
        """Keep a frame whose coordinates are possible."""
        if np.any(np.abs(sample.markers) > FARTHEST_M):  # False for NaN, a hidden one
            self._note_garbled("a marker farther than a kilometre away")
            return
        self._keep(sample.number, sample.time_s, sample.arrival_s, sample.markers)
