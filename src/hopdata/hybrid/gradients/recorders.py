"""Machine code of a user's functions that records on a tape, called by its address.

The templates have these names inserted: CALL, the user's function; N and N_GUARDS, the
numbers of states and of guards. Numbers are given by the addresses of rows of traced
numbers (`gradients.tape`).
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numba
from numba import cfunc, types

from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.errors import ArgumentError
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.calls import caller
from hopdata.hybrid.compiled.constants import Constants
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import sources_digest, with_digest
from hopdata.hybrid.compiled.memory import array_at, array_of, int_vector
from hopdata.hybrid.gradients.tape import TRACED
from hopdata.hybrid.system import System

PACKAGE = Path(__file__).parents[1]
# Inserted into the templates.
CALL: Any = None
ROWS: Any = None
PLAIN: Any = None
N: int = 0
N_GUARDS: int = 0

_INT = types.int64
_FLOAT = types.float64
_ROWS = array_at(TRACED)
_PLAIN = array_at(_FLOAT)

# t, states, mode and its length, params and their number, rates
FIELD = types.void(_FLOAT, *(_INT,) * 6)
# moment, states, dy, mode and its length, params and their number, h, hdot
GUARDS = types.void(*(_INT,) * 9)
# moment, states, mode and its length, params and their number, guard, direction
HANDLER = types.void(*(_INT,) * 8)
# moment, before, after, guard, direction, params and their number, result
AT_EVENT = types.void(*(_INT,) * 8)
# moment, states, params and their number, result
AT_END = types.void(*(_INT,) * 5)

call_field = caller(FIELD)
call_guards = caller(GUARDS)
call_handler = caller(HANDLER)
call_at_event = caller(AT_EVENT)
call_at_end = caller(AT_END)


def record_field(
    t: float, y: int, mode: int, n_modes: int, params: int, n_params: int, dy: int
) -> None:
    """Record the field at a fixed time."""
    modes = array_of(int_vector(mode, n_modes))
    CALL(t, ROWS(y, N), modes, ROWS(params, n_params), ROWS(dy, N))


def record_guards(  # noqa: PLR0913 (the guards' arguments)
    moment: int,
    y: int,
    dy: int,
    mode: int,
    n_modes: int,
    params: int,
    n_params: int,
    h: int,
    hdot: int,
) -> None:
    """Record all guards; the rates of the states are plain numbers."""
    t = ROWS(moment, 1)[0]
    modes = array_of(int_vector(mode, n_modes))
    numbers = ROWS(params, n_params)
    values = ROWS(h, N_GUARDS)
    rates = ROWS(hdot, N_GUARDS)
    CALL(t, ROWS(y, N), PLAIN(dy, N), modes, numbers, values, rates)


def record_each_guard(  # noqa: PLR0913 (the guards' arguments)
    moment: int,
    y: int,
    dy: int,
    mode: int,
    n_modes: int,
    params: int,
    n_params: int,
    h: int,
    hdot: int,
) -> None:
    """Record guards that are declared one by one."""
    t = ROWS(moment, 1)[0]
    modes = array_of(int_vector(mode, n_modes))
    numbers = ROWS(params, n_params)
    values = ROWS(h, N_GUARDS)
    rates = ROWS(hdot, N_GUARDS)
    for k in range(N_GUARDS):
        CALL(t, ROWS(y, N), PLAIN(dy, N), modes, numbers, k, values, rates)


def record_handler(
    moment: int,
    y: int,
    mode: int,
    n_modes: int,
    params: int,
    n_params: int,
    guard: int,
    direction: int,
) -> None:
    """Record the handler, which changes states, mode and parameters in place."""
    t = ROWS(moment, 1)[0]
    modes = array_of(int_vector(mode, n_modes))
    CALL(t, ROWS(y, N), modes, ROWS(params, n_params), guard, direction)


def record_at_event(
    moment: int,
    before: int,
    after: int,
    guard: int,
    direction: int,
    params: int,
    n_params: int,
    result: int,
) -> None:
    """Record a function of an event."""
    t = ROWS(moment, 1)[0]
    numbers = ROWS(params, n_params)
    found = CALL(t, ROWS(before, N), ROWS(after, N), guard, direction, numbers)
    ROWS(result, 1)[0] = found


def record_at_end(moment: int, y: int, params: int, n_params: int, result: int) -> None:
    """Record a function of the end."""
    t = ROWS(moment, 1)[0]
    ROWS(result, 1)[0] = CALL(t, ROWS(y, N), ROWS(params, n_params))


class Recorders(NamedTuple):
    """Addresses of the machine code of a system's functions; 0 where there is none."""

    field: int
    guards: int
    handler: int
    at_event: int
    at_end: int


