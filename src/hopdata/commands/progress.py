"""Progress on stderr: one line that is replaced, only where a person looks."""

from __future__ import annotations

import sys
from types import TracebackType

CLEAR_LINE = "\r\033[K"


class Progress:
    """Shows the step at hand; a context manager that leaves an empty line behind."""

    def __init__(self) -> None:
        self._shown = sys.stderr.isatty()

    def __call__(self, step: str) -> None:
        """Show a step, in words."""
        if self._shown:
            print(f"{CLEAR_LINE}{step} ...", end="", file=sys.stderr, flush=True)

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._shown:
            print(CLEAR_LINE, end="", file=sys.stderr, flush=True)
