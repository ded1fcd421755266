# ruff: noqa: ARG001 (the templates have the signatures of machine code)
"""Derivatives of a system's functions, by running their code on dual numbers.

A function is compiled once more, unchanged (see `numbers.duals`), into machine code
that reads and writes rows of duals and is called by its address (see `numbers.along`).
A function that does not compile for duals has no such code, and the reason is kept.

The templates have these names inserted: CALL, the user's function; N and N_GUARDS, the
numbers of states and guards; ROWS and DUAL, which make duals from rows of numbers.
"""

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numba import cfunc

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import in_module_of, sources_digest, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import array_at, array_of, float_vector, int_vector
from hopdata.hybrid.numbers import along, duals
from hopdata.hybrid.numbers.guards import users_own

PACKAGE = Path(__file__).parents[1]

# Inserted into the templates.
N: int = 0
N_GUARDS: int = 0
N_MODES: int = 0
CALL: Any = None
ROOM = ROWS = DUAL = SEED = HARVEST = STATES = VALUES = PACK = UNPACK = MOVING = CALL


def field_of_duals(
    t: float, states: int, mode: int, n_modes: int, params: int, n_params: int,
    rates: int, seeds: int,
) -> None:  # fmt: skip
    """Evaluate the field at a fixed time."""
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    CALL(t, ROWS(states, N), modes, numbers, ROWS(rates, N))


def field_of_few(
    t: float, y: int, mode: int, n_modes: int, params: int, n_params: int,
    into: int, seeds: int,
) -> None:  # fmt: skip
    """Evaluate the field at a fixed time along all directions at once."""
    states = ROOM()
    rates = ROOM()
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    SEED(states, y, seeds)
    CALL(t, ROWS(states, N), modes, numbers, ROWS(rates, N))
    HARVEST(rates, into, 0)


def guards_of_duals(  # noqa: PLR0913 (the signature of machine code)
    moment: int, states: int, dy: int, mode: int, n_modes: int, params: int,
    n_params: int, k: int, h: int, hdot: int,
) -> None:  # fmt: skip
    """Evaluate all guards."""
    slope = array_of(float_vector(dy, N))
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    values = ROWS(h, N_GUARDS)
    rates = ROWS(hdot, N_GUARDS)
    CALL(DUAL(moment), ROWS(states, N), slope, modes, numbers, values, rates)


def guard_of_duals(  # noqa: PLR0913 (the signature of machine code)
    moment: int, states: int, dy: int, mode: int, n_modes: int, params: int,
    n_params: int, k: int, h: int, hdot: int,
) -> None:  # fmt: skip
    """Evaluate one guard of those that are declared one by one."""
    slope = array_of(float_vector(dy, N))
    modes = array_of(int_vector(mode, n_modes))
    numbers = array_of(float_vector(params, n_params))
    values = ROWS(h, N_GUARDS)
    rates = ROWS(hdot, N_GUARDS)
    CALL(DUAL(moment), ROWS(states, N), slope, modes, numbers, k, values, rates)


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
    if callback.no_dual:
        return Derivative(reason=callback.no_dual)
    names = {"ROWS": array_at(duals.Dual(width)), "DUAL": duals.dual_at(width)}
    if template is field_of_few:
        n = sizes["N"]
        names["ROOM"] = duals.stack(n * (1 + width))
        names["SEED"] = duals.seed_all(n, width)
        names["HARVEST"] = duals.harvest_all(n, width, timed=False)

    def compile_it(cached: bool) -> Any:
        return cfunc(native, cache=cached and callback.kept, **ENTRY)(function)

    try:
        function = with_digest(template, **names, **sizes, CALL=callback.dual)
        own = in_module_of(own_digest(), callback)
        digest = f"{function_digest(function)}-{width}-{own}"
        code = compiled_in_cache(function, digest, compile_it)
    # Numba's own exceptions, and others raised within it.
    except Exception as error:
        reason, _ = reason_and_advice(error, users_own(callback).users)
        return Derivative(reason=reason)
    return Derivative(code.address, code=code)


@cache
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
        template: Any = field_of_duals
        if self.field_width >= of.n_states:
            template = field_of_few
        native = along.FIELD_NATIVE
        return compiled(template, native, of.field, self.field_width, N=of.n_states)

    def told(self, *, by_field: bool) -> str:
        """Return which functions have no code for duals, and why; empty if all have.

        What a Jacobian needs is compiled; the field only if it has no other derivative.
        """
        found = {"guards": self.guards, "on_event": self.handler}
        if by_field:
            found = {"field": self.field, **found}
        return "; ".join(
            f"{name}: {one.reason}" for name, one in found.items() if one.reason
        )

    @property
    def guards_one_by_one(self) -> bool:
        """Whether the guards are declared one by one."""
        guards = self._of.guards
        return guards is not None and "k" in guards.signature.arguments

    @cached_property
    def guards(self) -> Derivative:
        """The guards."""
        of = self._of
        template = guards_of_duals
        if self.guards_one_by_one:
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


