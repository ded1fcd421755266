"""A user's function by its name, as pickle stores it.

Pickle stores a function as the name by which a module holds it. The process that reads
this imports the module, so it must be able to, and the module must hold the same
function there. With a compiled function go the values of its constants: if the other
process has others, its results would differ.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from hashlib import sha256
from types import FunctionType
from typing import Any

from hopdata.errors import ArgumentError, NotPicklableError
from hopdata.hybrid.compiled.constants import Constants
from hopdata.hybrid.compiled.declare import place
from hopdata.hybrid.compiled.kernel import Signature

ADVICE = "define it at the top level of a module, and give it what varies as params"


def name_of(
    function: Callable[..., Any],
    signature: Signature,
    *,
    compiled: bool,
    holder: object,
) -> tuple[str, str, str, bool, dict[str, str]]:
    """Return what stands for a function when it is pickled.

    Parameters
    ----------
    function, signature
        The function and its kind.
    compiled : bool
        Whether it is to be compiled.
    holder : object
        The callback made from it, which a module may hold in its place.

    Returns
    -------
    module, name, kind : str
        The module that holds the function, the name that it has there, and its kind.
    compiled : bool
    constants : dict
        The values of its constants.

    Raises
    ------
    NotPicklableError
        If no module holds the function by its name.
    """
    module = getattr(function, "__module__", None)
    name = getattr(function, "__qualname__", "")
    where = place(function, signature)
    if not module or "<" in name or not name:
        raise NotPicklableError(
            f"{where} cannot be pickled: it is a lambda, or is defined inside another "
            f"function ({name or type(function).__name__}), and pickle stores a "
            f"function by the name that a module has for it; {ADVICE}"
        )
    found = held(sys.modules.get(module), name)
    if found is not holder and _function_of(found) is not function:
        instead = "not there" if found is None else "now another object"
        raise NotPicklableError(
            f"{where} cannot be pickled: pickle stores a function by its name, and "
            f"{module}.{name} is {instead}; {ADVICE}"
        )
    constants = _constants_of(function) if compiled else {}
    return module, name, signature.name, compiled, constants


def held(module: Any, name: str) -> Any:
    """Return what a module holds by a dotted name; None if it holds nothing."""
    found = module
    for part in name.split("."):
        found = getattr(found, part, None)
    return found


def require_same_constants(
    full_name: str, function: Callable[..., Any], constants: Mapping[str, str]
) -> None:
    """Raise `ArgumentError` if a constant of a function has another value here."""
    here = _constants_of(function)
    for name, value in constants.items():
        found = here.get(name, "no number, text or array of this name")
        if found != value:
            raise ArgumentError.at(
                full_name,
                f"{name} = {value}, as in the process that pickled it (give what "
                "varies as params)",
                found,
            )


def _function_of(holder: Any) -> Any:
    """Return the Python function in a callback or dispatcher, or itself."""
    inner = getattr(holder, "users", holder)
    return getattr(inner, "py_func", inner)


def _constants_of(function: Any) -> dict[str, str]:
    """Return the numbers, texts and arrays that a function reads, as text."""
    if not isinstance(function, FunctionType):
        return {}
    values = Constants([function]).values()
    return {name: _as_text(value) for name, value in values.items()}


def _as_text(value: Any) -> str:
    """Return a number or a text as it is written, and an array's bytes by a digest."""
    if isinstance(value, bytes):
        return f"bytes with the SHA-256 {sha256(value).hexdigest()[:16]}..."
    return repr(value)
