# ruff: noqa: ARG001, ARG002, ARG005, PLW0108 (Numba prescribes signatures and their names)
"""A Numba type for the processor's vectors, in which scalar functions compile.

A user's function of numbers compiles for it as it is. A `Lanes` holds one number for
each of `WIDTH` systems, and a `Mask` one truth value for each. `Rows` is an array of
`Lanes` by its address, with its length in the type. Operators, elementary functions,
`min`, `max`, `np.where` and lengths are those that fields and guards use. Operations
without a vector instruction run lane by lane. A branch on a mask has no type, which
Numba and this package report as an error.

Products and sums are fused only where `fma` is written, so a lane's bytes depend
neither on the processor nor on the width.
"""

import builtins
import math
import operator
import re
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba import config, njit, types
from numba.extending import (
    lower_builtin,
    lower_cast,
    models,
    overload,
    overload_attribute,
    register_model,
)

from hopdata.hybrid.compiled.memory import built, is_number
from hopdata.hybrid.compiled.terms import declared
from hopdata.private_numba import CONVERTS, structure, tried_first

Function = Callable[..., Any]


def _features() -> str:
    """Return the processor features for which Numba compiles."""
    chosen = config.CPU_FEATURES  # type: ignore[attr-defined]
    try:
        return llvm.get_host_cpu_features().flatten() if chosen is None else str(chosen)
    except RuntimeError:  # unknown to LLVM
        return ""


def _width() -> int:
    """Return the number of lanes: two of the processor's vectors.

    While one waits for its result, the other is processed.
    """
    features = _features()
    if "+avx512f" in features:
        return 16
    if "+avx" in features:
        return 8
    return 4


WIDTH = _width()
ALL = (1 << WIDTH) - 1
ALIGNMENT = 64
DOUBLE = ir.DoubleType()
LONG = ir.IntType(64)
VECTOR = ir.VectorType(DOUBLE, WIDTH)
LONGS = ir.VectorType(LONG, WIDTH)
TRUTHS = ir.VectorType(ir.IntType(1), WIDTH)
BITS = ir.IntType(WIDTH)


class _Lanes(types.Type):
    is_number = True  # a plain function may return it

    def can_convert_from(self, context: Any, other: Any) -> Any:
        return CONVERTS if is_number(other) else None

    def unify(self, context: Any, other: Any) -> Any:
        return self if is_number(other) else None


class _Mask(types.Type):
    pass


class Rows(types.Type):
    """The type of `length` consecutive lanes, stored by their address.

    A length of None stands for any number.
    """

    def __init__(self, length: int | None) -> None:
        self.length = length
        super().__init__(name=f"Rows{WIDTH}({length})")


lanes = _Lanes(f"Lanes{WIDTH}")
mask = _Mask(f"Mask{WIDTH}")
INDEX = types.intp


def _model(native: ir.Type) -> Any:
    """Return the class of a data model that holds one value of this native type."""

    def make(self: Any, manager: Any, kind: Any) -> None:
        models.PrimitiveModel.__init__(self, manager, kind, native)

    return type("Model", (models.PrimitiveModel,), {"__init__": make})


for _kind, _native in ((_Lanes, VECTOR), (_Mask, TRUTHS), (Rows, VECTOR.as_pointer())):
    register_model(_kind)(_model(_native))


def _fits(*kinds: Any) -> bool:
    """Return whether at least one of these is lanes, the others lanes or numbers."""
    return lanes in kinds and all(one == lanes or is_number(one) for one in kinds)


def number_for_all(builder: Any, kind: Any, value: Any) -> Any:
    """Build lanes from lanes, or from one number for all."""
    if kind == lanes:
        return value
    if isinstance(kind, types.Boolean):
        value = builder.uitofp(builder.trunc(value, ir.IntType(1)), DOUBLE)
    elif isinstance(kind, types.Integer):
        value = builder.sitofp(value, DOUBLE)
    elif kind != types.float64:
        value = builder.fpext(value, DOUBLE)
    none = ir.Constant(VECTOR, ir.Undefined)
    first = ir.Constant(ir.IntType(32), 0)
    all_first = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    one = builder.insert_element(none, value, first)
    return builder.shuffle_vector(one, none, all_first)


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return number_for_all(builder, types.unliteral(given), value)


