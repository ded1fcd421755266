"""A plain function written as the integrator's own form, for machine code.

Where the source is known, each ``return`` becomes a store into the array of the result,
so that a list or an array that is returned is never made. Elsewhere the function is
called, and what it returns is stored. Its body sees numbers of whatever type the caller
passes: floats, ranges, or numbers with derivatives.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from hopdata.hybrid.compiled import stored
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.compiled.forms import Form, cells_of, same_code
from hopdata.hybrid.compiled.helpers import names_in, with_helpers, within
from hopdata.hybrid.compiled.kernel import SIGNATURES

Function = Callable[..., Any]
PREFIX = "_hopdata_"  # of names that are inserted
STORE = f"{PREFIX}store"
KNOWN = f"{STORE}_known"  # for a number of elements that a system checks
ZEROED = f"{PREFIX}zeroed"
OUTER = f"{PREFIX}outer"
EMPTY_ARRAYS = (np.zeros, np.empty, np.zeros_like, np.empty_like)


def native_arguments(kind: str) -> tuple[str, ...]:
    """Return the arguments of the function as it is written.

    Guards that return their values have no use for rates.
    """
    if kind == "guards":
        return ("t", "y", "mode", "params", "h")
    return SIGNATURES[kind].arguments


class Written:
    """A plain function in the integrator's own form.

    Parameters
    ----------
    function : FunctionType
        The user's function.
    form : Form
        Its form.

    Attributes
    ----------
    count : int or None
        Number of elements that the function returns, if its source shows it.
    arguments : tuple of str
        The arguments of the written function: those of its kind; of guards, only
        ``t, y, mode, params, h``.
    function : FunctionType
        The written function.
    """

    def __init__(self, function: FunctionType, form: Form) -> None:
        self.count: int | None = None
        self._form = form
        self.arguments = native_arguments(form.kind)
        self.function = self._from_source(function) or _around(function, form)

    def _from_source(self, function: FunctionType) -> FunctionType | None:
        """Return the function with its returns as stores, if its source is known."""
        form = self._form
        node = source_of(function)
        if node is None or set(_mangled(node)):
            return None
        known = {**function.__globals__}
        for name, cell in cells_of(function):
            try:
                known[name] = cell.cell_contents
            except ValueError:
                return None
        own = set(function.__code__.co_varnames)
        _Plainer(known.keys() | own).visit(node)
        if form.returns:
            rewriter = _Returns(form, {k: v for k, v in known.items() if k not in own})
            rewriter.rewrite(node)
            self.count = rewriter.count
        _Unpacking(form).visit(node)
        arguments, opening = _opening(form)
        node.args = ast.arguments(
            posonlyargs=[],
            args=[ast.arg(arg=name) for name in arguments],
            kwonlyargs=[],
            kw_defaults=[],
            defaults=[],
        )
        node.body = opening + node.body
        code = _compiled(node, function)
        cells = dict(cells_of(function))
        inserted = _inserted(form)
        made = FunctionType(
            code,
            {**function.__globals__, **inserted},
            function.__name__,
            None,
            tuple(cells[name] for name in code.co_freevars),
        )
        made.__module__ = function.__module__
        made.__qualname__ = function.__qualname__
        return made


def _inserted(form: Form) -> dict[str, Any]:
    """Return the names that a written function uses besides the user's."""
    names = {f"{PREFIX}{name}": value for name, value in form.bound.items()}
    known = stored.KNOWN.get(form.kind, stored.STORES[form.kind])
    store = stored.STORES[form.kind]
    return {STORE: store, KNOWN: known, ZEROED: stored.zeroed, **names}


