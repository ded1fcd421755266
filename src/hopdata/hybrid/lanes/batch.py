"""Lanes for one system: whether they can integrate it, and its functions' code."""

import re
from collections.abc import Callable
from ctypes import CFUNCTYPE, c_int64
from functools import cache
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numba import NumbaError, cfunc, types

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.aloud import said_if_long
from hopdata.hybrid.compiled.caught import Caught
from hopdata.hybrid.compiled.declare import function_name, reason_and_advice
from hopdata.hybrid.compiled.digest import sources_digest, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import row
from hopdata.hybrid.driver.loop import compiled_aloud
from hopdata.hybrid.lanes import room as layout
from hopdata.hybrid.lanes import step as code
from hopdata.hybrid.lanes.ranges import make, nothing_of, ranges_of
from hopdata.hybrid.lanes.vectors import (
    WIDTH,
    Rows,
    aligned,
    largest,
    least,
    mask_of,
    part,
    spread,
    where,
)
from hopdata.hybrid.methods.explicit import compose
from hopdata.hybrid.methods.method import put_in
from hopdata.hybrid.system import System
from hopdata.hybrid.workspace import NO_TIMES, Workspace

MOST_GUARDS = 62  # their indices are bits of an integer

#: Most integers of the mode that field and guards may read: with more, lanes would
#: seldom agree, and each group of them is evaluated apart.
#: Unit: 1. Origin: chosen.
MOST_READ = 12

BRANCH = (
    "it branches on the state or the time: choose between values by np.where, min or "
    "max"
)

ARRAYS = "it writes a state or the time into an array: lanes keep them in variables"

_PLACE = re.compile(r" \(line (\d+)(?:: (.*))?\)$")
_UNKNOWN = re.compile(r"it does not know (\w+)\(")


def reason_against(system: System, method: str, jacobian: bool) -> str:
    """Return why lanes cannot integrate a system, as far as known without compiling.

    The reason is "" if there is none.
    """
    return _reason_of_declarations(system) or _reason_of_the_rest(
        system, method, jacobian
    )


def _reason_of_the_rest(system: System, method: str, jacobian: bool) -> str:
    """Return why lanes cannot integrate a system that declares nothing beside."""
    if jacobian:
        return "only the driver carries the Jacobian of the flow"
    if method not in ("auto", "dop853"):
        return f"their method is 'dop853', not {method!r}"
    if method == "auto" and system.affine is not None:
        return "the modes are affine, and 'auto' takes Taylor's method for them"
    if system.rules[at.TERMINAL].max(initial=0) > 1:
        return "a later event than a guard's first ends the integration"
    if system.n_guards > MOST_GUARDS:
        return f"there are {system.n_guards} guards, and lanes keep {MOST_GUARDS}"
    n_read = len(read_modes(system))
    if n_read > MOST_READ:
        return f"they read {n_read} integers of the mode: few lanes would agree"
    for one in (system.field, system.guards, system.guard, system.on_event):
        if one is not None and not (one.address and one.compiled):
            kind = one.signature.name
            return f"{kind} {function_name(one.function)!r} runs as plain Python"
    if system.branches.address < 0:
        return f"the guards have no code for ranges: {system.branches.reason}"
    return ""


def _reason_of_declarations(system: System) -> str:
    """Return why lanes cannot follow what the system declares beside its guards."""
    if system.by_law:
        return "a law decides about several guards at once, which only the driver asks"
    if system.takes_instants:
        return (
            "instants are known, or sought, at which the field jumps, and only the "
            "driver ends its steps there"
        )
    if system.slides is not None:
        return "guards may slide, and only the driver follows that"
    return ""


def lane_runner(
    system: System,
    method: str,
    jacobian: bool,
    arrays: tuple[Any, ...],
    options: tuple[Any, ...],
) -> tuple[Callable[[int, int], int] | None, str]:
    """Return a function that integrates rows in lanes, or None and the reason.

    Parameters
    ----------
    system, method, jacobian
        As in `solve_batch`.
    arrays : tuple of array
        Initial states, parameters and modes; room for status, ends, modes, counts and
        samples; requested times and absolute tolerances.
    options : tuple
        Start, end, relative tolerance, largest and first step, most steps and events.
    """
    reason = reason_against(system, method, jacobian)
    if not reason and options[1] == inf:
        reason = "the end of t_span is infinite"
    if reason:
        return None, reason
    params = arrays[1]
    n_params = params.shape[1]
    in_lanes = len(params) > 1 or system.n_memory > 0
    key = (lane_functions, n_params, in_lanes)
    if key not in system.made:
        system.made[key] = lane_functions(system, n_params, in_lanes)
    functions, reason = system.made[key]
    if reason:
        return None, reason
    integrate = CFUNCTYPE(c_int64, c_int64, c_int64, c_int64)(compiled_loop().address)

    idle = system.made.setdefault((_new_workspaces,), [])

    def run(first: int, last: int) -> int:
        works = idle.pop() if idle else _new_workspaces(system)
        block, _kept = _argument_block(
            system, arrays, options, in_lanes, functions, works
        )
        with Caught() as caught:
            integrate(first, last, block.ctypes.data)
        idle.append(works)
        if caught:
            raise caught[0]
        return last - first

    return run, ""