for _number in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_number, _Lanes)(_cast)


# Operators.


def _operator(
    key: Any, count: int, fits: Function, result: Any, emit: Function
) -> None:
    """Register an operator for arguments that fit.

    It is built by `emit(builder, *lanes)`.
    """

    def typed(*kinds: Any) -> Any:
        plain = tuple(map(types.unliteral, kinds))
        if len(plain) == count and fits(*plain):
            return result(*plain)
        return None

    tried_first(key, typed)

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        given = []
        for kind, value in zip(sign.args, values, strict=True):
            given.append(
                value if kind == mask else number_for_all(builder, kind, value)
            )
        return emit(builder, *given)

    choices: list[Any] = [_Mask]
    if fits is not _are_masks:
        choices = [_Lanes, types.Float, types.Integer, types.Boolean]
    if count == 1:
        lower_builtin(key, choices[0])(lower)
        return
    for one in choices:
        for other in choices:
            if one in (_Lanes, _Mask) or other == choices[0]:
                lower_builtin(key, one, other)(lower)


def _are_masks(*kinds: Any) -> bool:
    return all(kind == mask for kind in kinds)


def _compare(sign: str) -> Function:
    """Return the builder of a comparison.

    With NaN, only the one for inequality is true.
    """
    if sign == "!=":
        return lambda b, x, y: b.fcmp_unordered(sign, x, y)
    return lambda b, x, y: b.fcmp_ordered(sign, x, y)


def _method(name: str) -> Function:
    """Return the builder of an operation by the method of this name."""
    return lambda b, x, y: getattr(b, name)(x, y)


_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "truediv": "fdiv"}
_COMPARISONS = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}
for _name, _made in _ARITHMETIC.items():
    for _key in (_name, f"i{_name}"):  # in place, too
        _operator(getattr(operator, _key), 2, _fits, lanes, _method(_made))
for _name, _sign in _COMPARISONS.items():
    _operator(getattr(operator, _name), 2, _fits, mask, _compare(_sign))
for _name in ("and_", "or_", "xor"):
    _operator(getattr(operator, _name), 2, _are_masks, mask, _method(_name))
_operator(operator.neg, 1, _fits, lanes, lambda b, x: b.fneg(x))
_operator(operator.pos, 1, _fits, lanes, lambda b, x: x)
_operator(operator.invert, 1, _are_masks, mask, lambda b, x: b.not_(x))


# Rows: indexed by integers; negative ones count from the end, where it is known.


def _typed_get(owner: Any, index: Any) -> Any:
    if isinstance(owner, Rows) and isinstance(index, types.Integer):
        return lanes(owner, INDEX)
    return None


def _typed_set(owner: Any, index: Any, value: Any) -> Any:
    kind = types.unliteral(value)
    fits = isinstance(owner, Rows) and isinstance(index, types.Integer)
    if fits and (kind == lanes or is_number(kind)):
        return types.none(owner, INDEX, kind)
    return None


tried_first(operator.getitem, _typed_get)
tried_first(operator.setitem, _typed_set)


def _row_address(builder: Any, rows: Any, address: Any, index: Any) -> Any:
    """Build the address of a row; negative indices count from the end, if known."""
    if rows.length is not None:
        length = ir.Constant(index.type, rows.length)
        negative = builder.icmp_signed("<", index, ir.Constant(index.type, 0))
        index = builder.select(negative, builder.add(index, length), index)
    return builder.gep(address, [index], inbounds=True)


@lower_builtin(operator.getitem, Rows, types.Integer)
def _get_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    value = builder.load(_row_address(builder, sign.args[0], *values))
    value.align = ALIGNMENT // 2
    return value


@lower_builtin(operator.setitem, Rows, types.Integer, types.Any)
def _set_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    value = number_for_all(builder, sign.args[2], values[2])
    stored = builder.store(value, _row_address(builder, sign.args[0], *values[:2]))
    stored.align = ALIGNMENT // 2
    return context.get_dummy_value()


