# ruff: noqa: ARG001, ARG002 (signatures are prescribed by Numba)
# ruff: noqa: ARG001 (Numba reads the arguments from the signatures of intrinsics)
"""Arrays without owners, for compiled code.

Numba counts references whenever it takes an array out of a tuple or makes a row of a table; in the
driver that would cost more than the arithmetic. A view is only an address and a width. It is made
by the driver from an array that Python keeps alive meanwhile, and reads and writes by index:
``view[i]`` for a vector, ``table[row, i]`` for a table, whose rows are ``view.width`` long.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import Any, Protocol, TypeVar, get_type_hints

from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_getattr_generic,
    make_attribute_wrapper,
    register_model,
)
from numba.np.arrayobj import make_array, populate_array


class FloatVector(Protocol):
    """What a type checker knows of a view of floats."""

    width: int

    def __getitem__(self, index: Any) -> float: ...
    def __setitem__(self, index: Any, value: float) -> None: ...


class IntVector(Protocol):
    """What a type checker knows of a view of integers."""

    width: int

    def __getitem__(self, index: Any) -> int: ...
    def __setitem__(self, index: Any, value: int) -> None: ...


class FloatTable(FloatVector, Protocol):
    """A view of floats that is indexed by row and column."""


class IntTable(IntVector, Protocol):
    """A view of integers that is indexed by row and column."""


INDEX = types.int64


class View(types.Type):
    """The type of an array without an owner."""

    def __init__(self, dtype: Any, ndim: int) -> None:
        self.dtype, self.ndim = dtype, ndim
        super().__init__(name=f"View({dtype}, {ndim})")

    @property
    def index(self) -> Any:
        """The type by which it is indexed."""
        return INDEX if self.ndim == 1 else types.UniTuple(INDEX, 2)


@register_model(View)
class _ViewModel(models.StructModel):
    def __init__(self, manager: Any, kind: View) -> None:
        members = [("data", types.CPointer(kind.dtype)), ("width", INDEX)]
        super().__init__(manager, kind, members)


make_attribute_wrapper(View, "width", "width")


def _view_at(kind: View) -> Any:
    """Return a function that makes a view from an address and a width."""

    @intrinsic
    def make(typing: Any, address: Any, width: Any) -> Any:
        def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
            proxy = cgutils.create_struct_proxy(sign.return_type)(context, builder)
            proxy.data = builder.inttoptr(values[0], proxy.data.type)
            proxy.width = values[1]
            return proxy._getvalue()

        return kind(INDEX, INDEX), generate

    return make


@intrinsic
def _view(typing: Any, array: Any) -> Any:
    """Return a view of a C-ordered array."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        owner = make_array(sign.args[0])(context, builder, values[0])
        proxy = cgutils.create_struct_proxy(sign.return_type)(context, builder)
        proxy.data = owner.data
        proxy.width = cgutils.unpack_tuple(builder, owner.shape, array.ndim)[-1]
        return proxy._getvalue()

    return View(array.dtype, array.ndim)(array), generate


view: Any = _view
float_vector, float_table = (_view_at(View(types.float64, ndim)) for ndim in (1, 2))
int_vector, int_table = (_view_at(View(types.int64, ndim)) for ndim in (1, 2))


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        kind = args[0]
        return signature(kind.dtype, kind, kind.index) if isinstance(kind, View) else None


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        kind = args[0]
        if not isinstance(kind, View):
            return None
        return signature(types.none, kind, kind.index, kind.dtype)


def _element(context: Any, builder: Any, kind: View, value: Any, index: Any) -> Any:
    proxy = cgutils.create_struct_proxy(kind)(context, builder, value)
    if kind.ndim == 2:
        row, column = cgutils.unpack_tuple(builder, index, 2)
        index = builder.add(builder.mul(row, proxy.width), column)
    return builder.gep(proxy.data, [index])


@lower_builtin(operator.getitem, View, types.Any)
def _get_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return builder.load(_element(context, builder, sign.args[0], *values))


