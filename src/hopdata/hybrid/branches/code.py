# ruff: noqa: ARG001 (the signature of machine code is the same for all)
"""Which guards may branch on state or time, and their code for ranges.

A guard whose source shows that it does not (sums, products, smooth functions, choices
by the mode) is left to the driver as it is. Every other guard is compiled once more,
for ranges of states; see `branches.ranges`.
"""

import ast
import builtins
import inspect
import math
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

from numba import cfunc

from hopdata.code_cache import compiled_in_cache, function_digest
from hopdata.hybrid.branches.native import RANGES_NATIVE
from hopdata.hybrid.compiled.callbacks import Callback
from hopdata.hybrid.compiled.declare import reason_and_advice
from hopdata.hybrid.compiled.digest import sources_digest, with_digest
from hopdata.hybrid.compiled.kernel import ENTRY
from hopdata.hybrid.compiled.memory import array_of, float_vector, int_vector

Function = Callable[..., Any]

# Arguments of guards that vary within a step. Their other arguments do not.
VARIES = frozenset(("t", "y", "dy", "h", "hdot"))
# Functions of one argument, smooth wherever they are finite. Not among them are those
# with a vertical slope at an end of their domain, which make a kink of a smooth
# argument that touches it: acos(cos(t)) is a zigzag, and acosh(cosh(t)) is |t|.
SMOOTH = frozenset(
    (
        "sin", "cos", "exp", "expm1", "sinh", "cosh", "tanh", "erf", "atan", "arctan", "asinh",
        "arcsinh", "log", "log2", "log10", "log1p", "atanh", "arctanh", "square", "float",
        "float64",
    )
)  # fmt: skip
POWERS = frozenset(("pow", "power"))
POSITIVE = frozenset(("exp", "cosh"))  # their results are positive
COUNTS = frozenset(("len", "range", "enumerate", "zip"))  # their results do not vary
FORBIDDEN = (
    ast.Mod,
    ast.FloorDiv,
    ast.BitAnd,
    ast.BitOr,
    ast.BitXor,
    ast.LShift,
    ast.RShift,
)
NO_CODE = -1  # address where no code for ranges can be made


@dataclass(frozen=True)
class Branches:
    """The guards' code for ranges.

    Parameters
    ----------
    address : int
        Address of the machine code; 0 if the guards do not branch on state or time,
        NO_CODE if they may, and Numba cannot compile them for ranges.
    reason : str
        Why there is no code.
    code : object
        What holds the machine code.
    """

    address: int = 0
    reason: str = ""
    code: Any = None


def branches_of(guards: Callback | None) -> Branches:
    """Return the code for ranges of a system's guards.

    Parameters
    ----------
    guards : Callback, optional
        The guards, together (`@guards`) or one by one (`@guard`).
    """
    if guards is None:
        return Branches()
    users = guards
    while hasattr(users, "inner"):  # derived from the user's
        users = users.inner
    varying = [name for name in users.signature.arguments if name in VARIES]
    places = tuple(users.signature.arguments.index(name) for name in varying)
    if not may_branch(users.function, places):
        return Branches()
    return _compiled(guards)


def _compiled(guards: Callback) -> Branches:
    from hopdata.hybrid.branches import ranges

    one_by_one = "k" in guards.signature.arguments
    names = {
        "make": ranges.make, "rows_at": ranges.rows_at, "sink": ranges.sink,
        "array_of": array_of, "float_vector": float_vector, "int_vector": int_vector,
    }  # fmt: skip
    try:
        function = with_digest(
            _each if one_by_one else _all, **names, CALL=guards.ranged
        )
        sources = sources_digest(Path(__file__).parents[1], "branches")
        digest = f"{function_digest(function)}-{sources}"

        def compile_it(cached: bool) -> Any:
            return cfunc(RANGES_NATIVE, cache=cached and guards.kept, **ENTRY)(function)

        code = compiled_in_cache(function, digest, compile_it)
    except Exception as error:  # Numba's own exceptions, and others raised within it
        reason, _ = reason_and_advice(error)
        return Branches(NO_CODE, reason)
    return Branches(code.address, code=code)