def _opening(form: Form) -> tuple[list[str], list[ast.stmt]]:
    """Return the names of the arguments, and statements that make the user's own."""
    users = dict(zip(form.arguments, form.names, strict=True))
    arguments = []
    for name in native_arguments(form.kind):
        arguments.append(users.get(name, PREFIX + name))
    given = set(arguments)
    lines = []
    for expression, own in zip(form.arguments, form.names, strict=True):
        if own not in given:
            lines.append(f"{own} = {_of_native(expression, form, users)}")
    return arguments, list(ast.parse("\n".join(lines)).body)


def _of_native(expression: str, form: Form, users: dict[str, str]) -> str:
    """Return an expression of the kind's arguments in the written function's names."""
    name = users.get("params", f"{PREFIX}params")
    return _with_bound(expression.removeprefix("*"), form).replace("params", name)


def _with_bound(expression: str, form: Form) -> str:
    """Return an expression with the names under which constants are inserted."""
    for constant in form.bound:
        expression = re.sub(rf"\b{constant}\b", PREFIX + constant, expression)
    return expression


def _around(function: FunctionType, form: Form) -> FunctionType:
    """Return a function that calls the user's and stores what it returns."""
    arguments = native_arguments(form.kind)
    taken = []
    for expression in form.arguments:
        taken.append(_with_bound(expression, form))
    call = f"{PREFIX}inner({', '.join(taken)})"
    line = call
    if form.returns:
        line = f"{STORE}({call}, {form.result})"
    if form.kind == "on_event":
        line = f"return {line}"
    source = f"def {function.__name__}({', '.join(arguments)}): {line}\n"
    if not function.__name__.isidentifier():  # a lambda
        source = f"def plain({', '.join(arguments)}): {line}\n"
    inner = within(with_digest(with_helpers(function)))
    names: dict[str, Any] = {
        "__name__": function.__module__,
        f"{PREFIX}inner": inner,
        **_inserted(form),
    }
    exec(compile(source, function.__code__.co_filename, "exec"), names)
    made: FunctionType = names[ast.parse(source).body[0].name]  # type: ignore[attr-defined]
    made.__code__ = made.__code__.replace(
        co_firstlineno=function.__code__.co_firstlineno
    )
    made.__module__ = function.__module__
    return made


# The source.


def source_of(function: FunctionType) -> ast.FunctionDef | None:
    """Return the definition of a function, or None if it is not surely known.

    It is compiled and compared with the function, as a file may have changed since. A
    lambda becomes a definition.
    """
    if hasattr(function, "__wrapped__"):  # `inspect` would give another function's
        return None
    try:
        lines, first = inspect.getsourcelines(function)
        tree = ast.parse(textwrap.dedent("".join(lines)))
    except Exception:  # a file that is gone, or another one by now, may be any text
        return None
    ast.increment_lineno(tree, max(first, 1) - 1)
    for node in ast.walk(tree):
        found: ast.FunctionDef | None = None
        if isinstance(node, ast.FunctionDef) and node.name == function.__name__:
            found = node
            found.decorator_list = []
            found.returns = None
        elif isinstance(node, ast.Lambda) and function.__name__ == "<lambda>":
            found = _defined(node)
        if found is not None and _is_of(function, found):
            return found
    return None


def _defined(node: ast.Lambda) -> ast.FunctionDef:
    """Return a lambda as a definition."""
    body = ast.copy_location(ast.Return(value=node.body), node.body)
    made = ast.parse(f"def {PREFIX}lambda(): pass").body[0]
    assert isinstance(made, ast.FunctionDef)
    made.args = node.args
    made.body = [body]
    return ast.copy_location(made, node)


def _is_of(function: FunctionType, node: ast.FunctionDef) -> bool:
    """Return whether a definition gives the code of this function."""
    for one in ast.walk(node.args):
        if isinstance(one, ast.arg):
            one.annotation = None
    try:
        return same_code(_compiled(node, function), function.__code__)
    except (SyntaxError, ValueError):
        return False


