# ruff: noqa: ARG001 (Numba reads the arguments from the signatures of intrinsics)
"""Calls of machine code by its address, from the driver.

A Numba function passed as an argument would compile the driver anew for each scene, in each
process. Called by its address instead, it leaves the driver as it is: one driver serves all.

The driver hands over views; what is called takes arrays (the user's functions) or the addresses
and widths of views (steps, interpolants and tangents of a method).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hopdata.hybrid.compiled import signatures
from hopdata.hybrid.compiled.views import INDEX, View, lower_row

FLOATS, INTEGERS = View(types.float64, 1), View(types.int64, 1)
TABLE = View(types.float64, 2)

# How an argument is handed over: as it is; the row of a table, which takes two arguments, as an
# array; a vector as an array; a view as its address; a vector as its address and width.
VALUE, ROW, VECTOR, ADDRESS, SPAN = range(5)

Plan = tuple[tuple[Any, int], ...]


def _row(context: Any, builder: Any, kind: Any, values: list[Any]) -> list[Any]:
    return [lower_row(context, builder, kind, *values)]


def _address(context: Any, builder: Any, kind: Any, values: list[Any]) -> list[Any]:
    proxy = cgutils.create_struct_proxy(kind)(context, builder, values[0])
    return [builder.ptrtoint(proxy.data, context.get_value_type(INDEX))]


def _span(context: Any, builder: Any, kind: Any, values: list[Any]) -> list[Any]:
    proxy = cgutils.create_struct_proxy(kind)(context, builder, values[0])
    return [*_address(context, builder, kind, values), proxy.width]


def _value(context: Any, builder: Any, kind: Any, values: list[Any]) -> list[Any]:
    return values


LOWER = {VALUE: _value, ROW: _row, VECTOR: _row, ADDRESS: _address, SPAN: _span}


def caller(native: Any, *plan: tuple[Any, int]) -> Callable[..., Any]:
    """Return a function for compiled code, which takes an address and what the plan says.

    Parameters
    ----------
    native : Numba signature
        Of the machine code at the address.
    *plan : tuple
        For each argument its Numba type and the way in which it is handed over.
    """
    kinds = [k for kind, way in plan for k in ((kind, INDEX) if way == ROW else (kind,))]

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        from llvmlite import ir

        rest, arguments = list(values[1:]), []
        for kind, way in plan:
            count = 2 if way == ROW else 1
            arguments += LOWER[way](context, builder, kind, rest[:count])
            rest = rest[count:]
        taken = [context.get_value_type(kind) for kind in native.args]
        given = context.get_value_type(native.return_type)
        target = builder.inttoptr(values[0], ir.FunctionType(given, taken).as_pointer())
        result = builder.call(target, arguments)
        return context.get_dummy_value() if native.return_type == types.void else result

    # Numba wants an intrinsic whose arguments have names.
    names = ", ".join(f"a{k}" for k in range(len(kinds)))
    known = {"sign": native.return_type(INDEX, *kinds), "generate": generate}
    return intrinsic(eval(f"lambda typing, address, {names}: (sign, generate)", known))  # type: ignore[no-any-return]


_T = (types.float64, VALUE)
_STATE, _GUARDS, _MODE, _PARAMS = (TABLE, ROW), (TABLE, ROW), (INTEGERS, VECTOR), (FLOATS, VECTOR)
_NUMBER = (types.int64, VALUE)

# call_field(address, t, s, y, mode, params, s, dy): y and dy are rows of the table s.
call_field = caller(signatures.FIELD.native, _T, _STATE, _MODE, _PARAMS, _STATE)
# call_guards(address, t, s, y, s, dy, mode, params, g, h, g, hdot)
call_guards = caller(signatures.GUARDS.native, _T, _STATE, _STATE, _MODE, _PARAMS, _GUARDS, _GUARDS)
# call_guard(address, t, s, y, s, dy, mode, params, k, g, h, g, hdot)
call_guard = caller(
    signatures.GUARD.native, _T, _STATE, _STATE, _MODE, _PARAMS, _NUMBER, _GUARDS, _GUARDS
)
# call_rate_bound(address, t, s, y, s, dy, mode, params)
call_rate_bound = caller(signatures.RATE_BOUND.native, _T, _STATE, _STATE, _MODE, _PARAMS)
# call_on_event(address, t, s, y, mode, params, guard, direction)
call_on_event = caller(signatures.ON_EVENT.native, _T, _STATE, _MODE, _PARAMS, _NUMBER, _NUMBER)

_FLOAT, _INT = types.float64, types.int64
_VIEWS = (_INT,) * 5  # addresses of states, mode and its width, params and their width
_SPANS = (_INT,) * 6  # the same, with the width of the states
STEP_NATIVE = _FLOAT(_FLOAT, _FLOAT, _FLOAT, *_SPANS, _INT, _INT)
INTERPOLANT_NATIVE = _INT(_FLOAT, _FLOAT, *_SPANS, _INT)
REFRESH_NATIVE = _FLOAT(*_VIEWS)
TANGENT_NATIVE = _FLOAT(_FLOAT, _FLOAT, _FLOAT, *_VIEWS, _INT, _INT)
_LAID_OUT = ((TABLE, ADDRESS), (INTEGERS, SPAN), (FLOATS, SPAN))
_SPREAD = ((TABLE, SPAN), *_LAID_OUT[1:])

# call_step(address, t, dt, rtol, s, mode, params, atol, field): the field's own address
call_step = caller(STEP_NATIVE, _T, _T, _T, *_SPREAD, (FLOATS, ADDRESS), _NUMBER)
# call_interpolant(address, t, dt, s, mode, params, field)
call_interpolant = caller(INTERPOLANT_NATIVE, _T, _T, *_SPREAD, _NUMBER)
# call_tangent(address, t, dt, rtol, s, mode, params, atol, phi)
call_tangent = caller(TANGENT_NATIVE, _T, _T, _T, *_LAID_OUT, (FLOATS, ADDRESS), (TABLE, ADDRESS))
# call_refresh(address, s, mode, params)
call_refresh = caller(REFRESH_NATIVE, *_LAID_OUT)