CALL: Any = None  # inserted, as are the functions that it takes
make = rows_at = sink = CALL


def _all(
    start: float, end: float, states: int, slopes: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, room: int, n_guards: int, listed: int, count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards, declared together, for ranges; all of them are in the list."""
    y, dy = rows_at(states, n, n, at), rows_at(slopes, n, n, at)
    h, hdot = rows_at(room, n_guards, n_guards, at), sink(n_guards, at)
    modes, numbers = (
        array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)),
    )
    CALL(make(start, end, at), y, dy, modes, numbers, h, hdot)


def _each(
    start: float, end: float, states: int, slopes: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, room: int, n_guards: int, listed: int, count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards in a list, declared one by one, for ranges."""
    h, hdot = rows_at(room, n_guards, n_guards, at), sink(n_guards, at)
    modes, numbers = (
        array_of(int_vector(mode, n_modes)),
        array_of(float_vector(params, n_params)),
    )
    which = int_vector(listed, count)
    for a in range(count):
        y, dy = rows_at(states, n, n, at), rows_at(slopes, n, n, at)
        CALL(make(start, end, at), y, dy, modes, numbers, which[a], h, hdot)


# Whether a function's source shows that it does not branch on what varies.


Judged = frozenset[tuple[CodeType, tuple[int, ...] | None]]


def may_branch(
    function: Any, varying: tuple[int, ...] | None = None, judged: Judged = frozenset()
) -> bool:
    """Return whether a function may branch, jump or have a kink in its varying arguments.

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
    node = _definition(function)
    if node is None:
        return True
    arguments = _positional(node)
    places = range(len(arguments)) if varying is None else varying
    if any(place >= len(arguments) for place in places):  # an argument of *args
        return True
    names = {arguments[place] for place in places}
    known = _known(function)
    inside = judged | {(function.__code__, varying)}
    try:
        # A guard only reads its mode and parameters, but a helper may write to any
        # array.
        fixed = frozenset() if judged else frozenset(arguments) - names
        _spread(node, names, known, fixed)
        parts = (one for statement in node.body for one in ast.walk(statement))
        return any(_is_branch(one, names, known, inside) for one in parts)
    except RecursionError:  # an expression or a chain of calls too deep to be followed
        return True


def _definition(function: FunctionType) -> ast.FunctionDef | None:
    """Return the definition of a function, or None if its source is not known."""
    if hasattr(
        function, "__wrapped__"
    ):  # `inspect` would give the source of another function
        return None
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError, RecursionError):
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
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    known = {**vars(builtins), **function.__globals__}
    for name, cell in cells:
        try:
            known[name] = cell.cell_contents
        except ValueError:  # it has none yet
            known.pop(name, None)
    for name in (*function.__code__.co_varnames, *function.__code__.co_cellvars):
        known.pop(name, None)  # a local name hides a global one
    return known


def _spread(
    node: ast.AST, names: set[str], known: dict[str, Any], fixed: frozenset[str]
) -> None:
    """Add to the varying names those that get a varying value; the fixed ones by name only."""
    before = -1
    while before != len(names):
        before = len(names)
        for one in ast.walk(node):
            for target, value in _assignments(one):
                if _varies(value, names, known):
                    names |= set(_bound(target))
                elif _varies(
                    target, names, known
                ):  # an array may be changed by its other name
                    names |= set(_shared(value)) - fixed
            called = one.value if isinstance(one, ast.Expr) else None
            if isinstance(called, ast.Call) and _varies(called, names, known):
                for (
                    argument
                ) in called.args:  # called for what it writes to its arguments
                    names |= set(_shared(argument)) - fixed


def _bound(target: ast.AST) -> Iterator[str]:
    """Yield the names that an assignment changes: not those by which it indexes."""
    if isinstance(target, ast.Name):
        yield target.id
    elif isinstance(target, ast.Subscript | ast.Starred | ast.Attribute):
        yield from _bound(target.value)
    elif isinstance(target, ast.Tuple | ast.List):
        for one in target.elts:
            yield from _bound(one)


def _shared(node: ast.AST) -> Iterator[str]:
    """Yield the name of an array that an expression stands for, as a whole or as a slice."""
    if isinstance(node, ast.Name):
        yield node.id
    elif isinstance(node, ast.Subscript) and any(
        isinstance(one, ast.Slice) for one in ast.walk(node.slice)
    ):
        yield from _shared(node.value)


def _assignments(node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield targets and values of an assignment; those of pairs one by one."""
    if isinstance(node, ast.Assign):
        for target in node.targets:
            both = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            if both and len(target.elts) == len(node.value.elts):  # type: ignore[attr-defined]
                yield from zip(target.elts, node.value.elts, strict=True)  # type: ignore[attr-defined]
            else:
                yield target, node.value
    elif (
        isinstance(node, ast.AugAssign | ast.AnnAssign | ast.NamedExpr)
        and node.value is not None
    ):
        yield node.target, node.value
    elif isinstance(node, ast.For | ast.comprehension):
        yield node.target, node.iter


def _varies(node: ast.AST, names: set[str], known: dict[str, Any]) -> bool:
    """Return whether an expression varies: it contains a varying name, but not as a length."""
    if isinstance(node, ast.Call) and _called(node, known) in ("len", "range"):
        return (
            False
            if _called(node, known) == "len"
            else any(_varies(one, names, known) for one in node.args)
        )
    if isinstance(node, ast.Name):
        return node.id in names
    return any(_varies(one, names, known) for one in ast.iter_child_nodes(node))


def _called(node: ast.Call, known: dict[str, Any]) -> str:
    """Return the name of a function of Python, `math` or `numpy`; "" for any other."""
    function = node.func
    if isinstance(function, ast.Name):
        value = known.get(function.id)
        module = getattr(value, "__module__", None)
        own = isinstance(value, FunctionType) or hasattr(value, "py_func")
        plain = (
            module in ("builtins", "math", "numpy") or type(value).__module__ == "numpy"
        )
        return getattr(value, "__name__", "") if plain and not own else ""
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
        module = known.get(function.value.id)
        known_module = isinstance(module, ModuleType) and module.__name__ in (
            "math",
            "numpy",
        )
        return function.attr if known_module else ""
    return ""


def _is_branch(
    node: ast.AST, names: set[str], known: dict[str, Any], judged: Judged
) -> bool:
    """Return whether a node of the code may give a varying value a jump, a kink or a choice."""
    if isinstance(node, ast.If | ast.IfExp | ast.While | ast.Assert):
        return _varies(node.test, names, known)
    if isinstance(
        node, ast.Compare | ast.BoolOp | ast.Match | ast.Try | ast.With | ast.Lambda
    ):
        return _varies(node, names, known)
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return True  # what it returns may vary without a varying argument
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert):
        return _varies(node, names, known)
    if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, FORBIDDEN):
        return _varies(node, names, known)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return _power_branches(node.left, node.right, names, known)
    if isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Pow):
        return _power_branches(node.target, node.value, names, known)
    if isinstance(node, ast.Subscript):
        return _varies(node.slice, names, known)
    if isinstance(node, ast.For):
        return _varies(node.iter, names, known)
    if isinstance(node, ast.comprehension):
        return any(_varies(one, names, known) for one in node.ifs)
    if isinstance(node, ast.Call):
        return _call_branches(node, names, known, judged)
    return False


