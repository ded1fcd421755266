# ruff: noqa: ARG001, ARG002, ARG005, PLW0108 (Numba prescribes signatures and their names)
"""A Numba type for the processor's vectors, for which a user's scalar function compiles as it is.

A `Lanes` holds one number for each of `WIDTH` systems, and a `Mask` one truth value for
each. `Rows` is an array of `Lanes` by its address, with its length in the type.
Operators, elementary functions, `min`, `max`, `np.where` and lengths are those that
fields and guards use. Operations without a vector instruction run lane by lane. A
branch on a mask has no type, which Numba and this package report as an error.

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
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import infer_global, signature
from numba.extending import lower_builtin, overload, overload_attribute, register_model

from hopdata.hybrid.compiled.memory import FirstTried, built

Function = Callable[..., Any]


def _features() -> str:
    """Return the processor features for which Numba compiles."""
    chosen = config.CPU_FEATURES  # type: ignore[attr-defined]
    try:
        return llvm.get_host_cpu_features().flatten() if chosen is None else str(chosen)
    except RuntimeError:  # unknown to LLVM
        return ""


# Two of the processor's vectors: while one waits for its result, the other is
# processed.
WIDTH = 16 if "+avx512f" in _features() else 8 if "+avx" in _features() else 4
ALL = (1 << WIDTH) - 1
ALIGNMENT = 64
DOUBLE, LONG = ir.DoubleType(), ir.IntType(64)
VECTOR, LONGS = ir.VectorType(DOUBLE, WIDTH), ir.VectorType(LONG, WIDTH)
TRUTHS, BITS = ir.VectorType(ir.IntType(1), WIDTH), ir.IntType(WIDTH)


class _Lanes(types.Type):
    def can_convert_from(self, context: Any, other: Any) -> Any:
        return Conversion.safe if _is_number(other) else None

    def unify(self, context: Any, other: Any) -> Any:
        return self if _is_number(other) else None


class _Mask(types.Type):
    pass


class Rows(types.Type):
    """The type of `length` consecutive lanes, stored by their address; None: any number."""

    def __init__(self, length: int | None) -> None:
        self.length = length
        super().__init__(name=f"Rows{WIDTH}({length})")


lanes, mask = _Lanes(f"Lanes{WIDTH}"), _Mask(f"Mask{WIDTH}")
INDEX = types.intp


def _model(native: ir.Type) -> Any:
    def make(self: Any, manager: Any, kind: Any) -> None:
        models.PrimitiveModel.__init__(self, manager, kind, native)

    return type("Model", (models.PrimitiveModel,), {"__init__": make})


for _kind, _native in ((_Lanes, VECTOR), (_Mask, TRUTHS), (Rows, VECTOR.as_pointer())):
    register_model(_kind)(_model(_native))


def _is_number(kind: Any) -> bool:
    return isinstance(kind, types.Float | types.Integer | types.Boolean)


def _fits(*kinds: Any) -> bool:
    """Return whether at least one of these is lanes, and the others are lanes or numbers."""
    return lanes in kinds and all(one == lanes or _is_number(one) for one in kinds)


def _spread(builder: Any, kind: Any, value: Any) -> Any:
    """Build lanes from lanes, or from one number for all."""
    if kind == lanes:
        return value
    if isinstance(kind, types.Boolean):
        value = builder.uitofp(builder.trunc(value, ir.IntType(1)), DOUBLE)
    elif isinstance(kind, types.Integer):
        value = builder.sitofp(value, DOUBLE)
    elif kind != types.float64:
        value = builder.fpext(value, DOUBLE)
    none, first = ir.Constant(VECTOR, ir.Undefined), ir.Constant(ir.IntType(32), 0)
    places = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(
        builder.insert_element(none, value, first), none, places
    )


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _spread(builder, types.unliteral(given), value)


for _number in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_number, _Lanes)(_cast)


# Operators.


def _operator(
    key: Any, count: int, fits: Function, result: Any, emit: Function
) -> None:
    """Register an operator for arguments that fit; `emit(builder, *lanes)` builds it."""

    class Template(FirstTried):
        def generic(self, args: Any, kws: Any) -> Any:
            plain = tuple(map(types.unliteral, args))
            return (
                signature(result, *plain)
                if len(plain) == count and fits(*plain)
                else None
            )

    Template.key = key  # type: ignore[attr-defined]
    infer_global(key)(Template)

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        pairs = zip(sign.args, values, strict=True)
        return emit(
            builder, *(v if k == mask else _spread(builder, k, v) for k, v in pairs)
        )

    choices = (
        [_Mask]
        if fits is _are_masks
        else [_Lanes, types.Float, types.Integer, types.Boolean]
    )
    if count == 1:
        lower_builtin(key, choices[0])(lower)
        return
    for one in choices:
        for other in choices if one in (_Lanes, _Mask) else choices[:1]:
            lower_builtin(key, one, other)(lower)


def _are_masks(*kinds: Any) -> bool:
    return all(kind == mask for kind in kinds)


def _compare(sign: str) -> Function:
    ordered = sign != "!="
    return lambda b, x, y: (b.fcmp_ordered if ordered else b.fcmp_unordered)(sign, x, y)


for _name in ("add", "sub", "mul", "truediv"):
    for _key in (_name, f"i{_name}"):
        _made = f"f{_name.removeprefix('true')}"
        _operator(
            getattr(operator, _key), 2, _fits, lanes,
            lambda b, x, y, made=_made: getattr(b, made)(x, y),
        )  # fmt: skip
for _name, _sign in zip(
    ("lt", "le", "gt", "ge", "eq", "ne"),
    ["<", "<=", ">", ">=", "==", "!="],
    strict=True,
):
    _operator(getattr(operator, _name), 2, _fits, mask, _compare(_sign))
for _name in ("and_", "or_", "xor"):
    _operator(
        getattr(operator, _name), 2, _are_masks, mask,
        lambda b, x, y, made=_name: getattr(b, made)(x, y),
    )  # fmt: skip
_operator(operator.neg, 1, _fits, lanes, lambda b, x: b.fneg(x))
_operator(operator.pos, 1, _fits, lanes, lambda b, x: x)
_operator(operator.invert, 1, _are_masks, mask, lambda b, x: b.not_(x))


# Rows: indexed by integers; negative ones count from the end, where it is known.


@infer_global(operator.getitem)
class _GetItem(FirstTried):
    def generic(self, args: Any, kws: Any) -> Any:
        fits = isinstance(args[0], Rows) and isinstance(args[1], types.Integer)
        return signature(lanes, args[0], INDEX) if fits else None


@infer_global(operator.setitem)
class _SetItem(FirstTried):
    def generic(self, args: Any, kws: Any) -> Any:
        kind = types.unliteral(args[2])
        fits = isinstance(args[0], Rows) and isinstance(args[1], types.Integer)
        if fits and (kind == lanes or _is_number(kind)):
            return signature(types.none, args[0], INDEX, kind)
        return None


def _place(builder: Any, rows: Any, address: Any, index: Any) -> Any:
    if rows.length is not None:
        length = ir.Constant(index.type, rows.length)
        negative = builder.icmp_signed("<", index, ir.Constant(index.type, 0))
        index = builder.select(negative, builder.add(index, length), index)
    return builder.gep(address, [index], inbounds=True)


@lower_builtin(operator.getitem, Rows, types.Integer)
def _get_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    value = builder.load(_place(builder, sign.args[0], *values))
    value.align = ALIGNMENT // 2
    return value


@lower_builtin(operator.setitem, Rows, types.Integer, types.Any)
def _set_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    value = _spread(builder, sign.args[2], values[2])
    builder.store(value, _place(builder, sign.args[0], *values[:2])).align = (
        ALIGNMENT // 2
    )
    return context.get_dummy_value()


def _length(rows: Any) -> Any:
    count = rows.length if isinstance(rows, Rows) else 0
    return (lambda rows: count) if isinstance(rows, Rows) else None


overload(len)(lambda rows: _length(rows))
overload_attribute(Rows, "size")(lambda rows: _length(rows))


def part(length: int | None) -> Any:
    """Return a function for compiled code that gives `length` lanes of an array or of `Rows`.

    ``made(array, first)`` starts at row `first` of other `Rows`, or of an aligned float
    array (see `aligned`), or a view of one, whose rows have the length `WIDTH`.
    """

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        address = values[0]
        if not isinstance(sign.args[0], Rows):
            owner = cgutils.create_struct_proxy(sign.args[0])(context, builder, address)
            address = builder.bitcast(owner.data, VECTOR.as_pointer())
        return builder.gep(address, [values[1]], inbounds=True)

    return built(2, lambda owner, first: (Rows(length)(owner, INDEX), generate))


def aligned(count: int) -> Any:
    """Return `count` lanes of zeros, aligned so that the processor can load them at once."""
    room = np.zeros(count * WIDTH + ALIGNMENT // 8)
    first = -(room.ctypes.data // 8) % (ALIGNMENT // 8)
    return room[first : first + count * WIDTH]


# Functions that are a single instruction.


def _function(result: Any, taken: tuple[Any, ...], emit: Function) -> Any:
    """Return an intrinsic built by `emit(builder, *values)`; numbers may stand for lanes."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        triples = zip(taken, sign.args, values, strict=True)
        return emit(
            builder,
            *(_spread(builder, k, v) if w == lanes else v for w, k, v in triples),
        )

    def typed(*kinds: Any) -> Any:
        plain = tuple(map(types.unliteral, kinds))
        same = (
            w == k or (w == lanes and _is_number(k))
            for w, k in zip(taken, plain, strict=True)
        )
        given = tuple(k if w == lanes else w for w, k in zip(taken, plain, strict=True))
        return (
            (result(*given), generate)
            if all(same) or not {lanes, mask} & set(plain)
            else None
        )

    return built(len(taken), typed)


