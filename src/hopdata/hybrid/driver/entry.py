"""Python's way into the driver: one integration, or many in a row.

The driver itself is compiled once per install, as a C function; what calls it is small.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import cache
from math import inf
from pathlib import Path
from typing import Any

from numba import cfunc, njit, types
from numba.core import event

from hopdata.code_cache import cache_directory, compiled_in_cache
from hopdata.hybrid.arguments import SMALLEST_RTOL
from hopdata.hybrid.compiled.calls import VALUE, caller
from hopdata.hybrid.compiled.digest import driver_digest
from hopdata.hybrid.compiled.kernel import ENTRY, kernel
from hopdata.hybrid.compiled.views import FloatVector, IntVector, float_vector, int_vector
from hopdata.hybrid.driver.layout import (
    DESK_SLOTS,
    MAX_EVENTS,
    MAX_STEP,
    MAX_STEPS,
    RESUMED,
    RTOL,
    RUN,
    T_END,
    T_START,
)
from hopdata.hybrid.driver.loop import run
from hopdata.hybrid.status import BAD_NUMBERS

_INT, _FLOAT = types.int64, types.float64

RUN_NATIVE = _INT(_INT, _INT)
NOT_KEPT = "no folder to keep it in can be written to: set NUMBA_CACHE_DIR to one that can"

call_run = caller(RUN_NATIVE, *((kind, VALUE) for kind in RUN_NATIVE.args))


@kernel
def can_be_done(desk: IntVector, numbers: FloatVector) -> bool:
    """Tell whether the numbers on the desk can be asked for, as `arguments.check_numbers` does.

    A relative tolerance below rounding is raised to it.
    """
    in_order = -inf < numbers[T_START] <= numbers[T_END] < inf
    positive = numbers[MAX_STEP] > 0.0 and desk[MAX_STEPS] >= 1 and desk[MAX_EVENTS] >= 1
    rtol_is_right = 0.0 <= numbers[RTOL] < 1.0
    numbers[RTOL] = max(numbers[RTOL], SMALLEST_RTOL)
    return in_order and positive and rtol_is_right


def _run(desk: int, flags: int) -> int:
    """Run the driver on what stands on the desk at this address."""
    return run(int_vector(desk, DESK_SLOTS), flags)


def _enter(desk: int, flags: int) -> int:
    """Run the driver on the desk at this address, if what is asked for there can be done."""
    slots = int_vector(desk, DESK_SLOTS)
    if flags & RESUMED == 0 and not can_be_done(slots, float_vector(desk, DESK_SLOTS)):
        return BAD_NUMBERS
    return call_run(slots[RUN], desk, flags)


@cache
def compiled_run() -> Any:
    """Return the driver's machine code: from the cache, or compiled now, which stderr then says."""
    notice = _Notice()
    with event.install_listener("numba:run_pass", notice):
        code = compiled_in_cache(
            _run, driver_digest(), lambda cached: cfunc(RUN_NATIVE, cache=cached, **ENTRY)(_run)
        )
    with cache_directory(_run, driver_digest()) as folder:
        notice.end(folder)
    return code


class _Notice(event.Listener):  # type: ignore[misc]
    """Says on stderr that the driver is being compiled, from the compiler's first pass on."""

    started_s: float | None = None

    def on_start(self, _event: object) -> None:
        if self.started_s is None:
            self.started_s = time.monotonic()
            _say("compiling the integrator, some 20 s of one core; later processes load it")

    def on_end(self, _event: object) -> None:
        pass

    def end(self, folder: Path | None) -> None:
        if self.started_s is not None:
            where = f"it is kept in {folder.parent}" if folder else NOT_KEPT
            _say(f"compiled in {time.monotonic() - self.started_s:.0f} s; {where}")


def _say(what: str) -> None:
    print(f"hopdata: {what}", file=sys.stderr, flush=True)


def run_address() -> int:
    """Return the address of the driver."""
    return int(compiled_run().address)


def compiled_entry(function: Callable[..., Any], native: Any) -> Any:
    """Return a small compiled function which releases the interpreter's lock."""

    def compile_it(cached: bool) -> Any:
        return njit(native, cache=cached, nogil=True, **ENTRY)(function)

    return compiled_in_cache(function, driver_digest(), compile_it)


@cache
def driver_entry() -> Callable[..., int]:
    """Return `_enter` without the search for a signature that fits: arguments must be exact."""
    (compiled,) = compiled_entry(_enter, RUN_NATIVE).overloads.values()
    entry: Callable[..., int] = compiled.entry_point
    return entry
