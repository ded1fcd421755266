"""The loop in lanes for one system: whether it is possible, and its machine code."""

import hashlib
import re
from collections.abc import Callable
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numba import NumbaError, njit, types

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import DIGITS, compiled_in_cache, function_digest
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.callbacks import Caught
from hopdata.hybrid.compiled.declare import function_name, reason_and_advice
from hopdata.hybrid.compiled.digest import driver_digest, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import row, view
from hopdata.hybrid.lanes import method as written
from hopdata.hybrid.lanes import step as code
from hopdata.hybrid.lanes.vectors import WIDTH, aligned, part
from hopdata.hybrid.methods.explicit import compose
from hopdata.hybrid.methods.method import put_in
from hopdata.hybrid.system import System

MOST_GUARDS = 62  # their indices are bits of an integer
MOST_READ = 12  # most integers of the mode: with more, lanes would seldom agree
AIMS = 7
BRANCH = "it branches on the state or the time: choose between values by np.where, min or max"
_F, _I = types.float64, types.int64
_INTS, _FLOATS = types.int64[:, ::1], types.float64[:, ::1]
NATIVE = _I(
    _I, _I, _FLOATS, _FLOATS, _INTS, _INTS, _FLOATS, _INTS, _INTS, types.float64[:, :, ::1],
    types.float64[::1], types.float64[::1], _I, _INTS, _FLOATS, _INTS, _INTS,
    _F, _F, _F, _F, _F, _I, _I,
)  # fmt: skip
# The parts of the loop that depend on the system, each after the parts that it calls.
PARTS = (
    code.group, code.take_systems, code.settle, code.give_up, code.close, code.fire,
    code.refresh, code.first_step, code.clipped, code.look, code.look_along, code.judge, code.cut,
    code.land, code.sample, code.sample_again, code.leave,
)  # fmt: skip
STATE_ROWS = {"y": 1, "k": written.SLOPES, "inner": 1, "end": 1, "moved": 1, "work": 1, "other": 1,
              "dense": 7}  # fmt: skip


def reason_against(system: System, method: str, jacobian: bool) -> str:
    """Return why lanes cannot integrate a system, as far as known without compiling; "" if none."""
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
    if len(read_modes(system)) > MOST_READ:
        return f"they read {len(read_modes(system))} integers of the mode: few lanes would agree"
    for one in (system.field, system.guards, system.guard, system.on_event):
        if one is not None and not (one.address and one.compiled):
            return f"{one.signature.name} {function_name(one.function)!r} runs as plain Python"
    return ""


def lane_runner(
    system: System, method: str, jacobian: bool, arrays: tuple[Any, ...], options: tuple[Any, ...]
) -> tuple[Callable[[int, int], int] | None, str]:
    """Return a function that integrates rows in lanes, or None and the reason.

    Parameters
    ----------
    system, method, jacobian
        As in `solve_batch`.
    arrays : tuple of array
        Initial states, parameters and modes; room for status, ends, modes, counts and samples;
        requested times and absolute tolerances.
    options : tuple
        Start, end, relative tolerance, largest and first step, most steps and events.
    """
    reason = reason_against(system, method, jacobian)
    if reason:
        return None, reason
    key = LaneCode, arrays[1].shape[1], len(arrays[1]) > 1 or system.n_memory > 0
    if key not in system.made:
        system.made[key] = LaneCode(system, *key[1:])
    code = system.made[key]
    if code.run is None:
        return None, code.reason
    handler = 0 if system.on_event is None else system.on_event.address

    def run(first: int, last: int) -> int:
        with Caught() as caught:
            code.run(first, last, *arrays, handler, system.rules, *code.room(), *options)
        if caught:
            raise caught[0]
        return last - first

    return run, ""