def _llvm(name: str, count: int) -> Any:
    def emit(builder: Any, *values: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * count)
        full = f"llvm.{name}.v{WIDTH}f64"
        return builder.call(
            cgutils.get_or_insert_function(builder.module, kind, full), values
        )

    return _function(lanes, (lanes,) * count, emit)


def _bits_of(builder: Any, value: Any) -> Any:
    return builder.zext(builder.bitcast(value, BITS), LONG)


def _odd_flips(builder: Any, value: Any, whole: Any) -> Any:
    """Build a change of sign where an integer is odd: its last bit becomes the sign bit."""
    number = builder.fptosi(whole, LONGS)
    sign = builder.shl(number, ir.Constant(LONGS, [63] * WIDTH))
    return builder.bitcast(builder.xor(builder.bitcast(value, LONGS), sign), VECTOR)


def _rough_power(builder: Any, value: Any, power: Any) -> Any:
    """Build a power from the bits, because doubles read as integers approximate their logarithm."""
    one = ir.Constant(VECTOR, [float(0x3FF0_0000_0000_0000)] * WIDTH)
    number = builder.sitofp(builder.bitcast(value, LONGS), VECTOR)
    scaled = builder.fmul(builder.fsub(number, one), power)
    return builder.bitcast(builder.fptosi(builder.fadd(scaled, one), LONGS), VECTOR)


