# ruff: noqa: ARG001 (Numba reads the arguments from the signatures of intrinsics)
"""Calls of the user's functions by their addresses, from the driver.

A Numba function passed as an argument would compile the driver anew for each scene, in each
process. Called by its address instead, it leaves the driver as it is: one driver serves all.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic

from hopdata.hybrid.compiled.signatures import FIELD, GUARDS, ON_EVENT
from hopdata.hybrid.compiled.views import INDEX, View, lower_row

FLOATS, INTEGERS, TABLE = View(types.float64, 1), View(types.int64, 1), View(types.float64, 2)


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
        _call(context, builder, address, FIELD.native, [t, y, mode, params, dy])
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
        _call(context, builder, address, GUARDS.native, [t, y, dy, mode, params, h, hdot])
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
        return _call(
            context, builder, address, ON_EVENT.native, [t, y, mode, params, guard, direction]
        )

    kinds = (types.float64, TABLE, INDEX, INTEGERS, FLOATS, INDEX, INDEX)
    return types.int64(INDEX, *kinds), generate
