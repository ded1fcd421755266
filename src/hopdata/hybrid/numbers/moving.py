# ruff: noqa: ARG001, ARG005, PLW0108 (Numba and the tables prescribe signatures)
"""A Numba type of numbers that move: a value and its rate, of any kind of number.

The kind may be a float, a dual, a range, or a number that moves itself. So the rate of
a guard along a motion is a number of that kind: a dual, with its derivatives, or a
range of values and of rates. Derivatives and rates of a rate are second derivatives of
the guard.

Each operation is written once, in terms of the operations of the kind: the value as it
is, the rate by the chain rule. Comparisons decide by the value. What is constant
between jumps (`floor`, `sign`) has no rate. At a kink the rate is that of one side; of
a range that contains the kink, those of both.
"""

import builtins
import math
import operator
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from numba import types
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_model,
)

from hopdata.hybrid.compiled.memory import (
    NumberLike,
    array_from,
    is_number,
    structure,
    tried_first,
)
from hopdata.hybrid.numbers.duals import Dual, is_scalar
from hopdata.hybrid.numbers.ranges import DIGEST, RANGE, make

Function = Callable[..., Any]
in_code: Any = intrinsic
in_code_literally: Any = intrinsic(prefer_literal=True)


class Moving(NumberLike):
    """The type of a number that moves, of the kind `inner`."""

    is_kept = False  # see `code_cache`

    def __init__(self, inner: Any) -> None:
        self.inner = inner
        self.sources = DIGEST
        super().__init__(name=f"Moving({inner})")

    @property
    def key(self) -> Any:
        """What makes two types equal; one kept by an older version has no sources."""
        return self.name, vars(self).get("sources", "")

    def can_convert_from(self, context: Any, other: Any) -> Any:
        """Return whether another type converts to this one, as one that rests."""
        if other == self.inner:
            return super().can_convert_from(context, types.float64)
        if isinstance(self.inner, NumberLike):
            return self.inner.can_convert_from(context, other)
        return super().can_convert_from(context, other)

    def unify(self, context: Any, other: Any) -> Any:
        """Return the type of a variable that holds values of both types."""
        return self if self.can_convert_from(context, other) is not None else None


@register_model(Moving)
class _MovingModel(models.StructModel):
    def __init__(self, manager: Any, kind: Moving) -> None:
        super().__init__(manager, kind, [("value", kind.inner), ("rate", kind.inner)])


make_attribute_wrapper(Moving, "value", "value")
make_attribute_wrapper(Moving, "rate", "rate")


def _pair(context: Any, builder: Any, kind: Any, value: Any, rate: Any) -> Any:
    made = structure(context, builder, kind)
    made.value = value
    made.rate = rate
    return made._getvalue()


@in_code
def moving(typing: Any, value: Any, rate: Any) -> Any:
    """Build a number of the value's kind that moves at this rate."""
    inner = types.unliteral(value)
    inner = types.float64 if is_number(inner) else inner

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        parts = []
        for kind, part in zip(sign.args, values, strict=True):
            parts.append(context.cast(builder, part, kind, inner))
        return _pair(context, builder, sign.return_type, *parts)

    return Moving(inner)(types.unliteral(value), types.unliteral(rate)), generate