INT, FLOAT = types.int64, types.float64
fma, square_root, absolute, nearest, floor = (
    _llvm(name, count) for name, count in
    (("fma", 3), ("sqrt", 1), ("fabs", 1), ("rint", 1), ("floor", 1))
)  # fmt: skip
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
rough_power = _function(
    lanes, (lanes, lanes), _rough_power
)  # to some per cent, for positive x


# Elementary functions.

PER_PI, PI, PI_REST = (
    1.0 / math.pi,
    math.pi,
    1.2246467991473532e-16,
)  # pi to twice the digits
FARTHEST = 1e9  # beyond this the reduction runs out of digits
S3, S5, S7, S9, S11, S13, S15, S17, S19, S21 = (
    (-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 11)
)


@njit(inline="always")
def _short_sine(x: Any, turns: Any) -> Any:
    """Return the sine of x - turns pi, up to a right angle, by its series, to less than 2 ulp."""
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


_far_sine, _far_cosine = _one_by_one(math.sin), _one_by_one(math.cos)


@njit
def sine(x: Any) -> Any:
    """Return the sine of lanes."""
    n = nearest(x * PER_PI)
    far = ~(absolute(x) <= FARTHEST)
    near = flip_if_odd(
        _short_sine(where(far, 0.0, x), where(far, 0.0, n)), where(far, 0.0, n)
    )
    return where(far, _far_sine(x), near) if bits(far) != 0 else near


