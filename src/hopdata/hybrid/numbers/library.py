# ruff: noqa: ARG001 (all operations have the same arguments)
"""The longer operations of ranges, compiled once for all guards.

The guards' code calls them through functions of C, one for each group, by the number
of the operation. A group is compiled when code that calls it is: all of them take as
long as half of the driver, and most guards need one or two. `ONE`, `TWO` and
`OF_ANYTHING` say which functions of Python and NumPy mean which operation.
"""

import math
from collections.abc import Callable
from ctypes import CFUNCTYPE, c_double, c_int64, c_void_p, cast
from functools import cache, partial
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np
from numba import cfunc, types

from hopdata.code_cache import brought_code, compiled_in_cache, is_in_cache
from hopdata.hybrid.compiled.kernel import LARGE_ENTRY, kernel
from hopdata.hybrid.compiled.memory import float_vector, int_vector
from hopdata.hybrid.methods.explicit import compose
from hopdata.hybrid.numbers.arithmetic import (
    absolute,
    ceil,
    divide,
    floor,
    integer,
    largest,
    least,
    nearest_integer,
    opened,
    rest,
    rest_like_x,
    rint,
    sign,
    sound,
    table,
    trunc,
    unknown,
    whole_power,
    whole_quotient,
    with_sign,
)
from hopdata.hybrid.numbers.functions import (
    angle,
    arc_cosine,
    arc_sine,
    arc_tangent,
    area_cosine,
    area_sine,
    area_tangent,
    binary_logarithm,
    complement_of_it,
    cosine,
    cube_root,
    decimal_logarithm,
    error_function,
    exponential,
    exponential_less_1,
    hyperbolic_cosine,
    hyperbolic_sine,
    hyperbolic_tangent,
    length,
    logarithm_of_1_more,
    natural_logarithm,
    power_of_2,
    real_power,
    sine,
    square_root,
    tangent,
)
from hopdata.hybrid.numbers.ranges import DIGEST, put_range, range_at


class Operation(NamedTuple):
    """An operation: what it computes, and the functions that mean it."""

    function: Any
    keys: tuple[Any, ...]


# The operations, and what they stand for. Their order is their number.


def _of_math(name: str) -> tuple[Any, ...]:
    """Return a function of `math` that not all versions of Python have."""
    found = getattr(math, name, None)
    return () if found is None else (found,)


