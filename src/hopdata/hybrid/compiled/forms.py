"""The forms in which people write functions, and how each is recognised.

A function that takes all arguments of its kind (`kernel.SIGNATURES`) and fills arrays
is in the integrator's own form. In a *plain* form it takes time and state and, if it
needs them, the mode and the parameters; it returns its result, or fills the array that
is its last argument. The form follows from the number and the names of the arguments,
and from whether the function returns a value.
"""

from __future__ import annotations

import dis
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import CodeType, FunctionType
from typing import Any

from hopdata.hybrid.compiled.kernel import Signature

Function = Callable[..., Any]

#: Names by which an argument is known for the mode, and for the parameters.
MODES = frozenset(("mode", "modes"))
PARAMS = frozenset(("p", "params", "parameters", "par", "pars"))
#: What each kind of function may take in a plain form, and the array that its result
#: fills. A handler's arguments are known by their names.
TAKES = {
    "field": ("t", "y", "mode", "params"),
    "guards": ("t", "y", "mode", "params"),
    "on_event": ("t", "y", "mode", "params", "guard", "direction"),
    "jacobian": ("t", "y", "mode", "params"),
}
RESULTS = {"field": "dy", "guards": "h", "on_event": "y", "jacobian": "jac"}
ORDINARY = (
    inspect.Parameter.POSITIONAL_ONLY,
    inspect.Parameter.POSITIONAL_OR_KEYWORD,
)


@dataclass(frozen=True)
class Form:
    """How a user's function is called, and where its result goes.

    Parameters
    ----------
    kind : str
        Kind of function, as in `kernel.SIGNATURES`.
    arguments : tuple of str
        What each of the function's own arguments is: an expression of the kind's
        arguments, such as ``y`` or ``params[2]``, or a name in `bound`.
    returns : bool
        Whether the result is returned. Otherwise the last argument is filled.
    names : tuple of str
        The function's own names for these arguments.
    bound : dict
        Values of arguments that do not vary.
    """

    kind: str
    arguments: tuple[str, ...]
    returns: bool
    names: tuple[str, ...]
    bound: dict[str, Any] = field(default_factory=dict)

    @property
    def result(self) -> str:
        """Name of the array that the result fills."""
        return RESULTS[self.kind]


def form_of(function: Function, signature: Signature) -> Form | None:
    """Return the plain form of a function; None if it has none.

    Then it is in the integrator's own form, or in none that is known.

    Parameters
    ----------
    function : callable
        The user's function.
    signature : Signature
        Its kind.
    """
    kind = signature.name
    if kind not in TAKES:
        return None
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):  # some built-in functions have no signature
        return None
    needed = [one for one in parameters if one.default is one.empty]
    if any(one.kind not in ORDINARY for one in needed):
        return None
    names = [one.name for one in needed]
    # The integrator's own arguments, in whatever number: a mistake in them is told.
    if len(names) >= len(signature.arguments) or len(names) < 2:
        return None
    returns = kind == "on_event" or returns_a_value(function)
    if not returns and (len(names) < 3 or names[-1] in MODES | PARAMS):
        return None
    taken = names if returns else names[:-1]
    arguments = _meant(kind, taken)
    if arguments is None:
        return None
    if not returns:
        arguments = (*arguments, RESULTS[kind])
    # Arguments with defaults keep them.
    bound = {
        one.name: one.default for one in parameters if one.default is not one.empty
    }
    kept = tuple(one.name for one in parameters if one.name in bound)
    return Form(kind, (*arguments, *kept), returns, (*names, *kept), bound)


def _meant(kind: str, names: list[str]) -> tuple[str, ...] | None:
    """Return what the arguments after time and state are; None if it is unknown."""
    found = ["t", "y"]
    known = TAKES[kind][2:]
    for name in names[2:]:
        if name in MODES:
            found.append("mode")
        elif name in PARAMS:
            found.append("params")
        elif name in known:
            found.append(name)
        else:
            found.append("")
    # Others are known by their places: the parameters last, the mode before them.
    for other in ("params", "mode"):
        if "" in found and other not in found:
            last = len(found) - 1 - found[::-1].index("")
            found[last] = other
    if "" in found or len(set(found)) < len(found):
        return None
    return tuple(found)


def returns_a_value(function: Function) -> bool:
    """Return whether a function returns something else than None on some path.

    An object that is no function is taken to.
    """
    code = getattr(function, "__code__", None)
    if code is None:
        return True
    before = None
    for step in dis.get_instructions(code):
        if step.opname == "RETURN_CONST" and step.argval is not None:
            return True
        if step.opname == "RETURN_VALUE":
            is_none = before is not None and before.opname == "LOAD_CONST"
            if not (is_none and before is not None and before.argval is None):
                return True
        before = step
    return False


def same_code(one: CodeType, other: CodeType) -> bool:
    """Return whether two code objects do the same, wherever they were written."""
    told = ("co_code", "co_names", "co_varnames", "co_freevars", "co_cellvars")
    if any(getattr(one, name) != getattr(other, name) for name in told):
        return False
    if len(one.co_consts) != len(other.co_consts):
        return False
    pairs = zip(one.co_consts, other.co_consts, strict=True)
    return all(_same_constant(a, b) for a, b in pairs)


def _same_constant(one: Any, other: Any) -> bool:
    if isinstance(one, CodeType) and isinstance(other, CodeType):
        return same_code(one, other)
    return type(one) is type(other) and repr(one) == repr(other)


def cells_of(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield name and cell of each variable of a function's closure."""
    names = function.__code__.co_freevars
    yield from zip(names, function.__closure__ or (), strict=True)
