"""Check a user's function when it is declared: its arguments, and the arrays that it fills."""

from __future__ import annotations

import dis
import inspect
import re
from collections.abc import Callable
from types import FunctionType
from typing import Any

from hopdata.hybrid.compiled.signatures import SIGNATURES, Signature

Function = Callable[..., Any]

WANTED_RESULT = {
    "on_event": "return 0 to go on, 1 to stop, on every path",
    "rate_bound": "return a number on every path",
}


def function_name(function: Function) -> str:
    """Return the name by which messages call a function."""
    return getattr(function, "__name__", type(function).__name__)


def place(function: Function, signature: Signature) -> str:
    """Return what is declared, its name and where it stands, to begin a message."""
    code = getattr(function, "__code__", None)
    where = "" if code is None else f" ({code.co_filename}:{code.co_firstlineno})"
    return f"{signature.name} {function_name(function)!r}{where}"


def check_declaration(function: Any, signature: Signature) -> None:
    """Raise TypeError if a function cannot be called as the decorator's signature says.

    Parameters
    ----------
    function : object
        What the decorator stands above.
    signature : Signature
        The decorator's entry in the table.
    """
    if not callable(function):
        raise TypeError(f"@{signature.name}: expected a function, found {function!r}")
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):  # some built-in functions do not tell
        return
    _check_count(function, signature, parameters)
    _check_names(function, signature, [one.name for one in parameters])
    if isinstance(function, FunctionType):
        _check_arrays(function, signature, parameters)


def return_error(function: Function, signature: Signature, found: str) -> TypeError:
    """Return the exception for a function that returns what it should not."""
    if signature.fills:
        wanted = f"fill {' and '.join(signature.fills)} in place and return nothing"
    else:
        wanted = WANTED_RESULT.get(signature.name, "return nothing")
    words = {"none": "None", "NoneType": "None", "ndarray": "an array"}
    what = "an array" if found.startswith("array(") else words.get(found, found)
    return TypeError(f"{place(function, signature)} returns {what}; {wanted}")


def _check_count(
    function: Function, signature: Signature, parameters: list[inspect.Parameter]
) -> None:
    kinds = {one.kind for one in parameters}
    needed = [one for one in parameters if one.default is one.empty and one.kind in _POSITIONAL]
    taken = [one for one in parameters if one.kind in _POSITIONAL]
    wanted, open_ended = len(signature.arguments), inspect.Parameter.VAR_POSITIONAL in kinds
    if len(needed) > wanted or (len(taken) < wanted and not open_ended):
        n = len(taken)
        raise TypeError(
            f"{place(function, signature)} takes {n} argument{'s' * (n != 1)}; "
            f"expected {_call(function, signature)}{_hint(parameters)}"
        )


def _check_names(function: Function, signature: Signature, names: list[str]) -> None:
    """Tell a function whose arguments are, by name and order, those of another decorator."""
    found = tuple(names)
    kinds = [kind.name for kind in SIGNATURES.values() if kind.arguments == found]
    if kinds and signature.name not in kinds:
        raise TypeError(
            f"{place(function, signature)} has the arguments of @{kinds[0]}; "
            f"expected {_call(function, signature)}"
        )


def _check_arrays(
    function: FunctionType, signature: Signature, parameters: list[inspect.Parameter]
) -> None:
    """See that each array to fill is used, and used before its name is given to something else."""
    if any(one.kind not in _POSITIONAL for one in parameters):
        return
    for wanted in signature.fills:
        name = parameters[signature.arguments.index(wanted)].name
        use = _first_use(function, name)
        if use != "LOAD":
            what = "never uses" if use is None else "gives something else the name"
            raise TypeError(
                f"{place(function, signature)} {what} {name}; "
                f"fill it in place: {name}[:] = ..., and return nothing"
            )


def _first_use(function: FunctionType, name: str) -> str | None:
    """Return what the bytecode first does to an argument: LOAD, STORE or nothing."""
    if name in function.__code__.co_cellvars:  # handed to a function within
        return "LOAD"
    for step in dis.get_instructions(function):
        if "_FAST" in step.opname:
            names = step.argval if isinstance(step.argval, tuple) else (step.argval,)
            actions = re.findall("LOAD|STORE|DELETE", step.opname)
            for action, used in zip(actions, names, strict=False):
                if used == name:
                    return str(action)
    return None


def _call(function: Function, signature: Signature) -> str:
    return signature.call(function_name(function))


def _hint(parameters: list[inspect.Parameter]) -> str:
    found = tuple(one.name for one in parameters)
    others = [kind.name for kind in SIGNATURES.values() if kind.arguments == found]
    return f" (its arguments are those of @{others[0]})" if others else ""


_POSITIONAL = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
