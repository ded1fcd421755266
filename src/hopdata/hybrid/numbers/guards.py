# ruff: noqa: ARG001 (the signature of machine code is the same for all)
"""The guards' code for ranges, on which proofs stand.

A user's guards are compiled once more, with ranges for time and states, and without
their rates `hdot`, which the ranges have themselves. Guards that Numba cannot compile
so have no code, with a reason.
"""

from dataclasses import dataclass
from typing import Any

from numba import cfunc

from hopdata.code_cache import compiled_in_cache, function_digest, is_in_cache
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import in_module_of, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import array_of, float_vector, int_vector
from hopdata.hybrid.numbers.answers import CHOSEN, RANGES_NATIVE
from hopdata.hybrid.numbers.choice import may_be_left_out

NO_CODE = -1  # address where no code for ranges can be made

#: Guards from which on they may be left out of an evaluation one by one.
#: Unit: 1. Origin: chosen.
MANY_GUARDS = 100


@dataclass(frozen=True)
class RangedGuards:
    """The guards' code for ranges.

    Parameters
    ----------
    address : int
        Address of the machine code, of the signature RANGES_NATIVE; NO_CODE if Numba
        cannot compile the guards for ranges; 0 if there are no guards.
    reason : str
        Why there is no code.
    code : object
        What holds the machine code.
    leaves_out : bool
        Whether the code evaluates only chosen guards if the count of them is CHOSEN.
        The list then has a number for each guard, 0 for those that are left out.
    in_all_modes : bool
        Of a field: whether its jumps in time are the same in all modes.
    """

    address: int = 0
    reason: str = ""
    code: Any = None
    leaves_out: bool = False
    in_all_modes: bool = False


def users_own(callback: Callback) -> Callback:
    """Return the user's callback from which another is derived, or itself."""
    while hasattr(callback, "inner"):
        callback = callback.inner
    return callback


def guards_for_ranges(guards: Callback | None, count: int = 0) -> RangedGuards:
    """Return the code of guards for ranges, or why there is none.

    Parameters
    ----------
    guards : Callback, optional
        The guards, together (`@guards`) or one by one (`@guard`).
    count : int
        Number of guards, if many of them may be left out of an evaluation.
    """
    if guards is None:
        return RangedGuards()
    from hopdata.hybrid.numbers import library, ranges, sums

    one_by_one = "k" in guards.signature.arguments
    leaves_out = count >= MANY_GUARDS and may_be_left_out(guards)
    templates: tuple[Any, ...] = (_all, _all_by_arrays)
    if one_by_one:
        templates = (_each, _each_by_arrays)
    elif leaves_out:
        templates = (_all_or_chosen,)
    inserted = {
        "chosen_at": ranges.chosen_at,
        "make": ranges.make,
        "rows_at": ranges.rows_at,
        "results_at": ranges.results_at,
        "sink": ranges.sink,
        "array_of": array_of,
        "float_vector": float_vector,
        "int_vector": int_vector,
        "as_array": sums.as_array,
    }
    library.load()  # before code that calls it is loaded
    try:
        entries = _entries(templates, guards, inserted, ranges.DIGEST)
        code = _compiled(entries, guards)
    # Numba's own exceptions, and others raised within it.
    except Exception as error:
        reason, _ = reason_and_advice(error, users_own(guards).users)
        return RangedGuards(NO_CODE, reason)
    return RangedGuards(code.address, code=code, leaves_out=leaves_out)


def _entries(
    templates: tuple[Any, ...], guards: Callback, inserted: dict[str, Any], own: str
) -> list[tuple[Any, str]]:
    """Return the functions to compile, with their digests."""
    found = []
    own = in_module_of(own, guards)
    for template in templates:
        function = with_digest(template, **inserted, CALL=guards.ranged)
        found.append((function, f"{function_digest(function)}-{own}"))
    return found


def _compiled(entries: list[tuple[Any, str]], guards: Callback) -> Any:
    """Return the first machine code that can be made.

    Code that is kept is taken at once, as the other form did not compile then.
    """
    for entry in entries:
        if guards.kept and is_in_cache(*entry):
            entries = [entry]
            break
    for function, digest in entries[:-1]:
        try:
            return _code_of(function, digest, guards)
        # Numba's own exceptions, and others raised within it.
        except Exception:
            continue
    return _code_of(*entries[-1], guards)