class LaneCode:
    """The machine code for one system.

    Parameters
    ----------
    system : System
        System to integrate.
    n_params : int
        Number of its parameters, including the memory.
    in_lanes : bool
        Whether each lane has its own parameters.

    Attributes
    ----------
    reason : str
        Why there is no code; empty if there is.
    """

    def __init__(self, system: System, n_params: int, in_lanes: bool) -> None:
        self.reason, self.run, self._rows, self._n_modes = "", None, 0, system.n_modes
        function = with_digest(code.run, **self._names(system, n_params, in_lanes))
        digest = hashlib.sha256((function_digest(function) + _sources()).encode()).hexdigest()

        def compile_it(cached: bool) -> Any:
            return njit(NATIVE, cache=cached, nogil=True, **ENTRY)(function)

        try:
            self.run = compiled_in_cache(code.run, digest[:DIGITS], compile_it)
        except NumbaError as error:
            self.reason = _sentence(error)

    def _names(self, system: System, n_params: int, in_lanes: bool) -> dict[str, Any]:
        """Return the loop's names for properties of the system, with their values."""
        n, n_guards = system.n_states, system.n_guards
        names: dict[str, Any] = {
            "N": n, "N_GUARDS": n_guards, "N_PARAMS": n_params, "PARAMS_IN_LANES": in_lanes,
            "state": part(n), "READ": np.array(read_modes(system), dtype=np.int64),
        }  # fmt: skip
        lengths = {name: count * n for name, count in STATE_ROWS.items()} | {"aim": AIMS}
        lengths |= dict.fromkeys(code.Room._fields[len(lengths) : -4], n_guards)
        lengths["params"] = n_params if in_lanes else 0
        starts = dict(zip(lengths, accumulate(lengths.values(), initial=0), strict=False))
        self._rows = sum(lengths.values())
        names |= {f"part_{name}": part(length) for name, length in lengths.items()}
        names |= {"FIRST_LOCK": starts["lock"], "FIRST_PARAM": starts["params"]}
        items = [f"part_{name}(table, {first})" for name, first in starts.items()]
        items[-1] = items[-1] if in_lanes else "row(view(params), 0)"
        known = {**names, "Room": code.Room, "row": row, "view": view}
        body = [f"return Room({', '.join(items)}, view(table), view(modes), view(book))"]
        names["room"] = put_in(compose("room", "table, params, modes, book", body, known))
        names["FIELD"] = put_in(code.field_of_groups, CALL=system.field.dispatcher)
        names["GUARDS"] = put_in(code.guards_of_groups, CALL=_guards_of(system))
        known = {**vars(code), **names}
        for name, arguments, lines in (
            ("take_step", "t, h, rtol, atol, r", written.step_code()),
            ("prepare", "t, h, r", written.dense_code()),
        ):
            names[name] = put_in(compose(name, arguments, lines, known))
        for function in PARTS:
            names[function.__name__] = put_in(function, **names)
        return names

    def room(self) -> tuple[FloatArray, IntArray, IntArray]:
        """Return room for one thread: rows, modes and integers of the lanes."""
        table = np.asarray(aligned(self._rows).reshape(self._rows, WIDTH))
        modes = np.zeros((WIDTH, self._n_modes), dtype=np.int64)
        return table, modes, np.zeros((code.BOOK_ROWS, WIDTH), dtype=np.int64)


def _guards_of(system: System) -> Any:
    if system.guards is not None:
        return system.guards.dispatcher
    if system.guard is not None:
        return put_in(code.guards_one_by_one, CALL=system.guard.dispatcher)
    return put_in(code.no_guards)


def read_modes(system: System) -> tuple[int, ...]:
    """Return the places of the mode that field and guards read."""
    found: set[int] = set()
    for one in (system.field, system.guards, system.guard):
        if one is not None:
            found |= set(one.elements_of("mode", system.n_modes))
    return tuple(sorted(found))


@cache
def _sources() -> str:
    """Return a digest of the sources of the loop."""
    digest = hashlib.sha256(driver_digest().encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return f"{digest.hexdigest()} {WIDTH}"


def _sentence(error: NumbaError) -> str:
    """Return one line that says what Numba cannot do in lanes."""
    reason, _ = reason_and_advice(error)
    if "bool(Mask" in str(error):
        line = re.search(r"\(line (\d+)\)", reason)
        reason = BRANCH + (f" {line[0]}" if line else "")
    return reason
