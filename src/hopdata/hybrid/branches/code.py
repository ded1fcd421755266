# ruff: noqa: ARG001 (the signature of machine code is the same for all)
"""Which guards may branch on state or time, and their code for ranges.

A guard whose source shows that it does not (`branches.source`) is left to the driver as
it is. Every other guard is compiled once more, for ranges of states
(`branches.ranges`).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numba import cfunc

from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.hybrid.branches.native import RANGES_NATIVE
from hopdata.hybrid.branches.source import may_branch
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import sources_digest, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import array_of, float_vector, int_vector

# Arguments of guards that vary within a step. Their other arguments do not.
VARIES = frozenset(("t", "y", "dy", "h", "hdot"))
NO_CODE = -1  # address where no code for ranges can be made


@dataclass(frozen=True)
class Branches:
    """The guards' code for ranges.

    Parameters
    ----------
    address : int
        Address of the machine code; 0 if the guards do not branch on state or time,
        NO_CODE if they may, and Numba cannot compile them for ranges.
    reason : str
        Why there is no code.
    code : object
        What holds the machine code.
    """

    address: int = 0
    reason: str = ""
    code: Any = None


def branches_of(guards: Callback | None) -> Branches:
    """Return the code for ranges of a system's guards.

    Parameters
    ----------
    guards : Callback, optional
        The guards, together (`@guards`) or one by one (`@guard`).
    """
    if guards is None:
        return Branches()
    users = guards
    while hasattr(users, "inner"):  # derived from the user's
        users = users.inner
    function, places = users.source_and_places(VARIES)
    if not may_branch(function, places):
        return Branches()
    return compiled_for_ranges(guards)


def compiled_for_ranges(guards: Callback) -> Branches:
    """Return the code of guards for ranges, or why there is none."""
    from hopdata.hybrid.branches import ranges  # takes some time; few guards need it

    one_by_one = "k" in guards.signature.arguments
    template = _each if one_by_one else _all
    inserted = {
        "make": ranges.make,
        "rows_at": ranges.rows_at,
        "sink": ranges.sink,
        "array_of": array_of,
        "float_vector": float_vector,
        "int_vector": int_vector,
    }
    try:
        function = with_digest(template, **inserted, CALL=guards.ranged)
        sources = sources_digest(Path(__file__).parents[1], "branches")
        digest = f"{function_digest(function)}-{sources}"

        def compile_it(cached: bool) -> Any:
            return cfunc(RANGES_NATIVE, cache=cached and guards.kept, **ENTRY)(function)

        code = compiled_in_cache(function, digest, compile_it)
    # Numba's own exceptions, and others raised within it.
    except Exception as error:
        reason, _ = reason_and_advice(error)
        return Branches(NO_CODE, reason)
    return Branches(code.address, code=code)


CALL: Any = None  # inserted, as are the functions that it takes
make = rows_at = sink = CALL


def _all(  # noqa: PLR0913 (the signature of machine code)
    start: float, end: float, states: int, slopes: int, n: int, mode: int,
    n_modes: int, params: int, n_params: int, room: int, n_guards: int, listed: int,
    count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards, declared together, for ranges; the list has all of them."""
    y = rows_at(states, n, n, at)
    dy = rows_at(slopes, n, n, at)
    h = rows_at(room, n_guards, n_guards, at)
    hdot = sink(n_guards, at)
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    CALL(make(start, end, at), y, dy, modes, numbers, h, hdot)


def _each(  # noqa: PLR0913 (the signature of machine code)
    start: float, end: float, states: int, slopes: int, n: int, mode: int,
    n_modes: int, params: int, n_params: int, room: int, n_guards: int, listed: int,
    count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards in a list, declared one by one, for ranges."""
    h = rows_at(room, n_guards, n_guards, at)
    hdot = sink(n_guards, at)
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    which = int_vector(listed, count)
    for a in range(count):
        y = rows_at(states, n, n, at)
        dy = rows_at(slopes, n, n, at)
        CALL(make(start, end, at), y, dy, modes, numbers, which[a], h, hdot)
