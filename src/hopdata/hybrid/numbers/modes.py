"""Whether what a field does with the time is the same in all modes, by its source.

Then a stretch of time in which the field does not jump in one mode is clear of jumps in
each other mode. It is so if nothing that takes the time is done, or left out, because
of the mode, and if nothing jumps by both together. Where the source is not understood,
the mode may matter.
"""

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import FunctionType
from typing import Any

from hopdata.hybrid.numbers.source import (
    COUNTS,
    DEFINING,
    SMOOTH,
    Judged,
    _assignments,
    _changed,
    _Code,
    _known,
    _positional,
    _shared,
    definition,
)

Found = dict[Any, Any]

# Statements after which the rest of a loop or of a function is left out.
LEAVING = (ast.Return, ast.Break, ast.Continue, ast.Raise)
# What is too hard to follow.
HARD = (*DEFINING, ast.Lambda, ast.Try, ast.With, ast.Match, ast.Assert, ast.While)
LOOPS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


def is_same_in_all_modes(
    function: Any,
    times: Iterable[int],
    modes: Iterable[int],
    only_read: Iterable[int] = (),
    judged: Judged = frozenset(),
    found: Found | None = None,
) -> bool:
    """Return whether jumps of a function in time are surely the same in all modes.

    Parameters
    ----------
    function : callable
        A Python function.
    times, modes : iterable of int
        Positions of the arguments that depend on the time, and on the mode.
    only_read : iterable of int, optional
        Positions of arrays to which it does not write, nor a helper of it.
    judged : frozenset, optional
        Code and arguments of the functions that call this one.
    found : dict, optional
        What is known of functions already.
    """
    found = {} if found is None else found
    places = (*times, -1, *modes)
    if not isinstance(function, FunctionType) or (function.__code__, places) in judged:
        return False
    node = _definition(function, found)
    if node is None:
        return False
    arguments = _positional(node)
    if any(place >= len(arguments) for place in places):  # an argument of *args
        return False
    known = _known(function)
    inside = judged | {(function.__code__, places)}
    fixed = frozenset(arguments[place] for place in only_read)
    by_time = _Followed({arguments[place] for place in times}, known, inside, found)
    by_mode = _Followed({arguments[place] for place in modes}, known, inside, found)
    try:
        by_time.spread(node, fixed)
        by_mode.spread(node, fixed)
        both = _Both(by_time, by_mode, fixed)
        return all(both.is_free(one, False) for one in node.body)
    except RecursionError:
        return False


def _definition(function: FunctionType, found: Found) -> ast.FunctionDef | None:
    """Return the definition of a function, or None; each source is read once."""
    if function not in found:
        found[function] = definition(function)
    node: ast.FunctionDef | None = found[function]
    return node


@dataclass
class _Followed(_Code):
    """Code in which names also get a varying value where something varying decides.

    Parameters
    ----------
    found : dict
        What is known of functions already: their definitions, and to which of their
        arguments they surely do not write.
    """

    found: Found

    def _spread_from(self, one: ast.AST, fixed: frozenset[str]) -> None:
        for target, value in _assignments(one):
            if self.varies(value):
                self.varying |= set(_changed(target))
            elif self.varies(target):  # an array may be changed by its other name
                self.varying |= set(_names_of_arrays(self, value)) - fixed
        if _is_chosen(self, one):
            self.varying |= set(_written_in(one)) - fixed
        elif isinstance(one, ast.Call) and self.varies(one):
            self.varying |= set(_written_by(self, one)) - fixed


def _is_chosen(code: _Code, node: ast.AST) -> bool:
    """Return whether parts of a node are done, or left out, by what varies."""
    if isinstance(node, ast.If | ast.IfExp):
        return code.varies(node.test)
    if isinstance(node, ast.For):
        return code.varies(node.iter)
    if isinstance(node, ast.BoolOp):
        return code.varies(node)
    if isinstance(node, LOOPS):
        return code.varies(node)
    return False


def _written_in(node: ast.AST) -> Iterator[str]:
    """Yield the names that may get a value, or a new content, in a node."""
    for one in ast.walk(node):
        if isinstance(one, ast.Assign):
            for target in one.targets:
                yield from _changed(target)
        elif isinstance(one, ast.AugAssign | ast.NamedExpr | ast.AnnAssign | ast.For):
            yield from _changed(one.target)
        elif isinstance(one, ast.Call):
            yield from _plain_arguments(one)


def _plain_arguments(node: ast.Call) -> Iterator[str]:
    """Yield the names of the arrays that a call takes, whole or as slices."""
    for one in node.args:
        yield from _shared(one)


def _written_by(code: _Followed, node: ast.Call) -> Iterator[str]:
    """Yield the names of the arrays to which a call may write."""
    for place, one in enumerate(node.args):
        if not _only_reads(code, node, place, frozenset()):
            yield from _shared(one)