@lower_builtin(operator.setitem, View, types.Any, types.Any)
def _set_item(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    builder.store(values[2], _element(context, builder, sign.args[0], *values[:2]))
    return context.get_dummy_value()


def lower_row(context: Any, builder: Any, kind: View, value: Any, row: Any = None) -> Any:
    """Build, within an intrinsic, the array that is a vector, or a row of a table."""
    proxy = cgutils.create_struct_proxy(kind)(context, builder, value)
    start = proxy.data
    if row is not None:
        start = builder.gep(start, [builder.mul(row, proxy.width)])
    array_type = types.Array(kind.dtype, 1, "C")
    array = make_array(array_type)(context, builder)
    item = context.get_constant(types.intp, kind.dtype.bitwidth // 8)
    populate_array(array, start, [proxy.width], [item], item, meminfo=None)
    return array._getvalue()


@intrinsic
def _row(typing: Any, table: Any, index: Any) -> Any:
    """Return a row of a table of floats as an array, for the user's functions."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return lower_row(context, builder, sign.args[0], *values)

    return types.Array(table.dtype, 1, "C")(table, INDEX), generate


@intrinsic
def _array_of(typing: Any, vector: Any) -> Any:
    """Return a vector as an array."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return lower_row(context, builder, sign.args[0], values[0])

    return types.Array(vector.dtype, 1, "C")(vector), generate


@intrinsic
def _square(typing: Any, table: Any, index: Any) -> Any:
    """Return as many rows of a table as they are long, from a row on, as a matrix."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        proxy = cgutils.create_struct_proxy(sign.args[0])(context, builder, values[0])
        start = builder.gep(proxy.data, [builder.mul(values[1], proxy.width)])
        kind = types.Array(table.dtype, 2, "C")
        array = make_array(kind)(context, builder)
        item = context.get_constant(types.intp, table.dtype.bitwidth // 8)
        across = builder.mul(proxy.width, item)
        populate_array(array, start, [proxy.width, proxy.width], [across, item], item, meminfo=None)
        return array._getvalue()

    return types.Array(table.dtype, 2, "C")(table, INDEX), generate


@intrinsic
def _address_of(typing: Any, owner: Any) -> Any:
    """Return the address of what a view shows."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        proxy = cgutils.create_struct_proxy(sign.args[0])(context, builder, values[0])
        return builder.ptrtoint(proxy.data, context.get_value_type(INDEX))

    return INDEX(owner), generate


row: Any = _row
array_of: Any = _array_of
square: Any = _square
address_of: Any = _address_of


# Named tuples that are read from a table of addresses, each item where it is used.
#
# A named tuple of views is handed to a compiled function as one number after the other, thirty for
# the driver's memory: a call costs more than what is called. A record is one address, whatever is
# in it. Its items stay the same while the code that reads them runs, so that the compiler may read
# one once and keep it, though it cannot know what the stores in between change.

Tuple = TypeVar("Tuple", bound=tuple[Any, ...])

KINDS = {
    FloatVector: View(types.float64, 1),
    FloatTable: View(types.float64, 2),
    IntVector: View(types.int64, 1),
    IntTable: View(types.int64, 2),
    float: types.float64,
    int: types.int64,
    bool: types.boolean,
}


class Record(types.Type):
    """The type of a named tuple by address; `items` has the type and the slot of each."""

    def __init__(self, name: str, items: Mapping[str, tuple[Any, int]]) -> None:
        self.items = dict(items)
        super().__init__(name=f"Record({name}, {self.items})")


@register_model(Record)
class _RecordModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Record) -> None:
        address = manager.lookup(types.CPointer(INDEX)).get_value_type()
        super().__init__(manager, kind, address)


@infer_getattr
class _Items(AttributeTemplate):
    key = Record

    def generic_resolve(self, kind: Record, name: str) -> Any:  # type: ignore[override]
        return kind.items[name][0] if name in kind.items else None


def _slot(context: Any, builder: Any, address: Any, slot: int) -> Any:
    """Build the reading of a slot, which nothing changes meanwhile."""
    value = builder.load(builder.gep(address, [context.get_constant(INDEX, slot)]))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


@lower_getattr_generic(Record)
def _item(context: Any, builder: Any, kind: Record, address: Any, name: str) -> Any:
    item, slot = kind.items[name]
    value = _slot(context, builder, address, slot)
    if isinstance(item, View):
        proxy = cgutils.create_struct_proxy(item)(context, builder)
        proxy.data = builder.inttoptr(value, proxy.data.type)
        proxy.width = _slot(context, builder, address, slot + 1)
        return proxy._getvalue()
    if item == types.float64:
        return builder.bitcast(value, context.get_value_type(item))
    if item == types.boolean:
        return builder.icmp_unsigned("!=", value, value.type(0))
    return value


def reader(kind: type[Tuple], **slots: int) -> Callable[[IntVector], Tuple]:
    """Return a function for compiled code that reads a named tuple from a desk.

    Parameters
    ----------
    kind : type
        The named tuple, which says what its items are.
    **slots : int
        Where on the desk each stands: a number or a truth in one slot, address and width of a view
        in two.
    """
    hints = get_type_hints(kind)
    record = Record(kind.__name__, {k: (KINDS[hints[k]], int(slots[k])) for k in hints})

    @intrinsic
    def read(typing: Any, desk: Any) -> Any:
        def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
            return cgutils.create_struct_proxy(sign.args[0])(context, builder, values[0]).data

        return record(desk), generate

    made: Any = read
    return made  # type: ignore[no-any-return]
