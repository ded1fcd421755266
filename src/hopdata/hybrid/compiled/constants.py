"""What machine code was made from besides the function's text, and if it is still so.

Numba turns the globals, closures and attributes of modules that a function reads into
constants, and a call of another compiled function into a call of its machine code at
that time. A change of one of these has no effect on code that has been made. So each
function remembers them, a system compares them at the beginning of each solve, and what
has changed is compiled anew.

A name is compared by the identity of its value and, if that differs, by the value; an
array also by its bytes, because it may be changed in place. Not compared are attributes
of `math`, `cmath`, `numpy` and `numba`, and arrays that cannot be written to.
"""

from __future__ import annotations

import dis
from collections.abc import Callable, Iterable, Iterator
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.extending import is_jitted

Function = Callable[..., Any]
ABSENT = object()
# Modules whose attributes stay.
UNCHANGING = frozenset({"math", "cmath", "numpy", "numba"})
SCALARS = (bool, int, float, complex, str, bytes, np.generic)


class Constants:
    """The constants of some functions, as they are when this object is made.

    Parameters
    ----------
    compiled : iterable of callable
        Functions that are compiled.
    in_python : iterable of callable
        Functions that Python runs. They see each change themselves; only the compiled
        functions that they call are remembered.
    """

    def __init__(
        self, compiled: Iterable[Function] = (), in_python: Iterable[Function] = ()
    ) -> None:
        self._names: list[tuple[dict[str, Any], str, Any]] = []
        self._cells: list[tuple[CellType, str, Any]] = []
        self._arrays: list[tuple[np.ndarray[Any, Any], str, bytes]] = []
        self.dispatchers: list[Any] = []  # a function follows those that it calls
        self._seen: set[tuple[Any, ...]] = set()
        for function in compiled:
            self._add("", function, True)
        for function in in_python:
            self._add("", function, False)
        self._seen.clear()

    def joined(self, others: Iterable[Constants]) -> Constants:
        """Return these constants and those of others, each as it was remembered."""
        parts = (self, *others)
        whole = Constants()
        whole._names = _once(entry for one in parts for entry in one._names)
        whole._cells = _once(entry for one in parts for entry in one._cells)
        whole._arrays = [entry for one in parts for entry in one._arrays]
        whole.dispatchers = [entry for one in parts for entry in one.dispatchers]
        return whole

    def are_current(self) -> bool:
        """Return whether all are as they were; takes some 40 ns for each name."""
        for names, name, value in self._names:
            found = names.get(name, ABSENT)
            # Identity first, because a call takes longer.
            if found is not value and not _same(found, value):
                return False
        for cell, _, value in self._cells:
            found = _content(cell)
            if found is not value and not _same(found, value):
                return False
        return all(array.tobytes() == kept for array, _, kept in self._arrays)

    def changed(self) -> tuple[str, ...]:
        """Return the names whose values have changed."""
        changed = []
        for names, name, then in self._names:
            if not _same(names.get(name, ABSENT), then):
                changed.append(name)
        for cell, name, then in self._cells:
            if not _same(_content(cell), then):
                changed.append(name)
        for array, name, kept in self._arrays:
            if array.tobytes() != kept:
                changed.append(name)
        return tuple(dict.fromkeys(changed))

    def values(self) -> dict[str, Any]:
        """Return the numbers, texts and arrays among the constants, by their names.

        Those in a tuple have the tuple's name and their places in it: `gains[0]`,
        `gains[1][2]`.
        """
        found: dict[str, Any] = {}
        for _, name, value in (*self._names, *self._cells):
            found |= _scalars_in(name, value)
        return found | {name: kept for _, name, kept in self._arrays}

    def _add(self, name: str, value: Any, compiled: bool) -> None:
        """Add what a value reaches, whose name is for the message."""
        key = id(value), compiled
        if key in self._seen:
            return
        self._seen.add(key)
        if is_jitted(value):
            called: Any = value
            self._add_references(called.py_func, True)
            self.dispatchers.append(value)
        elif isinstance(value, FunctionType):
            self._add_references(value, compiled)
        elif isinstance(value, tuple):
            for place, item in enumerate(value):
                self._add(f"{name}[{place}]", item, compiled)
        elif isinstance(value, np.ndarray) and compiled and _may_change(value):
            self._arrays.append((value, name, value.tobytes()))

    def _add_references(self, function: FunctionType, compiled: bool) -> None:
        for holder, name, value in _references(function):
            key = id(holder), name
            if compiled and key not in self._seen:
                self._seen.add(key)
                if isinstance(holder, CellType):
                    self._cells.append((holder, name, value))
                else:
                    self._names.append((holder, name, value))
            self._add(name, value, compiled)


