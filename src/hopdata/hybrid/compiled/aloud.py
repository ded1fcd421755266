"""Lines on stderr while code is compiled, so that nobody waits in silence."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer

#: Time after which it is said that a system's functions are being compiled.
#: Unit: s. Origin: chosen.
SILENT_S = 3.0


def say(what: str) -> None:
    """Write a line to stderr."""
    print(f"hopdata: {what}", file=sys.stderr, flush=True)


@contextmanager
def said_if_long(what: str) -> Iterator[None]:
    """Say on stderr what is compiled, and how long it took, if it takes long."""
    later = Timer(SILENT_S, say, [f"compiling {what}; later processes load them"])
    later.daemon = True
    later.start()
    started = time.monotonic()
    try:
        yield
    finally:
        later.cancel()
        later.join()
    spent = time.monotonic() - started
    if spent > SILENT_S:
        say(f"compiled in {spent:.0f} s")