class Table:
    """The table by which the driver finds machine code and rooms (`numbers.along`).

    Parameters
    ----------
    derivatives : Derivatives
        The machine code.
    by_field : bool
        Whether the field's is needed.
    n_states, n_guards, n_modes : int
        Numbers of states and guards, and length of the mode.

    Attributes
    ----------
    slots : (ALONG_SLOTS,) array of int
        The table.
    told : str
        Which functions have no code for duals, and why; empty if all have.
    """

    def __init__(
        self,
        derivatives: Derivatives,
        *,
        by_field: bool,
        n_states: int,
        n_guards: int,
        n_modes: int,
    ) -> None:
        self._kept_alive = derivatives
        self._row = 1 + max(derivatives.field_width, derivatives.width)
        self._rooms: dict[Any, FloatArray] = {}
        self.slots: IntArray = np.zeros(along.ALONG_SLOTS, dtype=np.int64)
        self.slots[along.FIELD_WIDTH] = derivatives.field_width
        self.slots[along.WIDTH] = derivatives.width
        self._make_room(along.MOMENT, self._row)
        self._make_room(along.STATES, self._row * n_states)
        self._make_room(along.RATES, self._row * n_states)
        self._make_room(along.VALUES, self._row * n_guards)
        self._make_room(along.HDOTS, self._row * n_guards)
        self._make_room(along.MODES, n_modes)
        self._rooms[along.IDENTITY] = np.eye(n_states)
        self.slots[along.IDENTITY] = self._rooms[along.IDENTITY].ctypes.data
        if by_field:
            self.slots[along.FIELD] = derivatives.field.address
        self.slots[along.GUARD] = derivatives.guards.address
        self.slots[along.HANDLER] = derivatives.handler.address
        self.told = derivatives.told(by_field=by_field)

    def make_memory(self, n_params: int) -> None:
        """Make room for parameters."""
        self._make_room(along.MEMORY, self._row * n_params)

    def _make_room(self, slot: Any, count: int) -> None:
        room = np.zeros(max(count, 1))
        self._rooms[slot] = room
        self.slots[slot] = room.ctypes.data


class Exact:
    """Exact derivatives of a system's functions at one place, for Python.

    Where a function does not compile for duals, the result is None.

    Parameters
    ----------
    derivatives : Derivatives
        The machine code.
    n_guards : int
        Number of guards.
    """

    def __init__(self, derivatives: Derivatives, n_guards: int) -> None:
        self._of = derivatives
        self._n_guards = n_guards

    def field(
        self, t: float, y: FloatArray, mode: IntArray, params: FloatArray
    ) -> FloatArray | None:
        """Return the derivative of the field with respect to the states, (n, n)."""
        address = self._of.field.address
        if address == 0:
            return None
        call = ctypes.CFUNCTYPE(None, ctypes.c_double, *(7 * [ctypes.c_int64]))(address)
        given = (*_span(mode), *_span(params))
        n = len(y)
        slopes = np.zeros((n, n))
        if self._of.field_width >= n:
            identity = np.eye(n)
            call(t, _at(y), *given, _at(slopes), _at(identity))
            return slopes
        for states, columns in _passes(y, n, self._of.field_width):
            rates = np.zeros_like(states)
            call(t, _at(states), *given, _at(rates), 0)
            slopes[:, columns] = rates[:, 1 : 1 + len(columns)]
        return slopes

    def guards(
        self,
        t: float,
        y: FloatArray,
        dy: FloatArray,
        mode: IntArray,
        params: FloatArray,
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the derivatives of all guards, by states (n_guards, n) and by time."""
        address = self._of.guards.address
        if address == 0:
            return None
        call = ctypes.CFUNCTYPE(None, *(10 * [ctypes.c_int64]))(address)
        n = len(y)
        width = self._of.width
        given = (_at(dy), *_span(mode), *_span(params))
        slopes = np.zeros((self._n_guards, n + 1))
        for states, columns in _passes(y, n + 1, width):
            moment = _moment(t, columns, n, width)
            values = np.zeros((self._n_guards, 1 + width))
            rates = np.zeros_like(values)
            places = _at(moment), _at(states)
            for k in range(self._n_guards if self._of.guards_one_by_one else 1):
                call(*places, *given, k, _at(values), _at(rates))
            slopes[:, columns] = values[:, 1 : 1 + len(columns)]
        return slopes[:, :n], slopes[:, n]

    def handler(
        self,
        t: float,
        y: FloatArray,
        mode: IntArray,
        params: FloatArray,
        guard: int,
        direction: int,
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the derivatives of the state after a handler: by states, by time."""
        address = self._of.handler.address
        if address == 0:
            return None
        call = ctypes.CFUNCTYPE(None, *(7 * [ctypes.c_int64]))(address)
        n = len(y)
        width = self._of.width
        slopes = np.zeros((n, n + 1))
        for states, columns in _passes(y, n + 1, width):
            moment = _moment(t, columns, n, width)
            modes = np.array(mode)
            memory = np.zeros((len(params), 1 + width))
            memory[:, 0] = params
            places = _at(moment), _at(states), _at(modes), _at(memory)
            call(*places, len(params), guard, direction)
            slopes[:, columns] = states[:, 1 : 1 + len(columns)]
        return slopes[:, :n], slopes[:, n]


def _at(array: Any) -> int:
    """Return the address of an array, which the caller keeps alive."""
    return int(array.ctypes.data)


def _span(array: Any) -> tuple[int, int]:
    """Return the address of an array, and its length."""
    return _at(array), len(array)


def _passes(
    y: FloatArray, count: int, width: int
) -> Iterator[tuple[FloatArray, IntArray]]:
    """Yield the states as rows of duals, and the numbers of their directions."""
    for first in range(0, count, width):
        columns = np.arange(first, min(first + width, count))
        states = np.zeros((len(y), 1 + width))
        states[:, 0] = y
        states[:, 1 : 1 + len(columns)] = np.eye(len(y), count)[:, columns]
        yield states, columns


def _moment(t: float, columns: IntArray, n: int, width: int) -> FloatArray:
    """Return the time as a row of a dual, which changes along direction n."""
    moment = np.zeros(1 + width)
    moment[0] = t
    moment[1 : 1 + len(columns)] = columns == n
    return moment


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