def _compiled(node: ast.FunctionDef, function: FunctionType) -> CodeType:
    """Return the code of a definition with the function's closure around it."""
    outer = ast.parse(f"def {OUTER}({', '.join(function.__code__.co_freevars)}): pass")
    shell = outer.body[0]
    assert isinstance(shell, ast.FunctionDef)
    defaults = node.args.defaults, node.args.kw_defaults
    node.args.defaults = [ast.Constant(None) for _ in defaults[0]]
    node.args.kw_defaults = [one and ast.Constant(None) for one in defaults[1]]
    shell.body = [node]
    # The code of a call ``module.name()`` depends on whether it is seen to be imported.
    for name in sorted(names_in(function.__code__)):
        if isinstance(function.__globals__.get(name), ModuleType):
            outer.body.insert(0, ast.Import(names=[ast.alias(name=name)]))
    ast.fix_missing_locations(outer)
    module = compile(outer, function.__code__.co_filename, "exec", dont_inherit=True)
    node.args.defaults, node.args.kw_defaults = defaults
    inside = _code_named(module, OUTER)
    return _code_named(inside, node.name)


def _code_named(code: CodeType, name: str) -> CodeType:
    for constant in code.co_consts:
        if isinstance(constant, CodeType) and constant.co_name == name:
            return constant
    raise ValueError(name)


def _mangled(node: ast.AST) -> Iterator[str]:
    """Yield names that are ours already, and statements that cannot be moved."""
    for one in ast.walk(node):
        if isinstance(one, ast.Name) and one.id.startswith(PREFIX):
            yield one.id
        if isinstance(one, ast.Yield | ast.YieldFrom | ast.Await):
            yield "yield"


# What Numba does not read, in other words.

OF_ALL = ("sum", "min", "max", "any", "all")


class _Plainer(ast.NodeTransformer):
    """Generators that are added up, or compared, as lists.

    `a.sum(axis=1)` becomes `a.sum(1)`.

    Parameters
    ----------
    bound : set of str
        Names that have a meaning of their own in the function.
    """

    def __init__(self, bound: set[str]) -> None:
        self._bound = bound

    def visit_Call(self, node: ast.Call) -> ast.Call:
        """Replace the argument."""
        self.generic_visit(node)
        called = node.func
        if isinstance(called, ast.Attribute):
            is_axis = len(node.keywords) == 1 and node.keywords[0].arg == "axis"
            if called.attr == "sum" and is_axis and not node.args:
                node.args = [node.keywords.pop().value]
            return node
        if not isinstance(called, ast.Name) or called.id not in OF_ALL:
            return node
        if called.id in self._bound or len(node.args) != 1 or node.keywords:
            return node
        given = node.args[0]
        if isinstance(given, ast.GeneratorExp):
            made = ast.ListComp(elt=given.elt, generators=given.generators)
            node.args = [ast.copy_location(made, given)]
        return node


# Arguments that are unpacked.


class _Unpacking(ast.NodeTransformer):
    """Unpacked arguments, ``a, b = y``, as their elements, ``a, b = y[0], y[1]``.

    The arrays of other numbers than floats have elements, and cannot be unpacked.
    """

    def __init__(self, form: Form) -> None:
        pairs = zip(form.arguments, form.names, strict=True)
        self._rows = {own for meant, own in pairs if meant in ("y", "params")}

    def visit_Assign(self, node: ast.Assign) -> ast.Assign:
        """Replace the value."""
        target, value = node.targets[0], node.value
        if len(node.targets) > 1 or not isinstance(target, ast.Tuple | ast.List):
            return node
        is_row = isinstance(value, ast.Name) and value.id in self._rows
        if not is_row or not all(isinstance(one, ast.Name) for one in target.elts):
            return node
        items: list[ast.expr] = []
        for place in range(len(target.elts)):
            index = ast.Constant(place)
            items.append(ast.Subscript(value=value, slice=index, ctx=ast.Load()))
        made = ast.Tuple(elts=items, ctx=ast.Load())
        value = ast.copy_location(made, value)
        return ast.copy_location(ast.Assign(targets=node.targets, value=value), node)


