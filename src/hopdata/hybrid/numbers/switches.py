# ruff: noqa: ARG001 (the signature of machine code is the same for all)
"""Whether a field may jump in time, and its code for ranges, by which that is found.

The source of the field decides whether it may: by comparing the time, or by something
that jumps or has a kink in it (`numbers.source`). Others pay nothing.
"""

from typing import Any

from numba import cfunc

from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import in_module_of, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import array_of, float_vector, int_vector
from hopdata.hybrid.numbers.answers import RANGES_NATIVE
from hopdata.hybrid.numbers.guards import NO_CODE, RangedGuards, users_own
from hopdata.hybrid.numbers.modes import is_same_in_all_modes
from hopdata.hybrid.numbers.source import may_branch

TIME = frozenset(("t",))
MODE = frozenset(("mode",))
INPUTS = frozenset(("t", "y", "mode", "params"))


def may_switch(field: Callback) -> bool:
    """Return whether a field may jump, or have a kink, at an instant of its own.

    Parameters
    ----------
    field : Callback
        The user's field, or one that is derived from it.
    """
    function, places = users_own(field).source_and_places(TIME)
    return len(places) > 0 and may_branch(function, places)


def switches_in_all_modes(field: Callback) -> bool:
    """Return whether the jumps of a field in time are surely the same in all modes."""
    users = users_own(field)
    function, times = users.source_and_places(TIME)
    _, modes = users.source_and_places(MODE)
    _, inputs = users.source_and_places(INPUTS)
    return is_same_in_all_modes(function, times, modes, inputs)


def field_for_ranges(field: Callback) -> RangedGuards:
    """Return the code of a field for ranges, or why there is none."""
    from hopdata.hybrid.numbers import library, ranges, sums

    inserted = {
        "make": ranges.make,
        "rows_at": ranges.rows_at,
        "sink": ranges.sink,
        "array_of": array_of,
        "float_vector": float_vector,
        "int_vector": int_vector,
    }
    assert sums  # the modules give the ranges their operations
    library.load()  # before code that calls it is loaded
    try:
        function = with_digest(_field, **inserted, CALL=field.ranged)
        own = in_module_of(ranges.DIGEST, field)
        digest = f"{function_digest(function)}-{own}"

        def compile_it(cached: bool) -> Any:
            kept = cached and field.kept
            return cfunc(RANGES_NATIVE, cache=kept, **ENTRY)(function)

        code = compiled_in_cache(function, digest, compile_it)
    # Numba's own exceptions, and others raised within it.
    except Exception as error:
        reason, _ = reason_and_advice(error)
        return RangedGuards(NO_CODE, reason)
    in_all = switches_in_all_modes(field)
    return RangedGuards(code.address, code=code, in_all_modes=in_all)


CALL: Any = None  # inserted, as are the functions that it takes
make = rows_at = sink = CALL


def _field(  # noqa: PLR0913 (the signature of machine code)
    start: float, end: float, pace: float, states: int, slopes: int, n: int, mode: int,
    n_modes: int, params: int, n_params: int, room: int, n_guards: int, listed: int,
    count: int, at: int,
) -> None:  # fmt: skip
    """Run the field for ranges; of its rates nothing is kept."""
    t = make(start, end, pace, pace, at)
    y = rows_at(states, n, n, 1, at)
    dy = sink(n, at)
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    CALL(t, y, modes, numbers, dy)
