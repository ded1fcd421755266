# ruff: noqa: ARG001 (Numba reads the arguments from the signatures of intrinsics)
"""Named tuples that are read from a table of addresses, each item where it is used.

A named tuple of views is handed to a compiled function as one number after the other, thirty for
the driver's memory: a call costs more than what is called. A record is one address, whatever is in
it. Its items stay the same while the code that reads them runs, so that the compiler may read one
once and keep it, though it cannot know what the stores in between change.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar, get_type_hints

from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, lower_getattr_generic, register_model

from hopdata.hybrid.compiled.views import (
    INDEX,
    FloatTable,
    FloatVector,
    IntTable,
    IntVector,
    View,
)

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