ONE = {
    "absolute": Operation(absolute, (abs, np.abs, np.fabs, math.fabs)),
    "sign": Operation(sign, (np.sign,)),
    "floor": Operation(floor, (math.floor, np.floor)),
    "ceil": Operation(ceil, (math.ceil, np.ceil)),
    "trunc": Operation(trunc, (math.trunc, np.trunc)),
    "rint": Operation(rint, (np.rint,)),
    "exponential": Operation(exponential, (math.exp, np.exp)),
    "power_of_2": Operation(power_of_2, (np.exp2, *_of_math("exp2"))),
    "exponential_less_1": Operation(exponential_less_1, (math.expm1, np.expm1)),
    "hyperbolic_sine": Operation(hyperbolic_sine, (math.sinh, np.sinh)),
    "hyperbolic_cosine": Operation(hyperbolic_cosine, (math.cosh, np.cosh)),
    "hyperbolic_tangent": Operation(hyperbolic_tangent, (math.tanh, np.tanh)),
    "arc_sine": Operation(arc_sine, (math.asin, np.arcsin)),
    "arc_cosine": Operation(arc_cosine, (math.acos, np.arccos)),
    "arc_tangent": Operation(arc_tangent, (math.atan, np.arctan)),
    "area_sine": Operation(area_sine, (math.asinh, np.arcsinh)),
    "area_cosine": Operation(area_cosine, (math.acosh, np.arccosh)),
    "area_tangent": Operation(area_tangent, (math.atanh, np.arctanh)),
    "error_function": Operation(error_function, (math.erf,)),
    "complement_of_it": Operation(complement_of_it, (math.erfc,)),
    "square_root": Operation(square_root, (math.sqrt, np.sqrt)),
    "cube_root": Operation(cube_root, (np.cbrt, *_of_math("cbrt"))),
    "natural_logarithm": Operation(natural_logarithm, (math.log, np.log)),
    "binary_logarithm": Operation(binary_logarithm, (math.log2, np.log2)),
    "decimal_logarithm": Operation(decimal_logarithm, (math.log10, np.log10)),
    "logarithm_of_1_more": Operation(logarithm_of_1_more, (math.log1p, np.log1p)),
    "sine": Operation(sine, (math.sin, np.sin)),
    "cosine": Operation(cosine, (math.cos, np.cos)),
    "tangent": Operation(tangent, (math.tan, np.tan)),
}
TWO = {
    "divide": Operation(divide, ()),
    "whole_power": Operation(whole_power, ()),
    "real_power": Operation(real_power, ()),
    "least": Operation(least, (min, np.minimum, np.fmin)),
    "largest": Operation(largest, (max, np.maximum, np.fmax)),
    "with_sign": Operation(with_sign, (math.copysign, np.copysign)),
    "rest": Operation(rest, ()),
    "rest_like_x": Operation(rest_like_x, (math.fmod, np.fmod)),
    "whole_quotient": Operation(whole_quotient, (np.floor_divide,)),
    "angle": Operation(angle, (math.atan2, np.arctan2)),
    "length": Operation(length, (math.hypot, np.hypot)),
}
# These have a result even for what may not be a number.
OF_ANYTHING = {
    "integer": Operation(integer, ()),
    "nearest_integer": Operation(nearest_integer, ()),
    "opened": Operation(opened, ()),
}

# The operations that are compiled together. A place in its group is the number of one.

GROUPS: dict[str, tuple[str, ...]] = {
    "branches": ("opened", "table"),
    "quotients": ("divide", "whole_power", "square_root"),
    "kinks": ("absolute", "sign", "least", "largest", "with_sign"),
    "whole": (
        "floor",
        "ceil",
        "trunc",
        "rint",
        "rest",
        "rest_like_x",
        "whole_quotient",
        "integer",
        "nearest_integer",
    ),
    "waves": ("sine", "cosine", "tangent", "angle", "length"),
    "growth": (
        "exponential",
        "natural_logarithm",
        "real_power",
        "hyperbolic_sine",
        "hyperbolic_cosine",
        "hyperbolic_tangent",
    ),
    "arcs": ("arc_sine", "arc_cosine", "arc_tangent"),
    "others": (
        "power_of_2",
        "exponential_less_1",
        "binary_logarithm",
        "decimal_logarithm",
        "logarithm_of_1_more",
        "area_sine",
        "area_cosine",
        "area_tangent",
        "error_function",
        "complement_of_it",
        "cube_root",
    ),
}
GROUP_OF = {name: group for group, names in GROUPS.items() for name in names}


# Each group in one function of C.

APPLY_NATIVE = types.void(*(5 * [types.int64]))


@kernel
def read(address: int, where: int) -> Any:
    """Return the range at an address."""
    return sound(range_at(address, where))


@kernel
def write(x: Any, address: int) -> None:
    """Write a range to an address."""
    put_range(sound(x), address)


@kernel
def look_up(x: Any, given: int) -> Any:
    """Return a table's value: addresses of places and values, and their number."""
    table_at = int_vector(given, 3)
    n = table_at[2]
    if n < 1:
        return unknown(x.at)
    places = float_vector(table_at[0], n)
    values = float_vector(table_at[1], n)
    return table(x, places, values, n)


# Each operation with addresses for arguments. So its caller needs no room for results,
# which Numba would clear for all operations at each call.


def _with_one(function: Any) -> Any:
    @kernel
    def run(x_at: int, y_at: int, where: int, result: int) -> None:
        x = read(x_at, where)
        if math.isnan(x.lo):
            write(unknown(where), result)
        else:
            write(function(x), result)

    return run


