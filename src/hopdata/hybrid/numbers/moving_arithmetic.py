# ruff: noqa: ARG001 (Numba prescribes signatures)
"""Arithmetic of numbers that move: sums, products, quotients, remainders and powers.

Each formula returns value and rate.
"""

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import (
    lower_builtin,
)

from hopdata.hybrid.compiled.memory import is_number
from hopdata.hybrid.numbers.moving_type import (
    Function,
    Moving,
    defined,
    kind_among,
    moving,
    of,
)
from hopdata.hybrid.numbers.names import (
    ADD,
    DIVIDE,
    MULTIPLY,
    NEGATE,
    POWER,
    REMAINDER,
    SAME,
    SUBTRACT,
)
from hopdata.private_numba import tried_first

# Arithmetic. A plain number has no rate.


def _add(x: Any, y: Any) -> Any:
    return x.value + y.value, x.rate + y.rate


def _add_to_number(x: Any, y: Any) -> Any:
    return x + y.value, y.rate


def _add_number(x: Any, y: Any) -> Any:
    return x.value + y, x.rate


def _subtract(x: Any, y: Any) -> Any:
    return x.value - y.value, x.rate - y.rate


def _subtract_from_number(x: Any, y: Any) -> Any:
    return x - y.value, -y.rate


def _subtract_number(x: Any, y: Any) -> Any:
    return x.value - y, x.rate


def _multiply(x: Any, y: Any) -> Any:
    return x.value * y.value, x.rate * y.value + x.value * y.rate


def _times_number(x: Any, y: Any) -> Any:
    return x.value * y, x.rate * y


def _number_times(x: Any, y: Any) -> Any:
    return x * y.value, x * y.rate


def _divide(x: Any, y: Any) -> Any:
    v = x.value / y.value
    return v, (x.rate - v * y.rate) / y.value


def _number_over(x: Any, y: Any) -> Any:
    v = x / y.value
    return v, -v * y.rate / y.value


def _over_number(x: Any, y: Any) -> Any:
    return x.value / y, x.rate / y


def _remainder(x: Any, y: Any) -> Any:
    whole = of(np.floor, x.value / y.value)
    return x.value % y.value, x.rate - whole * y.rate


def _remainder_by_number(x: Any, y: Any) -> Any:
    return x.value % y, x.rate


def _signed_remainder(x: Any, y: Any) -> Any:
    whole = of(np.trunc, x.value / y.value)
    return of(np.fmod, x.value, y.value), x.rate - whole * y.rate


def _signed_remainder_by_number(x: Any, y: Any) -> Any:
    return of(np.fmod, x.value, y), x.rate


def _negative(x: Any) -> Any:
    return -x.value, -x.rate


def _same(x: Any) -> Any:
    return x


for _key in ADD:
    defined(_key, 2, _add, numbers={0: _add_to_number, 1: _add_number})
for _key in SUBTRACT:
    defined(_key, 2, _subtract, numbers={0: _subtract_from_number, 1: _subtract_number})
for _key in MULTIPLY:
    defined(_key, 2, _multiply, numbers={0: _number_times, 1: _times_number})
for _key in DIVIDE:
    defined(_key, 2, _divide, numbers={0: _number_over, 1: _over_number})
for _key in REMAINDER:
    defined(_key, 2, _remainder, numbers={1: _remainder_by_number})
for _key in (np.fmod, math.fmod):
    _by_number = {1: _signed_remainder_by_number}
    defined(_key, 2, _signed_remainder, numbers=_by_number)
for _key in NEGATE:
    defined(_key, 1, _negative)
for _key in SAME:
    defined(_key, 1, _same)


# Powers. An exponent that is an integer remains it; squares are products.


def _square(x: Any, n: int) -> Any:
    return moving(x.value * x.value, 2.0 * (x.value * x.rate))


def _whole_power(x: Any, n: int) -> Any:
    if n == 0:
        return moving(x.value**n, 0.0)
    return moving(x.value**n, float(n) * (x.value ** (n - 1) * x.rate))


def _power_by_number(x: Any, y: float) -> Any:
    return moving(x.value**y, y * (x.value ** (y - 1.0) * x.rate))


def _power(x: Any, y: Any) -> Any:
    v = x.value**y.value
    of_y = v * (math.log(x.value) * y.rate)
    return moving(v, y.value * (x.value ** (y.value - 1.0) * x.rate) + of_y)


def _power_of_number(x: float, y: Any) -> Any:
    v = x**y.value
    return moving(v, v * (math.log(x) * y.rate))


def _typed_power(*kinds: Any) -> Any:
    plain_kinds = tuple(map(types.unliteral, kinds))
    found = kind_among(plain_kinds)
    if len(kinds) != 2 or found is None:
        return None
    base = types.float64 if is_number(plain_kinds[0]) else found
    exponent: Any = found
    if isinstance(kinds[1], types.IntegerLiteral):
        exponent = kinds[1]
    elif isinstance(plain_kinds[1], types.Integer):
        exponent = types.int64
    elif is_number(plain_kinds[1]):
        exponent = types.float64
    return found(base, exponent)


def _lower_power(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    base, exponent = sign.args
    chosen: Function = _power
    if isinstance(exponent, types.IntegerLiteral) and exponent.literal_value == 2:
        chosen = _square
    elif isinstance(exponent, types.Integer | types.IntegerLiteral):
        chosen = _whole_power
    elif is_number(exponent):
        chosen = _power_by_number
    elif is_number(base):
        chosen = _power_of_number
    given = sign.return_type(*map(types.unliteral, sign.args))
    return context.compile_internal(builder, chosen, given, values)


for _key in POWER:
    tried_first(_key, _typed_power, literal=True)
    for _kinds in (
        (Moving, Moving), (Moving, types.Float), (Moving, types.Integer),
        (types.Float, Moving),
    ):  # fmt: skip
        lower_builtin(_key, *_kinds)(_lower_power)