def _scalars_in(name: str, value: Any) -> dict[str, Any]:
    """Return a number, text or array by its name, those in a tuple by their places."""
    if isinstance(value, SCALARS):
        return {name: value}
    if isinstance(value, np.ndarray):
        return {name: value.tobytes()}
    if not isinstance(value, tuple):
        return {}
    found: dict[str, Any] = {f"len({name})": len(value)}
    for place, item in enumerate(value):
        found |= _scalars_in(f"{name}[{place}]", item)
    return found


def _once(entries: Iterable[tuple[Any, str, Any]]) -> list[tuple[Any, str, Any]]:
    """Return entries without those of the same holder, name and value."""
    found = {(id(entry[0]), entry[1], id(entry[2])): entry for entry in entries}
    return list(found.values())


def _references(function: FunctionType) -> Iterator[tuple[Any, str, Any]]:
    """Yield holder, name and value of what a function reads.

    The holder is a dictionary of names or a cell.
    """
    names = function.__code__.co_freevars
    cells = dict(zip(names, function.__closure__ or (), strict=True))
    for code in _codes(function.__code__):
        holder: Any = None  # of the value that the instruction before has read
        value: Any = None
        for step in dis.get_instructions(code):
            reads_attribute = step.opname in ("LOAD_ATTR", "LOAD_METHOD")
            reads_cell = step.opname in ("LOAD_DEREF", "LOAD_CLASSDEREF")
            if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
                holder = function.__globals__
                value = holder.get(step.argval, ABSENT)
            elif reads_cell and step.argval in cells:
                holder = cells[step.argval]
                value = _content(holder)
            elif reads_attribute and _may_vary(value):
                holder = vars(value)
                value = holder.get(step.argval, ABSENT)
            elif step.opname in ("CACHE", "PUSH_NULL", "NOP"):
                continue
            else:
                holder = None
                value = None
                continue
            yield holder, step.argval, value


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield the code of a function and of the functions that are defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _may_vary(value: Any) -> bool:
    """Return whether a value is a module whose attributes may be given other values."""
    if not isinstance(value, ModuleType):
        return False
    return value.__name__.partition(".")[0] not in UNCHANGING


def _may_change(array: np.ndarray[Any, Any]) -> bool:
    """Return whether an array can be written to, itself or as part of another."""
    return array.flags.writeable or array.base is not None


def _content(cell: CellType) -> Any:
    """Return the value of a closure's variable."""
    try:
        return cell.cell_contents
    except ValueError:  # it has none yet, or no longer
        return ABSENT


def _same(one: Any, other: Any) -> bool:
    """Return whether two objects are the same constant to compiled code."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, tuple):
        pairs = zip(one, other, strict=False)
        return len(one) == len(other) and all(_same(a, b) for a, b in pairs)
    return isinstance(one, SCALARS) and repr(one) == repr(other)


# What each function of the user's that is decorated by Numba was made from. Numba
# compiles such a function once for each set of types, and uses the machine code in all
# functions that call it. The record is an attribute of the function: it refers to the
# function, so a table of the module's would keep both for ever.
MADE_FROM = "_hopdata_made_from"


def renew_called(constants: Constants) -> None:
    """Compile called functions anew if what they were made from has changed."""
    for dispatcher in dict.fromkeys(constants.dispatchers):
        known = getattr(dispatcher, MADE_FROM, None)
        if known is not None and known.are_current():
            continue
        if known is not None:
            dispatcher.recompile()
        setattr(dispatcher, MADE_FROM, Constants([dispatcher]))
