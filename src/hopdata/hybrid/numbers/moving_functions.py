# ruff: noqa: ARG005 (each derivative takes argument and value)
"""Elementary functions of numbers that move, by their derivatives, and tables.

DERIVATIVES is the table to read: the derivative of each function of one number, as a
formula of the argument x and of the value v. The formulas are not those of dual numbers
(`dual_functions`), which are written for floats alone: these are run for ranges, too,
and differentiated again.
"""

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import (
    lower_builtin,
    overload,
)

from hopdata.hybrid.compiled.memory import is_number
from hopdata.hybrid.numbers.moving_type import (
    Built,
    Function,
    Moving,
    defined,
    flat,
    moving,
    of,
    plain,
)
from hopdata.hybrid.numbers.names import (
    functions_named,
)
from hopdata.hybrid.numbers.ranges import RANGE, make
from hopdata.private_numba import tried_first

# Functions of one number, by their derivatives: of the argument x and the value v.

# Factor in the derivative of the error function.
PER_TURN = 2.0 / math.sqrt(math.pi)
LOG_2 = math.log(2.0)
LOG_10 = math.log(10.0)
DEGREES = 180.0 / math.pi
RADIANS = math.pi / 180.0

DERIVATIVES: dict[str, Function] = {
    "sin": lambda x, v: of(math.cos, x),
    "cos": lambda x, v: -of(math.sin, x),
    "tan": lambda x, v: 1.0 + v * v,
    "asin": lambda x, v: 1.0 / of(math.sqrt, (1.0 - x) * (1.0 + x)),
    "acos": lambda x, v: -1.0 / of(math.sqrt, (1.0 - x) * (1.0 + x)),
    "atan": lambda x, v: 1.0 / (1.0 + x * x),
    "sinh": lambda x, v: of(math.cosh, x),
    "cosh": lambda x, v: of(math.sinh, x),
    "tanh": lambda x, v: 1.0 - v * v,
    "asinh": lambda x, v: 1.0 / of(math.sqrt, 1.0 + x * x),
    "acosh": lambda x, v: 1.0 / of(math.sqrt, (x - 1.0) * (x + 1.0)),
    "atanh": lambda x, v: 1.0 / ((1.0 - x) * (1.0 + x)),
    "exp": lambda x, v: v,
    "exp2": lambda x, v: LOG_2 * v,
    "expm1": lambda x, v: v + 1.0,
    "log": lambda x, v: 1.0 / x,
    "log2": lambda x, v: 1.0 / (LOG_2 * x),
    "log10": lambda x, v: 1.0 / (LOG_10 * x),
    "log1p": lambda x, v: 1.0 / (1.0 + x),
    "sqrt": lambda x, v: 0.5 / v,
    "cbrt": lambda x, v: 1.0 / (3.0 * v * v),
    "erf": lambda x, v: PER_TURN * of(math.exp, -x * x),
    "erfc": lambda x, v: -PER_TURN * of(math.exp, -x * x),
    "square": lambda x, v: 2.0 * x,
    "degrees": lambda x, v: x.with_type(DEGREES),
    "radians": lambda x, v: x.with_type(RADIANS),
}


def _one(key: Any, derivative: Function) -> Function:
    """Return the formula of a function of one number, by its derivative."""

    def formula(x: Built) -> Any:
        v = of(key, x.value)
        return v, derivative(x.value, v) * x.rate

    return formula


for _name, _derivative in DERIVATIVES.items():
    for _key in functions_named(_name):
        defined(_key, 1, _one(_key, _derivative))


# A table.


def table_slope(x: Any, places: Any, values: Any) -> Any:
    """Return the slope of a table at a number, for compiled code."""
    raise NotImplementedError


def _slope_of_ranges(x, places, values):  # type: ignore[no-untyped-def]
    # The rate of the table, of what moves at the rate 1.
    found = np.interp(make(x.lo, x.hi, 1.0, 1.0, x.at), places, values)
    change = math.inf
    if found.dlo == found.dhi:
        change = 0.0
    return make(found.dlo, found.dhi, -change, change, x.at)


def _slope_of_numbers(x, places, values):  # type: ignore[no-untyped-def]
    k = np.searchsorted(places, plain(x), side="right")
    if k in (0, len(places)):
        return 0.0
    return (values[k] - values[k - 1]) / (places[k] - places[k - 1])


def _table_slope(x: Any) -> Any:
    if x == RANGE:
        return _slope_of_ranges
    if isinstance(x, Moving) and flat(x) == RANGE:
        return lambda x, places, values: table_slope(x.value, places, values)
    return _slope_of_numbers


overload(table_slope)(lambda x, places, values: _table_slope(x))


def _interpolate(x: Any, places: Any, values: Any) -> Any:
    slope = table_slope(x.value, places, values)
    return moving(np.interp(x.value, places, values), slope * x.rate)


def _typed_interpolation(*kinds: Any) -> Any:
    if len(kinds) != 3 or not isinstance(kinds[0], Moving):
        return None
    for kind in kinds[1:]:
        if not isinstance(kind, types.Array) or not is_number(kind.dtype):
            return None
    return kinds[0](*kinds)


def _lower_interpolation(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return context.compile_internal(builder, _interpolate, sign, values)


tried_first(np.interp, _typed_interpolation)
lower_builtin(np.interp, Moving, types.Array, types.Array)(_lower_interpolation)
