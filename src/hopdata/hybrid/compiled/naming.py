"""A user's function by its name, as pickle stores it.

Pickle stores a function as the name by which a module holds it. The process that reads
this imports the module, so it must be able to, and the module must hold the same
function there. With a compiled function go the values of its constants: if the other
process has others, its results would differ.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from hashlib import sha256
from importlib import import_module
from types import FunctionType
from typing import TYPE_CHECKING, Any

from hopdata.errors import ArgumentError, NotPicklableError
from hopdata.hybrid.compiled.constants import Constants
from hopdata.hybrid.compiled.declare import place
from hopdata.hybrid.compiled.kernel import SIGNATURES

if TYPE_CHECKING:
    from hopdata.hybrid.compiled.callbacks import Callback

ADVICE = "define it at the top level of a module, and give it what varies as params"


def name_of(callback: Callback) -> tuple[str, str, str, bool, dict[str, str]]:
    """Return module, name, kind, whether it is to be compiled, and the values of its constants.

    Raises
    ------
    NotPicklableError
        If no module holds the function by its name.
    """
    function = callback.function
    module, name = (
        getattr(function, "__module__", None),
        getattr(function, "__qualname__", ""),
    )
    where = place(function, callback.signature)
    if not module or "<" in name or not name:
        raise NotPicklableError(
            f"{where} cannot be pickled: it is a lambda, or is defined inside another function "
            f"({name or type(function).__name__}), and pickle stores a function by the name that "
            f"a module has for it; {ADVICE}"
        )
    held = _held(sys.modules.get(module), name)
    if held is not callback and _function_of(held) is not function:
        raise NotPicklableError(
            f"{where} cannot be pickled: pickle stores a function by its name, and {module}.{name} "
            f"is {'now another object' if held is not None else 'not there'}; {ADVICE}"
        )
    constants = _values(function) if callback.wanted else {}
    return module, name, callback.signature.name, callback.wanted, constants


def callback_by_name(
    module: str, name: str, kind: str, compiled: bool, constants: Mapping[str, str]
) -> Callback:
    """Return the callback of a function that a module holds; see `name_of`.

    Raises
    ------
    ArgumentError
        If the module holds no such function, or if its constants have other values
        here.
    """
    from hopdata.hybrid.compiled.callbacks import Callback

    full = f"{module}.{name}"
    held = _held(import_module(module), name)
    found = held
    if not (isinstance(held, Callback) and held.signature.name == kind):
        if not callable(held) or isinstance(held, Callback):
            raise ArgumentError.at(
                full,
                f"a function declared by @{kind}, as in the process that pickled it",
                held,
            )
        found = Callback(held, SIGNATURES[kind], compiled)
    here = _values(_function_of(found)) if compiled else {}
    for constant, value in constants.items():
        found_here = here.get(constant, "no number, text or array of this name")
        if found_here != value:
            raise ArgumentError.at(
                full,
                f"{constant} = {value}, as in the process that pickled it (give what varies as "
                "params)",
                found_here,
            )
    return found


def _held(module: Any, name: str) -> Any:
    """Return what a module holds by a dotted name; None if it holds nothing."""
    found = module
    for part in name.split("."):
        found = getattr(found, part, None)
    return found


def _function_of(held: Any) -> Any:
    """Return the Python function in a callback, a function decorated by Numba, or a function."""
    inner = getattr(held, "function", held)
    return getattr(inner, "py_func", inner)


def _values(function: Any) -> dict[str, str]:
    """Return the numbers, texts and arrays that a function reads, as text."""
    if not isinstance(function, FunctionType):
        return {}
    values = Constants([function]).values()
    return {name: _as_text(value) for name, value in values.items()}


def _as_text(value: Any) -> str:
    """Return a number or a text as it is written, and the bytes of an array by their digest."""
    if isinstance(value, bytes):
        return f"bytes with the SHA-256 {sha256(value).hexdigest()[:16]}..."
    return repr(value)
