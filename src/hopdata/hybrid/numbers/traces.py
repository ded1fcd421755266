# ruff: noqa: ARG001 (Numba prescribes signatures)
"""A Numba type of numbers that remember from which states they were made.

A `Trace` is a value and the address of a node: a record of two other nodes and of the
arena, the memory in which it stands. A state's node is a leaf; what is computed from
two numbers with nodes gets a new node above both. A number without a node is known: it
is the same whatever the states are. So a field that has run with traces tells which
states each rate depends on, and no value matters.

A comparison of numbers with nodes may go either way. Its answer is a bit that the
caller chooses, so that it can run the code along every path. Where a node reaches an
index or the end of a loop, nothing is known, and LOST is set.
"""

import builtins
from typing import Any

import numpy as np
from numba import types
from numba.extending import lower_builtin, lower_cast, models, register_model

from hopdata.hybrid.compiled.memory import NumberLike, int_vector, is_scalar
from hopdata.hybrid.compiled.terms import (
    LONG,
    TRUTH,
    Code,
    called,
    called_number,
    joined,
    parts_of,
)
from hopdata.hybrid.numbers import duals
from hopdata.hybrid.numbers.answers import N_ANSWERS
from hopdata.hybrid.numbers.names import POWER
from hopdata.hybrid.numbers.new_arrays import make_arrays_of
from hopdata.private_numba import tried_first

FLOAT, INT, BOOL = types.float64, types.int64, types.boolean

# The arena: its size, the next free number, whether the code is lost, open comparisons
# met, and the bits of their answers. Nodes follow.
SIZE, NEXT, LOST, OPENED, ANSWERS = range(5)
HEADER = 5
LEFT, RIGHT, ARENA = range(3)
NODE = 3  # numbers of a node
BYTES = 8
# Numba has code for Python's own of any number of arguments, and none for just two.
EXTREMES = {builtins.min: np.minimum, builtins.max: np.maximum}


class _Trace(NumberLike):
    """The type of a trace."""


TRACE = _Trace("Trace")


@register_model(_Trace)
class _TraceModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("value", FLOAT), ("node", INT)])


def _joined(a: int, b: int) -> int:
    """Return the node of what is made from two numbers."""
    if a == 0 or a == b:
        return b
    if b == 0:
        return a
    arena = int_vector(a, NODE)[ARENA]
    head = int_vector(arena, HEADER)
    place = head[NEXT]
    if place + NODE > head[SIZE]:
        head[LOST] = 1
        return a
    head[NEXT] = place + NODE
    found = arena + BYTES * place
    made = int_vector(found, NODE)
    made[LEFT] = a
    made[RIGHT] = b
    made[ARENA] = arena
    return found


def _lose(node: int) -> int:
    """Note that a number with a node decides an index or the end of a loop."""
    if node != 0:
        int_vector(int_vector(node, NODE)[ARENA], HEADER)[LOST] = 1
    return node


def _answered(node: int, known: bool) -> bool:
    """Return the answer of a comparison: the next bit, or the known one."""
    if node == 0:
        return known
    head = int_vector(int_vector(node, NODE)[ARENA], HEADER)
    count = head[OPENED]
    head[OPENED] = count + 1
    if count >= N_ANSWERS:
        head[LOST] = 1
        return known
    return (head[ANSWERS] >> count) & 1 != 0


def _parts(context: Any, builder: Any, kind: Any, value: Any) -> tuple[Any, Any]:
    """Build value and node of a trace, or of a number."""
    if kind == TRACE:
        number, node = parts_of(builder, value, 2)
        return number, node
    kind = types.unliteral(kind)
    if isinstance(kind, types.Array):
        value = builder.load(context.make_array(kind)(context, builder, value).data)
        kind = kind.dtype
    return context.cast(builder, value, kind, FLOAT), LONG(0)


def _made(context: Any, builder: Any, value: Any, node: Any) -> Any:
    return joined(builder, context.get_value_type(TRACE), value, node)


def _above(context: Any, builder: Any, nodes: list[Any]) -> Any:
    """Build the node above all of some."""
    found = nodes[0]
    for node in nodes[1:]:
        sign = INT(INT, INT)
        found = context.compile_internal(builder, _joined, sign, (found, node))
    return found