def _length(rows: Any) -> Any:
    """Return a function that gives the length of rows, which is in their type."""
    if not isinstance(rows, Rows):
        return None
    count = rows.length
    return lambda rows: count


overload(len)(lambda rows: _length(rows))
overload_attribute(Rows, "size")(lambda rows: _length(rows))


def part(length: int | None) -> Any:
    """Return a function for compiled code that gives `length` lanes of a longer array.

    ``made(array, first)`` starts at row `first` of other `Rows`, or of an aligned float
    array (see `aligned`), or a view of one, whose rows have the length `WIDTH`.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        address = values[0]
        if not isinstance(sign.args[0], Rows):
            owner = structure(context, builder, sign.args[0], address)
            address = builder.bitcast(owner.data, VECTOR.as_pointer())
        return builder.gep(address, [values[1]], inbounds=True)

    return built(2, lambda owner, first: (Rows(length)(owner, INDEX), generate))


def aligned(count: int) -> Any:
    """Return `count` lanes of zeros, aligned so that each can be loaded at once."""
    per_alignment = ALIGNMENT // 8  # numbers of 8 bytes
    room = np.zeros(count * WIDTH + per_alignment)
    first = -(room.ctypes.data // 8) % per_alignment
    return room[first : first + count * WIDTH]


# Functions that are a single instruction.


def _function(result: Any, taken: tuple[Any, ...], emit: Function) -> Any:
    """Return an intrinsic built by `emit(builder, *values)`.

    Numbers may stand for lanes.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        given = []
        for wanted, kind, value in zip(taken, sign.args, values, strict=True):
            given.append(
                number_for_all(builder, kind, value) if wanted == lanes else value
            )
        return emit(builder, *given)

    def typed(*kinds: Any) -> Any:
        plain = tuple(map(types.unliteral, kinds))
        pairs = list(zip(taken, plain, strict=True))
        suits = all(
            wanted == kind or (wanted == lanes and is_number(kind))
            for wanted, kind in pairs
        )
        of_lanes = lanes in plain or mask in plain
        if of_lanes and not suits:
            return None  # else plain numbers are converted, as Numba does
        given = (kind if wanted == lanes else wanted for wanted, kind in pairs)
        return result(*given), generate

    return built(len(taken), typed)


def _llvm(name: str, count: int) -> Any:
    """Return LLVM's intrinsic of this name, for `count` lanes."""

    def emit(builder: Any, *values: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * count)
        full = f"llvm.{name}.v{WIDTH}f64"
        function = declared(builder, kind, full)
        return builder.call(function, values)

    return _function(lanes, (lanes,) * count, emit)


def _bits_of(builder: Any, value: Any) -> Any:
    return builder.zext(builder.bitcast(value, BITS), LONG)


def _odd_flips(builder: Any, value: Any, whole: Any) -> Any:
    """Build a change of sign where `whole` is odd.

    Its last bit becomes the sign bit.
    """
    number = builder.fptosi(whole, LONGS)
    sign = builder.shl(number, ir.Constant(LONGS, [63] * WIDTH))
    return builder.bitcast(builder.xor(builder.bitcast(value, LONGS), sign), VECTOR)


def _rough_power(builder: Any, value: Any, power: Any) -> Any:
    """Build a power from the bits.

    Doubles read as integers approximate their logarithm.
    """
    one = ir.Constant(VECTOR, [float(0x3FF0_0000_0000_0000)] * WIDTH)
    number = builder.sitofp(builder.bitcast(value, LONGS), VECTOR)
    scaled = builder.fmul(builder.fsub(number, one), power)
    return builder.bitcast(builder.fptosi(builder.fadd(scaled, one), LONGS), VECTOR)