@njit
def cosine(x: Any) -> Any:
    """Return the cosine of lanes."""
    n = floor(x * PER_PI)
    far = ~(absolute(x) <= FARTHEST)
    n = where(far, 0.0, n)
    near = -flip_if_odd(_short_sine(where(far, 0.0, x), n + 0.5), n)
    return where(far, _far_cosine(x), near) if bits(far) != 0 else near


@njit
def _tangent(x: Any) -> Any:
    return sine(x) / cosine(x)


@njit
def _power(x: Any, n: int) -> Any:
    """Return an integer power by repeated squaring."""
    left, result = abs(n), spread(1.0)
    while left > 0:
        if left & 1:
            result = result * x
        x, left = x * x, left >> 1
    return 1.0 / result if n < 0 else result


def _pairs_one_by_one(function: Function) -> Any:
    @njit
    def through(x: Any, y: Any) -> Any:
        x, y = spread(x), spread(y)
        for i in range(WIDTH):
            x = with_lane(x, i, function(lane(x, i), lane(y, i)))
        return x

    return through


_raised = _pairs_one_by_one(math.pow)


def _overload(function: Any, taken: int, made: Any) -> None:
    """Let `made` replace a function where its arguments are lanes."""
    if taken == 1:
        overload(function)(lambda x: (lambda x: made(x)) if x == lanes else None)
    else:
        overload(function)(
            lambda x, y: (lambda x, y: made(x, y)) if _fits(x, y) else None
        )


def _typed_power(x: Any, y: Any) -> Any:
    if x == lanes and isinstance(y, types.Integer):
        return lambda x, y: _power(x, y)
    return (lambda x, y: _raised(x, y)) if _fits(x, y) else None


for _raise in (operator.pow, operator.ipow, pow, math.pow):
    overload(_raise)(lambda x, y: _typed_power(x, y))


VECTORISED = {
    "sin": sine,
    "cos": cosine,
    "tan": _tangent,
    "sqrt": square_root,
    "fabs": absolute,
}
OTHERS = (
    "exp", "log", "log2", "log10", "log1p", "expm1", "sinh", "cosh", "tanh", "asin", "acos", "atan",
    "asinh", "acosh", "atanh", "erf",
)  # fmt: skip
for _name in (*VECTORISED, *OTHERS):
    _made = VECTORISED.get(_name) or _one_by_one(getattr(math, _name))
    _known = (
        getattr(math, _name),
        getattr(np, re.sub("^a(?=[sct])", "arc", _name), None),
    )
    for _one in filter(None, _known):
        _overload(_one, 1, _made)
_overload(abs, 1, absolute)
_overload(np.abs, 1, absolute)
for _two, _made in (
    (builtins.min, least), (np.minimum, least), (builtins.max, largest), (np.maximum, largest),
    (math.atan2, _pairs_one_by_one(math.atan2)), (math.hypot, _pairs_one_by_one(math.hypot)),
):  # fmt: skip
    _overload(_two, 2, _made)


def _typed_where(m: Any, x: Any, y: Any) -> Any:
    return (
        (lambda m, x, y: where(m, x, y)) if m == mask and _fits(lanes, x, y) else None
    )


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