# The system's functions, compiled for lanes and called by their address.

# These names are inserted: the system's function, and what gives its arguments.
CALL: Any = None
states: Any = None
margins: Any = None
params_of: Any = None
ranges: Any = None
unknown: Any = None
results: Any = None
nothing: Any = None


def field_of_groups(t: Any, y: Any, r: Any, dy: Any) -> None:
    """Evaluate the field for each group of lanes."""
    other = states(r.other, 0)
    params = params_of(r)
    CALL(t, y, row(r.modes, r.book[layout.LEAD, 0]), params, dy)
    for group in range(1, r.book[layout.N_GROUPS, 0]):
        CALL(t, y, row(r.modes, r.book[layout.LEAD, group]), params, other)
        mine = mask_of(r.book[layout.MEMBERS, group])
        for i in range(len(dy)):
            dy[i] = where(mine, other[i], dy[i])


def guards_of_groups(t: Any, y: Any, dy: Any, r: Any, h: Any, rate: Any) -> None:
    """Evaluate the guards for each group of lanes."""
    other_h = margins(r.other_h, 0)
    other_rate = margins(r.other_rate, 0)
    params = params_of(r)
    CALL(t, y, dy, row(r.modes, r.book[layout.LEAD, 0]), params, h, rate)
    for group in range(1, r.book[layout.N_GROUPS, 0]):
        mode = row(r.modes, r.book[layout.LEAD, group])
        CALL(t, y, dy, mode, params, other_h, other_rate)
        mine = mask_of(r.book[layout.MEMBERS, group])
        for g in range(len(h)):
            h[g] = where(mine, other_h[g], h[g])
            rate[g] = where(mine, other_rate[g], rate[g])


def values_and_rates_of_groups(
    t: Any, y: Any, dy: Any, r: Any, h: Any, rate: Any
) -> None:
    """Evaluate guards that return only values; their rates are those of points."""
    one = spread(1.0)
    time = make(t, t, one, one)
    for i in range(len(y)):
        k = layout.RANGE * i
        r.ranges[k] = y[i]
        r.ranges[k + 1] = y[i]
        r.ranges[k + 2] = dy[i]
        r.ranges[k + 3] = dy[i]
    other_h = margins(r.other_h, 0)
    params = params_of(r)
    points = ranges(states(r.ranges, 0))
    none = unknown(states(r.ranges, 0))
    limits = results(margins(r.limits, 0))
    hdot = nothing(0)
    for group in range(r.book[layout.N_GROUPS, 0]):
        mode = row(r.modes, r.book[layout.LEAD, group])
        mine = mask_of(r.book[layout.MEMBERS, group])
        CALL(t, y, none, mode, params, other_h, hdot)
        CALL(time, points, none, mode, params, limits, hdot)
        for g in range(len(h)):
            k = layout.RANGE * g
            middle = 0.5 * (r.limits[k + 2] + r.limits[k + 3])
            h[g] = where(mine, other_h[g], h[g])
            rate[g] = where(mine, middle, rate[g])


def guards_one_by_one(
    t: Any, y: Any, dy: Any, mode: Any, params: Any, h: Any, rate: Any
) -> None:
    """Evaluate guards that are declared one by one."""
    for g in range(len(h)):
        CALL(t, y, dy, mode, params, g, h, rate)


def ranged_guards_of_groups(t: Any, t_end: Any, r: Any) -> None:
    """Evaluate the guards for ranges over the steps, for each group of lanes."""
    one = spread(1.0)
    time = make(least(t, t_end), largest(t, t_end), one, one)
    params = params_of(r)
    y = ranges(states(r.ranges, 0))
    dy = unknown(states(r.ranges, 0))
    limits = results(margins(r.limits, 0))
    other = results(margins(r.other_limits, 0))
    hdot = nothing(0)
    CALL(time, y, dy, row(r.modes, r.book[layout.LEAD, 0]), params, limits, hdot)
    for group in range(1, r.book[layout.N_GROUPS, 0]):
        mode = row(r.modes, r.book[layout.LEAD, group])
        CALL(time, y, dy, mode, params, other, hdot)
        mine = mask_of(r.book[layout.MEMBERS, group])
        for q in range(layout.RANGE * r.n_guards):
            r.limits[q] = where(mine, r.other_limits[q], r.limits[q])