def _with_two(function: Any) -> Any:
    @kernel
    def run(x_at: int, y_at: int, where: int, result: int) -> None:
        x = read(x_at, where)
        y = read(y_at, where)
        if math.isnan(x.lo) or math.isnan(y.lo):
            write(unknown(where), result)
        else:
            write(function(x, y), result)

    return run


def _with_anything(function: Any) -> Any:
    @kernel
    def run(x_at: int, y_at: int, where: int, result: int) -> None:
        write(function(read(x_at, where), read(y_at, where)), result)

    return run


@kernel
def _with_table(x_at: int, y_at: int, where: int, result: int) -> None:
    x = read(x_at, where)
    if math.isnan(x.lo):
        write(unknown(where), result)
    else:
        write(look_up(x, y_at), result)


def _run(name: str) -> Any:
    """Return the operation of this name, with addresses for arguments."""
    if name == "table":
        return _with_table
    if name in ONE:
        return _with_one(ONE[name].function)
    if name in TWO:
        return _with_two(TWO[name].function)
    return _with_anything(OF_ANYTHING[name].function)


ARGUMENTS = "number, x_at, y_at, where, result"


@cache
def _apply(group: str) -> tuple[Any, str]:
    """Return the function of C of a group, before it is compiled, and its digest.

    It takes the number of an operation; addresses of one or two ranges (or of the parts
    of a table); the address of the memory of answers; and the address of the result.
    """
    body = []
    known = {}
    for place, name in enumerate(GROUPS[group]):
        body.append(f"if number == {place}: run_{place}(x_at, y_at, where, result)")
        known[f"run_{place}"] = _run(name)
    return compose(f"apply_{group}", ARGUMENTS, body, known), f"{DIGEST}-{group}"


@cache
def _compiled(group: str) -> Any:
    """Return the machine code of a group, and let code that is loaded later call it."""
    function, digest = _apply(group)

    def compile_it(cached: bool) -> Any:
        return cfunc(APPLY_NATIVE, cache=cached, **LARGE_ENTRY)(function)

    compiled = compiled_in_cache(function, digest, compile_it)
    llvm.add_symbol(_symbol(group), compiled.address)
    return compiled


def _symbol(group: str) -> str:
    """Return the name by which machine code calls a group.

    The name changes with its sources, so that kept code calls no other.
    """
    return f"hopdata_ranges_{group}_{DIGEST}"


def place_of(name: str) -> tuple[str, int]:
    """Return the symbol of an operation's group, which is compiled, and its number."""
    group = GROUP_OF[name]
    _compiled(group)
    return _symbol(group), GROUPS[group].index(name)


@cache
def load() -> None:
    """Let machine code that is loaded find all groups.

    A group that is not kept is one that no kept code calls, unless its file was
    removed. Then its symbol is a function that compiles it when it is called.
    """
    for group in GROUPS:
        entry = _apply(group)
        if brought_code(*entry) is not None or is_in_cache(*entry):
            _compiled(group)
        else:
            late = _CALLED(partial(apply_late, group))
            llvm.add_symbol(_symbol(group), _address_of(late))
            _LOADED.append(late)


_CALLED = CFUNCTYPE(None, *(5 * [c_int64]))
_LOADED: list[Any] = []  # keeps the functions in memory


def _address_of(function: Any) -> int:
    return cast(function, c_void_p).value or 0


def apply_late(
    group: str, number: int, x_at: int, y_at: int, where: int, result: int
) -> None:
    """Apply an operation of a group that is compiled now.

    Where that fails nothing is known of the result, so that nothing is proven by it.
    """
    ends = (c_double * 4).from_address(result)
    ends[:] = [math.nan, math.nan, -math.inf, math.inf]
    called: Callable[..., None] = _CALLED(_compiled(group).address)
    called(number, x_at, y_at, where, result)