# Returns.


class _Returns(ast.NodeTransformer):
    """Returns of a function as stores into the array of its result."""

    def __init__(self, form: Form, known: dict[str, Any]) -> None:
        self._known = known
        self._handler = form.kind == "on_event"
        users = dict(zip(form.arguments, form.names, strict=True))
        self._result = users.get(form.result, PREFIX + form.result)
        self._stored: set[str] = set()  # names that stand for the result
        self._as_tuples: set[str] = set()  # names of lists that are only returned
        self._counts: set[int | None] = set()
        # A field's rates have the length of the state.
        self._like = users.get("y") if form.kind == "field" else None
        # Names of the state and the parameters, and of single numbers.
        self._rows = {users[one] for one in ("y", "params") if one in users}
        elements = [one for one in users if one.startswith(("params[", "int("))]
        self._numbers = {
            users[one] for one in ("t", *elements) if one in users and ":" not in one
        }

    @property
    def count(self) -> int | None:
        """Number of elements returned, if all returns show the same."""
        if len(self._counts) != 1:
            return None
        return next(iter(self._counts))

    def rewrite(self, node: ast.FunctionDef) -> None:
        """Rewrite a definition."""
        self._find_numbers(node)
        if not self._handler:
            self._find_results(node)
        body: list[ast.stmt] = []
        for statement in node.body:
            changed = self.visit(statement)
            body += changed if isinstance(changed, list) else [changed]
        if self._handler:
            last = ast.Return(value=ast.Constant(0))
            body.append(ast.copy_location(last, node.body[-1]))
        node.body = body
        if self.count is None:  # the number of elements is found as it runs
            for one in ast.walk(node):
                if isinstance(one, ast.Name) and one.id == KNOWN:
                    one.id = STORE

    def _find_numbers(self, node: ast.FunctionDef) -> None:
        """Find local names that stand for one number."""
        for one in node.body:
            if not isinstance(one, ast.Assign) or len(one.targets) != 1:
                continue
            target = one.targets[0]
            names: list[ast.expr] = []
            if isinstance(target, ast.Name) and self._is_number(one.value):
                names = [target]
            elif isinstance(target, ast.Tuple) and self._is_row(one.value):
                names = target.elts
            for name in names:
                if isinstance(name, ast.Name) and _is_made_once(node, name.id):
                    self._numbers.add(name.id)

    def _is_row(self, node: ast.expr) -> bool:
        """Return whether an expression is the state, or the parameters."""
        return isinstance(node, ast.Name) and node.id in self._rows

    def _is_number(self, node: ast.expr) -> bool:
        """Return whether an expression is surely one number."""
        if isinstance(node, ast.Constant):
            return type(node.value) in (int, float)
        if isinstance(node, ast.Name):
            is_global = isinstance(self._known.get(node.id), int | float)
            return node.id in self._numbers or is_global
        if isinstance(node, ast.Subscript):
            index = node.slice
            if isinstance(index, ast.UnaryOp):
                index = index.operand
            is_element = isinstance(index, ast.Constant) and type(index.value) is int
            return is_element and self._is_row(node.value)
        if isinstance(node, ast.UnaryOp):
            return self._is_number(node.operand)
        if isinstance(node, ast.BinOp):
            return self._is_number(node.left) and self._is_number(node.right)
        if isinstance(node, ast.Call) and not node.keywords:
            known = isinstance(self._called(node), np.ufunc | BuiltinFunctionType)
            return known and all(self._is_number(one) for one in node.args)
        return False

    def _size(self, node: ast.expr) -> int | None:
        """Return the number of elements of an expression, if it is sure."""
        return 1 if self._is_number(node) else _length(node)

    def _find_results(self, node: ast.FunctionDef) -> None:
        """Find arrays and lists that are made once and returned."""
        returned = {
            one.value.id
            for one in _own_nodes(node)
            if isinstance(one, ast.Return) and isinstance(one.value, ast.Name)
        }
        arguments = {one.arg for one in node.args.args}
        for name in returned - arguments:
            assigned = [one for one in node.body if _assigns(one, name)]
            if len(assigned) != 1 or not _is_made_once(node, name):
                continue
            value = assigned[0].value  # type: ignore[attr-defined]
            uses = _uses(node, name)
            if uses == {"return"} and isinstance(self._display(value), ast.Tuple):
                self._as_tuples.add(name)
            elif uses <= {"return", "item"} and self._makes_array(value):
                self._stored.add(name)

    def _makes_array(self, value: ast.expr) -> bool:
        """Return whether an expression makes an array that the result can stand for."""
        if isinstance(self._display(value), ast.Tuple):
            return True
        if not isinstance(value, ast.Call) or len(value.args) != 1:
            return False
        return self._called(value) in EMPTY_ARRAYS and _is_of_floats(value)

    def _called(self, node: ast.Call) -> Any:
        """Return the function of `numpy` or `math` that is called, or None."""
        function = node.func
        if isinstance(function, ast.Name):
            return self._known.get(function.id)
        if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
            module = self._known.get(function.value.id)
            if getattr(module, "__name__", "") in ("numpy", "math"):
                return getattr(module, function.attr, None)
        return None

    def _display(self, node: ast.expr) -> ast.expr:
        """Return a list, or an array of a list, as a tuple; others as they are."""
        if isinstance(node, ast.List | ast.Tuple):
            if any(isinstance(one, ast.Starred) for one in node.elts):
                return node
            items = [self._display(one) for one in node.elts]
            return ast.copy_location(ast.Tuple(elts=items, ctx=ast.Load()), node)
        if isinstance(node, ast.IfExp):
            body, orelse = self._display(node.body), self._display(node.orelse)
            both = isinstance(body, ast.Tuple) and isinstance(orelse, ast.Tuple)
            if both:
                made = ast.IfExp(test=node.test, body=body, orelse=orelse)
                return ast.copy_location(made, node)
            return node
        is_array = isinstance(node, ast.Call) and len(node.args) == 1
        if is_array and self._called(node) in (np.array, np.asarray):  # type: ignore[arg-type]
            assert isinstance(node, ast.Call)
            inside = self._display(node.args[0])
            if isinstance(inside, ast.Tuple) and _is_of_floats(node):
                return inside
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> Any:
        """Leave a function that is defined inside."""
        return node

    visit_Lambda = visit_FunctionDef  # type: ignore[assignment]  # noqa: N815
    visit_ClassDef = visit_FunctionDef  # type: ignore[assignment]  # noqa: N815

    def visit_Name(self, node: ast.Name) -> Any:
        """Name the array of the result by its own name."""
        if node.id in self._stored:
            return ast.copy_location(ast.Name(id=self._result, ctx=node.ctx), node)
        return node

    def visit_Return(self, node: ast.Return) -> Any:
        """Return statements that store the value."""
        value = node.value
        if value is None or (isinstance(value, ast.Constant) and value.value is None):
            number = ast.Constant(0) if self._handler else None
            return ast.copy_location(ast.Return(value=number), node)
        if isinstance(value, ast.Name) and value.id in self._stored:
            return ast.copy_location(ast.Return(value=None), node)
        if not (isinstance(value, ast.Name) and value.id in self._as_tuples):
            self._counts.add(self._size(self._display(value)))
        call = self._store(self.visit(self._display(value)))
        if self._handler:
            return ast.copy_location(ast.Return(value=call), node)
        statements = [ast.Expr(value=call), ast.Return(value=None)]
        return [ast.copy_location(one, node) for one in statements]

    def visit_Assign(self, node: ast.Assign) -> Any:
        """Make what is returned in the array of the result."""
        name = None
        if len(node.targets) == 1:
            name = getattr(node.targets[0], "id", None)
        if name in self._as_tuples:
            value = self._display(node.value)
            self._counts.add(_length(value))
            made = ast.Assign(targets=node.targets, value=value)
            return ast.copy_location(made, node)
        if name not in self._stored:
            return self.generic_visit(node)
        value = self._display(node.value)
        result = ast.Name(id=self._result, ctx=ast.Load())
        if isinstance(value, ast.Tuple):
            self._counts.add(_length(value))
            return ast.copy_location(ast.Expr(value=self._store(value)), node)
        assert isinstance(value, ast.Call)
        like = value.args[0]
        if isinstance(like, ast.Constant) and type(like.value) is int:
            self._counts.add(like.value)
            like = result
        elif isinstance(like, ast.Name) and like.id == self._like:
            like = result
        zeroed = ast.Name(id=ZEROED, ctx=ast.Load())
        call = ast.Call(func=zeroed, args=[result, like], keywords=[])
        return ast.copy_location(ast.Expr(value=call), node)

    def _store(self, value: ast.expr) -> ast.Call:
        name = STORE if self._size(value) is None else KNOWN
        store = ast.Name(id=name, ctx=ast.Load())
        result = ast.Name(id=self._result, ctx=ast.Load())
        call = ast.Call(func=store, args=[value, result], keywords=[])
        return ast.copy_location(call, value)