def no_guards(
    t: Any, y: Any, dy: Any, mode: Any, params: Any, h: Any, rate: Any
) -> None:
    """Evaluate the guards of a system that has none."""


def lane_functions(
    system: System, n_params: int, in_lanes: bool
) -> tuple[list[Any], str]:
    """Return the machine code of field and guards, and "" or why there is none.

    Parameters
    ----------
    system : System
        System to integrate.
    n_params : int
        Number of its parameters, including the memory.
    in_lanes : bool
        Whether each lane has its own parameters.
    """
    states = part(system.n_states)
    margins = part(system.n_guards)
    names = {
        "states": states,
        "margins": margins,
        "params_of": _params_of(n_params, in_lanes),
    }
    ranged = {
        "ranges": ranges_of(system.n_states),
        "unknown": ranges_of(system.n_states, False),
        "results": ranges_of(system.n_guards),
        "nothing": nothing_of(system.n_guards),
    }
    field = with_digest(field_of_groups, **names, CALL=system.field.dispatcher)
    guards = with_digest(guards_of_groups, **names, CALL=_guards_of(system))
    values = _values_of(system)
    if _has_no_rates(system):
        guards = with_digest(values_and_rates_of_groups, **names, **ranged, CALL=values)
    with said_if_long("the functions of a system for lanes"):
        return _compiled_for_lanes(system, field, guards, values, names | ranged)


def _compiled_for_lanes(
    system: System, field: Any, guards: Any, values: Any, names: dict[str, Any]
) -> tuple[list[Any], str]:
    """Return the machine code of field and guards, and "" or why there is none.

    Parameters
    ----------
    system : System
        System to integrate.
    field, guards : function
        What calls its functions for each group of lanes.
    values : function
        The guards' code for ranges.
    names : dict
        What stands for names in that code.
    """
    field_native, guards_native = layout.natives(
        Rows(system.n_states), Rows(system.n_guards)
    )
    code: list[Any] = []
    asked: list[tuple[Any, Any, Any]] = [(field, field_native, system.field)]
    asked.append((guards, guards_native, system.guards or system.guard))
    for function, native, users in asked:
        try:
            code.append(_compiled(function, native))
        except NumbaError as error:
            return [], _sentence(error, users)
    if system.n_guards == 0:
        return [*code, None], ""
    over_steps = with_digest(ranged_guards_of_groups, **names, CALL=values)
    try:
        return [*code, _compiled(over_steps, layout.RANGED)], ""
    except NumbaError:  # operations that ranges of lanes do not have
        return [*code, None], ""


def _has_no_rates(system: System) -> bool:
    """Return whether the user's guards return only values."""
    guards: Any = system.guards
    while hasattr(guards, "inner"):  # derived from the user's
        guards = guards.inner
    return guards is not None and guards.form is not None


def _params_of(n_params: int, in_lanes: bool) -> Any:
    """Return a function that gives the parameters: of all lanes, or a row for all.

    The length is in its name, because cached code is linked by name.
    """
    own = f"part_{n_params}"
    source = own if in_lanes else "row"
    known = {own: part(n_params), "row": row}
    return put_in(compose("params_of", "r", [f"return {source}(r.params, 0)"], known))


def _guards_of(system: System) -> Any:
    if system.guard is not None:
        return put_in(guards_one_by_one, CALL=system.guard.dispatcher)
    if system.guards is None:
        return put_in(no_guards)
    return system.guards.dispatcher


def _values_of(system: System) -> Any:
    """Return the guards' code for ranges, which leave their rates as they are."""
    if system.guard is not None:
        return put_in(guards_one_by_one, CALL=system.guard.ranged)
    if system.guards is None:
        return put_in(no_guards)
    return system.guards.ranged


