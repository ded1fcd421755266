"""Checks of a caller's arguments: fast if they are valid, with a clear message else."""

from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import ArgumentError

# rtol, max_step, first_step, max_steps, max_events
Limits = tuple[float, float, float | None, int, int]

#: Most steps, and most events, of an integration by default.
#: Unit: 1. Origin: chosen: no limit in practice, but no run for ever.
MOST = 10_000_000
#: Smallest relative tolerance; a smaller one that is asked for is raised to it.
#: Unit: 1. Origin: rounding: at a smaller one the controller mistakes rounding for
#: error. Ten units in the last place.
SMALLEST_RTOL = 10 * 2.0**-52
_LOCKS = frozenset((-1, 0, 1))


def expect(
    holds: object, name: str, wanted: str, found: object, hint: str = ""
) -> None:
    """Raise an `ArgumentError` that names the argument unless `holds` is true."""
    if not holds:
        raise ArgumentError(f"{name}: expected {wanted}, found {found}{hint}")


def check_numbers(
    t_span: tuple[float, float],
    rtol: float,
    max_step: float,
    first_step: float | None,
    max_steps: int,
    max_events: int,
) -> tuple[float, float, float, float, float, int, int]:
    """Return start, end, rtol, largest and first step, and the two counts.

    All of them are plain numbers; a first step of 0 is to be chosen.
    `driver.loop.can_be_done` makes the same checks.
    """
    try:
        t_start, t_end = map(float, t_span)
    except (TypeError, ValueError):
        raise ArgumentError(
            f"t_span: expected two times (start, end), found {t_span!r}"
        ) from None
    in_order = -inf < t_start < inf and t_start <= t_end
    wanted = "a finite start, and an end not before the start"
    expect(in_order, "t_span", wanted, t_span)
    largest = _number("max_step", max_step)
    first = 0.0
    if first_step is not None:
        first = _number("first_step", first_step)
    expect(largest > 0, "max_step", "> 0", max_step)
    expect(first_step is None or first > 0, "first_step", "> 0", first_step)
    relative = _number("rtol", rtol)
    expect(0 <= relative < 1, "rtol", "a number in [0, 1)", rtol)
    steps = check_count("max_steps", max_steps)
    events = check_count("max_events", max_events)
    return (
        t_start,
        t_end,
        max(relative, SMALLEST_RTOL),
        largest,
        first,
        steps,
        events,
    )


def check_infinite_end(
    system: Any, t_end: float, max_steps: int, max_events: int
) -> None:
    """Raise ValueError if the end is infinite and nothing may end the integration."""
    if t_end < inf or any(system.terminal or ()) or system.on_event is not None:
        return
    limited = max_steps < MOST or max_events < MOST
    wanted = (
        "a finite end, or something that may end the integration: "
        "System(terminal=...), a handler that returns 1, max_events or max_steps"
    )
    expect(limited, "t_span", wanted, "an infinite end and none of these")


def _number(name: str, value: Any) -> float:
    """Return the value as a float."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ArgumentError(f"{name}: expected a number, found {value!r}") from None


def check_count(name: str, value: Any) -> int:
    """Return a whole number from 1 to the largest 64-bit integer."""
    number = _number(name, value)
    fits = 1 <= number < 2**63 and number == int(number)
    expect(fits, name, "a whole number > 0", repr(value))
    return int(value)


def check_flag(name: str, value: Any) -> bool:
    """Return a bool, given as True or False (Python or NumPy) or as 0 or 1."""
    is_truth = isinstance(value, bool | int | np.bool_ | np.integer) and value in (0, 1)
    expect(is_truth, name, "True or False", repr(value))
    return bool(value)


def numbers_of(name: str, value: ArrayLike) -> FloatArray:
    """Return a C-contiguous array of floats; what a mask hides is NaN."""
    try:
        if isinstance(value, np.ma.MaskedArray):
            value = np.ma.filled(value.astype(np.float64), np.nan)
        given = np.asarray(value)
        kind = given.dtype.kind
        if kind in "USc" or (kind == "O" and None in given.ravel().tolist()):
            raise TypeError  # NumPy would convert text and None to numbers
        return np.ascontiguousarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ArgumentError(f"{name}: expected numbers, found {value!r}") from None


def check_shape(name: str, value: ArrayLike, length: int) -> FloatArray:
    """Return a state as an array; the driver checks that it is finite."""
    state = numbers_of(name, value)
    expect(state.shape == (length,), name, f"shape ({length},)", state.shape)
    return state


def check_rows(params: ArrayLike, n_runs: int) -> FloatArray:
    """Return the parameters shared by all runs, (1, p), or of each run, (n_runs, p)."""
    numbers = np.atleast_2d(numbers_of("params", params))
    fits = numbers.ndim == 2 and len(numbers) in (1, n_runs)
    expect(fits, "params", f"shape (p,) or ({n_runs}, p)", np.shape(params))
    return numbers


def with_memory(
    params: FloatArray, memory: ArrayLike | None, n_memory: int
) -> FloatArray:
    """Return the parameters (one row, or one per integration) with the memory appended.

    The memory starts at zero if it is not given.
    """
    if n_memory == 0 and memory is None:
        return params
    start = np.zeros(n_memory)
    if memory is not None:
        start = numbers_of("memory", memory).ravel()
    expect(len(start) == n_memory, "memory", f"{n_memory} numbers", len(start))
    of_each = np.broadcast_to(start, (*params.shape[:-1], n_memory))
    joined = np.concatenate([params, of_each], axis=-1)
    # A single column beside a broadcast row is joined column by column; the driver
    # reads rows.
    return np.ascontiguousarray(joined)


def set_mode(full: IntArray, n_guards: int, mode: Any) -> None:
    """Write the initial mode into `full`.

    It is given whole, or as the scene's integers, which follow locks of 0.
    """
    full.fill(0)
    given = np.asarray(mode)
    if given.dtype.kind not in "iub":
        given = numbers_of("mode", mode)
        whole = np.isfinite(given) & (given == np.rint(given))
        expect(whole.all(), "mode", "integers", repr(mode))
    given = given.astype(np.int64).ravel()
    if len(given) == len(full):
        full[:] = given
        locks = _LOCKS.issuperset(given[:n_guards].tolist())
        expect(locks, "mode", "locks -1, +1, or 0 to have them decided", given)
        return
    own = len(full) - n_guards
    wanted = (
        f"{len(full)} integers (locks and the scene's own) or {own} (the scene's own)"
    )
    expect(len(given) == own, "mode", wanted, len(given))
    full[n_guards:] = given


def set_tolerance(full: FloatArray, atol: ArrayLike) -> None:
    """Write the absolute tolerance of each component into `full`."""
    if np.ndim(atol):
        given = numbers_of("atol", atol)
    else:
        given = np.asarray(_number("atol", atol))
    fits = given.shape in ((), full.shape) and (given >= 0).all()
    expect(fits, "atol", f"a number or {len(full)} numbers, >= 0", repr(atol))
    full[:] = given


def check_times(t_eval: ArrayLike, t_start: float, t_end: float) -> FloatArray:
    """Return the requested times as an array."""
    times = np.array(numbers_of("t_eval", t_eval), ndmin=1)
    inside = (times >= t_start) & (times <= t_end) & np.isfinite(times)
    fits = times.ndim == 1 and inside.all() and (np.diff(times) > 0).all()
    expect(fits, "t_eval", f"increasing times within {(t_start, t_end)}", times)
    return times
