# ruff: noqa: ARG001, ARG002, ARG005 (Numba and the tables prescribe signatures)
"""A Numba type of dual numbers, for which a user's functions compile as they are.

A `Dual` is a value and its slopes along some directions at once, which are one vector
of the processor. Each operation computes the value as the code for numbers does, to the
bit, and the slopes by the chain rule. So the derivatives are exact but for rounding.

Comparisons decide by the value, as for numbers. What is constant between jumps
(`floor`, `//`, `sign`, `int`) is a plain number. `%` has the slope between its jumps.

At a kink the slope is one-sided, along each direction: that of `abs(x)` at 0 is the
size of the slope of x, that of `max` of two equal numbers the larger of their slopes,
and that of `hypot(x, y)` at 0 the hypotenuse of their slopes. In a table each direction
sees the piece into which it leads. Where a derivative is infinite (`sqrt` at 0), a
number whose slope is zero keeps a slope of zero.
"""

import builtins
import math
import operator
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import (
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    register_model,
)

from hopdata.hybrid.compiled.memory import (
    NumberLike,
    array_length,
    array_start,
    built,
    is_number,
    tried_first,
)
from hopdata.hybrid.numbers.new_arrays import make_arrays_of

FLOAT = types.float64
INT = types.int64
BOOL = types.boolean
DOUBLE = ir.DoubleType()
LONG = ir.IntType(64)
BYTES = 8  # of a number
WIDTHS = (1, 2, 4, 8)  # possible numbers of directions
Function = Callable[..., Any]
Value = Any  # of LLVM


class Dual(NumberLike):
    """The type of a value with slopes along `width` directions."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Dual({width})")


class Slopes(types.Type):
    """The type of slopes along `width` directions."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Slopes({width})")


def width_for(count: int) -> int:
    """Return the width of duals that suits a number of directions."""
    for width in WIDTHS:
        if width >= count:
            return width
    return WIDTHS[-1]


@register_model(Slopes)
class _SlopesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Slopes) -> None:
        super().__init__(manager, kind, ir.VectorType(DOUBLE, kind.width))


@register_model(Dual)
class _DualModel(models.StructModel):
    """A value and its slopes; in arrays without a gap between them."""

    def __init__(self, manager: Any, kind: Dual) -> None:
        members = [("value", FLOAT), ("slopes", Slopes(kind.width))]
        super().__init__(manager, kind, members)

    def get_data_type(self) -> Any:
        if self._data_type is None:
            parts = [one.get_data_type() for one in self._models]
            self._data_type = ir.LiteralStructType(parts, packed=True)
        return self._data_type

    def load_from_data_pointer(self, builder: Any, ptr: Any, align: Any = None) -> Any:
        whole = ir.Constant(self.get_value_type(), ir.Undefined)
        zero = ir.Constant(ir.IntType(32), 0)
        for place in range(2):
            member = builder.gep(ptr, [zero, zero.type(place)], inbounds=True)
            part = builder.load(member, align=BYTES)
            whole = builder.insert_value(whole, part, place)
        return whole


make_attribute_wrapper(Dual, "value", "value")
make_attribute_wrapper(Dual, "slopes", "slopes")


# How the code of an operation is built.


