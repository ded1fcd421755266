"""Whether a function's source shows that it does not branch on what varies.

It does not if it is made of sums, products, smooth functions, and choices by what does
not vary. Where the source is not understood, the function may branch.
"""

import ast
import builtins
import inspect
import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from tokenize import TokenError
from types import CodeType, FunctionType, ModuleType
from typing import Any

# Functions of one argument, smooth wherever they are finite. Not among them are those
# with a vertical slope at an end of their domain, which make a kink of a smooth
# argument that touches it: acos(cos(t)) is a zigzag, and acosh(cosh(t)) is |t|.
SMOOTH = frozenset(
    (
        "sin", "cos", "exp", "expm1", "sinh", "cosh", "tanh", "erf", "atan", "arctan",
        "asinh", "arcsinh", "log", "log2", "log10", "log1p", "atanh", "arctanh",
        "square", "float", "float64",
    )
)  # fmt: skip
POWERS = frozenset(("pow", "power"))
POSITIVE = frozenset(("exp", "cosh"))  # their results are positive
COUNTS = frozenset(("len", "range", "enumerate", "zip"))  # their results do not vary

# Operators that jump or have kinks, and parts of code that choose by a value in them.
JUMPING = (
    ast.Not,
    ast.Invert,
    ast.Mod,
    ast.FloorDiv,
    ast.BitAnd,
    ast.BitOr,
    ast.BitXor,
    ast.LShift,
    ast.RShift,
)
CHOOSING = (ast.Compare, ast.BoolOp, ast.Match, ast.Try, ast.With, ast.Lambda)
DEFINING = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)

# Code and varying arguments of the functions that call one another down to this one.
Judged = frozenset[tuple[CodeType, tuple[int, ...] | None]]


def may_branch(
    function: Any, varying: tuple[int, ...] | None = None, judged: Judged = frozenset()
) -> bool:
    """Return whether a function may branch, jump or have a kink in varying arguments.

    True also where the source is not understood. The answer is not kept: it depends on
    what the global names stand for at the time, as the machine code does.

    Parameters
    ----------
    function : callable
        A Python function.
    varying : tuple of int, optional
        Positions of the arguments that vary; by default all.
    judged : frozenset, optional
        Code and varying arguments of the functions that call this one. A function that
        calls itself is not followed, and may branch.
    """
    if not isinstance(function, FunctionType) or (function.__code__, varying) in judged:
        return True
    node = definition(function)
    if node is None:
        return True
    arguments = _positional(node)
    places = range(len(arguments)) if varying is None else varying
    if any(place >= len(arguments) for place in places):  # an argument of *args
        return True
    names = {arguments[place] for place in places}
    # A guard only reads its mode and parameters, but a helper may write to any array.
    is_guard = not judged
    fixed = frozenset(arguments) - names if is_guard else frozenset()
    inside = judged | {(function.__code__, varying)}
    code = _Code(names, _known(function), inside)
    try:
        code.spread(node, fixed)
        parts = (one for statement in node.body for one in ast.walk(statement))
        return any(code.is_branch(one) for one in parts)
    except RecursionError:  # an expression or a chain of calls too deep to be followed
        return True


def definition(function: FunctionType) -> ast.FunctionDef | None:
    """Return the definition of a function, or None if its source is not known."""
    if hasattr(function, "__wrapped__"):  # `inspect` would give another function's
        return None
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError, RecursionError, TokenError):
        return None
    node = tree.body[0]
    if not isinstance(node, ast.FunctionDef):
        return None
    code = function.__code__
    is_its_own = tuple(_positional(node)) == code.co_varnames[: code.co_argcount]
    return node if is_its_own else None


def _positional(node: ast.FunctionDef) -> list[str]:
    """Return the names of the arguments that have a position."""
    return [one.arg for one in (*node.args.posonlyargs, *node.args.args)]


def _known(function: FunctionType) -> dict[str, Any]:
    """Return what the global names and closures of a function stand for."""
    code = function.__code__
    known = {**vars(builtins), **function.__globals__}
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        try:
            known[name] = cell.cell_contents
        except ValueError:  # it has none yet
            known.pop(name, None)
    for name in (*code.co_varnames, *code.co_cellvars):
        known.pop(name, None)  # a local name hides a global one
    return known


