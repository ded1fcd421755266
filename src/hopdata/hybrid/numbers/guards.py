# ruff: noqa: ARG001 (the signature of machine code is the same for all)
"""The guards' code for ranges, on which proofs stand.

A user's guards are compiled once more, with ranges for time and states, and without
their rates `hdot`, which the ranges have themselves. Guards that Numba cannot compile
so have no code, with a reason.
"""

from dataclasses import dataclass
from typing import Any

from numba import cfunc

from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import in_module_of, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import array_of, float_vector, int_vector
from hopdata.hybrid.numbers.answers import RANGES_NATIVE
from hopdata.hybrid.numbers.choice import may_be_left_out
from hopdata.hybrid.numbers.source import may_branch

# Arguments of guards that vary within a step. Their other arguments do not.
VARIES = frozenset(("t", "y", "dy", "h", "hdot"))
NO_CODE = -1  # address where no code for ranges can be made
CHOSEN = -1  # count: some of all guards

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
    """

    address: int = 0
    reason: str = ""
    code: Any = None
    leaves_out: bool = False


def branches_of(guards: Callback | None) -> RangedGuards:
    """Return the code for ranges of guards that may branch; others need none.

    Parameters
    ----------
    guards : Callback, optional
        The guards, together (`@guards`) or one by one (`@guard`).
    """
    if guards is None:
        return RangedGuards()
    users = guards
    while hasattr(users, "inner"):  # derived from the user's
        users = users.inner
    function, places = users.source_and_places(VARIES)
    if not may_branch(function, places):
        return RangedGuards()
    return guards_for_ranges(guards)


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
    template = _all
    if one_by_one:
        template = _each
    elif leaves_out:
        template = _all_or_chosen
    inserted = {
        "chosen_at": ranges.chosen_at,
        "make": ranges.make,
        "rows_at": ranges.rows_at,
        "results_at": ranges.results_at,
        "sink": ranges.sink,
        "array_of": array_of,
        "float_vector": float_vector,
        "int_vector": int_vector,
    }
    assert sums  # the modules give the ranges their operations
    library.symbol()  # before code that calls it is loaded
    try:
        function = with_digest(template, **inserted, CALL=guards.ranged)
        own = in_module_of(ranges.DIGEST, guards)
        digest = f"{function_digest(function)}-{own}"

        def compile_it(cached: bool) -> Any:
            return cfunc(RANGES_NATIVE, cache=cached and guards.kept, **ENTRY)(function)

        code = compiled_in_cache(function, digest, compile_it)
    # Numba's own exceptions, and others raised within it.
    except Exception as error:
        reason, _ = reason_and_advice(error)
        return RangedGuards(NO_CODE, reason)
    return RangedGuards(code.address, code=code, leaves_out=leaves_out)


CALL: Any = None  # inserted, as are the functions that it takes
make = rows_at = results_at = chosen_at = sink = CALL


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