class Builder:
    """What builds one operation: LLVM's builder, Numba's context, and the width."""

    def __init__(self, context: Any, builder: Any, width: int) -> None:
        self.context = context
        self.llvm = builder
        self.vector = ir.VectorType(DOUBLE, width)
        self.kind = Dual(width)
        self.zeros = ir.Constant(self.vector, [0.0] * width)

    def parts(self, kind: Any, value: Value) -> tuple[Value, Value]:
        """Return value and slopes; a plain number has None for slopes."""
        if not isinstance(kind, Dual):
            return value, None
        number = self.llvm.extract_value(value, 0)
        return number, self.llvm.extract_value(value, 1)

    def dual(self, value: Value, slopes: Value) -> Value:
        """Return a dual number; slopes may be None."""
        if slopes is None:
            slopes = self.zeros
        whole = ir.Constant(self.context.get_value_type(self.kind), ir.Undefined)
        whole = self.llvm.insert_value(whole, value, 0)
        return self.llvm.insert_value(whole, slopes, 1)

    def axis(self, lane: int) -> Value:
        """Return the slopes of a number that is direction `lane` itself."""
        slopes = [0.0] * self.vector.count
        slopes[lane] = 1.0
        return ir.Constant(self.vector, slopes)

    def number(self, value: float) -> Value:
        """Return a constant."""
        return ir.Constant(DOUBLE, value)

    def spread(self, number: Value) -> Value:
        """Return a number for all directions."""
        if isinstance(number, ir.Constant):
            return ir.Constant(self.vector, [number.constant] * self.vector.count)
        none = ir.Constant(self.vector, ir.Undefined)
        first = ir.Constant(ir.IntType(32), 0)
        places = ir.VectorType(ir.IntType(32), self.vector.count)
        one = self.llvm.insert_element(none, number, first)
        all_first = ir.Constant(places, [0] * self.vector.count)
        return self.llvm.shuffle_vector(one, none, all_first)

    def intrinsic(self, name: str, *vectors: Value) -> Value:
        """Call an intrinsic of LLVM on slopes."""
        full = f"llvm.{name}.v{self.vector.count}f64"
        module = self.llvm.module
        function = module.globals.get(full)
        if function is None:
            kind = ir.FunctionType(self.vector, [self.vector] * len(vectors))
            function = ir.Function(module, kind, full)
        return self.llvm.call(function, vectors)

    def plus(self, one: Value, other: Value) -> Value:
        """Add slopes; None stands for zero."""
        if one is None:
            return other
        if other is None:
            return one
        return self.llvm.fadd(one, other)

    def negative(self, slopes: Value) -> Value:
        """Change the sign of slopes."""
        return None if slopes is None else self.llvm.fneg(slopes)

    def times(self, slopes: Value, factor: Value) -> Value:
        """Multiply slopes by a number."""
        if slopes is None:
            return None
        return self.llvm.fmul(slopes, self.spread(factor))

    def kept_times(self, slopes: Value, factor: Value) -> Value:
        """Multiply slopes by a number that may be infinite; zeros remain."""
        if slopes is None:
            return None
        is_zero = self.llvm.fcmp_ordered("==", slopes, self.zeros)
        return self.llvm.select(is_zero, self.zeros, self.times(slopes, factor))

    def times_plus(self, slopes: Value, factor: Value, others: Value) -> Value:
        """Return slopes times a number, and others added, rounded once."""
        if slopes is None:
            return others
        if others is None:
            return self.times(slopes, factor)
        return self.intrinsic("fma", slopes, self.spread(factor), others)

    def call(self, key: Any, *values: Value, kinds: tuple[Any, ...] = ()) -> Value:
        """Call what Numba knows by this key for plain numbers; return a number."""
        taken = kinds or (FLOAT,) * len(values)
        result, returned = self.called(key, taken, values)
        return self.context.cast(self.llvm, result, returned, FLOAT)

    def called(self, key: Any, kinds: Any, values: Any) -> tuple[Value, Any]:
        """Call what Numba knows by this key; return the result and its type."""
        typing = self.context.typing_context
        function = typing.resolve_value_type(key)
        sign = typing.resolve_function_type(function, tuple(kinds), {})
        made = self.context.get_function(function, sign)
        given = []
        for kind, wanted, value in zip(kinds, sign.args, values, strict=True):
            if kind != wanted:
                value = self.context.cast(self.llvm, value, kind, wanted)
            given.append(value)
        result = made(self.llvm, given)
        self.context.add_linking_libs(getattr(made, "libs", ()))
        return result, sign.return_type

    def compare(self, sign: str, one: Value, other: Value) -> Value:
        """Compare two numbers; false if one is NaN."""
        return self.llvm.fcmp_ordered(sign, one, other)

    def select(self, condition: Value, one: Value, other: Value) -> Value:
        """Choose between slopes; None stands for zero."""
        one = self.zeros if one is None else one
        other = self.zeros if other is None else other
        return self.llvm.select(condition, one, other)


# What a function takes and returns.


def is_scalar(kind: Any) -> bool:
    """Return whether a type is that of a number, or of an array without axes.

    `np.where` returns such arrays.
    """
    return is_number(kind) or (isinstance(kind, types.Array) and kind.ndim == 0)


def width_among(kinds: Any) -> int:
    """Return the width of the duals among numbers; 0 if there are none, or others."""
    width = 0
    for kind in kinds:
        if isinstance(kind, Dual):
            if width not in (0, kind.width):
                return 0
            width = kind.width
        elif not is_scalar(kind):
            return 0
    return width


