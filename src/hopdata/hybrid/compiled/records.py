"""Named tuples that are read from a table of addresses, each item where it is used.

A named tuple of views is passed to a compiled function as separate numbers, thirty
for the driver's memory, so a call costs more than the work of the function. A record
is one address, whatever its contents. Its items are constant while the code that
reads them runs. The compiler may therefore read an item once, although it cannot know
what the stores in between change.
"""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar, get_type_hints

from llvmlite import ir
from numba import extending, types
from numba.extending import models

from hopdata.hybrid.compiled.memory import (
    INDEX,
    FloatTable,
    FloatVector,
    IntTable,
    IntVector,
    View,
    built,
)
from hopdata.private_numba import (
    attributes_of,
    packed,
    structure,
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
    """The Numba type of a named tuple by address.

    `items` holds each item's type and slot.
    """

    def __init__(self, name: str, items: Mapping[str, tuple[Any, int]]) -> None:
        self.items = dict(items)
        super().__init__(name=f"Record({name}, {self.items})")


@extending.register_model(Record)
class _RecordModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Record) -> None:
        address = manager.lookup(types.CPointer(INDEX)).get_value_type()
        super().__init__(manager, kind, address)


def _typed_item(kind: Record, name: str) -> Any:
    return kind.items[name][0] if name in kind.items else None


attributes_of(Record, _typed_item)


def _slot(context: Any, builder: Any, address: Any, slot: int) -> Any:
    """Build the reading of a slot that is constant meanwhile."""
    value = builder.load(builder.gep(address, [context.get_constant(INDEX, slot)]))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


@extending.lower_getattr_generic(Record)
def _item(context: Any, builder: Any, kind: Record, address: Any, name: str) -> Any:
    item, slot = kind.items[name]
    value = _slot(context, builder, address, slot)
    if isinstance(item, View):
        made = structure(context, builder, item)
        made.data = builder.inttoptr(value, made.data.type)
        made.width = _slot(context, builder, address, slot + 1)
        return packed(made)
    if item == types.float64:
        return builder.bitcast(value, context.get_value_type(item))
    if item == types.boolean:
        return builder.icmp_unsigned("!=", value, value.type(0))
    native = context.get_value_type(item)
    if isinstance(native, ir.PointerType):
        return builder.inttoptr(value, native)
    return value


def reader(
    slots: Mapping[str, int], kind: type[Tuple], **others: int
) -> Callable[[IntVector], Tuple]:
    """Return a function for compiled code that reads a named tuple from a block.

    Parameters
    ----------
    slots : mapping
        Slot of each item in the argument block, by its name in capitals: a number or
        flag takes one slot, a view takes two (address and width).
    kind : type
        Class of the named tuple, which gives the types of its items.
    **others : int
        Slots of the items with another name on the argument block.
    """
    items = {}
    for name, hint in get_type_hints(kind).items():
        slot = others[name] if name in others else slots[name.upper()]
        items[name] = (KINDS[hint], int(slot))
    return reader_of(Record(kind.__name__, items))


def reader_of(record: Record) -> Any:
    """Return a function for compiled code that reads a record from a block."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        return structure(context, builder, sign.args[0], values[0]).data

    return built(1, lambda block: (record(block), generate))
