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
from hopdata.hybrid.compiled.views import address_of, int_vector, view
from hopdata.hybrid.driver.layout import DESK_SLOTS, RUN, IntArray
from hopdata.hybrid.driver.loop import run

_INT, _FLOAT, _INTS = types.int64, types.float64, types.int64[::1]

# t_start, t_end, rtol, max_step, step, max_steps, max_events; then the flags
OPTIONS = (_FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _INT, _INT)
RUN_NATIVE = _INT(_INT, *OPTIONS, _INT)
ENTER_NATIVE = _INT(_INTS, *OPTIONS, _INT)

call_run = caller(RUN_NATIVE, *((kind, VALUE) for kind in RUN_NATIVE.args))


def _run(
    desk: int, t_start: float, t_end: float, rtol: float, max_step: float, step: float,
    max_steps: int, max_events: int, flags: int,
) -> int:  # fmt: skip
    """Run the driver on what stands on the desk at this address."""
    return run(
        int_vector(desk, DESK_SLOTS), t_start, t_end, rtol, max_step, step, max_steps, max_events,
        flags,
    )  # fmt: skip


def _enter(
    desk: IntArray, t_start: float, t_end: float, rtol: float, max_step: float, step: float,
    max_steps: int, max_events: int, flags: int,
) -> int:  # fmt: skip
    """Run the driver."""
    return call_run(
        desk[RUN], address_of(view(desk)), t_start, t_end, rtol, max_step, step, max_steps,
        max_events, flags,
    )  # fmt: skip


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