# The functions defined so, with their numbers of arguments and what they return.
OPERATIONS: list[tuple[Any, int, Any]] = []


def defined(
    key: Any,
    count: int,
    build: Callable[..., Value],
    returned: Any = None,
) -> None:
    """Define a function of `count` numbers of which at least one is a dual.

    `build(code, key, *parts)` receives value and slopes of each, and returns a dual or
    what is `returned`.
    """

    def typed(*kinds: Any) -> Any:
        plain = tuple(map(types.unliteral, kinds))
        width = width_among(plain)
        if len(plain) != count or width == 0:
            return None
        taken = (one if isinstance(one, Dual) else FLOAT for one in plain)
        return (returned or Dual(width))(*taken)

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        code = Builder(context, builder, width_among(sign.args))
        pairs = zip(sign.args, values, strict=True)
        return build(code, key, *(code.parts(kind, value) for kind, value in pairs))

    OPERATIONS.append((key, count, returned))
    tried_first(key, typed)
    for kinds in product((Dual, types.Float), repeat=count):
        if Dual in kinds:
            lower_builtin(key, *kinds)(lower)


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    number = context.cast(builder, value, types.unliteral(given), FLOAT)
    return Builder(context, builder, wanted.width).dual(number, None)


for _number in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_number, Dual)(_cast)


# Functions of one number, by their derivatives.


def _one(derivative: Function, kept: bool) -> Function:
    """Return what builds a function from its derivative.

    `derivative(code, x, v)` receives argument and value. With `kept` it may be
    infinite.
    """

    def build(code: Builder, key: Any, x: Any) -> Value:
        number, slopes = x
        value = code.call(key, number)
        factor = derivative(code, number, value)
        scale = code.kept_times if kept else code.times
        return code.dual(value, scale(slopes, factor))

    return build


def _fraction(over: float, of: Function) -> Function:
    """Return the derivative `over` / of(code, x, v)."""

    def derivative(code: Builder, x: Value, v: Value) -> Value:
        return code.llvm.fdiv(code.number(over), of(code, x, v))

    return derivative


def _times_constant(factor: float, of: Function) -> Function:
    """Return the derivative `factor` of(code, x, v)."""

    def derivative(code: Builder, x: Value, v: Value) -> Value:
        return code.llvm.fmul(code.number(factor), of(code, x, v))

    return derivative


def _argument(code: Builder, x: Value, v: Value) -> Value:
    return x


def _value(code: Builder, x: Value, v: Value) -> Value:
    return v


def _one_plus(code: Builder, x: Value, v: Value) -> Value:
    return code.llvm.fadd(code.number(1.0), x)


def _value_plus_one(code: Builder, x: Value, v: Value) -> Value:
    return code.llvm.fadd(code.number(1.0), v)


def _one_minus_square(code: Builder, x: Value, v: Value) -> Value:
    one = code.number(1.0)
    return code.llvm.fmul(code.llvm.fsub(one, x), code.llvm.fadd(one, x))


def _one_plus_square(code: Builder, x: Value, v: Value) -> Value:
    return code.llvm.fadd(code.number(1.0), code.llvm.fmul(x, x))


def _one_plus_square_of_value(code: Builder, x: Value, v: Value) -> Value:
    return _one_plus_square(code, v, v)


def _square_of_value(code: Builder, x: Value, v: Value) -> Value:
    return code.llvm.fmul(v, v)


def _root_of(inside: Function) -> Function:
    def root(code: Builder, x: Value, v: Value) -> Value:
        return code.call(math.sqrt, inside(code, x, v))

    return root


def _root_for_acosh(code: Builder, x: Value, v: Value) -> Value:
    below = code.call(math.sqrt, code.llvm.fsub(x, code.number(1.0)))
    above = code.call(math.sqrt, code.llvm.fadd(x, code.number(1.0)))
    return code.llvm.fmul(below, above)


def _root_for_asinh(code: Builder, x: Value, v: Value) -> Value:
    return code.call(math.hypot, code.number(1.0), x)


def _of(function: Function) -> Function:
    """Return the derivative that is another function of the argument."""
    return lambda code, x, v: code.call(function, x)


def _square_of_cosh(code: Builder, x: Value, v: Value) -> Value:
    inverse = code.llvm.fdiv(code.number(1.0), code.call(math.cosh, x))
    return code.llvm.fmul(inverse, inverse)


