# ruff: noqa: ARG001, ARG002, ARG005 (signatures are prescribed by Numba)
"""Arrays without owners, for compiled code.

Numba counts references whenever it takes an array out of a tuple or makes a row of a
table; in the driver this would cost more than the arithmetic. A view is only an address
and a width. The driver makes it from an array that Python keeps alive meanwhile, and
reads and writes by index: ``view[i]`` for a vector, ``table[row, i]`` for a table,
whose rows have the length ``view.width``.
"""

import operator
from collections.abc import Callable
from typing import Any, Protocol

from numba import extending, types
from numba.extending import models

from hopdata.private_numba import (
    CONVERTS,
    array_from,
    array_shape,
    array_start,
    items_of,
    packed,
    structure,
    tried_first,
)


class FloatVector(Protocol):
    """A view of floats, as a type checker sees it."""

    width: int

    def __getitem__(self, index: Any) -> float: ...
    def __setitem__(self, index: Any, value: float) -> None: ...


class IntVector(Protocol):
    """A view of integers, as a type checker sees it."""

    width: int

    def __getitem__(self, index: Any) -> int: ...
    def __setitem__(self, index: Any, value: int) -> None: ...


class FloatTable(FloatVector, Protocol):
    """A view of floats that is indexed by row and column."""


class IntTable(IntVector, Protocol):
    """A view of integers that is indexed by row and column."""


INDEX = types.int64


class NumberLike(types.Type):
    """A Numba type of ours to which plain numbers convert, as integers do to floats."""

    def can_convert_from(self, context: Any, other: Any) -> Any:
        """Return whether another type converts to this one."""
        if is_number(other):
            return CONVERTS
        return None

    def unify(self, context: Any, other: Any) -> Any:
        """Return the type of a variable that holds values of both types."""
        return self if is_number(other) else None


def is_number(kind: Any) -> bool:
    """Return whether a Numba type is that of a real number."""
    return isinstance(kind, types.Float | types.Integer | types.Boolean)


def is_scalar(kind: Any) -> bool:
    """Return whether a type is that of a number, or of an array without axes.

    `np.where` returns such arrays.
    """
    return is_number(kind) or (isinstance(kind, types.Array) and kind.ndim == 0)


class View(types.Type):
    """The Numba type of an array without an owner."""

    def __init__(self, dtype: Any, ndim: int) -> None:
        self.dtype = dtype
        self.ndim = ndim
        super().__init__(name=f"View({dtype}, {ndim})")

    @property
    def index(self) -> Any:
        """Type of its index."""
        if self.ndim == 1:
            return INDEX
        return types.UniTuple(INDEX, 2)


@extending.register_model(View)
class _ViewModel(models.StructModel):
    def __init__(self, manager: Any, kind: View) -> None:
        members = [("data", types.CPointer(kind.dtype)), ("width", INDEX)]
        super().__init__(manager, kind, members)


extending.make_attribute_wrapper(View, "width", "width")


def built(count: int, typed: Callable[..., Any]) -> Any:
    """Return an intrinsic of `count` arguments; Numba requires that they have names.

    Given the types of the arguments, `typed` returns the signature and the function
    that builds the code, or None.
    """
    names = ", ".join(f"a{k}" for k in range(count))
    function = eval(f"lambda typing, {names}: typed({names})", {"typed": typed})
    return extending.intrinsic(function)


def _view_at(kind: View) -> Any:
    """Return a function that makes a view from an address and a width."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        made = structure(context, builder, sign.return_type)
        made.data = builder.inttoptr(values[0], made.data.type)
        made.width = values[1]
        return packed(made)

    return built(2, lambda address, width: (kind(INDEX, INDEX), generate))


def _view(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build a view of a C-ordered array."""
    kind = sign.args[0]
    made = structure(context, builder, sign.return_type)
    made.data = array_start(context, builder, kind, values[0])
    made.width = array_shape(context, builder, kind, values[0])[-1]
    return packed(made)


view = built(1, lambda array: (View(array.dtype, array.ndim)(array), _view))
float_vector = _view_at(View(types.float64, 1))
float_table = _view_at(View(types.float64, 2))
int_vector = _view_at(View(types.int64, 1))
int_table = _view_at(View(types.int64, 2))


def _typed_get(*kinds: Any) -> Any:
    kind = kinds[0]
    return kind.dtype(kind, kind.index) if isinstance(kind, View) else None