def _call_branches(
    node: ast.Call, names: set[str], known: dict[str, Any], judged: Judged
) -> bool:
    """Return whether a call that takes something varying is of a function that may branch."""
    if _varies(node.func, names, known):  # a method of an array
        return True
    if not any(_varies(one, names, known) for one in (*node.args, *node.keywords)):
        return False
    if node.keywords or any(isinstance(one, ast.Starred) for one in node.args):
        return True
    called = _called(node, known)
    if called in COUNTS:
        return False
    if called in POWERS and len(node.args) == 2:
        return _power_branches(node.args[0], node.args[1], names, known)
    if (
        called == "hypot" and len(node.args) == 2
    ):  # a cone: smooth if it stays off its tip
        return not any(_is_positive(one, known) for one in node.args)
    if called == "sqrt" and len(node.args) == 1:
        return not _is_positive(node.args[0], known)
    if called:
        return called not in SMOOTH or len(node.args) != 1
    value = known.get(node.func.id) if isinstance(node.func, ast.Name) else None
    helper = getattr(value, "py_func", None)
    if helper is None:
        return True
    given = enumerate(node.args)
    places = tuple(i for i, one in given if _varies(one, names, known))
    return may_branch(helper, places, judged)


def _power_branches(
    base: ast.AST, exponent: ast.AST, names: set[str], known: dict[str, Any]
) -> bool:
    """Return whether a power may have a kink where its base is zero: (x**2)**0.5 is |x|."""
    if not _varies(base, names, known) and not _varies(exponent, names, known):
        return False
    return not _is_whole(exponent, names, known) and not _is_positive(base, known)


