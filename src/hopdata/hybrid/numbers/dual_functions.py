# ruff: noqa: ARG005 (each derivative takes argument and value)
"""Elementary functions of dual numbers, by their derivatives, and tables.

DERIVATIVES is the table to read: the derivative of each function of one number, as a
formula of the argument x and of the value v.
"""

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import lower_builtin

from hopdata.hybrid.compiled.terms import (
    FLOAT,
    Code,
    Term,
    called_number,
    of,
    where,
)
from hopdata.hybrid.numbers.dual_type import (
    Dual,
    Function,
    Number,
    Slopes,
    defined,
    dual_of,
    number_of,
)
from hopdata.hybrid.numbers.names import functions_named
from hopdata.private_numba import tried_first

LOG_2 = math.log(2.0)
LOG_10 = math.log(10.0)
PER_TURN = 2.0 / math.sqrt(math.pi)  # in the derivative of the error function


def _inverse_square_of_cosh(x: Term) -> Term:
    inverse = 1.0 / of(math.cosh, x)
    return inverse * inverse


# `tanh` and `acosh` are written so that nothing in them overflows.
DERIVATIVES: dict[str, Function] = {
    "sin": lambda x, v: of(math.cos, x),
    "cos": lambda x, v: -1.0 * of(math.sin, x),
    "tan": lambda x, v: 1.0 + v * v,
    "asin": lambda x, v: 1.0 / of(math.sqrt, (1.0 - x) * (1.0 + x)),
    "acos": lambda x, v: -1.0 / of(math.sqrt, (1.0 - x) * (1.0 + x)),
    "atan": lambda x, v: 1.0 / (1.0 + x * x),
    "sinh": lambda x, v: of(math.cosh, x),
    "cosh": lambda x, v: of(math.sinh, x),
    "tanh": lambda x, v: _inverse_square_of_cosh(x),
    "asinh": lambda x, v: 1.0 / of(math.hypot, 1.0, x),
    "acosh": lambda x, v: 1.0 / (of(math.sqrt, x - 1.0) * of(math.sqrt, x + 1.0)),
    "atanh": lambda x, v: 1.0 / ((1.0 - x) * (1.0 + x)),
    "exp": lambda x, v: v,
    "exp2": lambda x, v: LOG_2 * v,
    "expm1": lambda x, v: 1.0 + v,
    "log": lambda x, v: 1.0 / x,
    "log2": lambda x, v: (1.0 / LOG_2) / x,
    "log10": lambda x, v: (1.0 / LOG_10) / x,
    "log1p": lambda x, v: 1.0 / (1.0 + x),
    "sqrt": lambda x, v: 0.5 / v,
    "cbrt": lambda x, v: (1.0 / 3.0) / (v * v),
    "erf": lambda x, v: PER_TURN * of(math.exp, -(x * x)),
    "erfc": lambda x, v: -PER_TURN * of(math.exp, -(x * x)),
    "square": lambda x, v: 2.0 * x,
    "reciprocal": lambda x, v: -1.0 * (v * v),
    "degrees": lambda x, v: 180.0 / math.pi,
    "radians": lambda x, v: math.pi / 180.0,
}
# Those whose derivative is infinite somewhere; a slope of zero remains zero there.
INFINITE = {
    "asin", "acos", "acosh", "atanh", "log", "log2", "log10", "log1p", "sqrt", "cbrt",
    "reciprocal",
}  # fmt: skip


def _by_derivative(key: Any, name: str) -> Function:
    """Return the formula of a function of one number."""

    def formula(x: Number) -> tuple[Term, Slopes]:
        v = of(key, x.value)
        factor = DERIVATIVES[name](x.value, v)
        if name in INFINITE:
            return v, x.slopes.times_infinite(factor)
        return v, x.slopes * factor

    return formula


for _name in DERIVATIVES:
    for _key in functions_named(_name):
        defined(_key, 1, _by_derivative(_key, _name))


# A table: the slope of the piece into which each direction leads.


def _slope_ahead(x: float, places: Any, values: Any) -> float:
    """Return the slope of a table just above x."""
    last = len(places) - 1
    k = np.searchsorted(places, x, side="right")
    if k == 0 or k > last:
        return 0.0
    return (values[k] - values[k - 1]) / (places[k] - places[k - 1])


def _slope_behind(x: float, places: Any, values: Any) -> float:
    """Return the slope of a table just below x."""
    last = len(places) - 1
    k = np.searchsorted(places, x, side="left")
    if k == 0 or k > last:
        return 0.0
    return (values[k] - values[k - 1]) / (places[k] - places[k - 1])


def _interpolate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    code = Code(context, builder)
    x = number_of(code, sign.return_type.width, sign.args[0], values[0])
    kinds = (FLOAT, *sign.args[1:])
    given = (x.value.built, *values[1:])
    sides = []
    for function in (_slope_behind, _slope_ahead):
        slope = context.compile_internal(builder, function, FLOAT(*kinds), given)
        sides.append(Term(code, slope))
    behind, ahead = sides
    slopes = x.slopes.all
    led = where(slopes < 0.0, slopes * behind, slopes * ahead)
    value = called_number(code, np.interp, kinds, given)
    return dual_of(value, Slopes(x.slopes.zeros, led))


def _typed_interpolation(*kinds: Any) -> Any:
    if len(kinds) == 3 and isinstance(kinds[0], Dual):
        of_numbers = all(
            isinstance(kind, types.Array) and isinstance(kind.dtype, types.Number)
            for kind in kinds[1:]
        )
        if of_numbers:
            return kinds[0](*kinds)
    return None


tried_first(np.interp, _typed_interpolation)
lower_builtin(np.interp, Dual, types.Array, types.Array)(_interpolate)
