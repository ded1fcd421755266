# ruff: noqa: ARG001 (the signature of machine code is the same for all)
"""Which guards may branch on state or time, and their code for ranges.

A guard whose source shows that it does not (sums, products, smooth functions, choices by the mode)
is left to the driver as it is. Every other guard is compiled once more, for ranges of states; see
`branches.ranges`.
"""

import ast
import builtins
import inspect
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import FunctionType, ModuleType
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
SMOOTH = frozenset(
    (
        "sin", "cos", "exp", "expm1", "sinh", "cosh", "tanh", "erf", "atan", "arctan", "asinh",
        "arcsinh", "sqrt", "log", "log2", "log10", "log1p", "asin", "arcsin", "acos", "arccos",
        "acosh", "arccosh", "atanh", "arctanh", "hypot", "pow", "power", "square", "float",
        "float64",
    )
)  # fmt: skip
COUNTS = frozenset(("len", "range", "enumerate", "zip"))  # their results do not vary
FORBIDDEN = (ast.Mod, ast.FloorDiv, ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift)
NO_CODE = -1  # address where no code for ranges can be made


@dataclass(frozen=True)
class Branches:
    """The guards' code for ranges.

    Parameters
    ----------
    address : int
        Address of the machine code; 0 if the guards do not branch on state or time, NO_CODE if they
        may, and Numba cannot compile them for ranges.
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
        function = with_digest(_each if one_by_one else _all, **names, CALL=guards.ranged)
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
    modes, numbers = array_of(int_vector(mode, n_modes)), array_of(float_vector(params, n_params))
    CALL(make(start, end, at), y, dy, modes, numbers, h, hdot)


def _each(
    start: float, end: float, states: int, slopes: int, n: int, mode: int, n_modes: int,
    params: int, n_params: int, room: int, n_guards: int, listed: int, count: int, at: int,
) -> None:  # fmt: skip
    """Evaluate the guards in a list, declared one by one, for ranges."""
    h, hdot = rows_at(room, n_guards, n_guards, at), sink(n_guards, at)
    modes, numbers = array_of(int_vector(mode, n_modes)), array_of(float_vector(params, n_params))
    which = int_vector(listed, count)
    for a in range(count):
        y, dy = rows_at(states, n, n, at), rows_at(slopes, n, n, at)
        CALL(make(start, end, at), y, dy, modes, numbers, which[a], h, hdot)


# Whether a function's source shows that it does not branch on what varies.


@lru_cache(256)
def may_branch(function: Any, varying: tuple[int, ...] | None = None) -> bool:
    """Return whether a function may branch, jump or have a kink in its varying arguments.

    Parameters
    ----------
    function : callable
        A Python function.
    varying : tuple of int, optional
        Positions of the arguments that vary; by default all.
    """
    if not isinstance(function, FunctionType):
        return True
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError):
        return True
    node = tree.body[0]
    if not isinstance(node, ast.FunctionDef):
        return True
    arguments = [one.arg for one in node.args.args]
    places = range(len(arguments)) if varying is None else varying
    names = {arguments[place] for place in places if place < len(arguments)}
    known = _known(function)
    _spread(node, names, known)
    return any(_is_branch(one, names, known) for one in ast.walk(node))


def _known(function: FunctionType) -> dict[str, Any]:
    """Return what the global names and closures of a function stand for."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    inner = {name: cell.cell_contents for name, cell in cells}
    return {**vars(builtins), **function.__globals__, **inner}


def _spread(node: ast.AST, names: set[str], known: dict[str, Any]) -> None:
    """Add to the varying names those that are assigned a varying value."""
    before = -1
    while before != len(names):
        before = len(names)
        for one in ast.walk(node):
            for target, value in _assignments(one):
                if _varies(value, names, known):
                    names |= set(_bound(target))


def _bound(target: ast.AST) -> Iterator[str]:
    """Yield the names that an assignment changes: not those by which it indexes."""
    if isinstance(target, ast.Name):
        yield target.id
    elif isinstance(target, ast.Subscript | ast.Starred | ast.Attribute):
        yield from _bound(target.value)
    elif isinstance(target, ast.Tuple | ast.List):
        for one in target.elts:
            yield from _bound(one)


def _assignments(node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield targets and values of an assignment; those of pairs one by one."""
    if isinstance(node, ast.Assign):
        for target in node.targets:
            both = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            if both and len(target.elts) == len(node.value.elts):  # type: ignore[attr-defined]
                yield from zip(target.elts, node.value.elts, strict=True)  # type: ignore[attr-defined]
            else:
                yield target, node.value
    elif isinstance(node, ast.AugAssign | ast.AnnAssign | ast.NamedExpr) and node.value is not None:
        yield node.target, node.value
    elif isinstance(node, ast.For):
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
        plain = module in ("builtins", "math", "numpy") or type(value).__module__ == "numpy"
        return getattr(value, "__name__", "") if plain and not own else ""
    if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
        module = known.get(function.value.id)
        known_module = isinstance(module, ModuleType) and module.__name__ in ("math", "numpy")
        return function.attr if known_module else ""
    return ""


def _is_branch(node: ast.AST, names: set[str], known: dict[str, Any]) -> bool:
    """Return whether a node of the code may give a varying value a jump, a kink or a choice."""
    if isinstance(node, ast.If | ast.IfExp | ast.While):
        return _varies(node.test, names, known)
    if isinstance(node, ast.Compare | ast.BoolOp | ast.Match | ast.Try | ast.With | ast.Lambda):
        return _varies(node, names, known)
    if isinstance(node, ast.FunctionDef) and node.name not in known:
        return False
    if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, FORBIDDEN):
        return _varies(node, names, known)
    if isinstance(node, ast.Subscript):
        return _varies(node.slice, names, known)
    if isinstance(node, ast.For):
        return _varies(node.iter, names, known)
    if isinstance(node, ast.Call):
        return _call_branches(node, names, known)
    return False


def _call_branches(node: ast.Call, names: set[str], known: dict[str, Any]) -> bool:
    """Return whether a call with a varying argument is of a function that may branch."""
    if not any(_varies(one, names, known) for one in (*node.args, *node.keywords)):
        return False
    called = _called(node, known)
    if called:
        return called not in SMOOTH and called not in COUNTS
    value = known.get(node.func.id) if isinstance(node.func, ast.Name) else None
    helper = getattr(value, "py_func", None)
    if helper is None or node.keywords or any(isinstance(x, ast.Starred) for x in node.args):
        return True
    given = enumerate(node.args)
    return may_branch(helper, tuple(i for i, one in given if _varies(one, names, known)))