def _argument_block(
    system: System,
    arrays: tuple[Any, ...],
    options: tuple[Any, ...],
    in_lanes: bool,
    functions: list[Any],
    works: list[Workspace],
) -> tuple[IntArray, tuple[Any, ...]]:
    """Return the argument block of one thread, and the arrays to which it points.

    Its entries are those of `room.ITEMS`, in this order.
    """
    n = system.n_states
    n_guards = system.n_guards
    params = arrays[1]
    n_own = params.shape[1] if in_lanes else 0
    first = layout.first_rows(n, n_guards)
    table = np.asarray(aligned(first["params"] + n_own).reshape(-1, WIDTH))
    own_params = np.empty((WIDTH, params.shape[1]))
    modes = np.zeros((WIDTH, system.n_modes), dtype=np.int64)
    _ask_for_proofs(works, own_params, modes, arrays[-1], options)
    views = (
        table,
        table[first["lock"] :],
        table[first["params"] :] if in_lanes else params,
        np.empty(n),  # state of one lane, for the handler
        own_params,
        modes,
        np.zeros((layout.BOOK_ROWS, WIDTH), dtype=np.int64),
        np.array([[work.block_address for work in works]], dtype=np.int64),
        np.array(read_modes(system), dtype=np.int64),
        system.rules,
        *arrays,
    )
    block = []
    for name, row_number in first.items():
        if name != "params":
            block.append(table[row_number:].ctypes.data)
    for array in views:
        block += [array.ctypes.data, array.shape[-1]]
    floats = np.array(options[:5])  # kept in the memory of integers
    block += floats.view(np.int64).tolist()
    block += [*options[5:], n, n_guards, n_own, len(params)]
    block.append(0 if system.on_event is None else system.on_event.address)
    block += [0 if one is None else one.address for one in functions]
    return np.array(block, dtype=np.int64), (*views, works)


def _new_workspaces(system: System) -> list[Workspace]:
    """Return the memory of the driver for each lane, in which its steps are proven."""
    methods = system.methods("dop853", False)
    works = [Workspace(system) for _ in range(WIDTH)]
    for work in works:
        work.begin(methods, NO_TIMES, False)
    return works


def _ask_for_proofs(
    works: list[Workspace],
    params: FloatArray,
    modes: IntArray,
    atol: FloatArray,
    options: tuple[Any, ...],
) -> None:
    """Let each of these have a row of `params` and of `modes`, and the options."""
    for work, own, mode in zip(works, params, modes, strict=True):
        work.set_tolerance(atol)
        for slot, array in ((at.PARAMS, own), (at.MODE, mode)):
            work.block[slot] = array.ctypes.data
            work.block[slot + 1] = len(array)
        numbers = work.block.view(np.float64)
        numbers[[at.T_START, at.T_END, at.RTOL]] = options[:3]


@cache
def compiled_loop() -> Any:
    """Return the machine code of the loop, which serves all systems.

    Compiling it is announced on stderr.
    """

    def compile_it(cached: bool) -> Any:
        native = types.int64(types.int64, types.int64, types.int64)
        compiler = cfunc(native, cache=cached, **ENTRY)
        what = "the loop in lanes, some 10 s"
        return compiled_aloud(code.run, compiler, cached, what)

    return compiled_in_cache(code.run, _digest_of(code.run), compile_it)


def _compiled(function: Any, native: Any) -> Any:
    return compiled_in_cache(
        function,
        _digest_of(function),
        lambda kept: cfunc(native, cache=kept, **ENTRY)(function),
    )


def _digest_of(function: Any) -> str:
    sources = sources_digest(Path(__file__).parents[1], "lanes")
    return f"{function_digest(function)}-{sources}-{WIDTH}"


def read_modes(system: System) -> tuple[int, ...]:
    """Return the places of the mode that field and guards read."""
    key = (read_modes,)
    if key not in system.made:
        found: set[int] = set()
        for one in (system.field, system.guards, system.guard):
            if one is not None:
                found |= set(one.elements_of("mode", system.n_modes))
        system.made[key] = tuple(sorted(found))
    return system.made[key]


def _sentence(error: NumbaError, one: Any) -> str:
    """Return a sentence that names a function, its line, and what stands in the way.

    `one` is the system's field or guards, as declared.
    """
    function = getattr(one.function, "users", one.function)
    reason, _ = reason_and_advice(error, function)
    said = _PLACE.search(reason)
    where = f"{one.signature.name} {function_name(function)!r}"
    if said:
        where += f", line {said[1]}"
        where += f" ({said[2]})" if said[2] else ""
        reason = reason[: said.start()]
    unknown = _UNKNOWN.search(reason)
    if "bool(Mask" in str(error):
        reason = BRANCH
    elif unknown and unknown[1] == "setitem":
        reason = ARRAYS
    elif unknown:
        reason = f"lanes have no code for {unknown[1]!r} of a state or the time"
    return f"{where}: {reason}"
