"""Why Numba cannot compile a function, in one line out of its many, and what to do."""

from __future__ import annotations

import builtins
import re
import warnings
from collections.abc import Callable
from typing import Any

from hopdata.hybrid.compiled.declaration import place, return_error
from hopdata.hybrid.compiled.signatures import Signature

Function = Callable[..., Any]

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_RETURNS = re.compile(r"No conversion from (.+) to \w+ for '\$\w*return")
_LINE = re.compile(r'File ".*", line (\d+)')
_CALL = re.compile(r">>> (.+)")
_UNTYPED = re.compile(r"Untyped global name '(\w+)'.*<class 'function'>")
LONGEST = 160  # characters of a reason


class SlowCallbackWarning(UserWarning):
    """A function of the user's runs as plain Python, many times slower than compiled."""


def warn_slow(function: Function, signature: Signature, reason: str, advice: str) -> None:
    """Warn, at the place of the function, that it runs as plain Python."""
    code = getattr(function, "__code__", None)
    text = (
        f"{place(function, signature)} runs as plain Python, many times slower, because "
        f"Numba cannot compile it: {reason}. To do: {advice}, or declare it by "
        f"@{signature.name}(compiled=False) to have it so without this warning."
    )
    if code is None:
        warnings.warn(text, SlowCallbackWarning, stacklevel=2)
        return
    registry = getattr(function, "__globals__", {}).setdefault("__warningregistry__", {})
    warnings.warn_explicit(
        text, SlowCallbackWarning, code.co_filename, code.co_firstlineno, registry=registry
    )


def raise_if_mistaken(function: Function, signature: Signature, error: Exception) -> None:
    """Raise, instead of running slowly, if the function would fail in Python, too."""
    returned = _RETURNS.search(_COLOUR.sub("", str(error)))
    if returned:
        raise return_error(function, signature, returned[1]) from None
    for name in _undefined(function):
        raise NameError(f"{place(function, signature)}: name {name!r} is not defined") from None


def reason_and_advice(error: Exception) -> tuple[str, str]:
    """Return what Numba stumbled over, in one line, and what the user can do about it."""
    text = _COLOUR.sub("", str(error))
    lines = [line.strip() for line in text.splitlines()]
    told = [one for one in lines if one and not one.startswith(("Failed in", "During", "File "))]
    reason = told[0] if told else f"{type(error).__name__} inside Numba"
    call = _CALL.search(text)
    if reason.startswith("No implementation of function") and call:
        reason = f"it does not know {call[1]}"
    reason = reason.split(". Raised from")[0].rstrip(".: ")
    reason = reason if len(reason) <= LONGEST else reason[:LONGEST].rstrip() + " ..."
    number = _LINE.search(text)
    helper = _UNTYPED.search(text)
    advice = f"decorate {helper[1]!r} by @numba.njit" if helper else _ADVICE
    return f"{reason} (line {number[1]})" if number else reason, advice


_ADVICE = "use only numbers, NumPy and functions decorated by @numba.njit in it"


def _undefined(function: Function) -> list[str]:
    """Return the global names that the function's own code reads and nobody has defined."""
    import dis

    if not hasattr(function, "__code__"):
        return []
    known = {**vars(builtins), **function.__globals__}
    steps = dis.get_instructions(function)
    return [x.argval for x in steps if x.opname == "LOAD_GLOBAL" and x.argval not in known]
