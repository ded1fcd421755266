"""Arithmetic of dual numbers: sums, products, quotients, remainders and powers.

Each formula returns value and slopes. A plain number has slopes that are zero.
"""

import math
import operator
from typing import Any

import numpy as np
from numba import types
from numba.extending import lower_builtin

from hopdata.hybrid.compiled.terms import (
    FLOAT,
    Code,
    Term,
    Value,
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
    numbers_of,
    width_among,
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

Parts = tuple[Term, Slopes]
INT = types.int64


def _add(x: Number, y: Number) -> Parts:
    return x.value + y.value, x.slopes + y.slopes


def _subtract(x: Number, y: Number) -> Parts:
    return x.value - y.value, x.slopes - y.slopes


def _multiply(x: Number, y: Number) -> Parts:
    return x.value * y.value, x.slopes.times_plus(y.value, y.slopes * x.value)


def _divide(x: Number, y: Number) -> Parts:
    v = x.value / y.value
    return v, y.slopes.times_plus(-v, x.slopes) * (1.0 / y.value)


def _negative(x: Number) -> Parts:
    return -x.value, -x.slopes


def _same(x: Number) -> Parts:
    return x.value, x.slopes


def _remainder(key: Any, whole: Function) -> Function:
    """Return the formula of a remainder: x - q y, where q is `whole` of x and y."""

    def formula(x: Number, y: Number) -> Parts:
        quotient = whole(x.value, y.value)
        slopes = y.slopes.times_plus(-quotient, x.slopes)
        return of(key, x.value, y.value), slopes

    return formula


def _whole_below(x: Term, y: Term) -> Term:
    return of(operator.floordiv, x, y)


def _whole_towards_zero(x: Term, y: Term) -> Term:
    return of(np.trunc, x / y)


for _keys, _formula in (
    (ADD, _add), (SUBTRACT, _subtract), (MULTIPLY, _multiply), (DIVIDE, _divide)
):  # fmt: skip
    for _key in _keys:
        defined(_key, 2, _formula)
for _key in REMAINDER:
    defined(_key, 2, _remainder(_key, _whole_below))
defined(np.fmod, 2, _remainder(np.fmod, _whole_towards_zero))
for _key in NEGATE:
    defined(_key, 1, _negative)
for _key in SAME:
    defined(_key, 1, _same)


# Powers. An exponent that is an integer, or written as one, remains it.


def _power_of(key: Any) -> Function:
    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        code = Code(context, builder)
        kinds = tuple(FLOAT if isinstance(kind, Dual) else kind for kind in sign.args)
        x, y = numbers_of(context, builder, sign.args, values)
        if _literal(kinds[1]) == 2:
            v = x.value * x.value
        else:
            v = called_number(code, key, kinds, (x.value.built, y.value.built))
        slopes = y.slopes
        if y.slopes.known is not None:
            slopes = y.slopes.times_infinite(_log_times(x.value, v))
        if x.slopes.known is not None:
            factor = _slope_of_power(code, key, kinds, x.value, y.value.built)
            slopes = x.slopes.times_infinite(factor) + slopes
        return dual_of(v, slopes)

    return lower


def _literal(kind: Any) -> int | None:
    """Return the integer that a type stands for, if it does."""
    if isinstance(kind, types.IntegerLiteral):
        return int(kind.literal_value)
    return None


def _slope_of_power(code: Code, key: Any, kinds: Any, x: Term, y: Value) -> Any:
    """Build y x^(y - 1), zero if y is zero; `kinds` are the types of x and y."""
    exponent = kinds[1]
    n = _literal(exponent)
    if n is not None:
        return _slope_of_known_power(code, key, x, n)
    if isinstance(exponent, types.Integer):
        is_none = code.llvm.icmp_signed("==", y, y.type(0))
        less = code.llvm.select(is_none, y, code.llvm.sub(y, y.type(1)))
        number = Term(code, code.context.cast(code.llvm, y, exponent, FLOAT))
    else:
        number = Term(code, y)
        less = (number - 1.0).built
    power = called_number(code, key, kinds, (x.built, less))
    return where(number.equals(0.0), 0.0, number * power)


def _slope_of_known_power(code: Code, key: Any, x: Term, n: int) -> Any:
    """Build n x^(n - 1) for a known n."""
    if n == 0:
        return 0.0
    if n == 1:
        return 1.0
    if n == 2:
        return 2.0 * x
    kinds = (FLOAT, types.literal(n - 1))
    return float(n) * called_number(code, key, kinds, (x.built, n - 1))


def _log_times(x: Term, power: Term) -> Term:
    """Build log(x) x^y; zero where the power is."""
    return where(power.equals(0.0), 0.0, of(math.log, x) * power)


def _typed_power(*kinds: Any) -> Any:
    plain = tuple(map(types.unliteral, kinds))
    width = width_among(plain)
    if len(plain) != 2 or width == 0:
        return None
    base = plain[0] if isinstance(plain[0], Dual) else FLOAT
    exponent: Any = FLOAT
    if isinstance(plain[1], Dual):
        exponent = plain[1]
    elif isinstance(kinds[1], types.IntegerLiteral):
        exponent = kinds[1]
    elif isinstance(plain[1], types.Integer):
        exponent = INT
    return Dual(width)(base, exponent)


for _key in POWER:
    tried_first(_key, _typed_power, literal=True)
    for _kinds in (
        (Dual, Dual), (Dual, types.Float), (Dual, types.Integer), (types.Float, Dual)
    ):  # fmt: skip
        lower_builtin(_key, *_kinds)(_power_of(_key))
