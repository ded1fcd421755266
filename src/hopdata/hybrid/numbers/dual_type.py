# ruff: noqa: ARG002 (Numba prescribes signatures)
"""The type of dual numbers, and how an operation on them is defined by a formula.

`defined` gives a function of numbers a meaning for duals. Its formula takes each
argument as a `Number`, which has a `value` and `slopes`, and returns value and slopes
of the result: of a product, ``x.value * y.value`` and ``x.slopes * y.value + y.slopes *
x.value``. Python runs it once, while code is generated (`compiled.terms`).
"""

from collections.abc import Callable
from itertools import product
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.extending import (
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    register_model,
)

from hopdata.hybrid.compiled.memory import NumberLike, is_scalar
from hopdata.hybrid.compiled.terms import (
    BYTES,
    DOUBLE,
    FLOAT,
    Code,
    Term,
    Value,
    joined,
    parts_of,
    where,
)
from hopdata.private_numba import tried_first

WIDTHS = (1, 2, 4, 8)  # possible numbers of directions
Function = Callable[..., Any]


class Dual(NumberLike):
    """The type of a value with slopes along `width` directions."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Dual({width})")


class SlopesType(types.Type):
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


@register_model(SlopesType)
class _SlopesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: SlopesType) -> None:
        super().__init__(manager, kind, ir.VectorType(DOUBLE, kind.width))


@register_model(Dual)
class _DualModel(models.StructModel):
    """A value and its slopes; in arrays without a gap between them."""

    def __init__(self, manager: Any, kind: Dual) -> None:
        members = [("value", FLOAT), ("slopes", SlopesType(kind.width))]
        super().__init__(manager, kind, members)

    def get_data_type(self) -> Any:
        if self._data_type is None:
            parts = [one.get_data_type() for one in self._models]
            self._data_type = ir.LiteralStructType(parts, packed=True)
        return self._data_type

    def load_from_data_pointer(self, builder: Any, ptr: Any, align: Any = None) -> Any:
        zero = ir.Constant(ir.IntType(32), 0)
        parts = []
        for place in range(2):
            member = builder.gep(ptr, [zero, zero.type(place)], inbounds=True)
            parts.append(builder.load(member, align=BYTES))
        return joined(builder, self.get_value_type(), *parts)


make_attribute_wrapper(Dual, "value", "value")
make_attribute_wrapper(Dual, "slopes", "slopes")


# Numbers of a formula.


class Slopes:
    """The slopes of a number of a formula; `known` is None for a plain number.

    What is None costs nothing, and is an exact zero: infinity times it is zero.
    """

    def __init__(self, zeros: Term, known: Term | None) -> None:
        self.zeros = zeros
        self.known = known

    @property
    def all(self) -> Term:
        """The slopes as a vector."""
        return self.zeros if self.known is None else self.known

    def _like(self, known: Term | None) -> "Slopes":
        return Slopes(self.zeros, known)

    def __add__(self, other: "Slopes") -> "Slopes":
        if self.known is None:
            return other
        if other.known is None:
            return self
        return self._like(self.known + other.known)

    def __sub__(self, other: "Slopes") -> "Slopes":
        if self.known is None or other.known is None:
            return self + -other
        return self._like(self.known - other.known)

    def __neg__(self) -> "Slopes":
        return self if self.known is None else self._like(-self.known)

    def __mul__(self, factor: Any) -> "Slopes":
        return self if self.known is None else self._like(self.known * factor)

    def times_infinite(self, factor: Term) -> "Slopes":
        """Multiply by a number that may be infinite; slopes of zero remain zero."""
        if self.known is None:
            return self
        is_zero = self.known.equals(0.0)
        return self._like(where(is_zero, self.zeros, self.known * factor))

    def times_plus(self, factor: Any, others: "Slopes") -> "Slopes":
        """Multiply by a number and add others, rounded once."""
        if self.known is None or others.known is None:
            return self * factor + others
        return self._like(self.known.intrinsic("fma", factor, others.known))

    def sizes(self) -> "Slopes":
        """Return the absolute values."""
        return self if self.known is None else self._like(self.known.intrinsic("fabs"))


def choose(truth: Term, one: Slopes, other: Slopes) -> Slopes:
    """Choose between slopes."""
    return Slopes(one.zeros, where(truth, one.all, other.all))


class Number(NamedTuple):
    """A number of a formula: its value, and its slopes."""

    value: Term
    slopes: Slopes


def zeros_of(code: Code, width: int) -> Term:
    """Return slopes of zero."""
    vector = ir.VectorType(DOUBLE, width)
    return Term(code, ir.Constant(vector, [0.0] * width))


def number_of(code: Code, width: int, kind: Any, built: Value) -> Number:
    """Return a dual, or a plain number, as a number of a formula."""
    zeros = zeros_of(code, width)
    if not isinstance(kind, Dual):
        return Number(Term(code, built), Slopes(zeros, None))
    value, slopes = (Term(code, one) for one in parts_of(code.llvm, built, 2))
    return Number(value, Slopes(zeros, slopes))


def dual_of(value: Term, slopes: Slopes) -> Value:
    """Build a dual number."""
    code = value.code
    every = slopes.all.built
    kind = code.context.get_value_type(Dual(every.type.count))
    return joined(code.llvm, kind, value.built, every)


def axis(code: Code, width: int, direction: int) -> Slopes:
    """Return the slopes of a number that is one of the directions itself."""
    zeros = zeros_of(code, width)
    slopes = [0.0] * width
    slopes[direction] = 1.0
    return Slopes(zeros, Term(code, ir.Constant(zeros.built.type, slopes)))


# What a function takes and returns.


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


def defined(key: Any, count: int, formula: Function, returned: Any = None) -> None:
    """Define a function of `count` numbers of which at least one is a dual.

    Parameters
    ----------
    key : callable
        What is called.
    count : int
        Number of arguments.
    formula : callable
        Takes the arguments, each a `Number`. Returns value and slopes of the result; or
        a value of LLVM, with `returned`.
    returned : Numba type, optional
        Type of a result that has no slopes.
    """

    def typed(*kinds: Any) -> Any:
        plain = tuple(map(types.unliteral, kinds))
        width = width_among(plain)
        if len(plain) != count or width == 0:
            return None
        taken = (one if isinstance(one, Dual) else FLOAT for one in plain)
        return (returned or Dual(width))(*taken)

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        found = formula(*numbers_of(context, builder, sign.args, values))
        return dual_of(*found) if returned is None else found

    OPERATIONS.append((key, count, returned))
    tried_first(key, typed)
    for kinds in product((Dual, types.Float), repeat=count):
        if Dual in kinds:
            lower_builtin(key, *kinds)(lower)


def numbers_of(context: Any, builder: Any, kinds: Any, values: Any) -> list[Number]:
    """Return the arguments of a function as numbers of a formula."""
    code = Code(context, builder)
    width = width_among(map(types.unliteral, kinds))
    pairs = zip(kinds, values, strict=True)
    return [number_of(code, width, kind, value) for kind, value in pairs]


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    number = context.cast(builder, value, types.unliteral(given), FLOAT)
    return dual_of(*number_of(Code(context, builder), wanted.width, FLOAT, number))


for _number in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_number, Dual)(_cast)