INT = types.int64
FLOAT = types.float64
fma = _llvm("fma", 3)
square_root = _llvm("sqrt", 1)
absolute = _llvm("fabs", 1)
nearest = _llvm("rint", 1)
floor = _llvm("floor", 1)
ceil = _llvm("ceil", 1)
least = _function(
    lanes, (lanes, lanes), lambda b, x, y: b.select(_compare("<")(b, x, y), x, y)
)
largest = _function(
    lanes, (lanes, lanes), lambda b, x, y: b.select(_compare(">")(b, x, y), x, y)
)
where = _function(lanes, (mask, lanes, lanes), lambda b, m, x, y: b.select(m, x, y))
spread = _function(lanes, (lanes,), lambda b, x: x)
bits = _function(INT, (mask,), _bits_of)  # lane l is bit l
mask_of = _function(mask, (INT,), lambda b, n: b.bitcast(b.trunc(n, BITS), TRUTHS))
lane = _function(FLOAT, (lanes, INDEX), lambda b, x, i: b.extract_element(x, i))
with_lane = _function(
    lanes, (lanes, INDEX, FLOAT), lambda b, x, i, v: b.insert_element(x, v, i)
)
flip_if_odd = _function(lanes, (lanes, lanes), _odd_flips)
# To some per cent, for positive numbers.
rough_power = _function(lanes, (lanes, lanes), _rough_power)


# Elementary functions.

PER_PI = 1.0 / math.pi
PI = math.pi
PI_REST = 1.2246467991473532e-16  # the next digits of pi: with PI, twice as many
FARTHEST = 1e9  # rad: beyond this the reduction runs out of digits

# Coefficients of the sine's series, by the power.
S3 = -1.0 / math.factorial(3)
S5 = 1.0 / math.factorial(5)
S7 = -1.0 / math.factorial(7)
S9 = 1.0 / math.factorial(9)
S11 = -1.0 / math.factorial(11)
S13 = 1.0 / math.factorial(13)
S15 = -1.0 / math.factorial(15)
S17 = 1.0 / math.factorial(17)
S19 = -1.0 / math.factorial(19)
S21 = 1.0 / math.factorial(21)


@njit(inline="always")
def _short_sine(x: Any, turns: Any) -> Any:
    """Return the sine of x - turns pi, up to a right angle, by its series.

    It errs by less than 2 ulp.
    """
    r = fma(turns, -PI_REST, fma(turns, -PI, x))
    s = r * r
    p = fma(s, fma(s, fma(s, S21, S19), S17), S15)
    p = fma(s, fma(s, fma(s, fma(s, p, S13), S11), S9), S7)
    return fma(s * r, fma(s, fma(s, p, S5), S3), r)


def _one_by_one(function: Function) -> Any:
    """Return a function for lanes that calls the function for numbers in each lane."""

    @njit
    def through(x: Any) -> Any:
        for i in range(WIDTH):
            x = with_lane(x, i, function(lane(x, i)))
        return x

    return through


_far_sine = _one_by_one(math.sin)
_far_cosine = _one_by_one(math.cos)


@njit
def sine(x: Any) -> Any:
    """Return the sine of lanes."""
    n = nearest(x * PER_PI)
    far = ~(absolute(x) <= FARTHEST)
    n = where(far, 0.0, n)
    near = flip_if_odd(_short_sine(where(far, 0.0, x), n), n)
    if bits(far) != 0:
        return where(far, _far_sine(x), near)
    return near


@njit
def cosine(x: Any) -> Any:
    """Return the cosine of lanes."""
    n = floor(x * PER_PI)
    far = ~(absolute(x) <= FARTHEST)
    n = where(far, 0.0, n)
    near = -flip_if_odd(_short_sine(where(far, 0.0, x), n + 0.5), n)
    if bits(far) != 0:
        return where(far, _far_cosine(x), near)
    return near


@njit
def _tangent(x: Any) -> Any:
    return sine(x) / cosine(x)


@njit
def _power(x: Any, n: int) -> Any:
    """Return an integer power by repeated squaring."""
    left = abs(n)
    result = spread(1.0)
    while left > 0:
        if left & 1:
            result = result * x
        x = x * x
        left = left >> 1
    if n < 0:
        return 1.0 / result
    return result