def _names_of_arrays(code: _Followed, value: ast.AST) -> Iterator[str]:
    """Yield the names of arrays that a value may be, or have among its parts."""
    yield from _shared(value)
    if isinstance(value, ast.Tuple | ast.List):
        for one in value.elts:
            yield from _names_of_arrays(code, one)
    elif isinstance(value, ast.IfExp):
        yield from _names_of_arrays(code, value.body)
        yield from _names_of_arrays(code, value.orelse)
    elif isinstance(value, ast.Attribute):
        yield from _changed(value)
    elif isinstance(value, ast.Call):
        if not code.called(value):
            yield from _changed(value.func)  # a method of an array
        yield from _written_by(code, value)


def _helper_of(code: _Code, node: ast.Call) -> Any:
    """Return the Python function that a call calls, or None."""
    value = None
    if isinstance(node.func, ast.Name):
        value = code.known.get(node.func.id)
    return getattr(value, "py_func", value)


def _only_reads(
    code: _Followed, node: ast.Call, place: int, judged: frozenset[tuple[Any, int]]
) -> bool:
    """Return whether a call surely does not write to an argument, nor keep it."""
    if node.keywords or any(isinstance(one, ast.Starred) for one in node.args):
        return False
    called = code.called(node)
    if called:
        return called in SMOOTH or called in COUNTS
    helper = _helper_of(code, node)
    if not isinstance(helper, FunctionType) or (helper, place) in judged:
        return False
    inner = _definition(helper, code.found)
    if inner is None or place >= len(_positional(inner)):
        return False
    if (helper, place) not in code.found:
        name = _positional(inner)[place]
        own = _Followed(set(), _known(helper), frozenset(), code.found)
        inside = judged | {(helper, place)}
        parts = (one for statement in inner.body for one in ast.walk(statement))
        reads = all(_leaves_alone(own, one, name, inside) for one in parts)
        code.found[(helper, place)] = reads
    return bool(code.found[(helper, place)])


def _leaves_alone(
    code: _Followed, node: ast.AST, name: str, judged: frozenset[tuple[Any, int]]
) -> bool:
    """Return whether a node itself neither writes to an array nor gives it a name."""
    if isinstance(node, ast.Call):
        places = [i for i, one in enumerate(node.args) if name in set(_shared(one))]
        return all(_only_reads(code, node, place, judged) for place in places)
    if isinstance(node, ast.Attribute | ast.Starred):
        return name not in set(_changed(node.value))
    if isinstance(node, ast.Return):
        return node.value is None or name not in set(_names_of_arrays(code, node.value))
    for target, value in _assignments(node):
        if name in {*_changed(target), *_names_of_arrays(code, value)}:
            return False
    return not isinstance(node, HARD)


class _Both:
    """What in a function's code depends on the time, and what on the mode."""

    def __init__(
        self, by_time: _Followed, by_mode: _Followed, fixed: frozenset[str]
    ) -> None:
        self.by_time = by_time
        self.by_mode = by_mode
        self.fixed = fixed

    def is_free(self, node: ast.AST, chosen: bool) -> bool:
        """Return whether a node surely does the same with the time in all modes.

        `chosen` says whether it is done, or left out, by the mode.
        """
        if isinstance(node, HARD):
            return False
        if chosen and (isinstance(node, LEAVING) or self.by_time.is_branch(node)):
            return False
        if self._jumps_by_both(node):
            return False
        inside = chosen or _is_chosen(self.by_mode, node)
        return all(self.is_free(one, inside) for one in ast.iter_child_nodes(node))

    def _jumps_by_both(self, node: ast.AST) -> bool:
        """Return whether a node may jump in time where the mode says."""
        part: ast.AST = node
        if isinstance(node, ast.If | ast.IfExp):
            part = node.test
        elif isinstance(node, ast.For):
            part = node.iter
        elif isinstance(node, ast.stmt) and not isinstance(node, ast.AugAssign):
            return False  # its parts are judged
        if not (self.by_time.varies(part) and self.by_mode.varies(part)):
            return False
        if isinstance(node, ast.Call) and not self.by_time.called(node):
            return not self._helper_is_free(node)
        return self.by_time.is_branch(node)

    def _helper_is_free(self, node: ast.Call) -> bool:
        """Return whether a helper that takes both time and mode is free."""
        if node.keywords or any(isinstance(one, ast.Starred) for one in node.args):
            return False
        helper = _helper_of(self.by_time, node)
        times = [i for i, one in enumerate(node.args) if self.by_time.varies(one)]
        modes = [i for i, one in enumerate(node.args) if self.by_mode.varies(one)]
        read = []
        for place, one in enumerate(node.args):
            if isinstance(one, ast.Name) and one.id in self.fixed:
                read.append(place)
        known = self.by_time
        return is_same_in_all_modes(
            helper, times, modes, read, known.judged, known.found
        )