def _resting(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    inner = wanted.inner
    number = context.cast(builder, value, given, inner)
    zero = context.get_constant(types.float64, 0.0)
    rate = context.cast(builder, zero, types.float64, inner)
    return _pair(context, builder, wanted, number, rate)


for _number in (
    types.Float, types.Integer, types.IntegerLiteral, types.Boolean, NumberLike
):  # fmt: skip
    lower_cast(_number, Moving)(_resting)


# Room for numbers, and their kinds. The functions are intrinsics of this module, so
# that kept code that calls them changes with it (see `code_cache.function_digest`).


def _room(item: Any, like: Any, count: Any) -> Any:
    """Return what builds an array of items on the stack."""
    kind = types.Array(item, 1, "C")
    n = int(count.literal_value)

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        native = context.get_data_type(item)
        with builder.goto_entry_block():
            start = builder.alloca(native, max(n, 1))
        size = context.get_constant(types.intp, context.get_abi_sizeof(native))
        length = context.get_constant(types.intp, n)
        return array_from(context, builder, kind, start, length, size)

    return kind(like, count), generate


def _item_of(like: Any) -> Any:
    """Return the kind of an array's items, or of a number."""
    item = getattr(like, "dtype", types.unliteral(like))
    return types.float64 if is_number(item) else item


@in_code_literally
def room_like(typing: Any, like: Any, count: Any) -> Any:
    """Build an array of a number of items of the kind of `like`, or of its items."""
    return _room(_item_of(like), like, count)


@in_code_literally
def room_moving(typing: Any, like: Any, count: Any) -> Any:
    """Build an array as `room_like` does, of items that move."""
    return _room(Moving(_item_of(like)), like, count)


@in_code
def as_item(typing: Any, number: Any, array: Any) -> Any:
    """Build a number of the kind of an array's items."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return context.cast(builder, values[0], sign.args[0], sign.return_type)

    return array.dtype(types.unliteral(number), array), generate


def plain(x: Any) -> float:
    """Return the value of a number as a float, for compiled code."""
    raise NotImplementedError


def _plain(x: Any) -> Any:
    if is_number(x):
        return lambda x: float(x)
    if isinstance(x, Dual):
        return lambda x: x.value
    if isinstance(x, Moving):
        return lambda x: plain(x.value)
    if x == RANGE:
        return lambda x: 0.5 * (x.lo + x.hi)
    return None


overload(plain)(lambda x: _plain(x))  # Numba compares annotations, too


# How an operation is defined: by a formula that Python runs once, on numbers of the
# code that is being generated. So it costs next to no time to compile.


class Traced:
    """A number of the generated code; Python's operators build their code.

    Parameters
    ----------
    context, builder
        Numba's context, and LLVM's builder.
    kind : Numba type
        Its type.
    built : LLVM value
        Its value.
    """

    def __init__(self, context: Any, builder: Any, kind: Any, built: Any) -> None:
        self.context = context
        self.builder = builder
        self.kind = kind
        self.built = built

    def _part(self, name: str) -> "Traced":
        held = structure(self.context, self.builder, self.kind, self.built)
        return self._like(self.kind.inner, getattr(held, name))

    def _like(self, kind: Any, built: Any) -> "Traced":
        return Traced(self.context, self.builder, kind, built)

    @property
    def value(self) -> "Traced":
        """The value of a number that moves."""
        return self._part("value")

    @property
    def rate(self) -> "Traced":
        """Its rate."""
        return self._part("rate")

    def cast(self, kind: Any) -> Any:
        """Build the number as one of another type."""
        return self.context.cast(self.builder, self.built, self.kind, kind)

    def traced(self, other: Any) -> "Traced":
        """Return a number of Python as a constant of the code; others as they are."""
        if isinstance(other, Traced):
            return other
        constant = self.context.get_constant(types.float64, float(other))
        return self._like(types.float64, constant)

    def __add__(self, other: Any) -> "Traced":
        return of(operator.add, self, other)

    def __radd__(self, other: Any) -> "Traced":
        return of(operator.add, self.traced(other), self)

    def __sub__(self, other: Any) -> "Traced":
        return of(operator.sub, self, other)

    def __rsub__(self, other: Any) -> "Traced":
        return of(operator.sub, self.traced(other), self)

    def __mul__(self, other: Any) -> "Traced":
        return of(operator.mul, self, other)

    def __rmul__(self, other: Any) -> "Traced":
        return of(operator.mul, self.traced(other), self)

    def __truediv__(self, other: Any) -> "Traced":
        return of(operator.truediv, self, other)

    def __rtruediv__(self, other: Any) -> "Traced":
        return of(operator.truediv, self.traced(other), self)

    def __mod__(self, other: Any) -> "Traced":
        return of(operator.mod, self, other)

    def __neg__(self) -> "Traced":
        return of(operator.neg, self)


def of(key: Any, *numbers: Any) -> Traced:
    """Build the call of a function that Numba knows, with numbers of the code."""
    first = numbers[0]
    given = [first.traced(one) for one in numbers]
    typing = first.context.typing_context
    function = typing.resolve_value_type(key)
    sign = typing.resolve_function_type(function, tuple(one.kind for one in given), {})
    made = first.context.get_function(function, sign)
    values = []
    for one, wanted in zip(given, sign.args, strict=True):
        values.append(one.built if one.kind == wanted else one.cast(wanted))
    result = made(first.builder, values)
    first.context.add_linking_libs(getattr(made, "libs", ()))
    return Traced(first.context, first.builder, sign.return_type, result)


def _kind_among(kinds: Any) -> Any:
    """Return the kind of moving numbers to which all of these convert, or None."""
    found: Any = None
    for kind in kinds:
        if isinstance(kind, Moving) and (found is None or _is_within(found, kind)):
            found = kind
    if found is None:
        return None
    for kind in kinds:
        fits = kind == found or is_scalar(kind) or _is_within(kind, found)
        if not fits:
            return None
    return found


def _is_within(kind: Any, outer: Any) -> bool:
    """Return whether a kind is that of the values of an outer one, at any depth."""
    while isinstance(outer, Moving):
        outer = outer.inner
        if kind == outer:
            return True
    return False


def defined(
    key: Any,
    count: int,
    formula: Function,
    *,
    numbers: dict[int, Function] | None = None,
    returns: Function | None = None,
) -> None:
    """Define a function of `count` numbers of which at least one moves.

    Parameters
    ----------
    key : callable
        What is called.
    count : int
        Number of arguments.
    formula : callable
        Takes the arguments as `Traced` numbers. Returns value and rate of a result that
        moves, or the result itself.
    numbers : dict, optional
        Formulas for a plain number among the arguments, by its position.
    returns : callable, optional
        Takes the type of the moving arguments, and returns that of the result. Without
        it they are the same.
    """
    shorter = numbers or {}

    def typed(*kinds: Any) -> Any:
        kinds = tuple(map(types.unliteral, kinds))
        found = _kind_among(kinds)
        if len(kinds) != count or found is None:
            return None
        result = found if returns is None else returns(found)
        taken = []
        for place, kind in enumerate(kinds):
            is_short = place in shorter and is_number(kind)
            taken.append(types.float64 if is_short else found)
        return result(*taken)

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        chosen = formula
        given = []
        for place, kind in enumerate(sign.args):
            given.append(Traced(context, builder, kind, values[place]))
            if is_number(kind):
                chosen = shorter[place]
        found = chosen(*given)
        if isinstance(found, Traced):
            return found.cast(sign.return_type)
        inner = sign.return_type.inner
        parts = [given[0].traced(one).cast(inner) for one in found]
        return _pair(context, builder, sign.return_type, *parts)

    tried_first(key, typed)
    _lower_all(key, count, lower)


def branching(key: Any, count: int, function: Function) -> None:
    """Define a function of `count` numbers by one for Numba, as it branches."""

    def typed(*kinds: Any) -> Any:
        kinds = tuple(map(types.unliteral, kinds))
        found = _kind_among(kinds)
        if len(kinds) != count or found is None:
            return None
        return found(*[found] * count)

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return context.compile_internal(builder, function, sign, values)

    tried_first(key, typed)
    _lower_all(key, count, lower)


def _lower_all(key: Any, count: int, lower: Function) -> None:
    for kinds in product((Moving, types.Float), repeat=count):
        if Moving in kinds:
            lower_builtin(key, *kinds)(lower)


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
    "degrees": lambda x, v: x.traced(DEGREES),
    "radians": lambda x, v: x.traced(RADIANS),
}
IN_NUMPY = {
    "asin": ("arcsin",),
    "acos": ("arccos",),
    "atan": ("arctan",),
    "asinh": ("arcsinh",),
    "acosh": ("arccosh",),
    "atanh": ("arctanh",),
    "degrees": ("degrees", "rad2deg"),
    "radians": ("radians", "deg2rad"),
}


def _one(key: Any, derivative: Function) -> Function:
    """Return the formula of a function of one number, by its derivative."""

    def formula(x: Traced) -> Any:
        v = of(key, x.value)
        return v, derivative(x.value, v) * x.rate

    return formula


for _name, _derivative in DERIVATIVES.items():
    _found = [getattr(math, _name, None)]
    for _in_numpy in IN_NUMPY.get(_name, (_name,)):
        _found.append(getattr(np, _in_numpy, None))
    for _key in _found:
        if _key is not None:
            defined(_key, 1, _one(_key, _derivative))


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


for _key in (operator.add, operator.iadd, np.add):
    defined(_key, 2, _add, numbers={0: _add_to_number, 1: _add_number})
for _key in (operator.sub, operator.isub, np.subtract):
    defined(_key, 2, _subtract, numbers={0: _subtract_from_number, 1: _subtract_number})
for _key in (operator.mul, operator.imul, np.multiply):
    defined(_key, 2, _multiply, numbers={0: _number_times, 1: _times_number})
for _key in (operator.truediv, operator.itruediv, np.divide):
    defined(_key, 2, _divide, numbers={0: _number_over, 1: _over_number})
for _key in (operator.mod, operator.imod, np.mod):
    defined(_key, 2, _remainder, numbers={1: _remainder_by_number})
for _key in (np.fmod, math.fmod):
    _by_number = {1: _signed_remainder_by_number}
    defined(_key, 2, _signed_remainder, numbers=_by_number)
for _key in (operator.neg, np.negative):
    defined(_key, 1, _negative)
for _key in (operator.pos, np.positive, float):
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
    found = _kind_among(plain_kinds)
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


for _key in (operator.pow, operator.ipow, pow, math.pow, np.power):
    tried_first(_key, _typed_power, literal=True)
    for _kinds in (
        (Moving, Moving), (Moving, types.Float), (Moving, types.Integer),
        (types.Float, Moving),
    ):  # fmt: skip
        lower_builtin(_key, *_kinds)(_lower_power)


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


for _key in (abs, np.abs, math.fabs, np.fabs):
    defined(_key, 1, _absolute)
for _key in (builtins.min, np.minimum, np.fmin):
    branching(_key, 2, _least)
for _key in (builtins.max, np.maximum, np.fmax):
    branching(_key, 2, _largest)
for _key in (math.hypot, np.hypot):
    defined(_key, 2, _hypotenuse)
for _key in (math.atan2, np.arctan2):
    defined(_key, 2, _angle)
for _key in (math.copysign, np.copysign):
    defined(_key, 2, _copy_sign)


# What depends on the value alone.


def _of_values(key: Any) -> Function:
    """Return the formula of a function of the values of its arguments."""
    return lambda *numbers: of(key, *(one.value for one in numbers))


def _flat(kind: Any) -> Any:
    """Return the type of what is constant between jumps, such as `floor`."""
    inner = kind.inner
    if isinstance(inner, Moving):
        return _flat(inner)
    return RANGE if inner == RANGE else types.float64


def _truth(kind: Any) -> Any:
    return types.boolean


def _whole(kind: Any) -> Any:
    return types.int64


def _flat_or_whole(kind: Any) -> Any:
    """Return the type of `math.floor`, which is an integer of numbers but of ranges."""
    flat = _flat(kind)
    return RANGE if flat == RANGE else types.int64


for _key in (
    operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne
):  # fmt: skip
    defined(_key, 2, _of_values(_key), returns=_truth)
for _key in (math.isnan, math.isinf, math.isfinite, np.isnan, np.isinf, np.isfinite):
    defined(_key, 1, _of_values(_key), returns=_truth)
for _key in (math.floor, math.ceil, math.trunc):
    defined(_key, 1, _of_values(_key), returns=_flat_or_whole)
for _key in (int, round):
    defined(_key, 1, _of_values(_key), returns=_whole)
for _key in (np.floor, np.ceil, np.trunc, np.rint, np.sign):
    defined(_key, 1, _of_values(_key), returns=_flat)
for _key in (operator.floordiv, operator.ifloordiv, np.floor_divide):
    defined(_key, 2, _of_values(operator.floordiv), returns=_flat)
defined(bool, 1, lambda x: of(operator.ne, x.value, 0.0), returns=_truth)
defined(operator.truth, 1, lambda x: of(operator.ne, x.value, 0.0), returns=_truth)
defined(operator.not_, 1, lambda x: of(operator.eq, x.value, 0.0), returns=_truth)


# Choices, more than two numbers, tables.


def _typed_where(*kinds: Any) -> Any:
    kinds = tuple(map(types.unliteral, kinds))
    if len(kinds) != 3 or kinds[0] != types.boolean:
        return None
    found = _kind_among(kinds[1:])
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
        found = _kind_among(kinds)
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
    if isinstance(x, Moving) and _flat(x) == RANGE:
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