def _own_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a function, without those of functions defined inside it."""
    for one in ast.iter_child_nodes(node):
        if isinstance(one, ast.FunctionDef | ast.Lambda | ast.ClassDef):
            continue
        yield one
        yield from _own_nodes(one)


def _assigns(statement: ast.stmt, name: str) -> bool:
    """Return whether a statement assigns to a name, and only to it."""
    if not isinstance(statement, ast.Assign) or len(statement.targets) != 1:
        return False
    target = statement.targets[0]
    return isinstance(target, ast.Name) and target.id == name


def _is_made_once(node: ast.FunctionDef, name: str) -> bool:
    """Return whether a name is bound once, and not used by a function inside."""
    bound = 0
    for one in ast.walk(node):
        if isinstance(one, ast.Name) and one.id == name:
            bound += not isinstance(one.ctx, ast.Load)
        if isinstance(one, ast.Global | ast.Nonlocal) and name in one.names:
            return False
        if isinstance(one, ast.FunctionDef | ast.Lambda) and one is not node:
            inside = (inner for inner in ast.walk(one) if isinstance(inner, ast.Name))
            if any(inner.id == name for inner in inside):
                return False
    return bound == 1


def _uses(node: ast.FunctionDef, name: str) -> set[str]:
    """Return the ways in which a name is used: "return", "item", or "other"."""
    ways: dict[int, str] = {}
    for one in ast.walk(node):
        if isinstance(one, ast.Return) and isinstance(one.value, ast.Name):
            ways[id(one.value)] = "return"
        elif isinstance(one, ast.Subscript) and isinstance(one.value, ast.Name):
            ways[id(one.value)] = "item"
    found = set()
    for one in ast.walk(node):
        is_use = isinstance(one, ast.Name) and isinstance(one.ctx, ast.Load)
        if is_use and one.id == name:  # type: ignore[attr-defined]
            found.add(ways.get(id(one), "other"))
    return found


def _is_of_floats(node: ast.Call) -> bool:
    """Return whether a call asks for no other type than float."""
    for one in node.keywords:
        value = one.value
        is_float = isinstance(value, ast.Name) and value.id == "float"
        is_float |= isinstance(value, ast.Attribute) and value.attr == "float64"
        if one.arg != "dtype" or not is_float:
            return False
    return True


def _length(node: ast.expr) -> int | None:
    """Return the number of elements of a tuple."""
    return len(node.elts) if isinstance(node, ast.Tuple) else None
