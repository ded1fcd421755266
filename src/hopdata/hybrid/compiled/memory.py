# ruff: noqa: ARG001, ARG002, ARG005 (signatures are prescribed by Numba)
"""Arrays without owners, for compiled code.

Numba counts references whenever it takes an array out of a tuple or makes a row of a
table; in the driver this would cost more than the arithmetic. A view is only an address
and a width. The driver makes it from an array that Python keeps alive meanwhile, and
reads and writes by index: ``view[i]`` for a vector, ``table[row, i]`` for a table,
whose rows have the length ``view.width``. The module ends with calls of machine code by
address, and of Python functions.

Of Numba's internals it uses `cgutils` (structures and branches of the generated code),
`datamodel` (the memory layout of a type), `typeconv` (conversions between types),
`typing.templates` (the meaning of indexing a view), `np.arrayobj` (arrays made from an
address) and `ir_utils` (the exception by which a rewriting gives up); the public API
cannot define a type without an owner.
"""

import operator
from collections.abc import Callable, Mapping
from enum import Enum, auto
from typing import Any, Protocol, TypeVar, get_type_hints

import numpy as np
from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.ir_utils import GuardException
from numba.core.typeconv import Conversion
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.np.arrayobj import make_array, populate_array

# What a rewriting of Numba's raises to leave the code as it is.
LEFT_AS_IT_IS: type[Exception] = GuardException


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
            return Conversion.safe
        return None

    def unify(self, context: Any, other: Any) -> Any:
        """Return the type of a variable that holds values of both types."""
        return self if is_number(other) else None


def is_number(kind: Any) -> bool:
    """Return whether a Numba type is that of a real number."""
    return isinstance(kind, types.Float | types.Integer | types.Boolean)


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


def structure(context: Any, builder: Any, kind: Any, value: Any = None) -> Any:
    """Return a structure of the generated code, whose members are attributes.

    Without `value`, they are to be set.
    """
    return cgutils.create_struct_proxy(kind)(context, builder, value)


def array_from(
    context: Any, builder: Any, kind: Any, start: Any, length: Any, item: Any
) -> Any:
    """Build an array without an owner: items of `item` bytes from an address on."""
    array = make_array(kind)(context, builder)
    populate_array(array, start, [length], [item], item, meminfo=None)
    return array._getvalue()


def _view_at(kind: View) -> Any:
    """Return a function that makes a view from an address and a width."""

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        proxy = cgutils.create_struct_proxy(sign.return_type)(context, builder)
        proxy.data = builder.inttoptr(values[0], proxy.data.type)
        proxy.width = values[1]
        return proxy._getvalue()

    return built(2, lambda address, width: (kind(INDEX, INDEX), generate))


