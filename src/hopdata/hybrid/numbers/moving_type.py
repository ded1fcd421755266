# ruff: noqa: ARG001, PLW0108 (Numba prescribes signatures and their names)
"""The type of numbers that move, and how an operation on them is defined by a formula.

`defined` takes a formula of value and rate, on numbers of the code that is being
generated; `branching` a function that Numba compiles, where the code branches.
"""

from collections.abc import Callable
from itertools import product
from typing import Any

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

from hopdata.hybrid.compiled.memory import NumberLike, is_number, is_scalar
from hopdata.hybrid.compiled.terms import Code, Operators, called
from hopdata.hybrid.numbers.duals import Dual
from hopdata.hybrid.numbers.ranges import DIGEST, RANGE
from hopdata.private_numba import array_from, packed, structure, tried_first

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
    return packed(made)


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
        return array_from(context, builder, kind, start, [length], [size])

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


class Built(Operators):
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

    def _part(self, name: str) -> "Built":
        held = structure(self.context, self.builder, self.kind, self.built)
        return self._like(self.kind.inner, getattr(held, name))

    def _like(self, kind: Any, built: Any) -> "Built":
        return Built(self.context, self.builder, kind, built)

    @property
    def value(self) -> "Built":
        """The value of a number that moves."""
        return self._part("value")

    @property
    def rate(self) -> "Built":
        """Its rate."""
        return self._part("rate")

    def cast(self, kind: Any) -> Any:
        """Build the number as one of another type."""
        return self.context.cast(self.builder, self.built, self.kind, kind)

    def with_type(self, other: Any) -> "Built":
        """Return a number of Python as a constant of the code; others as they are."""
        if isinstance(other, Built):
            return other
        constant = self.context.get_constant(types.float64, float(other))
        return self._like(types.float64, constant)

    def _apply(self, key: Any, *operands: Any) -> "Built":
        return of(key, *operands)


def of(key: Any, *numbers: Any) -> Built:
    """Build the call of a function that Numba knows, with numbers of the code."""
    first = next(one for one in numbers if isinstance(one, Built))
    given = [first.with_type(one) for one in numbers]
    kinds = tuple(one.kind for one in given)
    code = Code(first.context, first.builder)
    result, returned = called(code, key, kinds, [one.built for one in given])
    return Built(first.context, first.builder, returned, result)


def kind_among(kinds: Any) -> Any:
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
        Takes the arguments as `Built` numbers. Returns value and rate of a result that
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
        found = kind_among(kinds)
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
            given.append(Built(context, builder, kind, values[place]))
            if is_number(kind):
                chosen = shorter[place]
        found = chosen(*given)
        if isinstance(found, Built):
            return found.cast(sign.return_type)
        inner = sign.return_type.inner
        parts = [given[0].with_type(one).cast(inner) for one in found]
        return _pair(context, builder, sign.return_type, *parts)

    tried_first(key, typed)
    _lower_all(key, count, lower)


def branching(key: Any, count: int, function: Function) -> None:
    """Define a function of `count` numbers by one for Numba, as it branches."""

    def typed(*kinds: Any) -> Any:
        kinds = tuple(map(types.unliteral, kinds))
        found = kind_among(kinds)
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


def flat(kind: Any) -> Any:
    """Return the type of what is constant between jumps, such as `floor`."""
    inner = kind.inner
    if isinstance(inner, Moving):
        return flat(inner)
    return RANGE if inner == RANGE else types.float64
