"""Functions of dual numbers with kinks or jumps, comparisons and choices.

At a kink the slope is one-sided, along each direction. What is constant between jumps
is a plain number, and comparisons decide by the value.
"""

import builtins
import math
import operator
from typing import Any

import numpy as np
from numba import types
from numba.extending import lower_builtin

from hopdata.hybrid.compiled.terms import (
    FLOAT,
    TRUTH,
    Code,
    Term,
    Value,
    called,
    of,
    where,
)
from hopdata.hybrid.numbers.dual_type import (
    Dual,
    Function,
    Number,
    Slopes,
    choose,
    defined,
    dual_of,
    numbers_of,
    width_among,
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
from hopdata.private_numba import tried_first

Parts = tuple[Term, Slopes]
INT = types.int64
BOOL = types.boolean


# Kinks.


def _absolute(key: Any) -> Function:
    def formula(x: Number) -> Parts:
        turned = choose(x.value < 0.0, -x.slopes, x.slopes)
        at_kink = x.value.equals(0.0)
        return of(key, x.value), choose(at_kink, x.slopes.sizes(), turned)

    return formula


def _extreme(key: Any, sign: str) -> Function:
    """Return the formula of the one of two numbers that is `sign` the other, < or >.

    Python's own takes the first where neither is. NumPy's differ for NaN.
    """

    def formula(x: Number, y: Number) -> Parts:
        takes_second = y.value.compared(sign, x.value)
        if key in (builtins.min, builtins.max):
            v = where(takes_second, y.value, x.value)
        else:
            v = of(key, x.value, y.value)
        along_x = x.slopes.all.compared(sign, y.slopes.all)
        at_kink = choose(along_x, x.slopes, y.slopes)
        apart = choose(takes_second, y.slopes, x.slopes)
        return v, choose(y.value.equals(x.value), at_kink, apart)

    return formula


def _hypotenuse(key: Any) -> Function:
    def formula(x: Number, y: Number) -> Parts:
        v = of(key, x.value, y.value)
        slopes = y.slopes.times_plus(y.value / v, x.slopes * (x.value / v))
        at_kink = _length_of(x.slopes, y.slopes)
        return v, choose(v.equals(0.0), at_kink, slopes)

    return formula


def _length_of(one: Slopes, other: Slopes) -> Slopes:
    """Build the hypotenuse of slopes of which at least one is not zero."""
    squares = one * one.all + other * other.all
    return Slopes(one.zeros, squares.all.intrinsic("sqrt"))


def _angle(key: Any) -> Function:
    def formula(y: Number, x: Number) -> Parts:
        radius = of(math.hypot, y.value, x.value)
        per_y = x.value / radius / radius
        per_x = -(y.value / radius / radius)
        slopes = y.slopes.times_infinite(per_y) + x.slopes.times_infinite(per_x)
        return of(key, y.value, x.value), slopes

    return formula


def _copy_sign(key: Any) -> Function:
    def formula(x: Number, y: Number) -> Parts:
        first = of(math.copysign, 1.0, x.value)
        second = of(math.copysign, 1.0, y.value)
        return of(key, x.value, y.value), x.slopes * (first * second)

    return formula


for _key in ABSOLUTE:
    defined(_key, 1, _absolute(_key))
for _key in LEAST:
    defined(_key, 2, _extreme(_key, "<"))
for _key in LARGEST:
    defined(_key, 2, _extreme(_key, ">"))
for _key in HYPOTENUSE:
    defined(_key, 2, _hypotenuse(_key))
for _key in ANGLE:
    defined(_key, 2, _angle(_key))
for _key in COPY_SIGN:
    defined(_key, 2, _copy_sign(_key))


# Of more than two numbers, the least and the largest are those of pairs.


def _typed_extreme(*kinds: Any) -> Any:
    plain = tuple(map(types.unliteral, kinds))
    width = width_among(plain)
    if len(plain) < 3 or width == 0:
        return None
    return Dual(width)(*[Dual(width)] * len(plain))


def _extreme_of_many(formula: Function) -> Function:
    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        found, *others = numbers_of(context, builder, sign.args, values)
        for one in others:
            found = Number(*formula(found, one))
        return dual_of(*found)

    return lower


for _key, _sign in ((builtins.min, "<"), (builtins.max, ">")):
    tried_first(_key, _typed_extreme)
    _lower = _extreme_of_many(_extreme(_key, _sign))
    lower_builtin(_key, Dual, Dual, Dual, types.VarArg(types.Any))(_lower)


# What depends on the value alone.


def _by_value(key: Any) -> Function:
    def formula(*numbers: Number) -> Value:
        values = [one.value.built for one in numbers]
        code = numbers[0].value.code
        return called(code, key, (FLOAT,) * len(values), values)[0]

    return formula


def _is_true(x: Number) -> Value:
    """Build whether a number is not zero; NaN is true."""
    zero = x.value.built.type(0.0)
    return x.value.code.llvm.fcmp_unordered("!=", x.value.built, zero)


def _is_false(x: Number) -> Value:
    return x.value.equals(0.0).built


for _keys, _count, _returned in (
    (COMPARE, 2, BOOL),
    (TELL_NUMBERS, 1, BOOL),
    ((*ROUND, int, round), 1, INT),
    ((*ROUND_TO_FLOAT, np.sign), 1, FLOAT),
    (WHOLE_QUOTIENT, 2, FLOAT),
):
    for _key in _keys:
        defined(_key, _count, _by_value(_key), _returned)
defined(bool, 1, _is_true, BOOL)
defined(operator.not_, 1, _is_false, BOOL)


# Choices.


def _choose(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build `np.where` of a truth value, which evaluates both sides as Python does."""
    truth = Term(Code(context, builder), builder.trunc(values[0], TRUTH))
    one, other = numbers_of(context, builder, sign.args[1:], values[1:])
    v = where(truth, one.value, other.value)
    return dual_of(v, choose(truth, one.slopes, other.slopes))


def _typed_where(*kinds: Any) -> Any:
    plain = tuple(map(types.unliteral, kinds))
    width = width_among(plain[1:])
    if len(plain) != 3 or plain[0] != BOOL or width == 0:
        return None
    taken = (one if isinstance(one, Dual) else FLOAT for one in plain[1:])
    return Dual(width)(BOOL, *taken)


tried_first(np.where, _typed_where)
for _kinds in ((Dual, Dual), (Dual, types.Float), (types.Float, Dual)):
    lower_builtin(np.where, types.Boolean, *_kinds)(_choose)
