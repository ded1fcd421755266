# ruff: noqa: ARG001, F821 (templates: the names that they lack are inserted)
"""Derivatives of a system's functions, by running their code on dual numbers.

A function is compiled once more, unchanged (see `numbers.duals`), into machine code
that reads and writes rows of duals and is called by its address (see `numbers.along`).
A function that does not compile for duals has no such code, and the reason is kept.

The templates have these names inserted: CALL, the user's function; N and N_GUARDS, the
numbers of states and guards; ROWS and DUAL, which make duals from rows of numbers.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numba import cfunc

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import sources_digest, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import array_at, array_of, int_vector
from hopdata.hybrid.numbers import along, duals

PACKAGE = Path(__file__).parents[1]


def field_of_duals(t: float, states: int, mode: Any, params: Any, rates: int) -> None:
    """Evaluate the field at a fixed time."""
    CALL(t, ROWS(states, N), mode, params, ROWS(rates, N))


def guards_of_duals(
    moment: int, states: int, dy: Any, mode: Any, params: Any, k: int, h: int, hdot: int
) -> None:
    """Evaluate all guards."""
    values = ROWS(h, N_GUARDS)
    rates = ROWS(hdot, N_GUARDS)
    CALL(DUAL(moment), ROWS(states, N), dy, mode, params, values, rates)


def guard_of_duals(
    moment: int, states: int, dy: Any, mode: Any, params: Any, k: int, h: int, hdot: int
) -> None:
    """Evaluate one guard of those that are declared one by one."""
    values = ROWS(h, N_GUARDS)
    rates = ROWS(hdot, N_GUARDS)
    CALL(DUAL(moment), ROWS(states, N), dy, mode, params, k, values, rates)


def handler_of_duals(
    moment: int, states: int, mode: int, params: int, n_params: int, k: int, way: int
) -> None:
    """Call the handler."""
    modes = array_of(int_vector(mode, N_MODES))
    CALL(DUAL(moment), ROWS(states, N), modes, ROWS(params, n_params), k, way)


def guards_with_rates(
    t: float, y: Any, dy: Any, mode: Any, params: Any, h: Any, hdot: Any
) -> None:
    """Fill h, and hdot by its slopes along the motion, from guards without rates."""
    states = STATES()
    values = VALUES()
    PACK(states, y, dy)
    CALL(MOVING(t), ROWS(states, N), mode, params, ROWS(values, N_GUARDS))
    UNPACK(values, h, hdot)


@dataclass(frozen=True)
class Derivative:
    """Machine code of one of a system's functions for duals.

    Parameters
    ----------
    address : int
        Address of the machine code; 0 if there is none.
    reason : str
        Why there is none, though there is a function.
    code : object
        What holds the machine code.
    """

    address: int = 0
    reason: str = ""
    code: Any = None


def compiled(
    template: Any, native: Any, callback: Callback | None, width: int, **sizes: int
) -> Derivative:
    """Return the machine code of a template for a user's function, or why not.

    Parameters
    ----------
    template : callable
        A template of this module.
    native : Numba signature
        Signature of its machine code.
    callback : Callback, optional
        The user's function.
    width : int
        Number of directions that a dual carries.
    **sizes : int
        N, and N_GUARDS or N_MODES.
    """
    if callback is None:
        return Derivative()
    if not callback.compiled:
        return Derivative(reason="it runs as plain Python")
    names = {"ROWS": array_at(duals.Dual(width)), "DUAL": duals.dual_at(width)}
    function = with_digest(template, **names, **sizes, CALL=callback.dual)
    digest = f"{function_digest(function)}-{width}-{own_digest()}"

    def compile_it(cached: bool) -> Any:
        return cfunc(native, cache=cached and callback.kept, **ENTRY)(function)

    try:
        code = compiled_in_cache(function, digest, compile_it)
    # Numba's own exceptions, and others raised within it.
    except Exception as error:
        reason, _ = reason_and_advice(error)
        return Derivative(reason=reason)
    return Derivative(code.address, code=code)


def own_digest() -> str:
    """Return a digest of the sources of duals and of what they import."""
    return sources_digest(PACKAGE, "numbers")


@dataclass(frozen=True)
class Functions:
    """The functions of a system that have derivatives, and its sizes.

    Parameters
    ----------
    field : Callback
        Vector field.
    guards : Callback, optional
        Event functions, all at once or one by one.
    handler : Callback, optional
        Handler of events.
    n_states, n_guards, n_modes : int
        Numbers of states and guards, and length of the mode.
    """

    field: Callback
    guards: Callback | None
    handler: Callback | None
    n_states: int
    n_guards: int
    n_modes: int


class Derivatives:
    """Derivatives of a system's functions; each is compiled when it is asked for.

    Parameters
    ----------
    functions : Functions
        The system's functions.
    """

    def __init__(self, functions: Functions) -> None:
        self._of = functions
        self.field_width = duals.width_for(functions.n_states)
        self.width = duals.width_for(functions.n_states + 1)

    @cached_property
    def field(self) -> Derivative:
        """The field at a fixed time."""
        of = self._of
        native = along.FIELD_NATIVE
        return compiled(
            field_of_duals, native, of.field, self.field_width, N=of.n_states
        )

    @cached_property
    def guards(self) -> Derivative:
        """The guards."""
        of = self._of
        template = guards_of_duals
        if of.guards is not None and "k" in of.guards.signature.arguments:
            template = guard_of_duals
        sizes = {"N": of.n_states, "N_GUARDS": of.n_guards}
        return compiled(template, along.GUARD_NATIVE, of.guards, self.width, **sizes)

    @cached_property
    def handler(self) -> Derivative:
        """The handler."""
        of = self._of
        sizes = {"N": of.n_states, "N_MODES": of.n_modes}
        native = along.HANDLER_NATIVE
        return compiled(handler_of_duals, native, of.handler, self.width, **sizes)

    @cached_property
    def told(self) -> str:
        """Which functions have no derivative, and why; empty if all have."""
        told = []
        for name in ("field", "guards", "handler"):
            reason = getattr(self, name).reason
            if reason:
                told.append(f"{name}: {reason}")
        return "; ".join(told)


class Table:
    """The table by which the driver finds machine code and rooms (`numbers.along`).

    Parameters
    ----------
    derivatives : Derivatives
        The machine code.
    n_states, n_guards, n_modes, n_params : int
        Numbers of states, guards, entries of the mode, and parameters.
    """

    def __init__(
        self,
        derivatives: Derivatives,
        *,
        n_states: int,
        n_guards: int,
        n_modes: int,
        n_params: int,
    ) -> None:
        row = 1 + max(derivatives.field_width, derivatives.width)
        counts = {
            along.MOMENT: row,
            along.STATES: row * n_states,
            along.RATES: row * n_states,
            along.VALUES: row * n_guards,
            along.HDOTS: row * n_guards,
            along.MEMORY: row * n_params,
            along.MODES: n_modes,
        }
        self.slots: IntArray = np.zeros(along.ALONG_SLOTS, dtype=np.int64)
        self._rooms: dict[int, FloatArray] = {}
        for slot, count in counts.items():
            room = np.zeros(max(count, 1))
            self._rooms[slot] = room
            self.slots[slot] = room.ctypes.data
        self.slots[along.FIELD_WIDTH] = derivatives.field_width
        self.slots[along.WIDTH] = derivatives.width
        self.slots[along.FIELD] = derivatives.field.address
        self.slots[along.GUARD] = derivatives.guards.address
        self.slots[along.HANDLER] = derivatives.handler.address
        self._kept_alive = derivatives


def rates_of(values: Any, n_states: int, n_guards: int) -> Any:
    """Return guards with rates, as `@guards` declares them, from guards without.

    Parameters
    ----------
    values : callable
        Callable from compiled code as ``values(t, y, mode, params, h)``, with numbers
        or duals for t, y and h; it fills h (n_guards,).
    n_states, n_guards : int
        Numbers of states and of guards.

    Returns
    -------
    callable
        ``guards(t, y, dy, mode, params, h, hdot)``, for Numba to compile: hdot is the
        rate of h when y changes at the rate dy, exact but for rounding. Where its
        machine code is cached, `own_digest` belongs to its digest.
    """
    names = {
        "ROWS": array_at(duals.Dual(1)),
        "STATES": duals.stack(2 * n_states),
        "VALUES": duals.stack(2 * n_guards),
        "PACK": duals.pack,
        "UNPACK": duals.unpack,
        "MOVING": duals.moving,
        "N": n_states,
        "N_GUARDS": n_guards,
    }
    return with_digest(guards_with_rates, **names, CALL=values)