def _code_of(function: Any, digest: str, guards: Callback) -> Any:
    def compile_it(cached: bool) -> Any:
        return cfunc(RANGES_NATIVE, cache=cached and guards.kept, **ENTRY)(function)

    return compiled_in_cache(function, digest, compile_it)


# The code comes in two forms. By address, a range is read where the guards use it. Code
# that computes with whole arrays gets arrays, into which the ranges are copied.

CALL: Any = None  # inserted, as are the functions that it takes
make = rows_at = results_at = chosen_at = sink = as_array = CALL


def _all(  # noqa: PLR0913 (the signature of machine code)
    start: float, end: float, pace: float, states: int, slopes: int, n: int, mode: int,
    n_modes: int, params: int, n_params: int, room: int, n_guards: int, listed: int,
    count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards, declared together, for ranges; the list has all of them."""
    t = make(start, end, pace, pace, at)
    y = rows_at(states, n, n, 1, at)
    dy = rows_at(slopes, n, n, 0, at)
    h = results_at(room, n_guards, n_guards, 1, at)
    hdot = sink(n_guards, at)
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    CALL(t, y, dy, modes, numbers, h, hdot)


def _all_or_chosen(  # noqa: PLR0913 (the signature of machine code)
    start: float, end: float, pace: float, states: int, slopes: int, n: int, mode: int,
    n_modes: int, params: int, n_params: int, room: int, n_guards: int, listed: int,
    count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards, declared together, for ranges: all, or those chosen."""
    t = make(start, end, pace, pace, at)
    y = rows_at(states, n, n, 1, at)
    dy = rows_at(slopes, n, n, 0, at)
    hdot = sink(n_guards, at)
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    if count == CHOSEN:
        h = chosen_at(room, n_guards, n_guards, listed, at)
        CALL(t, y, dy, modes, numbers, h, hdot)
    else:
        all_h = results_at(room, n_guards, n_guards, 1, at)
        CALL(t, y, dy, modes, numbers, all_h, hdot)


def _each(  # noqa: PLR0913 (the signature of machine code)
    start: float, end: float, pace: float, states: int, slopes: int, n: int, mode: int,
    n_modes: int, params: int, n_params: int, room: int, n_guards: int, listed: int,
    count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards in a list, declared one by one, for ranges."""
    t = make(start, end, pace, pace, at)
    y = rows_at(states, n, n, 1, at)
    dy = rows_at(slopes, n, n, 0, at)
    h = results_at(room, n_guards, n_guards, 1, at)
    hdot = sink(n_guards, at)
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    which = int_vector(listed, count)
    for a in range(count):
        CALL(t, y, dy, modes, numbers, which[a], h, hdot)


def _all_by_arrays(  # noqa: PLR0913 (the signature of machine code)
    start: float, end: float, pace: float, states: int, slopes: int, n: int, mode: int,
    n_modes: int, params: int, n_params: int, room: int, n_guards: int, listed: int,
    count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards, declared together, for arrays of ranges."""
    t = make(start, end, pace, pace, at)
    y = as_array(rows_at(states, n, n, 1, at))
    dy = as_array(rows_at(slopes, n, n, 0, at))
    results = results_at(room, n_guards, n_guards, 1, at)
    h = as_array(results)
    hdot = as_array(results)
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    CALL(t, y, dy, modes, numbers, h, hdot)
    for k in range(n_guards):
        results[k] = h[k]


def _each_by_arrays(  # noqa: PLR0913 (the signature of machine code)
    start: float, end: float, pace: float, states: int, slopes: int, n: int, mode: int,
    n_modes: int, params: int, n_params: int, room: int, n_guards: int, listed: int,
    count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards in a list, declared one by one, for arrays of ranges."""
    t = make(start, end, pace, pace, at)
    y = as_array(rows_at(states, n, n, 1, at))
    dy = as_array(rows_at(slopes, n, n, 0, at))
    results = results_at(room, n_guards, n_guards, 1, at)
    h = as_array(results)
    hdot = as_array(results)
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    which = int_vector(listed, count)
    for a in range(count):
        CALL(t, y, dy, modes, numbers, which[a], h, hdot)
        results[which[a]] = h[which[a]]
