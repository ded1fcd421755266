# ruff: noqa: ARG001 (all operations have the same arguments)
"""The longer operations of ranges, compiled once for all guards.

The guards' code calls them through one function of C, `apply`, by the number of the
operation. `ONE`, `TWO` and `OF_ANYTHING` say which functions of Python and NumPy mean
which operation.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np
from numba import cfunc, types

from hopdata.code_cache import compiled_in_cache
from hopdata.hybrid.compiled.kernel import ENTRY, kernel
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
NAMES = (*ONE, *TWO, *OF_ANYTHING, "table")
NUMBERS = {name: place for place, name in enumerate(NAMES)}


# All of them in one function of C.

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


ARGUMENTS = "number, x_at, y_at, where, result"
GROUP = 8  # operations in one function: few, because each clears some memory


def _runs() -> list[Any]:
    """Return all operations, in the order of their numbers."""
    runs = [_with_one(one.function) for one in ONE.values()]
    runs += [_with_two(two.function) for two in TWO.values()]
    runs += [_with_anything(one.function) for one in OF_ANYTHING.values()]
    return [*runs, _with_table]


def _choice(name: str, value: str, chosen: list[Any], arguments: str) -> Any:
    """Return a function that calls one of some functions, by a number."""
    body = []
    for place in range(len(chosen)):
        body.append(f"if {value} == {place}: run_{place}({arguments})")
    known = {f"run_{place}": run for place, run in enumerate(chosen)}
    return compose(name, ARGUMENTS, body, known)


def _apply() -> Any:
    """Return the function of C, before it is compiled.

    It takes the number of an operation; addresses of one or two ranges (or of the parts
    of a table); the address of the memory of answers; and the address of the result.
    """
    runs = _runs()
    groups = []
    for first in range(0, len(runs), GROUP):
        some = runs[first : first + GROUP]
        value = f"number % {GROUP}"
        groups.append(kernel(_choice("some", value, some, "x_at, y_at, where, result")))
    return _choice("apply", f"number // {GROUP}", groups, ARGUMENTS)


@cache
def symbol() -> str:
    """Load the function of C, and return the name by which the guards' code calls it.

    The name changes with its sources, so that kept code calls no other.
    """
    function = _apply()

    def compile_it(cached: bool) -> Any:
        return cfunc(APPLY_NATIVE, cache=cached, **ENTRY)(function)

    compiled = compiled_in_cache(function, DIGEST, compile_it)
    name = f"hopdata_ranges_{DIGEST}"
    llvm.add_symbol(name, compiled.address)
    _LOADED.append(compiled)
    return name


_LOADED: list[Any] = []  # keeps the machine code in memory
