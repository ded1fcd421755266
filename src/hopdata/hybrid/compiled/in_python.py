"""Calls from machine code back into Python, for functions that Numba cannot compile.

A trampoline is a compiled function of the same signature, so the driver calls it like
any other. It takes the interpreter's lock, passes arrays that are the driver's own
memory, and calls the Python function. Numba's object mode would take half as long
again, and five times as long to compile.
"""

from collections.abc import Callable
from math import inf, nan
from typing import Any

import numpy as np
from numba import types

from hopdata.hybrid.compiled import declare
from hopdata.hybrid.compiled.caught import current
from hopdata.hybrid.compiled.declare import place, return_error
from hopdata.hybrid.compiled.forms import Form
from hopdata.hybrid.compiled.kernel import SIGNATURES, Signature
from hopdata.hybrid.compiled.memory import built
from hopdata.hybrid.compiled.rates import rates_in_python
from hopdata.hybrid.compiled.stored import WrongResultError, store_in_python
from hopdata.hybrid.compiled.written import native_arguments
from hopdata.private_numba import is_null, room_with

Function = Callable[..., Any]

# A NaN that no arithmetic produces, which distinguishes an unfilled element from a
# computed NaN.
UNFILLED = np.int64(0x7FF8_0000_0BAD_F111)
# Kinds that must fill all elements of their arrays in each call.
FILLS_ALL = ("field", "guards")


def in_own_form(function: Function, form: Form) -> Function:
    """Return a Python function in the integrator's own form that calls a plain one.

    It sees each change of a global that the function reads, as the function does.
    """
    names = native_arguments(form.kind)
    # Evaluated in each call: an argument may be an element of the parameters.
    call = f"lambda {', '.join(names)}: FUNCTION({', '.join(form.arguments)})"
    scope = {"FUNCTION": function, **form.bound}
    ask = eval(call, scope)

    def fill(*arguments: Any) -> Any:
        value = ask(*arguments)
        if not form.returns:
            return value
        result = arguments[names.index(form.result)]
        try:
            return store_in_python(form.kind, value, result)
        except WrongResultError as error:
            where = place(function, SIGNATURES[form.kind])
            raise WrongResultError(f"{where} {error}") from None

    def guards(t: Any, y: Any, dy: Any, *others: Any) -> None:
        rates_in_python(fill, t, y, dy, *others)

    made: Any = guards if form.kind == "guards" else fill
    made.__name__ = declare.function_name(function)
    made.users = function
    return made


def protected(function: Function, signature: Signature) -> Function:
    """Return `function` with its exceptions collected for the caller of the driver.

    After the first exception the function is not called again: its arrays are filled
    with NaN, and an event handler stops the integration, so that the driver soon ends.
    In the first call it is also checked that the function fills its arrays.
    """
    is_first_call = True

    def call(*arguments: Any) -> Any:
        nonlocal is_first_call
        caught = current()
        try:
            if caught:  # an earlier call in this integration has failed
                return _give_up(signature, arguments)
            if is_first_call:
                is_first_call = False
                return _checked(function, signature, arguments)
            return _converted(function(*arguments), function, signature)
        except BaseException as error:
            if caught is None:  # called outside an integration
                raise
            error.add_note(f"in {place(function, signature)}")
            caught.append(error)
            return _give_up(signature, arguments)

    return call


def _converted(result: Any, function: Function, signature: Signature) -> Any:
    """Return the result converted to the signature's type, as compiled code would."""
    kind = signature.native.return_type
    if kind == types.none and result is None:
        return None
    if kind != types.none and isinstance(result, int | float | np.number | np.bool_):
        return int(result) if kind == types.int64 else float(result)
    raise return_error(function, signature, type(result).__name__)


def _checked(
    function: Function, signature: Signature, arguments: tuple[Any, ...]
) -> Any:
    """Call the function, and check that it fills all of its arrays."""
    arrays = {}
    if signature.name in FILLS_ALL:
        arrays = _filled_by(signature, arguments)
    for array in arrays.values():
        array.view(np.int64).fill(UNFILLED)
    result = _converted(function(*arguments), function, signature)
    for name, array in arrays.items():
        unfilled = np.flatnonzero(array.view(np.int64) == UNFILLED)
        if len(unfilled) > 0:
            where = place(function, signature)
            raise ValueError(f"{where} does not fill {name}[{unfilled[0]}]")
    return result


def _filled_by(signature: Signature, arguments: tuple[Any, ...]) -> dict[str, Any]:
    """Return the arrays among the arguments that the function fills, by name."""
    named = dict(zip(signature.arguments, arguments, strict=True))
    return {name: named[name] for name in signature.fills}


def _give_up(signature: Signature, arguments: tuple[Any, ...]) -> Any:
    """Fill the arrays with NaN, and return what ends the integration soon."""
    for array in _filled_by(signature, arguments).values():
        array.fill(nan)
    if signature.native.return_type == types.none:
        return None
    return 1 if signature.name == "on_event" else inf


def trampoline(function: Function, signature: Signature) -> Any:
    """Return a Python function that Numba compiles into a call of `function`.

    The machine code contains the object's address, so the caller must keep the object
    alive.
    """
    lower = lower_call_of_python(function)
    return_type = signature.native.return_type

    def typed(*kinds: Any) -> Any:
        """Return Numba's signature for arguments of these types, and the code."""
        return return_type(*kinds), lower

    call = built(len(signature.arguments), typed)
    # Numba requires that arguments have names, so the function is written out.
    names = ", ".join(signature.arguments)
    scope = {"call": call}
    exec(f"def trampoline({names}):\n    return call({names})\n", scope)
    return scope["trampoline"]


# A call of a Python function, with the interpreter's lock. The caller keeps the
# function alive.

DTYPES = {types.float64: np.dtype(np.float64), types.int64: np.dtype(np.int64)}


def lower_call_of_python(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the code generator of a call to a Python function.

    The code prints the function's exceptions.
    """

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        python = context.get_python_api(builder)
        lock = python.gil_ensure()
        boxed = []
        for kind, value in zip(sign.args, values, strict=True):
            boxed.append(_boxed(context, builder, python, kind, value))
        called = _object(context, builder, python, function)
        result = python.call_function_objargs(called, boxed)
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
    """Return the number in a Python result.

    If there is none, the exception is printed, and the number is 0.
    """
    native_type = context.get_value_type(kind)
    nothing = native_type(None) if kind == types.none else native_type(0)
    slot = room_with(builder, nothing)
    is_missing = is_null(builder, result)
    with builder.if_else(is_missing, likely=False) as (failed, returned):
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
    if kind == types.none:
        return context.get_dummy_value()
    return builder.load(slot)