def _typed_set(*kinds: Any) -> Any:
    kind = kinds[0]
    if not isinstance(kind, View):
        return None
    return types.none(kind, kind.index, kind.dtype)


tried_first(operator.getitem, _typed_get)
tried_first(operator.setitem, _typed_set)


def _element(context: Any, builder: Any, kind: View, value: Any, index: Any) -> Any:
    own = structure(context, builder, kind, value)
    if kind.ndim == 2:
        row, column = items_of(builder, index, 2)
        index = builder.add(builder.mul(row, own.width), column)
    return builder.gep(own.data, [index])


@extending.lower_builtin(operator.getitem, View, types.Any)
def _get_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return builder.load(_element(context, builder, sign.args[0], *values))


@extending.lower_builtin(operator.setitem, View, types.Any, types.Any)
def _set_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    builder.store(values[2], _element(context, builder, sign.args[0], *values[:2]))
    return context.get_dummy_value()


def lower_array(
    context: Any, builder: Any, kind: View, value: Any, row: Any = None, ndim: int = 1
) -> Any:
    """Build, within an intrinsic, an array from a vector, a row, or a square block."""
    own = structure(context, builder, kind, value)
    start = own.data
    if row is not None:
        start = builder.gep(start, [builder.mul(row, own.width)])
    made = types.Array(kind.dtype, ndim, "C")
    item = context.get_constant(types.intp, kind.dtype.bitwidth // 8)
    strides = [builder.mul(own.width, item), item][-ndim:]
    return array_from(context, builder, made, start, [own.width] * ndim, strides)


def _from_row_on(ndim: int) -> Any:
    """Return a function that makes an array from a table's row, or a square block."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return lower_array(context, builder, sign.args[0], values[0], values[1], ndim)

    def typed(table: Any, _row: Any) -> Any:
        return types.Array(table.dtype, ndim, "C")(table, INDEX), generate

    return built(2, typed)


def array_at(dtype: Any) -> Any:
    """Return a function that makes an array from an address and a length.

    The items lie side by side, as this type is kept in arrays.
    """
    kind = types.Array(dtype, 1, "C")

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        native = context.get_data_type(dtype)
        item = context.get_constant(types.intp, context.get_abi_sizeof(native))
        start = builder.inttoptr(values[0], native.as_pointer())
        return array_from(context, builder, kind, start, [values[1]], [item])

    return built(2, lambda address, length: (kind(INDEX, INDEX), generate))


def as_span(context: Any, builder: Any, kind: Any, values: list[Any]) -> list[Any]:
    """Build, within an intrinsic, the address and the width of a view."""
    own = structure(context, builder, kind, values[0])
    return [builder.ptrtoint(own.data, context.get_value_type(INDEX)), own.width]


def _array(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return lower_array(context, builder, sign.args[0], values[0])


def _address(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return as_span(context, builder, sign.args[0], values)[0]


def _matrix(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build an array from an address and its numbers of rows and columns."""
    address, rows, columns = values
    kind = sign.return_type
    native = context.get_data_type(kind.dtype)
    start = builder.inttoptr(address, native.as_pointer())
    item = context.get_constant(types.intp, types.float64.bitwidth // 8)
    strides = [builder.mul(columns, item), item]
    return array_from(context, builder, kind, start, [rows, columns], strides)


def _typed_matrix(*_: Any) -> Any:
    return types.Array(types.float64, 2, "C")(INDEX, INDEX, INDEX), _matrix


row = _from_row_on(1)
square = _from_row_on(2)
matrix_at = built(3, _typed_matrix)
array_of = built(1, lambda vector: (types.Array(vector.dtype, 1, "C")(vector), _array))
address_of = built(1, lambda owner: (INDEX(owner), _address))


def _start(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    start = array_start(context, builder, sign.args[0], values[0])
    return builder.ptrtoint(start, context.get_value_type(INDEX))


start_of = built(1, lambda array: (INDEX(array), _start))


# A product and a sum, rounded once.
#
# If the compiler is free to contract them, rounding depends on the surrounding
# expression and on the processor. An explicit operation gives the same result
# everywhere.

FLOAT = types.float64


def _fma(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return builder.fma(*values)


# fma(a, b, c) is a b + c: one instruction if the processor has it.
fma = built(3, lambda *_: (FLOAT(FLOAT, FLOAT, FLOAT), _fma))
