"""The way from machine code back into Python, for functions that Numba cannot compile.

A trampoline is a compiled function of the same signature, so the driver calls it like any other.
It takes the interpreter's lock, hands over arrays that are the driver's own memory, and calls the
Python function. Numba's object mode does the same in half as much time again, and takes five times
longer to compile.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from typing import Any

import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hopdata.hybrid.compiled.declaration import place, return_error
from hopdata.hybrid.compiled.signatures import FIELD, GUARDS, ON_EVENT, Signature
from hopdata.hybrid.compiled.unraisable import current

Function = Callable[..., Any]

DTYPES = {types.float64: np.dtype(np.float64), types.int64: np.dtype(np.int64)}
# A NaN that no arithmetic makes, by which an element that was not filled is told from a NaN.
UNFILLED = np.int64(0x7FF8_0000_0BAD_F111)


def protected(function: Function, signature: Signature) -> Function:
    """Return `function` with its exceptions kept for the caller of the driver.

    After the first exception the function is not called again: its arrays are filled with NaN, and
    an event handler stops, so that the driver soon gives up.
    """
    first, silent = True, signature.native.return_type == types.none

    def call(*arguments: Any) -> Any:
        nonlocal first
        caught = current()
        try:
            if caught:
                return _give_up(signature, arguments)
            if first:
                first = False
                return _checked(function, signature, arguments)
            result = function(*arguments)
            if silent and result is None:
                return None
            return _converted(result, function, signature)
        except BaseException as error:
            if caught is None:
                raise
            caught.append(error)
            return _give_up(signature, arguments)

    return call


def _converted(result: Any, function: Function, signature: Signature) -> Any:
    """Return the result in the type of the signature, as compiled code would convert it."""
    kind = signature.native.return_type
    if kind == types.none and result is None:
        return None
    if kind != types.none and isinstance(result, int | float | np.number | np.bool_):
        return int(result) if kind == types.int64 else float(result)
    raise return_error(function, signature, type(result).__name__)


def _checked(function: Function, signature: Signature, arguments: tuple[Any, ...]) -> Any:
    """Call the function, and see that it fills all of its arrays."""
    arrays = _filled_by(signature, arguments) if signature in (FIELD, GUARDS) else {}
    for array in arrays.values():
        array.view(np.int64).fill(UNFILLED)
    result = _converted(function(*arguments), function, signature)
    for name, array in arrays.items():
        left = np.flatnonzero(array.view(np.int64) == UNFILLED)
        if len(left) > 0:
            raise ValueError(f"{place(function, signature)} does not fill {name}[{left[0]}]")
    return result


def _filled_by(signature: Signature, arguments: tuple[Any, ...]) -> dict[str, Any]:
    named = dict(zip(signature.arguments, arguments, strict=True))
    return {name: named[name] for name in signature.fills}


def _give_up(signature: Signature, arguments: tuple[Any, ...]) -> Any:
    for array in _filled_by(signature, arguments).values():
        array.fill(nan)
    if signature.native.return_type == types.none:
        return None
    return 1 if signature is ON_EVENT else inf


def trampoline(function: Function, signature: Signature) -> Any:
    """Return a Python function that Numba compiles into a call of `function`.

    The object is written into the machine code by its address: the caller keeps it alive.
    """
    names = ", ".join(signature.arguments)
    scope = {"lower": _lower_call(function), "returns": signature.native.return_type}
    exec(
        f"def call(typing, {names}):\n    return returns({names}), lower\n"
        f"def trampoline({names}):\n    return call({names})\n",
        scope,
    )
    scope["call"] = intrinsic(scope["call"])
    return scope["trampoline"]


def compiled_trampoline(function: Function, signature: Signature) -> Any:
    """Return the trampoline's machine code, with its address."""
    return numba.cfunc(signature.native)(trampoline(function, signature))


def _lower_call(function: Function) -> Callable[..., Any]:
    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        python = context.get_python_api(builder)
        lock = python.gil_ensure()
        pairs = zip(sign.args, values, strict=True)
        boxed = [_boxed(context, builder, python, kind, value) for kind, value in pairs]
        result = python.call_function_objargs(_object(context, builder, python, function), boxed)
        native = _unboxed(context, builder, python, sign.return_type, result)
        for item in boxed:
            python.decref(item)
        python.gil_release(lock)
        return native

    return lower


def _object(context: Any, builder: Any, python: Any, value: object) -> Any:
    return builder.inttoptr(context.get_constant(types.intp, id(value)), python.pyobj)


def _boxed(context: Any, builder: Any, python: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.Array):
        dtype = _object(context, builder, python, DTYPES[kind.dtype])
        return python.nrt_adapt_ndarray_to_python(kind, value, dtype)
    if kind == types.float64:
        return python.float_from_double(value)
    return python.long_from_longlong(value)


def _unboxed(context: Any, builder: Any, python: Any, kind: Any, result: Any) -> Any:
    """Return the number in a Python result, 0 with the exception printed if there is none."""
    native_type = context.get_value_type(kind)
    slot = cgutils.alloca_once_value(
        builder, native_type(None) if kind == types.none else native_type(0)
    )
    with builder.if_else(cgutils.is_null(builder, result), likely=False) as (failed, returned):
        with failed:
            name = context.insert_const_string(builder.module, "hopdata callback")
            label = python.string_from_string(name)
            python.err_write_unraisable(label)
            python.decref(label)
        with returned:
            if kind == types.float64:
                builder.store(python.float_as_double(result), slot)
            elif kind == types.int64:
                builder.store(python.long_as_longlong(result), slot)
            python.decref(result)
    return context.get_dummy_value() if kind == types.none else builder.load(slot)