@dataclass
class _Code:
    """What the names in a function's code stand for.

    Parameters
    ----------
    varying : set of str
        Names of what varies.
    known : dict
        What the global names and closures stand for.
    judged
        See `may_branch`.
    """

    varying: set[str]
    known: dict[str, Any]
    judged: Judged

    # What varies.

    def spread(self, node: ast.AST, fixed: frozenset[str]) -> None:
        """Add the names that get a varying value; the fixed ones only by assignment."""
        n_before = -1
        while n_before != len(self.varying):
            n_before = len(self.varying)
            for one in ast.walk(node):
                self._spread_from(one, fixed)

    def _spread_from(self, node: ast.AST, fixed: frozenset[str]) -> None:
        for target, value in _assignments(node):
            if self.varies(value):
                self.varying |= set(_changed(target))
            elif self.varies(target):  # an array may be changed by its other name
                self.varying |= set(_shared(value)) - fixed
        called = node.value if isinstance(node, ast.Expr) else None
        if isinstance(called, ast.Call) and self.varies(called):
            for argument in called.args:  # called for what it writes to its arguments
                self.varying |= set(_shared(argument)) - fixed

    def varies(self, node: ast.AST) -> bool:
        """Return whether an expression has a varying name, not only its length."""
        if isinstance(node, ast.Name):
            return node.id in self.varying
        if isinstance(node, ast.Call):
            called = self.called(node)
            if called == "len":
                return False
            if called == "range":
                return any(self.varies(one) for one in node.args)
        return any(self.varies(one) for one in ast.iter_child_nodes(node))

    def called(self, node: ast.Call) -> str:
        """Return the name of a function of Python, `math` or `numpy`; "" for others."""
        function = node.func
        if isinstance(function, ast.Name):
            return _plain_name(self.known.get(function.id))
        if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
            module = self.known.get(function.value.id)
            if isinstance(module, ModuleType) and module.__name__ in ("math", "numpy"):
                return function.attr
        return ""

    # What branches.

    def is_branch(self, node: ast.AST) -> bool:
        """Return whether a node may give a varying value a jump, a kink or a choice."""
        if isinstance(node, ast.If | ast.IfExp | ast.While | ast.Assert):
            return self.varies(node.test)
        if isinstance(node, CHOOSING):
            return self.varies(node)
        if isinstance(node, DEFINING):
            return True  # what it returns may vary without a varying argument
        if isinstance(node, ast.UnaryOp | ast.BinOp | ast.AugAssign):
            return self._operator_branches(node)
        if isinstance(node, ast.Subscript):
            return self.varies(node.slice)
        if isinstance(node, ast.For):
            return self.varies(node.iter)
        if isinstance(node, ast.comprehension):
            return any(self.varies(one) for one in node.ifs)
        if isinstance(node, ast.Call):
            return self._call_branches(node)
        return False

    def _operator_branches(self, node: ast.UnaryOp | ast.BinOp | ast.AugAssign) -> bool:
        if isinstance(node.op, JUMPING):
            return self.varies(node)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            return self._power_branches(node.left, node.right)
        if isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Pow):
            return self._power_branches(node.target, node.value)
        return False

    def _call_branches(self, node: ast.Call) -> bool:
        """Return whether a call that takes something varying may branch on it."""
        if self.varies(node.func):  # a method of an array
            return True
        if not any(self.varies(one) for one in (*node.args, *node.keywords)):
            return False
        if node.keywords or any(isinstance(one, ast.Starred) for one in node.args):
            return True
        called = self.called(node)
        if called:
            return self._plain_call_branches(called, node.args)
        value = None
        if isinstance(node.func, ast.Name):
            value = self.known.get(node.func.id)
        helper = getattr(value, "py_func", value)
        if not isinstance(helper, FunctionType):
            return True
        varying = [i for i, one in enumerate(node.args) if self.varies(one)]
        return may_branch(helper, tuple(varying), self.judged)

    def _plain_call_branches(self, called: str, arguments: list[ast.expr]) -> bool:
        """Return whether a function of Python, `math` or `numpy` may branch."""
        if called in COUNTS:
            return False
        if called in POWERS and len(arguments) == 2:
            return self._power_branches(arguments[0], arguments[1])
        if called == "hypot" and len(arguments) == 2:
            # A cone: smooth if it stays off its tip.
            return not any(self._is_positive(one) for one in arguments)
        if called == "sqrt" and len(arguments) == 1:
            return not self._is_positive(arguments[0])
        return called not in SMOOTH or len(arguments) != 1

    def _power_branches(self, base: ast.AST, exponent: ast.AST) -> bool:
        """Return whether a power may have a kink where its base is zero.

        (x**2)**0.5 is |x|.
        """
        if not self.varies(base) and not self.varies(exponent):
            return False
        return not self._is_whole(exponent) and not self._is_positive(base)

    def _is_whole(self, node: ast.AST) -> bool:
        """Return whether an exponent is a whole number that does not vary.

        Such as 2 or int(params[0]).
        """
        number = _literal(node)
        if number is not None:
            return number == int(number)
        is_cast = isinstance(node, ast.Call) and self.called(node) == "int"
        return is_cast and not self.varies(node)

    def _is_positive(self, node: ast.AST) -> bool:
        """Return whether an expression is certainly positive: 1.0 + x**2, exp(x)."""
        number = _literal(node)
        if number is not None:
            return number > 0.0
        if isinstance(node, ast.Call):
            return self.called(node) in POSITIVE
        if not isinstance(node, ast.BinOp):
            return False
        left, right = node.left, node.right
        if isinstance(node.op, ast.Add):
            if self._is_positive(left) and self._is_not_negative(right):
                return True
            return self._is_not_negative(left) and self._is_positive(right)
        if isinstance(node.op, ast.Mult | ast.Div):
            return self._is_positive(left) and self._is_positive(right)
        return isinstance(node.op, ast.Pow) and self._is_positive(left)

    def _is_not_negative(self, node: ast.AST) -> bool:
        """Return whether an expression is certainly not negative: a sum of squares."""
        if self._is_positive(node) or _literal(node) == 0.0:
            return True
        if not isinstance(node, ast.BinOp):
            return False
        left, right = node.left, node.right
        if isinstance(node.op, ast.Pow):
            number = _literal(right)
            return number is not None and number % 2.0 == 0.0
        both = self._is_not_negative(left) and self._is_not_negative(right)
        if isinstance(node.op, ast.Mult):
            # A call might return another value the second time.
            calls = (ast.Call, ast.NamedExpr)
            is_plain = not any(isinstance(one, calls) for one in ast.walk(node))
            is_square = ast.dump(left) == ast.dump(right)
            return both or (is_plain and is_square)
        return isinstance(node.op, ast.Add) and both


