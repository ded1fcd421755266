"""Formulas of the code that is being generated, written as formulas.

LLVM builds code by one call for each instruction, `builder.fadd(x, y)`, so a formula
of ten operations is hard to read. A `Term` is a value of that code on which Python's
operators work: ``(x - 1.0) * (x + 1.0)`` builds two sums and a product. `of` calls what
Numba knows for plain numbers, `where` chooses, and `Cells` are numbers in memory.

A `Term` knows LLVM's types alone. Numbers of other kinds, whose operations Numba looks
up by their types, have the same operators (`numbers.moving`).
"""

import operator
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types

FLOAT = types.float64
DOUBLE = ir.DoubleType()
LONG = ir.IntType(64)
LANE = ir.IntType(32)  # of the place of a number in a vector
TRUTH = ir.IntType(1)
BYTES = 8  # of a number
Value = Any  # of LLVM


class Operators:
    """Python's operators for the numbers of a formula, each by `_apply`."""

    def _apply(self, key: Any, *operands: Any) -> Any:
        """Build an operation, of which one operand is this number."""
        raise NotImplementedError

    def __add__(self, other: Any) -> Any:
        return self._apply(operator.add, self, other)

    def __radd__(self, other: Any) -> Any:
        return self._apply(operator.add, other, self)

    def __sub__(self, other: Any) -> Any:
        return self._apply(operator.sub, self, other)

    def __rsub__(self, other: Any) -> Any:
        return self._apply(operator.sub, other, self)

    def __mul__(self, other: Any) -> Any:
        return self._apply(operator.mul, self, other)

    def __rmul__(self, other: Any) -> Any:
        return self._apply(operator.mul, other, self)

    def __truediv__(self, other: Any) -> Any:
        return self._apply(operator.truediv, self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return self._apply(operator.truediv, other, self)

    def __mod__(self, other: Any) -> Any:
        return self._apply(operator.mod, self, other)

    def __neg__(self) -> Any:
        return self._apply(operator.neg, self)


class Code(NamedTuple):
    """Where code is being generated: Numba's context, and LLVM's builder."""

    context: Any
    llvm: Any


# The builder's method for each operation on numbers and on vectors of them.
INSTRUCTIONS = {
    operator.add: "fadd",
    operator.sub: "fsub",
    operator.mul: "fmul",
    operator.truediv: "fdiv",
    operator.neg: "fneg",
}


class Term(Operators):
    """A number, a vector of numbers, or truth values, of the generated code.

    A number of Python among the operands becomes a constant, and a number beside a
    vector stands for each of its lanes. Comparisons are false where one side is NaN.

    Parameters
    ----------
    code : Code
        Where it stands.
    built : LLVM value
        Its value.
    """

    def __init__(self, code: Code, built: Value) -> None:
        self.code = code
        self.built = built

    def _like(self, other: Any) -> Value:
        """Return another operand as a value of this type."""
        kind = self.built.type
        if not isinstance(other, Term):
            if isinstance(kind, ir.VectorType):
                return ir.Constant(kind, [other] * kind.count)
            return ir.Constant(kind, other)
        if isinstance(kind, ir.VectorType):
            return spread(self.code.llvm, other.built, kind)
        return other.built

    def _apply(self, key: Any, *operands: Any) -> "Term":
        like: Term = self
        for one in operands:
            if isinstance(one, Term) and isinstance(one.built.type, ir.VectorType):
                like = one
        method = getattr(self.code.llvm, INSTRUCTIONS[key])
        return Term(self.code, method(*(like._like(one) for one in operands)))

    def compared(self, sign: str, other: Any) -> "Term":
        """Compare, by "<", "==" or another sign."""
        found = self.code.llvm.fcmp_ordered(sign, self.built, self._like(other))
        return Term(self.code, found)

    def __lt__(self, other: Any) -> "Term":
        return self.compared("<", other)

    def __le__(self, other: Any) -> "Term":
        return self.compared("<=", other)

    def __gt__(self, other: Any) -> "Term":
        return self.compared(">", other)

    def __ge__(self, other: Any) -> "Term":
        return self.compared(">=", other)

    def equals(self, other: Any) -> "Term":
        """Return whether both are the same."""
        return self.compared("==", other)

    def __and__(self, other: "Term") -> "Term":
        return Term(self.code, self.code.llvm.and_(self.built, other.built))

    def __or__(self, other: "Term") -> "Term":
        return Term(self.code, self.code.llvm.or_(self.built, other.built))

    def __invert__(self) -> "Term":
        return Term(self.code, self.code.llvm.not_(self.built))

    def lane(self, place: int) -> "Term":
        """Return the number at a place of a vector."""
        return Term(self.code, self.code.llvm.extract_element(self.built, LANE(place)))

    def picked(self, places: list[int], other: "Term | None" = None) -> "Term":
        """Return the vector of the numbers at these places; those of `other` follow."""
        beyond = ir.Constant(self.built.type, ir.Undefined)
        if other is not None:
            beyond = other.built
        taken = ir.Constant(ir.VectorType(LANE, len(places)), places)
        found = self.code.llvm.shuffle_vector(self.built, beyond, taken)
        return Term(self.code, found)

    def intrinsic(self, name: str, *others: Any) -> "Term":
        """Call a function of LLVM's on vectors like this one."""
        kind = self.built.type
        given = [self.built, *(self._like(one) for one in others)]
        native = ir.FunctionType(kind, [kind] * len(given))
        full = f"llvm.{name}.v{kind.count}f64"
        function = declared(self.code.llvm, native, full)
        return Term(self.code, self.code.llvm.call(function, given))


def where(truth: Term, one: Any, other: Any) -> Term:
    """Choose; at least one of the sides is a term."""
    like = one if isinstance(one, Term) else other
    sides = like._like(one), like._like(other)
    return Term(like.code, like.code.llvm.select(truth.built, *sides))


def of(key: Any, *numbers: Any) -> Term:
    """Call what Numba knows by this key; at least one of the numbers is a term."""
    like = next(one for one in numbers if isinstance(one, Term))
    values = [like._like(one) for one in numbers]
    return called_number(like.code, key, (FLOAT,) * len(values), values)


def called_number(code: Code, key: Any, kinds: Any, values: Any) -> Term:
    """Call what Numba knows by this key for these types; the result is a number."""
    result, returned = called(code, key, kinds, values)
    return Term(code, code.context.cast(code.llvm, result, returned, FLOAT))


def called(code: Code, key: Any, kinds: Any, values: Any) -> tuple[Value, Any]:
    """Call what Numba knows by this key for these types; return result and its type."""
    context, builder = code
    typing = context.typing_context
    function = typing.resolve_value_type(key)
    sign = typing.resolve_function_type(function, tuple(kinds), {})
    made = context.get_function(function, sign)
    given = []
    for kind, wanted, value in zip(kinds, sign.args, values, strict=True):
        if kind != wanted:
            value = context.cast(builder, value, kind, wanted)
        given.append(value)
    result = made(builder, given)
    context.add_linking_libs(getattr(made, "libs", ()))
    return result, sign.return_type


# Pieces of LLVM's.


def declared(builder: Any, native: Any, name: str) -> Value:
    """Return a function elsewhere by its name."""
    known = builder.module.globals.get(name)
    return known or ir.Function(builder.module, native, name)


def spread(builder: Any, number: Value, kind: ir.VectorType) -> Value:
    """Build the vector that has a number in all places; a vector remains."""
    if number.type == kind:
        return number
    if isinstance(number, ir.Constant):
        return ir.Constant(kind, [number.constant] * kind.count)
    none = ir.Constant(kind, ir.Undefined)
    one = builder.insert_element(none, number, LANE(0))
    all_first = ir.Constant(ir.VectorType(LANE, kind.count), [0] * kind.count)
    return builder.shuffle_vector(one, none, all_first)


def joined(builder: Any, kind: Any, *parts: Value) -> Value:
    """Build a structure of its parts."""
    whole = ir.Constant(kind, ir.Undefined)
    for place, part in enumerate(parts):
        whole = builder.insert_value(whole, part, place)
    return whole


def parts_of(builder: Any, whole: Value, count: int) -> list[Value]:
    """Build the first parts of a structure."""
    return [builder.extract_value(whole, place) for place in range(count)]


def lanes_of(builder: Any, vector: Value, count: int) -> list[Value]:
    """Build the first numbers of a vector."""
    return [builder.extract_element(vector, LANE(place)) for place in range(count)]


def vector_of(builder: Any, kind: ir.VectorType, numbers: list[Value]) -> Value:
    """Build a vector that begins with these numbers; the others are zero."""
    vector = ir.Constant(kind, [0.0] * kind.count)
    for place, number in enumerate(numbers):
        vector = builder.insert_element(vector, number, LANE(place))
    return vector


def room(builder: Any, kind: Any, count: int | None = None) -> Value:
    """Build room on the stack, once for a whole function; return its pointer."""
    with builder.goto_entry_block():
        return builder.alloca(kind, count)


class Cells:
    """Numbers of 8 bytes in memory, from an address on."""

    def __init__(self, builder: Any, address: Value) -> None:
        self.llvm = builder
        self.address = address

    def pointer(self, place: Any, kind: Any = DOUBLE) -> Value:
        """Build the pointer to a value of this type at a place."""
        if isinstance(place, int):
            place = LONG(place)
        start = self.llvm.inttoptr(self.address, DOUBLE.as_pointer())
        return self.llvm.bitcast(self.llvm.gep(start, [place]), kind.as_pointer())

    def load(self, place: Any, kind: Any = DOUBLE) -> Value:
        """Build the value of this type, or vector, from a place on."""
        return self.llvm.load(self.pointer(place, kind), align=BYTES)

    def store(self, value: Value, place: Any) -> None:
        """Build what writes a value from a place on."""
        self.llvm.store(value, self.pointer(place, value.type), align=BYTES)
