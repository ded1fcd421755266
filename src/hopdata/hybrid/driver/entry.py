"""Python's way into the driver: one integration, or many in a row.

The driver itself is compiled once per install, as a C function; what calls it is small.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import cfunc, njit, types

from hopdata.hybrid.compiled.cache import cache_directory
from hopdata.hybrid.compiled.calls import VALUE, caller
from hopdata.hybrid.compiled.digest import driver_digest
from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.views import IntVector, float_vector, int_vector
from hopdata.hybrid.driver.layout import (
    DESK_SLOTS,
    EACH_STEP,
    EVERY_STEP,
    FIRST_STEP,
    MAX_EVENTS,
    MAX_STEP,
    MAX_STEPS,
    RTOL,
    RUN,
    T_END,
    T_START,
)
from hopdata.hybrid.driver.loop import run

_INT, _FLOAT = types.int64, types.float64

# t_start, t_end, rtol, max_step, step, max_steps, max_events; then the flags
OPTIONS = (_FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _INT, _INT)
RUN_NATIVE = _INT(_INT, _INT)
ENTER_NATIVE = _INT(_INT, *OPTIONS, _INT)

call_run = caller(RUN_NATIVE, *((kind, VALUE) for kind in RUN_NATIVE.args))


@kernel
def ask(
    address: int, t_start: float, t_end: float, rtol: float, max_step: float, step: float,
    max_steps: int, max_events: int, flags: int,
) -> IntVector:  # fmt: skip
    """Write on the desk what is asked for; return the desk."""
    desk, numbers = int_vector(address, DESK_SLOTS), float_vector(address, DESK_SLOTS)
    numbers[T_START], numbers[T_END], numbers[RTOL] = t_start, t_end, rtol
    numbers[MAX_STEP], numbers[FIRST_STEP] = max_step, step
    desk[MAX_STEPS], desk[MAX_EVENTS], desk[EACH_STEP] = max_steps, max_events, flags & EVERY_STEP
    return desk


def _run(desk: int, flags: int) -> int:
    """Run the driver on what stands on the desk at this address."""
    return run(int_vector(desk, DESK_SLOTS), flags)


def _enter(
    desk: int, t_start: float, t_end: float, rtol: float, max_step: float, step: float,
    max_steps: int, max_events: int, flags: int,
) -> int:  # fmt: skip
    """Run the driver on the desk at this address."""
    slots = ask(desk, t_start, t_end, rtol, max_step, step, max_steps, max_events, flags)
    return call_run(slots[RUN], desk, flags)


@cache
def compiled_run() -> Any:
    """Return the driver's machine code: from the cache, or compiled now (some seconds)."""
    with cache_directory(_run, driver_digest()) as cached:
        return cfunc(RUN_NATIVE, cache=cached, error_model="numpy")(_run)


def run_address() -> int:
    """Return the address of the driver."""
    return int(compiled_run().address)


def compiled_entry(function: Callable[..., Any], native: Any) -> Any:
    """Return a small compiled function which releases the interpreter's lock."""
    with cache_directory(function, driver_digest()) as cached:
        return njit(native, cache=cached, nogil=True, error_model="numpy")(function)


@cache
def driver_entry() -> Callable[..., int]:
    """Return `_enter` without the search for a signature that fits: arguments must be exact."""
    (compiled,) = compiled_entry(_enter, ENTER_NATIVE).overloads.values()
    entry: Callable[..., int] = compiled.entry_point
    return entry