def _view(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build a view of a C-ordered array."""
    owner = make_array(sign.args[0])(context, builder, values[0])
    proxy = cgutils.create_struct_proxy(sign.return_type)(context, builder)
    proxy.data = owner.data
    proxy.width = cgutils.unpack_tuple(builder, owner.shape, sign.args[0].ndim)[-1]
    return proxy._getvalue()


view = built(1, lambda array: (View(array.dtype, array.ndim)(array), _view))
float_vector = _view_at(View(types.float64, 1))
float_table = _view_at(View(types.float64, 2))
int_vector = _view_at(View(types.int64, 1))
int_table = _view_at(View(types.int64, 2))


class FirstTried(AbstractTemplate):
    """Meaning of an operator for our types, tried before all that Numba defines."""

    metadata = {"target": "cpu"}  # noqa: RUF012


def ask_first(key: Any, template: Any) -> None:
    """Let Numba ask a template (`FirstTried`) first for the meaning of an operator."""
    template.key = key
    infer_global(key)(template)


def tried_first(key: Any, typed: Callable[..., Any], literal: bool = False) -> None:
    """Give an operator a meaning for our types.

    `typed(*types)` returns its signature, or None. With `literal`, the types of literal
    numbers are tried first.
    """

    class Template(FirstTried):
        prefer_literal = literal

        def generic(self, args: Any, kws: Any) -> Any:
            return typed(*args)

    ask_first(key, Template)


def method_first(
    kind: Any, name: str, fits: Callable[[Any], bool], typed: Callable[..., Any]
) -> Any:
    """Give a method a meaning for types that fit; return the key of its code.

    `typed(context, owner, arguments)` returns the type of its result, or None.
    """
    code = (kind, f"hopdata.{name}")

    class Method(AbstractTemplate):
        key = code
        this: Any = None  # the owner, which Numba sets

        def generic(self, args: Any, kws: Any) -> Any:
            found = None if kws else typed(self.context, self.this, args)
            return None if found is None else signature(found, *args, recvr=self.this)

    class Methods(AttributeTemplate):
        key = kind
        metadata = {"target": "cpu"}  # noqa: RUF012

        def generic_resolve(self, owner: Any, attribute: str) -> Any:  # type: ignore[override]
            if attribute != name or not fits(owner):
                return None
            return types.BoundFunction(Method, owner)

    infer_getattr(Methods)
    return code


@infer_global(operator.getitem)
class _GetItem(FirstTried):
    def generic(self, args: Any, kws: Any) -> Any:
        kind = args[0]
        if not isinstance(kind, View):
            return None
        return signature(kind.dtype, kind, kind.index)


@infer_global(operator.setitem)
class _SetItem(FirstTried):
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
    proxy = cgutils.create_struct_proxy(kind)(context, builder, value)
    start = proxy.data
    if row is not None:
        start = builder.gep(start, [builder.mul(row, proxy.width)])
    array = make_array(types.Array(kind.dtype, ndim, "C"))(context, builder)
    item = context.get_constant(types.intp, kind.dtype.bitwidth // 8)
    strides = [builder.mul(proxy.width, item), item][-ndim:]
    populate_array(array, start, [proxy.width] * ndim, strides, item, meminfo=None)
    return array._getvalue()


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
        array = make_array(kind)(context, builder)
        populate_array(array, start, [values[1]], [item], item, meminfo=None)
        return array._getvalue()

    return built(2, lambda address, length: (kind(INDEX, INDEX), generate))


def array_start(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Build, within an intrinsic, the pointer to the first item of an array."""
    return make_array(kind)(context, builder, value).data


def array_length(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Build, within an intrinsic, the length of an array with one axis."""
    shape = make_array(kind)(context, builder, value).shape
    return cgutils.unpack_tuple(builder, shape, 1)[0]


def _array(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return lower_array(context, builder, sign.args[0], values[0])


def _address(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    return _as_span(context, builder, sign.args[0], values)[0]


def _matrix(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    """Build an array from an address and its numbers of rows and columns."""
    address, rows, columns = values
    array = make_array(sign.return_type)(context, builder)
    start = builder.inttoptr(address, array.data.type)
    item = context.get_constant(types.intp, types.float64.bitwidth // 8)
    strides = [builder.mul(columns, item), item]
    populate_array(array, start, [rows, columns], strides, item, meminfo=None)
    return array._getvalue()


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


# Named tuples that are read from a table of addresses, each item where it is used.
#
# A named tuple of views is passed to a compiled function as separate numbers, thirty
# for the driver's memory, so a call costs more than the work of the function. A record
# is one address, whatever its contents. Its items are constant while the code that
# reads them runs. The compiler may therefore read an item once, although it cannot know
# what the stores in between change.

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


@infer_getattr
class _Items(AttributeTemplate):
    key = Record

    def generic_resolve(self, kind: Record, name: str) -> Any:  # type: ignore[override]
        if name not in kind.items:
            return None
        return kind.items[name][0]


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
        proxy = cgutils.create_struct_proxy(item)(context, builder)
        proxy.data = builder.inttoptr(value, proxy.data.type)
        proxy.width = _slot(context, builder, address, slot + 1)
        return proxy._getvalue()
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
        proxy = cgutils.create_struct_proxy(sign.args[0])(context, builder, values[0])
        return proxy.data

    return built(1, lambda block: (record(block), generate))


# Calls of machine code by address, and the conversion of views to its arguments.


class Passed(Enum):
    """How an argument is passed."""

    AS_IT_IS = auto()
    ROW = auto()  # a row of a table, which takes two arguments, as an array
    VECTOR = auto()  # a vector, as an array
    ADDRESS = auto()  # a view, as its address
    SPAN = auto()  # a vector, as its address and width


def _as_span(context: Any, builder: Any, kind: Any, values: list[Any]) -> list[Any]:
    proxy = cgutils.create_struct_proxy(kind)(context, builder, values[0])
    return [builder.ptrtoint(proxy.data, context.get_value_type(INDEX)), proxy.width]


def _handed_over(
    context: Any, builder: Any, passed: Passed, kind: Any, values: list[Any]
) -> list[Any]:
    """Build what the machine code takes for an argument."""
    if passed is Passed.AS_IT_IS:
        return values
    if passed in (Passed.ROW, Passed.VECTOR):
        return [lower_array(context, builder, kind, *values)]
    address, width = _as_span(context, builder, kind, values)
    if passed is Passed.ADDRESS:
        return [address]
    return [address, width]


def caller(native: Any, *plan: tuple[Any, Passed]) -> Callable[..., Any]:
    """Return a function for compiled code that takes an address and planned arguments.

    Parameters
    ----------
    native : Numba signature
        Signature of the machine code at the address.
    *plan : tuple
        Numba type of each argument, and how it is passed; by default all are passed as
        they are.
    """
    if not plan:
        plan = tuple((kind, Passed.AS_IT_IS) for kind in native.args)
    kinds: list[Any] = []
    for kind, passed in plan:
        kinds.append(kind)
        if passed is Passed.ROW:
            kinds.append(INDEX)

    def generate(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        address, *remaining = values
        arguments: list[Any] = []
        for kind, passed in plan:
            count = 2 if passed is Passed.ROW else 1
            own = remaining[:count]
            arguments += _handed_over(context, builder, passed, kind, own)
            remaining = remaining[count:]
        taken = [context.get_value_type(kind) for kind in native.args]
        returned = context.get_value_type(native.return_type)
        function = ir.FunctionType(returned, taken).as_pointer()
        result = builder.call(builder.inttoptr(address, function), arguments)
        if native.return_type == types.void:
            return context.get_dummy_value()
        return result

    sign = native.return_type(INDEX, *kinds)
    made: Callable[..., Any] = built(1 + len(kinds), lambda *_: (sign, generate))
    return made


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


# A call of a Python function, with the interpreter's lock. The caller keeps the
# function alive.

DTYPES = {types.float64: np.dtype(np.float64), types.int64: np.dtype(np.int64)}


def lower_call_of_python(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the code generator of a call to a Python function.

    The code prints the function's exceptions.
    """

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        python = context.get_python_api(builder)
        lock = python.gil_ensure()
        boxed = []
        for kind, value in zip(sign.args, values, strict=True):
            boxed.append(_boxed(context, builder, python, kind, value))
        called = _object(context, builder, python, function)
        result = python.call_function_objargs(called, boxed)
        native = _unboxed(context, builder, python, sign.return_type, result)
        for item in boxed:
            python.decref(item)
        python.gil_release(lock)
        return native

    return lower


def _object(context: Any, builder: Any, python: Any, value: object) -> Any:
    return builder.inttoptr(context.get_constant(types.intp, id(value)), python.pyobj)


def _boxed(context: Any, builder: Any, python: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.Array):
        dtype = _object(context, builder, python, DTYPES[kind.dtype])
        return python.nrt_adapt_ndarray_to_python(kind, value, dtype)
    if kind == types.float64:
        return python.float_from_double(value)
    return python.long_from_longlong(value)


def _unboxed(context: Any, builder: Any, python: Any, kind: Any, result: Any) -> Any:
    """Return the number in a Python result.

    If there is none, the exception is printed, and the number is 0.
    """
    native_type = context.get_value_type(kind)
    nothing = native_type(None) if kind == types.none else native_type(0)
    slot = cgutils.alloca_once_value(builder, nothing)
    is_missing = cgutils.is_null(builder, result)
    with builder.if_else(is_missing, likely=False) as (failed, returned):
        with failed:
            name = context.insert_const_string(builder.module, "hopdata callback")
            label = python.string_from_string(name)
            python.err_write_unraisable(label)
            python.decref(label)
        with returned:
            if kind == types.float64:
                builder.store(python.float_as_double(result), slot)
            elif kind == types.int64:
                builder.store(python.long_as_longlong(result), slot)
            python.decref(result)
    if kind == types.none:
        return context.get_dummy_value()
    return builder.load(slot)