def _cast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    return _made(context, builder, *_parts(context, builder, given, value))


for _number in (types.Float, types.Integer, types.IntegerLiteral, types.Boolean):
    lower_cast(_number, _Trace)(_cast)


def _fits(kinds: Any) -> bool:
    return TRACE in kinds and all(one == TRACE or is_scalar(one) for one in kinds)


def _operation(key: Any, count: int | None, returned: Any) -> None:
    """Give a function of `count` numbers a meaning; None: of three or more."""

    def typed(*kinds: Any) -> Any:
        plain = tuple(map(types.unliteral, kinds))
        fits = len(plain) == count or (count is None and len(plain) > 2)
        if not fits or not _fits(plain):
            return None
        if count is None:
            return TRACE(*(TRACE for _ in plain))
        result = returned if returned in (BOOL, INT) else TRACE
        return result(*plain)

    def lower(context: Any, builder: Any, sign: Any, values: Any) -> Any:
        pairs = zip(sign.args, values, strict=True)
        parts = [_parts(context, builder, *pair) for pair in pairs]
        node = _above(context, builder, [one for _, one in parts])
        code = Code(context, builder)
        numbers = [one for one, _ in parts]
        kinds = (FLOAT,) * len(numbers)
        if key in EXTREMES:
            found, kind = numbers[0], FLOAT
            for other in numbers[1:]:
                pair = found, other
                found, _ = called(code, EXTREMES[key], (FLOAT, FLOAT), pair)
        else:
            found, kind = called(code, key, kinds, numbers)
        if returned == BOOL:
            found = context.cast(builder, found, kind, BOOL)
            sign = BOOL(INT, BOOL)
            return context.compile_internal(builder, _answered, sign, (node, found))
        if returned == INT:
            context.compile_internal(builder, _lose, INT(INT), (node,))
            return context.cast(builder, found, kind, INT)
        return _made(context, builder, context.cast(builder, found, kind, FLOAT), node)

    tried_first(key, typed)
    kinds = (_Trace, types.Float, types.Integer, types.Boolean, types.Array)
    if count is None:
        lower_builtin(key, _Trace, _Trace, _Trace, types.VarArg(types.Any))(lower)
        return
    for chosen in np.ndindex(*(count * (len(kinds),))):
        if 0 in chosen:
            lower_builtin(key, *(kinds[place] for place in chosen))(lower)


for _key, _count, _returned in duals.OPERATIONS:
    _operation(_key, _count, _returned)
for _key in POWER:
    _operation(_key, 2, None)
for _key in EXTREMES:
    _operation(_key, None, None)


def _typed_where(*kinds: Any) -> Any:
    plain = tuple(map(types.unliteral, kinds))
    if len(plain) == 3 and plain[0] == BOOL and _fits(plain[1:]):
        return TRACE(*plain)
    return None


def _where(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    sides = []
    for kind, value in zip(sign.args[1:], values[1:], strict=True):
        sides.append(_parts(context, builder, kind, value))
    truth = builder.trunc(values[0], TRUTH)
    value = builder.select(truth, sides[0][0], sides[1][0])
    node = _above(context, builder, [one for _, one in sides])
    return _made(context, builder, value, node)


tried_first(np.where, _typed_where)
for _kinds in ((_Trace, types.Any), (types.Float, _Trace), (types.Integer, _Trace)):
    lower_builtin(np.where, types.Boolean, *_kinds)(_where)


def _typed_table(*kinds: Any) -> Any:
    is_table = all(isinstance(kind, types.Array) for kind in kinds[1:])
    if len(kinds) == 3 and kinds[0] == TRACE and is_table:
        return TRACE(*kinds)
    return None


def _table(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    number, node = _parts(context, builder, TRACE, values[0])
    code = Code(context, builder)
    kinds = (FLOAT, *sign.args[1:])
    value = called_number(code, np.interp, kinds, (number, *values[1:]))
    return _made(context, builder, value.built, node)


tried_first(np.interp, _typed_table)
lower_builtin(np.interp, _Trace, types.Array, types.Array)(_table)
make_arrays_of(TRACE)