Function = Callable[..., Any]


def recorders(
    system: System, n_shown: int, at_event: Function | None, at_end: Function | None
) -> Recorders:
    """Return the machine code of a system's functions and of a loss.

    Parameters
    ----------
    system : System
        The system.
    n_shown : int
        Number of states that `at_event` and `at_end` receive.
    at_event, at_end : callable, optional
        Functions of an event and of the end.

    Raises
    ------
    ArgumentError
        If one of the functions does not compile for traced numbers.
    """
    sizes = {"N": system.n_states, "N_GUARDS": system.n_guards}
    guards = system.guards or system.guard
    template = record_guards
    if guards is not None and "k" in guards.signature.arguments:
        template = record_each_guard
    own = {"N": n_shown}
    return Recorders(
        _of_callback(system, record_field, FIELD, system.field, sizes),
        _of_callback(system, template, GUARDS, guards, sizes),
        _of_callback(system, record_handler, HANDLER, system.on_event, sizes),
        _of_function(system, record_at_event, AT_EVENT, at_event, own),
        _of_function(system, record_at_end, AT_END, at_end, own),
    )


def _of_callback(
    system: System, template: Any, native: Any, callback: Callback | None, sizes: Any
) -> int:
    """Return the address of a template's machine code for one of its callbacks."""
    if callback is None:
        return 0
    key = (template, callback)
    if key not in system.made:
        name = callback.signature.name
        if not callback.compiled:
            raise ArgumentError(
                f"{name}: expected a function that Numba compiles, because its "
                "derivatives come from its machine code, found one that runs as plain "
                "Python"
            )
        called = (name, callback.dual)
        system.made[key] = _compiled(template, native, called, sizes, callback.kept)
    return int(system.made[key].address)


def _of_function(
    system: System, template: Any, native: Any, function: Function | None, sizes: Any
) -> int:
    """Return the address of a template's machine code for a loss.

    It is compiled anew if a global name that the function uses has another value.
    """
    if function is None:
        return 0
    plain = getattr(function, "py_func", function)
    key = (template, plain)
    known = system.made.get(key)
    if known is None or not known[0].are_current():
        constants = Constants([plain])
        name = getattr(plain, "__name__", "loss")
        compiled = numba.njit(error_model="numpy")(with_digest(plain))
        code = _compiled(template, native, (name, compiled), sizes, True)
        known = (constants, code)
        system.made[key] = known
    return int(known[1].address)


def _compiled(
    template: Any, native: Any, called: tuple[str, Any], sizes: Any, kept: bool
) -> Any:
    """Return a template's machine code; `kept` if other processes may use it."""
    name, dispatcher = called
    names = {"ROWS": _ROWS, "PLAIN": _PLAIN, **sizes}
    function = with_digest(template, **names, CALL=dispatcher)
    digest = f"{function_digest(function)}-{own_digest()}"

    def compile_it(cached: bool) -> Any:
        compiler = cfunc(native, cache=cached and kept, error_model="numpy")
        return compiler(function)

    try:
        return compiled_in_cache(function, digest, compile_it)
    # Numba's own exceptions, and others raised within it.
    except Exception as error:
        reason, _ = reason_and_advice(error)
        raise ArgumentError(
            f"{name}: expected a function whose derivative can be recorded, found "
            f"one that does not compile for it: {reason}"
        ) from error


@cache
def own_digest() -> str:
    """Return a digest of the sources of this folder and of what they import."""
    return sources_digest(PACKAGE, "gradients")