def _is_whole(node: ast.AST, names: set[str], known: dict[str, Any]) -> bool:
    """Return whether an exponent is a whole number that does not vary: 2, int(params[0])."""
    number = _literal(node)
    if number is not None:
        return number == int(number)
    is_cast = isinstance(node, ast.Call) and _called(node, known) == "int"
    return is_cast and not _varies(node, names, known)


def _literal(node: ast.AST) -> float | None:
    """Return the finite number that an expression is, with its sign; None for any other."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        number = _literal(node.operand)
        return None if number is None else -number
    is_number = isinstance(node, ast.Constant) and type(node.value) in (int, float)
    if not is_number or not math.isfinite(node.value):  # type: ignore[attr-defined]
        return None
    return float(node.value)  # type: ignore[attr-defined]


def _is_positive(node: ast.AST, known: dict[str, Any]) -> bool:
    """Return whether an expression is certainly positive: 1.0 + x**2, exp(x)."""
    number = _literal(node)
    if number is not None:
        return number > 0.0
    if isinstance(node, ast.Call):
        return _called(node, known) in POSITIVE
    if not isinstance(node, ast.BinOp):
        return False
    left, right = node.left, node.right
    if isinstance(node.op, ast.Add):
        one_way = _is_positive(left, known) and _is_not_negative(right, known)
        return one_way or (_is_not_negative(left, known) and _is_positive(right, known))
    if isinstance(node.op, ast.Mult | ast.Div):
        return _is_positive(left, known) and _is_positive(right, known)
    return isinstance(node.op, ast.Pow) and _is_positive(left, known)


def _is_not_negative(node: ast.AST, known: dict[str, Any]) -> bool:
    """Return whether an expression is certainly positive or zero: a square, or a sum of squares."""
    if _is_positive(node, known) or _literal(node) == 0.0:
        return True
    if not isinstance(node, ast.BinOp):
        return False
    left, right = node.left, node.right
    if isinstance(node.op, ast.Pow):
        number = _literal(right)
        return number is not None and number % 2.0 == 0.0
    both = _is_not_negative(left, known) and _is_not_negative(right, known)
    if isinstance(node.op, ast.Mult):
        is_plain = not any(
            isinstance(one, ast.Call | ast.NamedExpr) for one in ast.walk(node)
        )
        return both or (is_plain and ast.dump(left) == ast.dump(right))
    return isinstance(node.op, ast.Add) and both