def _plain_name(value: Any) -> str:
    """Return the name of a function of Python, `math` or `numpy`; "" for any other."""
    if isinstance(value, FunctionType) or hasattr(value, "py_func"):
        return ""
    module = getattr(value, "__module__", None)
    is_ufunc = type(value).__module__ == "numpy"
    if module in ("builtins", "math", "numpy") or is_ufunc:
        return getattr(value, "__name__", "")
    return ""


def _changed(target: ast.AST) -> Iterator[str]:
    """Yield the names that an assignment changes: not those by which it indexes."""
    if isinstance(target, ast.Name):
        yield target.id
    elif isinstance(target, ast.Subscript | ast.Starred | ast.Attribute):
        yield from _changed(target.value)
    elif isinstance(target, ast.Tuple | ast.List):
        for one in target.elts:
            yield from _changed(one)


def _shared(node: ast.AST) -> Iterator[str]:
    """Yield the name of the array that an expression is, whole or as a slice."""
    if isinstance(node, ast.Name):
        yield node.id
    elif isinstance(node, ast.Subscript):
        index = ast.walk(node.slice)
        if any(isinstance(one, ast.Slice) for one in index):
            yield from _shared(node.value)


def _assignments(node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield targets and values of an assignment; those of pairs one by one."""
    if isinstance(node, ast.Assign):
        for target in node.targets:
            yield from _pairs(target, node.value)
    elif isinstance(node, ast.AugAssign | ast.NamedExpr):
        yield node.target, node.value
    elif isinstance(node, ast.AnnAssign):
        if node.value is not None:
            yield node.target, node.value
    elif isinstance(node, ast.For | ast.comprehension):
        yield node.target, node.iter


def _pairs(target: ast.expr, value: ast.expr) -> Iterator[tuple[ast.AST, ast.AST]]:
    targets = target.elts if isinstance(target, ast.Tuple) else []
    values = value.elts if isinstance(value, ast.Tuple) else []
    if targets and len(targets) == len(values):
        yield from zip(targets, values, strict=True)
    else:
        yield target, value


def _literal(node: ast.AST) -> float | None:
    """Return the finite number that an expression is, with its sign, or None."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        number = _literal(node.operand)
        return None if number is None else -number
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        value = float(node.value)  # type: ignore[arg-type]
        return value if math.isfinite(value) else None
    return None
