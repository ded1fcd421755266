# ruff: noqa: ARG001 (Numba prescribes signatures)
"""Calls of machine code by address, and the conversion of views to its arguments."""

from collections.abc import Callable
from enum import Enum, auto
from typing import Any

from llvmlite import ir
from numba import types

from hopdata.hybrid.compiled.memory import INDEX, as_span, built, lower_array


class Passed(Enum):
    """How an argument is passed."""

    AS_IT_IS = auto()
    ROW = auto()  # a row of a table, which takes two arguments, as an array
    VECTOR = auto()  # a vector, as an array
    ADDRESS = auto()  # a view, as its address
    SPAN = auto()  # a vector, as its address and width


def _handed_over(
    context: Any, builder: Any, passed: Passed, kind: Any, values: list[Any]
) -> list[Any]:
    """Build what the machine code takes for an argument."""
    if passed is Passed.AS_IT_IS:
        return values
    if passed in (Passed.ROW, Passed.VECTOR):
        return [lower_array(context, builder, kind, *values)]
    address, width = as_span(context, builder, kind, values)
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
