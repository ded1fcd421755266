"""Sixteen doubles as one value in compiled code: the same sum for sixteen problems at a time.

Numba has no type for a vector register, and its loops over a few numbers become vector code only
where LLVM can prove that nothing overlaps. Here is the type, with what the kernels need:
arithmetic, `load`, `spread`, `store`, `root`, `where_above` and `any_above`. An operation does to
each lane what it would do to a number, so that results do not depend on the processor.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

#: Lanes of a vector: two of the widest registers, so that one works while the other waits.
LANES = 16

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class LanesType(types.Type):  # type: ignore[misc]
    """Numba's type of `LANES` doubles."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{LANES}")


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


lanes = LanesType()


@intrinsic  # type: ignore[misc]
def load(typing, array, place):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return the numbers from `place` on of a contiguous array, counted flat."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(_address(context, builder, signature, args), align=8)

    return lanes(array, place), generate


@intrinsic  # type: ignore[misc]
def store(typing, array, place, value):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Write numbers to `place` of a contiguous array, counted flat."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], _address(context, builder, signature, args), align=8)
        return context.get_dummy_value()

    return types.void(array, place, value), generate


@intrinsic  # type: ignore[misc]
def spread(typing, number):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return a number in every lane."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        single = builder.insert_element(_VECTOR(ir.Undefined), args[0], ir.IntType(32)(0))
        every = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(single, _VECTOR(ir.Undefined), every)

    return lanes(types.float64), generate


@intrinsic  # type: ignore[misc]
def root(typing, value):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return the square root."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.sqrt.v{LANES}f64")
        return builder.call(function, args)

    return lanes(value), generate


@intrinsic  # type: ignore[misc]
def where_above(typing, value, bound, yes, no):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return `yes` in the lanes in which `value` is above `bound`, else `no`; NaN is not above."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        return builder.select(builder.fcmp_ordered(">", args[0], args[1]), args[2], args[3])

    return lanes(value, bound, yes, no), generate


@intrinsic  # type: ignore[misc]
def any_above(typing, value, bound):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return whether `value` is above `bound` in any lane."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        above = builder.fcmp_ordered(">", args[0], args[1])
        bits = builder.bitcast(above, ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.IntType(LANES)(0))

    return types.boolean(value, bound), generate


def _address(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    array = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=args[0])
    place = builder.gep(array.data, [args[1]])
    return builder.bitcast(place, _VECTOR.as_pointer())


def _define(symbol: Callable[[Any, Any], Any], instruction: str) -> None:
    """Give two vectors an operator."""

    @intrinsic  # type: ignore[misc]
    def compute(typing, a, b):  # type: ignore[no-untyped-def]  # noqa: ARG001
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
            return getattr(builder, instruction)(*args)

        return lanes(a, b), generate

    @overload(symbol)
    def _overload(a, b):  # type: ignore[no-untyped-def]
        if isinstance(a, LanesType) and isinstance(b, LanesType):
            return lambda a, b: compute(a, b)  # noqa: PLW0108
        return None


for _symbol, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _define(_symbol, _instruction)