def _gauss(code: Builder, x: Value, v: Value) -> Value:
    return code.call(math.exp, code.llvm.fneg(code.llvm.fmul(x, x)))


# The derivative of each function, and whether it may be infinite.
PER_TURN = 2.0 / math.sqrt(math.pi)
DERIVATIVES: dict[str, tuple[Function, bool]] = {
    "sin": (_of(math.cos), False),
    "cos": (_times_constant(-1.0, _of(math.sin)), False),
    "tan": (_one_plus_square_of_value, False),
    "asin": (_fraction(1.0, _root_of(_one_minus_square)), True),
    "acos": (_fraction(-1.0, _root_of(_one_minus_square)), True),
    "atan": (_fraction(1.0, _one_plus_square), False),
    "sinh": (_of(math.cosh), False),
    "cosh": (_of(math.sinh), False),
    "tanh": (_square_of_cosh, False),
    "asinh": (_fraction(1.0, _root_for_asinh), False),
    "acosh": (_fraction(1.0, _root_for_acosh), True),
    "atanh": (_fraction(1.0, _one_minus_square), True),
    "exp": (_value, False),
    "exp2": (_times_constant(math.log(2.0), _value), False),
    "expm1": (_value_plus_one, False),
    "log": (_fraction(1.0, _argument), True),
    "log2": (_fraction(1.0 / math.log(2.0), _argument), True),
    "log10": (_fraction(1.0 / math.log(10.0), _argument), True),
    "log1p": (_fraction(1.0, _one_plus), True),
    "sqrt": (_fraction(0.5, _value), True),
    "cbrt": (_fraction(1.0 / 3.0, _square_of_value), True),
    "erf": (_times_constant(PER_TURN, _gauss), False),
    "erfc": (_times_constant(-PER_TURN, _gauss), False),
    "square": (_times_constant(2.0, _argument), False),
    "reciprocal": (_times_constant(-1.0, _square_of_value), True),
    "degrees": (lambda code, x, v: code.number(180.0 / math.pi), False),
    "radians": (lambda code, x, v: code.number(math.pi / 180.0), False),
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
for _name, (_derivative, _kept) in DERIVATIVES.items():
    _found = [getattr(math, _name, None)]
    for _in_numpy in IN_NUMPY.get(_name, (_name,)):
        _found.append(getattr(np, _in_numpy, None))
    for _key in _found:
        if _key is not None:
            defined(_key, 1, _one(_derivative, _kept))


# Arithmetic.


def _add(code: Builder, key: Any, x: Any, y: Any) -> Value:
    return code.dual(code.llvm.fadd(x[0], y[0]), code.plus(x[1], y[1]))


def _subtract(code: Builder, key: Any, x: Any, y: Any) -> Value:
    value = code.llvm.fsub(x[0], y[0])
    if x[1] is None or y[1] is None:
        return code.dual(value, code.plus(x[1], code.negative(y[1])))
    return code.dual(value, code.llvm.fsub(x[1], y[1]))


def _multiply(code: Builder, key: Any, x: Any, y: Any) -> Value:
    value = code.llvm.fmul(x[0], y[0])
    return code.dual(value, code.times_plus(x[1], y[0], code.times(y[1], x[0])))


def _divide(code: Builder, key: Any, x: Any, y: Any) -> Value:
    value = code.llvm.fdiv(x[0], y[0])
    inverse = code.llvm.fdiv(code.number(1.0), y[0])
    above = code.times_plus(y[1], code.llvm.fneg(value), x[1])
    return code.dual(value, code.times(above, inverse))


def _negative(code: Builder, key: Any, x: Any) -> Value:
    return code.dual(code.llvm.fneg(x[0]), code.negative(x[1]))


def _same(code: Builder, key: Any, x: Any) -> Value:
    return code.dual(*x)


def _rest(whole: Any) -> Function:
    """Return what builds a remainder: x - q y, where q is `whole` of x and y."""

    def build(code: Builder, key: Any, x: Any, y: Any) -> Value:
        value = code.call(key, x[0], y[0])
        quotient = whole(code, x[0], y[0])
        slopes = code.times_plus(y[1], code.llvm.fneg(quotient), x[1])
        return code.dual(value, slopes)

    return build


def _whole_below(code: Builder, x: Value, y: Value) -> Value:
    return code.call(operator.floordiv, x, y)


def _whole_towards_zero(code: Builder, x: Value, y: Value) -> Value:
    return code.call(np.trunc, code.llvm.fdiv(x, y))


for _key in (operator.add, operator.iadd, np.add):
    defined(_key, 2, _add)
for _key in (operator.sub, operator.isub, np.subtract):
    defined(_key, 2, _subtract)
for _key in (operator.mul, operator.imul, np.multiply):
    defined(_key, 2, _multiply)
for _key in (operator.truediv, operator.itruediv, np.divide):
    defined(_key, 2, _divide)
for _key in (operator.mod, operator.imod, np.mod):
    defined(_key, 2, _rest(_whole_below))
defined(np.fmod, 2, _rest(_whole_towards_zero))
for _key in (operator.neg, np.negative):
    defined(_key, 1, _negative)
for _key in (operator.pos, np.positive, float):
    defined(_key, 1, _same)


# Powers. An exponent that is an integer, or written as one, remains it.


def _power_of(key: Any) -> Function:
    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        code = Builder(context, builder, width_among(map(types.unliteral, sign.args)))
        kinds = tuple(FLOAT if isinstance(kind, Dual) else kind for kind in sign.args)
        x, y = (code.parts(*pair) for pair in zip(sign.args, values, strict=True))
        if _literal(kinds[1]) == 2:
            value = builder.fmul(x[0], x[0])
        else:
            value = code.call(key, x[0], y[0], kinds=kinds)
        slopes = None
        if x[1] is not None:
            slopes = code.kept_times(x[1], _slope_of_power(code, key, kinds, x, y))
        if y[1] is not None:
            slopes = code.plus(
                slopes, code.kept_times(y[1], _log_times(code, x, value))
            )
        return code.dual(value, slopes)

    return lower


def _literal(kind: Any) -> int | None:
    """Return the integer that a type stands for, if it does."""
    if isinstance(kind, types.IntegerLiteral):
        return int(kind.literal_value)
    return None


def _slope_of_power(code: Builder, key: Any, kinds: Any, x: Any, y: Any) -> Value:
    """Build y x^(y - 1); zero if y is zero."""
    exponent = kinds[1]
    n = _literal(exponent)
    if n is not None:
        power = code.number(1.0)
        if n == 0:
            return code.number(0.0)
        if n == 2:
            power = x[0]
        elif n != 1:
            less = types.literal(n - 1)
            power = code.call(key, x[0], n - 1, kinds=(FLOAT, less))
        return code.llvm.fmul(code.number(float(n)), power)
    if isinstance(exponent, types.Integer):
        one = ir.Constant(y[0].type, 1)
        is_none = code.llvm.icmp_signed("==", y[0], one.type(0))
        less = code.llvm.select(is_none, y[0], code.llvm.sub(y[0], one))
        number = code.context.cast(code.llvm, y[0], exponent, FLOAT)
    else:
        number = y[0]
        less = code.llvm.fsub(number, code.number(1.0))
    power = code.call(key, x[0], less, kinds=kinds)
    slope = code.llvm.fmul(number, power)
    is_zero = code.compare("==", number, code.number(0.0))
    return code.llvm.select(is_zero, code.number(0.0), slope)


def _log_times(code: Builder, x: Any, value: Value) -> Value:
    """Build log(x) x^y; zero where the power is."""
    slope = code.llvm.fmul(code.call(math.log, x[0]), value)
    is_zero = code.compare("==", value, code.number(0.0))
    return code.llvm.select(is_zero, code.number(0.0), slope)


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


POWERS = (operator.pow, operator.ipow, pow, math.pow, np.power)
for _key in POWERS:
    tried_first(_key, _typed_power, literal=True)
    for _kinds in (
        (Dual, Dual), (Dual, types.Float), (Dual, types.Integer), (types.Float, Dual)
    ):  # fmt: skip
        lower_builtin(_key, *_kinds)(_power_of(_key))


# Functions with kinks.


def _size_of(code: Builder, slopes: Value) -> Value:
    return None if slopes is None else code.intrinsic("fabs", slopes)


def _absolute(code: Builder, key: Any, x: Any) -> Value:
    number, slopes = x
    zero = code.number(0.0)
    value = code.call(key, number)
    falls = code.compare("<", number, zero)
    turned = code.select(falls, code.negative(slopes), slopes)
    at_kink = code.compare("==", number, zero)
    return code.dual(value, code.select(at_kink, _size_of(code, slopes), turned))


def _extreme(sign: str) -> Function:
    """Return what builds the one of two numbers that is `sign` the other, < or >.

    Python's own takes the first where neither is. NumPy's differ for NaN.
    """

    def build(code: Builder, key: Any, x: Any, y: Any) -> Value:
        second = code.compare(sign, y[0], x[0])
        if key in (builtins.min, builtins.max):
            value = code.llvm.select(second, y[0], x[0])
        else:
            value = code.call(key, x[0], y[0])
        equal = code.compare("==", y[0], x[0])
        one = code.zeros if x[1] is None else x[1]
        other = code.zeros if y[1] is None else y[1]
        is_first = code.llvm.fcmp_ordered(sign, one, other)
        at_kink = code.llvm.select(is_first, one, other)
        apart = code.llvm.select(second, other, one)
        return code.dual(value, code.llvm.select(equal, at_kink, apart))

    return build


def _hypotenuse(code: Builder, key: Any, x: Any, y: Any) -> Value:
    value = code.call(key, x[0], y[0])
    along_x = code.times(x[1], code.llvm.fdiv(x[0], value))
    slopes = code.times_plus(y[1], code.llvm.fdiv(y[0], value), along_x)
    squares = None
    for part in (x[1], y[1]):
        if part is not None:
            squares = code.plus(squares, code.llvm.fmul(part, part))
    at_kink = code.intrinsic("sqrt", squares)
    is_kink = code.compare("==", value, code.number(0.0))
    return code.dual(value, code.select(is_kink, at_kink, slopes))


def _angle(code: Builder, key: Any, y: Any, x: Any) -> Value:
    value = code.call(key, y[0], x[0])
    radius = code.call(math.hypot, y[0], x[0])
    per_y = code.llvm.fdiv(code.llvm.fdiv(x[0], radius), radius)
    per_x = code.llvm.fneg(code.llvm.fdiv(code.llvm.fdiv(y[0], radius), radius))
    slopes = code.plus(code.kept_times(y[1], per_y), code.kept_times(x[1], per_x))
    return code.dual(value, slopes)


def _copy_sign(code: Builder, key: Any, x: Any, y: Any) -> Value:
    value = code.call(key, x[0], y[0])
    one = code.number(1.0)
    first = code.call(math.copysign, one, x[0])
    second = code.call(math.copysign, one, y[0])
    slopes = code.times(x[1], code.llvm.fmul(first, second))
    return code.dual(value, slopes)


for _key in (abs, np.abs, math.fabs, np.fabs):
    defined(_key, 1, _absolute)
for _key in (builtins.min, np.minimum, np.fmin):
    defined(_key, 2, _extreme("<"))
for _key in (builtins.max, np.maximum, np.fmax):
    defined(_key, 2, _extreme(">"))
for _key in (math.hypot, np.hypot):
    defined(_key, 2, _hypotenuse)
for _key in (math.atan2, np.arctan2):
    defined(_key, 2, _angle)
for _key in (math.copysign, np.copysign):
    defined(_key, 2, _copy_sign)


# What depends on the value alone.


def _by_value(code: Builder, key: Any, *parts: Any) -> Value:
    values = [number for number, _ in parts]
    return code.called(key, (FLOAT,) * len(values), values)[0]


for _key in (
    operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne
):  # fmt: skip
    defined(_key, 2, _by_value, BOOL)
for _key in (math.isnan, math.isinf, math.isfinite, np.isnan, np.isinf, np.isfinite):
    defined(_key, 1, _by_value, BOOL)
for _key in (math.floor, math.ceil, math.trunc, int, round):
    defined(_key, 1, _by_value, INT)
for _key in (np.floor, np.ceil, np.trunc, np.rint, np.sign):
    defined(_key, 1, _by_value, FLOAT)
for _key in (operator.floordiv, operator.ifloordiv, np.floor_divide):
    defined(_key, 2, _by_value, FLOAT)


def _is_true(code: Builder, key: Any, x: Any) -> Value:
    return code.llvm.fcmp_unordered("!=", x[0], code.number(0.0))


def _is_false(code: Builder, key: Any, x: Any) -> Value:
    return code.compare("==", x[0], code.number(0.0))


defined(bool, 1, _is_true, BOOL)
defined(operator.not_, 1, _is_false, BOOL)


def _choose(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build `np.where` of a truth value, which evaluates both sides as Python does."""
    code = Builder(context, builder, sign.return_type.width)
    truth = builder.trunc(values[0], ir.IntType(1))
    one, other = (
        code.dual(*code.parts(kind, value))
        for kind, value in zip(sign.args[1:], values[1:], strict=True)
    )
    chosen = []
    for place in range(2):  # value and slopes
        sides = (builder.extract_value(side, place) for side in (one, other))
        chosen.append(builder.select(truth, *sides))
    return code.dual(*chosen)


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


# Of more than two numbers, the least and the largest are those of pairs.


def _typed_extreme(*kinds: Any) -> Any:
    plain = tuple(map(types.unliteral, kinds))
    width = width_among(plain)
    if len(plain) < 3 or width == 0:
        return None
    return Dual(width)(*[Dual(width)] * len(plain))


def _extreme_of_many(key: Any, build: Function) -> Function:
    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        code = Builder(context, builder, sign.return_type.width)
        found = values[0]
        for value in values[1:]:
            pair = (code.parts(code.kind, one) for one in (found, value))
            found = build(code, key, *pair)
        return found

    return lower


for _key, _sign in ((builtins.min, "<"), (builtins.max, ">")):
    tried_first(_key, _typed_extreme)
    _lower = _extreme_of_many(_key, _extreme(_sign))
    lower_builtin(_key, Dual, Dual, Dual, types.VarArg(types.Any))(_lower)


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
    code = Builder(context, builder, sign.return_type.width)
    number, slopes = code.parts(sign.args[0], values[0])
    kinds = (FLOAT, *sign.args[1:])
    given = (number, *values[1:])
    value = code.call(np.interp, *given, kinds=kinds)
    ahead, behind = (
        context.compile_internal(builder, function, FLOAT(*kinds), given)
        for function in (_slope_ahead, _slope_behind)
    )
    falls = builder.fcmp_ordered("<", slopes, code.zeros)
    factor = builder.select(falls, code.spread(behind), code.spread(ahead))
    return code.dual(value, builder.fmul(slopes, factor))


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


for _width in WIDTHS:
    make_arrays_of(Dual(_width))


# Duals from rows of numbers: a value and its slopes, side by side.


def _place(builder: Any, address: Value, index: Value, kind: Any = DOUBLE) -> Value:
    """Build the pointer to the number `index` at an address."""
    start = builder.inttoptr(address, DOUBLE.as_pointer())
    return builder.bitcast(builder.gep(start, [index]), kind.as_pointer())


def _each(builder: Any, count: Value) -> Any:
    """Return the blocks of a loop over `count` indices, and the index.

    The builder is left inside it; `_end_each` ends it.
    """
    before = builder.block
    inside = builder.append_basic_block("each")
    after = builder.append_basic_block("after")
    some = builder.icmp_signed(">", count, ir.Constant(count.type, 0))
    builder.cbranch(some, inside, after)
    builder.position_at_end(inside)
    index = builder.phi(count.type)
    index.add_incoming(ir.Constant(count.type, 0), before)
    return inside, after, index


def _end_each(builder: Any, loop: Any, count: Value) -> None:
    inside, after, index = loop
    following = builder.add(index, ir.Constant(count.type, 1))
    index.add_incoming(following, builder.block)
    more = builder.icmp_signed("<", following, count)
    builder.cbranch(more, inside, after)
    builder.position_at_end(after)


def dual_at(width: int) -> Any:
    """Return a function that reads a dual from its address."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        code = Builder(context, builder, width)
        zero = ir.Constant(LONG, 0)
        value = builder.load(_place(builder, values[0], zero))
        slopes = _place(builder, values[0], zero.type(1), code.vector)
        return code.dual(value, builder.load(slopes, align=BYTES))

    return built(1, lambda address: (Dual(width)(INT), generate))


def _moving(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    code = Builder(context, builder, 1)
    return code.dual(values[0], ir.Constant(code.vector, [1.0]))


def _pack(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build duals from an array of values and one of slopes."""
    room, numbers, slopes = values
    count = array_length(context, builder, sign.args[1], numbers)
    loop = _each(builder, count)
    index = loop[2]
    twice = builder.add(index, index)
    for shift, kind, array in ((0, sign.args[1], numbers), (1, sign.args[2], slopes)):
        start = array_start(context, builder, kind, array)
        number = builder.load(builder.gep(start, [index]))
        place = builder.add(twice, ir.Constant(LONG, shift))
        builder.store(number, _place(builder, room, place))
    _end_each(builder, loop, count)
    return context.get_dummy_value()


def _unpack(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build an array of values and one of slopes from duals."""
    room, numbers, slopes = values
    count = array_length(context, builder, sign.args[1], numbers)
    loop = _each(builder, count)
    index = loop[2]
    twice = builder.add(index, index)
    for shift, kind, array in ((0, sign.args[1], numbers), (1, sign.args[2], slopes)):
        place = builder.add(twice, ir.Constant(LONG, shift))
        number = builder.load(_place(builder, room, place))
        start = array_start(context, builder, kind, array)
        builder.store(number, builder.gep(start, [index]))
    _end_each(builder, loop, count)
    return context.get_dummy_value()


moving = built(1, lambda t: (Dual(1)(FLOAT), _moving))
pack = built(3, lambda room, y, dy: (types.none(INT, y, dy), _pack))
unpack = built(3, lambda room, h, hdot: (types.none(INT, h, hdot), _unpack))


def seed_all(n: int, width: int) -> Any:
    """Return a function that makes duals of n states, with seeds (n, n) for slopes.

    It takes the addresses of room for them, of the states, and of the seeds. All is
    written out, so that the duals of few states need no memory.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        room, y, seeds = values
        code = Builder(context, builder, width)
        for i in range(n):
            slopes = code.zeros
            for j in range(n):
                seed = builder.load(_place(builder, seeds, _index(i * n + j)))
                slopes = builder.insert_element(slopes, seed, _lane(j))
            value = builder.load(_place(builder, y, _index(i)))
            row = i * (1 + width)
            builder.store(value, _place(builder, room, _index(row)))
            place = _place(builder, room, _index(row + 1), code.vector)
            builder.store(slopes, place, align=BYTES)
        return context.get_dummy_value()

    return built(3, lambda room, y, seeds: (types.none(INT, INT, INT), generate))


def each_alone(n: int, width: int) -> Any:
    """Return a function that makes duals of n states, which are the directions.

    It takes the addresses of room for them and of the states.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        room, y = values
        code = Builder(context, builder, width)
        for i in range(n):
            value = builder.load(_place(builder, y, _index(i)))
            row = i * (1 + width)
            builder.store(value, _place(builder, room, _index(row)))
            place = _place(builder, room, _index(row + 1), code.vector)
            builder.store(code.axis(i), place, align=BYTES)
        return context.get_dummy_value()

    return built(2, lambda room, y: (types.none(INT, INT), generate))


def number_along(lane: int, width: int) -> Any:
    """Return a function that makes a dual which is one of the directions."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        code = Builder(context, builder, width)
        return code.dual(values[0], code.axis(lane))

    return built(1, lambda value: (Dual(width)(FLOAT), generate))


def harvest_all(n: int, width: int, *, timed: bool) -> Any:
    """Return a function that writes the slopes of n duals as a matrix (n, n).

    It takes the addresses of the duals, of the matrix, and of room for the slopes along
    direction n, which are written if `timed`.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        room, into, into_last = values
        code = Builder(context, builder, width)
        for i in range(n):
            row = _index(i * (1 + width) + 1)
            place = _place(builder, room, row, code.vector)
            slopes = builder.load(place, align=BYTES)
            for j in range(n):
                slope = builder.extract_element(slopes, _lane(j))
                builder.store(slope, _place(builder, into, _index(i * n + j)))
            if timed:
                slope = builder.extract_element(slopes, _lane(n))
                builder.store(slope, _place(builder, into_last, _index(i)))
        return context.get_dummy_value()

    return built(3, lambda room, into, last: (types.none(INT, INT, INT), generate))


def _index(number: int) -> Value:
    return ir.Constant(LONG, number)


def _lane(number: int) -> Value:
    return ir.Constant(ir.IntType(32), number)


def stack(count: int) -> Any:
    """Return a function that gives the address of room for numbers on the stack."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        with builder.goto_entry_block():
            room = builder.alloca(DOUBLE, max(count, 1))
        return builder.ptrtoint(room, LONG)

    return built(0, lambda: (INT(), generate))