def _pairs_one_by_one(function: Function) -> Any:
    """Return a function for pairs of lanes.

    It calls the function for numbers in each lane.
    """

    @njit
    def through(x: Any, y: Any) -> Any:
        x = spread(x)
        y = spread(y)
        for i in range(WIDTH):
            x = with_lane(x, i, function(lane(x, i), lane(y, i)))
        return x

    return through


_raised = _pairs_one_by_one(math.pow)
# Exact, as x - floor(x / y) y is not.
rest = _pairs_one_by_one(njit(error_model="numpy")(lambda x, y: x % y))


def _overload(function: Any, taken: int, made: Any) -> None:
    """Let `made` replace a function where its arguments are lanes."""

    def of_one(x: Any) -> Any:
        if x == lanes:
            return lambda x: made(x)
        return None

    def of_two(x: Any, y: Any) -> Any:
        if _fits(x, y):
            return lambda x, y: made(x, y)
        return None

    # Lambdas, because Numba compares signatures with their annotations.
    if taken == 1:
        overload(function)(lambda x: of_one(x))
    else:
        overload(function)(lambda x, y: of_two(x, y))


def _typed_power(x: Any, y: Any) -> Any:
    if x == lanes and isinstance(y, types.Integer):
        return lambda x, y: _power(x, y)
    if _fits(x, y):
        return lambda x, y: _raised(x, y)
    return None


for _raise in (operator.pow, operator.ipow, pow, math.pow):
    overload(_raise)(lambda x, y: _typed_power(x, y))


VECTORISED = {
    "sin": sine,
    "cos": cosine,
    "tan": _tangent,
    "sqrt": square_root,
    "fabs": absolute,
    "floor": floor,
    "ceil": ceil,
}
OTHERS = (
    "exp", "log", "log2", "log10", "log1p", "expm1", "sinh", "cosh", "tanh",
    "asin", "acos", "atan", "asinh", "acosh", "atanh", "erf",
)  # fmt: skip
exponential = _one_by_one(math.exp)
logarithm = _one_by_one(math.log)
for _name in (*VECTORISED, *OTHERS):
    _made = VECTORISED.get(_name) or _one_by_one(getattr(math, _name))
    _overload(getattr(math, _name), 1, _made)
    _of_numpy = getattr(np, re.sub("^a(?=[sct])", "arc", _name), None)
    if _of_numpy is not None:
        _overload(_of_numpy, 1, _made)
_overload(abs, 1, absolute)
_overload(np.abs, 1, absolute)
_overload(builtins.min, 2, least)
_overload(np.minimum, 2, least)
_overload(builtins.max, 2, largest)
_overload(np.maximum, 2, largest)
for _of_pairs, _of_numbers in (
    ((math.atan2, np.arctan2), math.atan2),
    ((math.hypot, np.hypot), math.hypot),
):
    for _pair_key in _of_pairs:
        _overload(_pair_key, 2, _pairs_one_by_one(_of_numbers))
for _remainder in (operator.mod, operator.imod, np.mod, np.remainder):
    _overload(_remainder, 2, rest)


@njit
def _from_table(x: Any, xp: Any, fp: Any) -> Any:
    """Return what a table has for each lane."""
    for i in range(WIDTH):
        x = with_lane(x, i, np.interp(lane(x, i), xp, fp))
    return x


def _typed_interp(x: Any, xp: Any, fp: Any) -> Any:
    if x == lanes and isinstance(xp, types.Array) and isinstance(fp, types.Array):
        return lambda x, xp, fp: _from_table(x, xp, fp)
    return None


overload(np.interp)(lambda x, xp, fp: _typed_interp(x, xp, fp))


def _typed_where(m: Any, x: Any, y: Any) -> Any:
    if m == mask and _fits(lanes, x, y):
        return lambda m, x, y: where(m, x, y)
    return None


def _typed_negative(x: Any, out: Any) -> Any:
    if not (isinstance(x, Rows) and x == out):
        return None

    def negative(x: Any, out: Any = None) -> Any:
        for i in range(len(x)):
            out[i] = -x[i]
        return out

    return negative


overload(np.where)(lambda m, x, y: _typed_where(m, x, y))
overload(np.negative)(lambda x, out=None: _typed_negative(x, out))
