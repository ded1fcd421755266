# ruff: noqa: ARG001 (Numba reads the arguments from the signatures of intrinsics)
"""The user's three functions: compiled one by one, and called by address.

A Numba function passed as an argument would compile the driver anew for each scene, in each
process. Called by its address instead, it leaves the driver as it is: one driver serves all.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any

import numba
from numba import types
from numba.extending import intrinsic

from hopdata.hybrid.compiled.cache import cache_directory
from hopdata.hybrid.compiled.digest import function_digest
from hopdata.hybrid.compiled.views import INDEX, View, lower_row

STATE = types.float64[::1]
MODE = types.int64[::1]

FLOATS, INTEGERS, TABLE = View(types.float64, 1), View(types.int64, 1), View(types.float64, 2)

FIELD = types.void(types.float64, STATE, MODE, STATE, STATE)
GUARDS = types.void(types.float64, STATE, STATE, MODE, STATE, STATE, STATE)
ON_EVENT = types.int64(types.float64, STATE, MODE, STATE, types.int64, types.int64)


class Callback:
    """A user's function, compiled when its address is first asked for, then cached on disk.

    Calling it runs the plain Python function, for a debugger or another solver.
    """

    def __init__(self, function: Callable[..., Any], signature: Any) -> None:
        self.function = function
        self.signature = signature
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function."""
        return self.function(*arguments)

    def __repr__(self) -> str:
        return f"<hybrid callback {self.function.__qualname__}>"

    @cached_property
    def address(self) -> int:
        """Address of the machine code."""
        return int(self._compiled.address)

    @cached_property
    def _compiled(self) -> Any:
        with cache_directory(self.function, function_digest(self.function)) as cached:
            compiler = numba.cfunc(self.signature, cache=cached, error_model="numpy")
            return compiler(self.function)


def field(function: Callable[..., None]) -> Callback:
    """Declare a vector field ``field(t, y, mode, params, dy)``, which fills `dy` in place.

    Parameters
    ----------
    function : callable
        Takes t (float, s), y (n,), mode (n_guards + n_extra_modes,) of int64, params (p,) and
        the (n,) array `dy` to fill. It is compiled by Numba in nopython mode.
    """
    return Callback(function, FIELD)


def guards(function: Callable[..., None]) -> Callback:
    """Declare event functions ``guards(t, y, dy, mode, params, h, hdot)``.

    Parameters
    ----------
    function : callable
        Fills `h` (n_guards,), the event functions at y, and `hdot` (n_guards,), their rates of
        change when y changes at the rate `dy`, both in place.
    """
    return Callback(function, GUARDS)


def on_event(function: Callable[..., int]) -> Callback:
    """Declare what happens at an event: ``on_event(t, y, mode, params, guard, direction)``.

    Parameters
    ----------
    function : callable
        Is told the guard's number and the direction in which its event function crossed zero
        (+1 upwards, -1 downwards). May change y and mode in place. Returns 0 to go on, 1 to stop.
    """
    return Callback(function, ON_EVENT)


def _call(context: Any, builder: Any, address: Any, signature: Any, arguments: list[Any]) -> Any:
    from llvmlite import ir

    kinds = [context.get_value_type(kind) for kind in signature.args]
    kind = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
    return builder.call(builder.inttoptr(address, kind.as_pointer()), arguments)


@intrinsic
def call_field(
    typing: Any, address: Any, t: Any, s: Any, y: Any, mode: Any, params: Any, dy: Any
) -> Any:
    """Call the vector field at an address; `y` and `dy` are rows of the table `s`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address, t, s, y, mode, params, dy = values
        y, dy = (lower_row(context, builder, TABLE, s, row) for row in (y, dy))
        mode = lower_row(context, builder, INTEGERS, mode)
        params = lower_row(context, builder, FLOATS, params)
        _call(context, builder, address, FIELD, [t, y, mode, params, dy])
        return context.get_dummy_value()

    return types.void(INDEX, types.float64, TABLE, INDEX, INTEGERS, FLOATS, INDEX), generate


@intrinsic
def call_guards(
    typing: Any,
    address: Any,
    t: Any,
    s: Any,
    y: Any,
    dy: Any,
    mode: Any,
    params: Any,
    g: Any,
    h: Any,
    hdot: Any,
) -> Any:
    """Call the event functions at an address; arrays are rows of the tables `s` and `g`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address, t, s, y, dy, mode, params, g, h, hdot = values
        y, dy = (lower_row(context, builder, TABLE, s, row) for row in (y, dy))
        h, hdot = (lower_row(context, builder, TABLE, g, row) for row in (h, hdot))
        mode = lower_row(context, builder, INTEGERS, mode)
        params = lower_row(context, builder, FLOATS, params)
        _call(context, builder, address, GUARDS, [t, y, dy, mode, params, h, hdot])
        return context.get_dummy_value()

    kinds = (types.float64, TABLE, INDEX, INDEX, INTEGERS, FLOATS, TABLE, INDEX, INDEX)
    return types.void(INDEX, *kinds), generate


@intrinsic
def call_on_event(
    typing: Any,
    address: Any,
    t: Any,
    s: Any,
    y: Any,
    mode: Any,
    params: Any,
    guard: Any,
    direction: Any,
) -> Any:
    """Call the event handler at an address; `y` is a row of the table `s`."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address, t, s, y, mode, params, guard, direction = values
        y = lower_row(context, builder, TABLE, s, y)
        mode = lower_row(context, builder, INTEGERS, mode)
        params = lower_row(context, builder, FLOATS, params)
        return _call(context, builder, address, ON_EVENT, [t, y, mode, params, guard, direction])

    kinds = (types.float64, TABLE, INDEX, INTEGERS, FLOATS, INDEX, INDEX)
    return types.int64(INDEX, *kinds), generate
