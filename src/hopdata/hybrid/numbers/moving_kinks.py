# ruff: noqa: ARG001 (the formulas of types prescribe signatures)
"""Functions of numbers that move with kinks or jumps, comparisons and choices.

At a kink the rate is that of one side; of a range that contains the kink, those of
both. What is constant between jumps has no rate, and comparisons decide by the value.
"""

import builtins
import math
import operator
from typing import Any

import numpy as np
from numba import types
from numba.extending import (
    lower_builtin,
)

from hopdata.hybrid.numbers.moving_type import (
    Function,
    Moving,
    branching,
    defined,
    flat,
    kind_among,
    moving,
    of,
)
from hopdata.hybrid.numbers.names import (
    ABSOLUTE,
    ANGLE,
    COMPARE,
    COPY_SIGN,
    HYPOTENUSE,
    LARGEST,
    LEAST,
    ROUND,
    ROUND_TO_FLOAT,
    TELL_NUMBERS,
    WHOLE_QUOTIENT,
)
from hopdata.hybrid.numbers.ranges import RANGE
from hopdata.private_numba import tried_first

# Functions with kinks.


def _absolute(x: Any) -> Any:
    return of(abs, x.value), of(np.sign, x.value) * x.rate


def _least(x: Any, y: Any) -> Any:
    if y.value < x.value:
        return moving(min(x.value, y.value), y.rate)
    return moving(min(x.value, y.value), x.rate)


def _largest(x: Any, y: Any) -> Any:
    if y.value > x.value:
        return moving(max(x.value, y.value), y.rate)
    return moving(max(x.value, y.value), x.rate)


def _hypotenuse(x: Any, y: Any) -> Any:
    v = of(math.hypot, x.value, y.value)
    return v, (x.value * x.rate + y.value * y.rate) / v


def _angle(y: Any, x: Any) -> Any:
    size = x.value * x.value + y.value * y.value
    turning = x.value * y.rate - y.value * x.rate
    return of(math.atan2, y.value, x.value), turning / size


def _copy_sign(x: Any, y: Any) -> Any:
    signs = of(np.sign, x.value) * of(np.sign, y.value)
    return of(math.copysign, x.value, y.value), signs * x.rate


for _key in ABSOLUTE:
    defined(_key, 1, _absolute)
for _key in LEAST:
    branching(_key, 2, _least)
for _key in LARGEST:
    branching(_key, 2, _largest)
for _key in HYPOTENUSE:
    defined(_key, 2, _hypotenuse)
for _key in ANGLE:
    defined(_key, 2, _angle)
for _key in COPY_SIGN:
    defined(_key, 2, _copy_sign)


# What depends on the value alone.


def _of_values(key: Any) -> Function:
    """Return the formula of a function of the values of its arguments."""
    return lambda *numbers: of(key, *(one.value for one in numbers))


def _truth(kind: Any) -> Any:
    return types.boolean


def _whole(kind: Any) -> Any:
    return types.int64


def _flat_or_whole(kind: Any) -> Any:
    """Return the type of `math.floor`, which is an integer of numbers but of ranges."""
    return RANGE if flat(kind) == RANGE else types.int64


for _key in COMPARE:
    defined(_key, 2, _of_values(_key), returns=_truth)
for _key in TELL_NUMBERS:
    defined(_key, 1, _of_values(_key), returns=_truth)
for _key in ROUND:
    defined(_key, 1, _of_values(_key), returns=_flat_or_whole)
for _key in (int, round):
    defined(_key, 1, _of_values(_key), returns=_whole)
for _key in (*ROUND_TO_FLOAT, np.sign):
    defined(_key, 1, _of_values(_key), returns=flat)
for _key in WHOLE_QUOTIENT:
    defined(_key, 2, _of_values(operator.floordiv), returns=flat)
defined(bool, 1, lambda x: of(operator.ne, x.value, 0.0), returns=_truth)
defined(operator.truth, 1, lambda x: of(operator.ne, x.value, 0.0), returns=_truth)
defined(operator.not_, 1, lambda x: of(operator.eq, x.value, 0.0), returns=_truth)


# Choices, more than two numbers, tables.


def _typed_where(*kinds: Any) -> Any:
    kinds = tuple(map(types.unliteral, kinds))
    if len(kinds) != 3 or kinds[0] != types.boolean:
        return None
    found = kind_among(kinds[1:])
    return None if found is None else found(types.boolean, found, found)


def _choose(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return context.compile_internal(
        builder, lambda truth, x, y: x if truth else y, sign, values
    )


tried_first(np.where, _typed_where)
lower_builtin(np.where, types.Boolean, Moving, Moving)(_choose)


def _of_many(key: Any) -> None:
    def typed(*kinds: Any) -> Any:
        kinds = tuple(map(types.unliteral, kinds))
        found = kind_among(kinds)
        if len(kinds) < 3 or found is None:
            return None
        return found(*[found] * len(kinds))

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        kind = sign.return_type
        made = values[0]
        function = _least if key is min else _largest
        for value in values[1:]:
            given = kind(kind, kind)
            made = context.compile_internal(builder, function, given, (made, value))
        return made

    tried_first(key, typed)
    lower_builtin(key, Moving, Moving, Moving, types.VarArg(types.Any))(lower)


_of_many(builtins.min)
_of_many(builtins.max)
