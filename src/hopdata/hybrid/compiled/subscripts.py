"""Find the elements that a function's code names by number.

To compare them with what is there: machine code does not look whether an element exists; beyond
the end of an array it reads, and writes, whatever stands there. And to know what cannot matter:
elements that a function never names.
"""

from __future__ import annotations

import dis
from collections.abc import Callable
from types import FunctionType
from typing import Any


def largest_subscripts(function: Callable[..., Any]) -> dict[str, int]:
    """Return, for each argument that the code indexes by literal numbers, the largest of them.

    Parameters
    ----------
    function : callable
        A Python function. One that asks for a length may know what it does: it has none.
    """
    if not isinstance(function, FunctionType) or "len" in function.__code__.co_names:
        return {}
    code, largest = function.__code__, dict[str, int]()
    steps = list(dis.get_instructions(code))
    stored = {name for step in steps if "STORE_FAST" in step.opname for name in _names(step)}
    arguments = set(code.co_varnames[: code.co_argcount]) - stored
    for name, number in _literal_subscripts(steps):
        if name in arguments:
            largest[name] = max(number, largest.get(name, -1))
    return {name: number for name, number in largest.items() if number >= 0}


def elements_named(function: Callable[..., Any], position: int) -> frozenset[int] | None:
    """Return which elements of an argument a function's code names, if it names all by numbers.

    None if the argument is used in another way (indexed by a variable or from the end, handed on),
    so that any element may matter.

    Parameters
    ----------
    function : callable
        A Python function.
    position : int
        The argument's, among the positional ones.
    """
    if not isinstance(function, FunctionType) or position >= function.__code__.co_argcount:
        return None
    argument, steps = function.__code__.co_varnames[position], list(dis.get_instructions(function))
    numbers = [number for name, number in _literal_subscripts(steps) if name == argument]
    mentions = sum(_names(step).count(argument) for step in steps)
    return frozenset(numbers) if mentions == len(numbers) and min(numbers, default=0) >= 0 else None


def _literal_subscripts(steps: list[dis.Instruction]) -> list[tuple[Any, int]]:
    """Return the name and the number at each place where something is indexed by a literal."""
    return [
        (_names(array)[-1], index.argval)
        for array, index, use in zip(steps, steps[1:], steps[2:], strict=False)
        if _is_literal(index) and _is_subscript(use)
    ]


def _is_literal(step: dis.Instruction) -> bool:
    return step.opname.startswith("LOAD_") and type(step.argval) is int


def _is_subscript(step: dis.Instruction) -> bool:
    """Tell whether an instruction indexes, or (COPY) keeps array and index for doing so twice."""
    if step.opname == "BINARY_OP":  # that of Python 3.14
        return step.argrepr == "[]"
    return step.opname in ("BINARY_SUBSCR", "STORE_SUBSCR", "COPY")


def _names(step: dis.Instruction) -> tuple[str, ...]:
    return step.argval if isinstance(step.argval, tuple) else (step.argval,)
