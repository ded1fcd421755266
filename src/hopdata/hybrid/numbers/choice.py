"""Whether guards may be left out of an evaluation, as their source shows.

A guard that is left out keeps the range that it had over a larger piece of the state
space. That is right if nothing but time, the states and the parameters decides its
value: its code has no branches, reads neither the mode nor what it has written, and
takes the rates of the states for `hdot` alone. Where the source shows anything else,
no guard is left out.
"""

import ast
import builtins
import inspect
import textwrap
from collections.abc import Iterator
from tokenize import TokenError
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

import numpy as np

STATEMENTS = (ast.Assign, ast.For, ast.Expr, ast.Pass)
EXPRESSIONS = (
    ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Constant, ast.Subscript,
    ast.Attribute, ast.Tuple, ast.operator, ast.UAdd, ast.USub, ast.expr_context,
)  # fmt: skip
# Arguments of @guards, in their order.
ARGUMENTS = ("t", "y", "dy", "mode", "params", "h", "hdot")
COUNTS = (len, range)


def may_be_left_out(guards: Any) -> bool:
    """Return whether a guard's range over a larger piece serves for a smaller one.

    Parameters
    ----------
    guards : Callback
        The guards, declared together.
    """
    function = guards.function
    if hasattr(guards, "inner") or guards.form is not None:
        return False
    if not isinstance(function, FunctionType) or hasattr(function, "__wrapped__"):
        return False
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError, RecursionError, TokenError):
        return False
    node = tree.body[0]
    if not isinstance(node, ast.FunctionDef):
        return False
    names = [one.arg for one in node.args.args]
    if len(names) != len(ARGUMENTS) or node.args.posonlyargs or node.args.kwonlyargs:
        return False
    if tuple(names) != function.__code__.co_varnames[: len(names)]:
        return False
    named = dict(zip(ARGUMENTS, names, strict=True))
    return _is_plain(node.body, function) and _flows(node.body, named)


def _is_plain(
    body: list[ast.stmt], function: FunctionType, in_loop: bool = False
) -> bool:
    """Return whether statements only compute, with functions that do not branch.

    In a loop, no function but those of COUNTS may be called: its call would not be left
    out, so nothing would be won.
    """
    for statement in body:
        if not isinstance(statement, STATEMENTS):
            return False
        parts: list[ast.expr] = []
        if isinstance(statement, ast.For):
            if statement.orelse or not _is_plain(statement.body, function, True):
                return False
            parts = [statement.target, statement.iter]
        elif isinstance(statement, ast.Assign):
            parts = [*statement.targets, statement.value]
        elif isinstance(statement, ast.Expr):
            parts = [statement.value]
        inside = [one for part in parts for one in ast.walk(part)]
        if not all(_is_allowed(one, function, in_loop) for one in inside):
            return False
    return True


def _is_allowed(node: ast.AST, function: FunctionType, in_loop: bool) -> bool:
    """Return whether a part of an expression only computes."""
    if not isinstance(node, EXPRESSIONS):
        return False
    if not isinstance(node, ast.Call):
        return True
    if in_loop and _meant(node.func, function) not in COUNTS:
        return False
    return _is_known_call(node, function)


def _is_known_call(call: ast.Call, function: FunctionType) -> bool:
    """Return whether a ufunc, a function of `math`, or a built-in one is called."""
    called = _meant(call.func, function)
    if call.keywords:
        return False
    return isinstance(called, np.ufunc | BuiltinFunctionType) or called in COUNTS


def _meant(node: ast.expr, function: FunctionType) -> Any:
    """Return what a name, or a name in a module, stands for; None if not known."""
    if isinstance(node, ast.Attribute):
        owner = _meant(node.value, function)
        if isinstance(owner, ModuleType):
            return getattr(owner, node.attr, None)
        return None
    if not isinstance(node, ast.Name) or node.id in function.__code__.co_varnames:
        return None
    known = inspect.getclosurevars(function)
    for names in (known.nonlocals, known.globals, vars(builtins)):
        if node.id in names:
            return names[node.id]
    return None


def _flows(body: list[ast.stmt], named: dict[str, str]) -> bool:
    """Return whether values depend on time, states and parameters alone.

    The rates of the states may pass through other names to `hdot`.
    """
    pairs = list(_assigned(body))
    rates = {named["dy"]}
    grown = True
    while grown:
        grown = False
        for target, value in pairs:
            if not isinstance(target, ast.Name) or target.id in rates:
                continue
            if _names(value) & rates:
                rates.add(target.id)
                grown = True
    written = (named["h"], named["hdot"])
    for target, value in pairs:
        read = set(_names(value))
        if named["mode"] in read or read & set(written):
            return False
        if isinstance(target, ast.Name):
            continue
        if not isinstance(target, ast.Subscript):
            return False
        if not isinstance(target.value, ast.Name) or target.value.id not in written:
            return False
        place = set(_names(target.slice))
        if place & (rates | set(written) | {named["mode"]}):
            return False
        if target.value.id == named["h"] and read & rates:
            return False
    return True


def _assigned(body: list[ast.stmt]) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Yield each target of an assignment, with the expression that it depends on."""
    for statement in body:
        if isinstance(statement, ast.For):
            yield statement.target, statement.iter
            yield from _assigned(statement.body)
        elif isinstance(statement, ast.Assign):
            for target in statement.targets:
                yield from _pairs(target, statement.value)


def _pairs(target: ast.expr, value: ast.expr) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Yield the parts of a target with those of the value, or with all of it."""
    if not isinstance(target, ast.Tuple):
        yield target, value
        return
    fits = isinstance(value, ast.Tuple) and len(value.elts) == len(target.elts)
    for place, one in enumerate(target.elts):
        yield from _pairs(one, value.elts[place] if fits else value)  # type: ignore[attr-defined]


def _names(node: ast.expr) -> set[str]:
    """Return the names in an expression, but for an array whose length is asked."""
    is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    if is_call and node.func.id == "len":  # type: ignore[attr-defined]
        return set()
    found = set()
    if isinstance(node, ast.Name):
        found.add(node.id)
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            found |= _names(child)
    return found
