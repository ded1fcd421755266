"""Checks of a user's function when it is declared: its arguments, what it fills."""

import builtins
import dis
import inspect
import linecache
import re
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from hopdata.hybrid.compiled.kernel import SIGNATURES, Signature

Function = Callable[..., Any]

WANTED_RESULT = {
    "on_event": "return 0 to go on, 1 to stop, on every path (a handler of fewer than "
    "six arguments may return the new state)",
    "together": "return 0 to go on, 1 to stop, on every path",
    "rate_bound": "return a number on every path",
}


# What a plain function returns.
RETURNED = {
    "field": "the rates of the state, as (y[1], -9.81)",
    "guards": "the values of the guards, as y[0] or (y[0], y[1])",
    "jacobian": "the rows of the matrix",
}

# What the length of a plain function's result is.
LENGTHS = {
    "field": "the number of states (n_states)",
    "guards": "the number of guards (guard_names)",
    "on_event": "the number of states (n_states)",
    "jacobian": "the number of states (n_states)",
}


def function_name(function: Function) -> str:
    """Return the name of a function for use in messages."""
    return getattr(function, "__name__", type(function).__name__)


def place(function: Function, signature: Signature) -> str:
    """Return the kind, name and source location of a function, to start a message."""
    function = getattr(function, "users", function)
    code = getattr(function, "__code__", None)
    where = "" if code is None else f" ({code.co_filename}:{code.co_firstlineno})"
    return f"{signature.name} {function_name(function)!r}{where}"


def check_declaration(function: Any, signature: Signature) -> None:
    """Raise TypeError if a function cannot be called with the decorator's signature.

    Parameters
    ----------
    function : object
        Object that is decorated.
    signature : Signature
        Signature of the decorator.
    """
    if not callable(function):
        raise TypeError(f"@{signature.name}: expected a function, found {function!r}")
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):  # some built-in functions have no signature
        return
    _check_arguments(function, signature, parameters)
    if isinstance(function, FunctionType):
        _check_arrays(function, signature, parameters)


def return_error(function: Function, signature: Signature, found: str) -> TypeError:
    """Return the exception for a function with a wrong return value."""
    if signature.fills:
        wanted = f"fill {' and '.join(signature.fills)} in place and return nothing"
    else:
        wanted = WANTED_RESULT.get(signature.name, "return nothing")
    words = {"none": "None", "NoneType": "None", "ndarray": "an array"}
    what = words.get(found, found)
    if found.startswith("array("):
        what = "an array"
    return TypeError(f"{place(function, signature)} returns {what}; {wanted}")


def _check_arguments(
    function: Function, signature: Signature, parameters: list[inspect.Parameter]
) -> None:
    """Check the number of arguments, and that they are not another decorator's."""
    positional = [one for one in parameters if one.kind in _POSITIONAL]
    n_needed = sum(one.default is one.empty for one in positional)
    n_taken = len(positional)
    n_wanted = len(signature.arguments)
    open_ended = any(one.kind == one.VAR_POSITIONAL for one in parameters)
    names = tuple(one.name for one in parameters)
    theirs = [kind.name for kind in SIGNATURES.values() if kind.arguments == names]
    call = signature.call(function_name(function))
    if signature.name in RETURNED and 2 <= n_needed < n_wanted and not theirs:
        raise TypeError(_nothing_returned(function, signature, call))
    if n_needed > n_wanted or (n_taken < n_wanted and not open_ended):
        found = "takes 1 argument" if n_taken == 1 else f"takes {n_taken} arguments"
        hint = f" (its arguments are those of @{theirs[0]})" if theirs else ""
    elif theirs and signature.name not in theirs:
        found = f"has the arguments of @{theirs[0]}"
        hint = ""
    else:
        return
    raise TypeError(f"{place(function, signature)} {found}; expected {call}{hint}")


def _nothing_returned(function: Function, signature: Signature, call: str) -> str:
    """Return the message for a function with fewer arguments and without a result."""
    code = getattr(function, "__code__", None)
    wanted = RETURNED[signature.name]
    what = "returns nothing"
    if code is not None and code.co_flags & inspect.CO_GENERATOR:
        what = "is a generator (it has a yield)"
    n_taken = 0 if code is None else code.co_argcount
    return (
        f"{place(function, signature)} takes {n_taken} arguments and {what}; return "
        f"{wanted}, or fill an array: expected {call}"
    )


def _check_arrays(
    function: FunctionType, signature: Signature, parameters: list[inspect.Parameter]
) -> None:
    """Check that each array to fill is used, and used before its name is reassigned."""
    if any(one.kind not in _POSITIONAL for one in parameters):
        return
    for wanted in signature.fills:
        name = parameters[signature.arguments.index(wanted)].name
        use = _first_use(function, name)
        if use != "LOAD":
            what = "never uses" if use is None else "reassigns"
            raise TypeError(
                f"{place(function, signature)} {what} {name}; "
                f"fill it in place: {name}[:] = ..., and return nothing"
            )


def _first_use(function: FunctionType, name: str) -> str | None:
    """Return the first action of the bytecode on an argument: LOAD, STORE or None."""
    if name in function.__code__.co_cellvars:  # used by an inner function
        return "LOAD"
    for step in dis.get_instructions(function):
        if "_FAST" in step.opname:
            actions = re.findall("LOAD|STORE|DELETE", step.opname)
            for action, used in zip(actions, _names(step), strict=False):
                if used == name:
                    return str(action)
    return None


_POSITIONAL = (
    inspect.Parameter.POSITIONAL_ONLY,
    inspect.Parameter.POSITIONAL_OR_KEYWORD,
)


# Why Numba cannot compile a function, condensed to one line, and what to do.

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_RETURNS = re.compile(r"No conversion from (.+) to \w+ for '\$\w*return")
# What `stored` says of a result that cannot be stored.
_REFUSED = re.compile(r"it (returns [^\n]+; (?:expected|return) [^\n]+)")
_LINE = re.compile(r'File "(.*)", line (\d+)|at (\S+) \((\d+)\)')
_CALL = re.compile(r">>> ([^_\s].*)")
_UNTYPED = re.compile(r"Untyped global name '(\w+)'.*<class 'function'>")
LONGEST = 160  # most characters of a reason
LONGEST_LINE = 60  # and of the line of source that it names


class SlowCallbackWarning(UserWarning):
    """A user's function runs as plain Python, many times slower than compiled."""


def warn_slow(
    function: Function, signature: Signature, reason: str, advice: str
) -> None:
    """Warn, at the function's source location, that it runs as plain Python."""
    code = getattr(function, "__code__", None)
    where = place(function, signature)
    text = (
        f"{where} runs as plain Python, many times slower, because Numba cannot "
        f"compile it: {reason}. To fix it, {advice}, or declare it by "
        f"@{signature.name}(compiled=False) to silence this warning."
    )
    if code is None:
        warnings.warn(text, SlowCallbackWarning, stacklevel=2)
        return
    registry = getattr(function, "__globals__", {}).setdefault(
        "__warningregistry__", {}
    )
    warnings.warn_explicit(
        text,
        SlowCallbackWarning,
        code.co_filename,
        code.co_firstlineno,
        registry=registry,
    )


def reason_of_object(users: Any) -> tuple[str, str]:
    """Return why an object that is no function is not compiled, and advice."""
    if isinstance(users, partial):
        name = function_name(users.func)
        reason = f"it is a functools.partial of {name!r}"
        advice = (
            "give the arguments that it fixes as params, or write a function (def) "
            f"that calls {name!r} with them"
        )
        return reason, advice
    reason = f"it is a {type(users).__name__} object"
    return reason, "write a function (def) that does the same without the object"


def raise_if_mistaken(
    function: Function, signature: Signature, error: Exception
) -> None:
    """Raise, rather than run slowly, if the function would fail in Python as well."""
    text = _COLOUR.sub("", str(error))
    returned = _RETURNS.search(text)
    if returned:
        raise return_error(function, signature, returned[1]) from None
    refused = _REFUSED.search(text)
    if refused:
        raise TypeError(f"{place(function, signature)} {refused[1]}") from None
    for name in _undefined(function):
        raise NameError(
            f"{place(function, signature)}: name {name!r} is not defined"
        ) from None
    for module, name in _missing(function):
        raise AttributeError(
            f"{place(function, signature)}: module {module!r} has no {name!r}"
        ) from None


def reason_and_advice(
    error: Exception, function: Function | None = None
) -> tuple[str, str]:
    """Return why Numba failed, in one line, and advice to the user.

    With the function, the reason has its line, and what stands there.
    """
    text = _COLOUR.sub("", str(error))
    lines = [line.strip() for line in text.splitlines()]
    frame = ("Failed in", "During", "File ")
    told = [one for one in lines if one and not one.startswith(frame)]
    reason = f"{type(error).__name__} inside Numba"
    if told:
        reason = told[0]
    call = _CALL.search(text)
    if reason.startswith("No implementation of function") and call:
        reason = f"it does not know {call[1]}"
    elif "opcode (FORMAT_" in reason:  # Numba's words on Python 3.13
        reason = "it does not support format specifications in f-strings"
    reason = reason.split(". Raised from")[0].rstrip(".: ")
    if len(reason) > LONGEST:
        reason = reason[:LONGEST].rstrip() + " ..."
    number = _line_in(text, function)
    if number:
        reason = f"{reason} (line {number}{_source_line(function, number)})"
    for sign, advice in _ADVICE_FOR:
        found = sign.search(text)
        if found:
            return reason, advice.format(*found.groups())
    return reason, _ADVICE


def _line_in(text: str, function: Function | None) -> int:
    """Return the line that Numba names: in the function's file, if it is known; or 0.

    A line of another file says nothing about the function.
    """
    code = getattr(function, "__code__", None)
    for found in _LINE.finditer(text):
        file, line = found[1] or found[3], int(found[2] or found[4])
        if code is None or Path(file).name == Path(code.co_filename).name:
            return line
    return 0


def _source_line(function: Function | None, number: int) -> str:
    """Return what stands in a line of a function's file, to follow its number."""
    code = getattr(function, "__code__", None)
    if code is None:
        return ""
    line = linecache.getline(code.co_filename, number).strip()
    if len(line) > LONGEST_LINE:
        line = line[:LONGEST_LINE].rstrip() + " ..."
    return f": {line}" if line else ""


_ADVICE = "use only numbers, NumPy and functions decorated with @numba.njit in it"
# What to do where Numba's words show what it is.
_ADVICE_FOR = [
    (_UNTYPED, "decorate {!r} with @numba.njit"),
    (
        re.compile(r"Untyped global name '(\w+)'.*(?:<class 'dict'>|empty list)"),
        "give its values as params, or as a tuple or numbers beside it; and no results "
        "can be collected in {!r}: the solution has them",
    ),
    (
        re.compile(r"Untyped global name '(\w+)'.*<class '[\w.]*interp"),
        "use np.interp with arrays in place of {!r}",
    ),
    (
        re.compile(r"Untyped global name '(\w+)'"),
        "take the numbers out of {!r} before, or give them as params: @numba.njit "
        "knows numbers, tuples, NumPy's arrays and functions",
    ),
    (
        re.compile(r"array\(int64, .*array\(float64|array\(float64, .*array\(int64"),
        "make both arrays of floats (1.0 for 1); use only what @numba.njit can compile",
    ),
    (
        re.compile(r"Cannot unify (\S+) and (\S+)"),
        "let the name have one kind of value throughout, as @numba.njit wants it",
    ),
]


def _missing(function: Function) -> Iterator[tuple[str, str]]:
    """Yield module and name of attributes that a module does not have."""
    if not hasattr(function, "__code__"):
        return
    module: Any = None
    for step in dis.get_instructions(function):
        if step.opname == "LOAD_GLOBAL":
            module = function.__globals__.get(step.argval)
        elif step.opname in ("LOAD_ATTR", "LOAD_METHOD"):
            if isinstance(module, ModuleType) and not hasattr(module, step.argval):
                yield module.__name__, step.argval
            module = None
        elif step.opname not in ("CACHE", "PUSH_NULL", "NOP"):
            module = None


def _undefined(function: Function) -> list[str]:
    """Return the global names that the function's own code reads but nobody defines."""
    if not hasattr(function, "__code__"):
        return []
    known = {**vars(builtins), **function.__globals__}
    steps = dis.get_instructions(function)
    read = [step.argval for step in steps if step.opname == "LOAD_GLOBAL"]
    return [name for name in read if name not in known]


# Find the elements that a function's code accesses by literal indices.
#
# They are compared with the arrays' lengths, because machine code does not check
# bounds: beyond the end of an array it reads and writes other memory. They also show
# which elements cannot matter: those that a function never accesses.


def largest_subscripts(function: Callable[..., Any]) -> dict[str, int]:
    """Return the largest literal index into each argument that is indexed by literals.

    Parameters
    ----------
    function : callable
        A Python function. If it asks for a length, it may check bounds itself, so there
        are none.
    """
    if not isinstance(function, FunctionType) or "len" in function.__code__.co_names:
        return {}
    code = function.__code__
    steps = list(dis.get_instructions(code))
    arguments = set(code.co_varnames[: code.co_argcount])
    for step in steps:
        if "STORE_FAST" in step.opname:
            arguments -= set(_names(step))
    largest: dict[str, int] = {}
    for name, number in _literal_subscripts(steps):
        if name in arguments:
            largest[name] = max(number, largest.get(name, -1))
    return {name: number for name, number in largest.items() if number >= 0}


def names_unpacked(function: Callable[..., Any]) -> dict[str, int]:
    """Return the number of names into which each argument is unpacked: a, b = y."""
    if not isinstance(function, FunctionType):
        return {}
    code = function.__code__
    arguments = set(code.co_varnames[: code.co_argcount])
    steps = list(dis.get_instructions(code))
    for step in steps:
        if "STORE_FAST" in step.opname:
            arguments -= set(_names(step))
    found = {}
    for loaded, use in pairwise(steps):
        is_argument = loaded.opname.startswith("LOAD_FAST") and use.opname == (
            "UNPACK_SEQUENCE"
        )
        if is_argument and _names(loaded)[-1] in arguments:
            found[_names(loaded)[-1]] = int(use.arg or 0)
    return found


def elements_named(
    function: Callable[..., Any], position: int
) -> frozenset[int] | None:
    """Return the elements of an argument that a function accesses by literal indices.

    None if the argument is used in another way (indexed by a variable or from the end,
    passed on), so that any element may matter.

    Parameters
    ----------
    function : callable
        A Python function.
    position : int
        Position of the argument among the positional ones.
    """
    if not isinstance(function, FunctionType):
        return None
    if position >= function.__code__.co_argcount:
        return None
    argument = function.__code__.co_varnames[position]
    steps = list(dis.get_instructions(function))
    subscripts = _literal_subscripts(steps)
    numbers = [number for name, number in subscripts if name == argument]
    n_mentions = sum(_names(step).count(argument) for step in steps)
    if n_mentions == len(numbers) and min(numbers, default=0) >= 0:
        return frozenset(numbers)
    return None


def _literal_subscripts(steps: list[dis.Instruction]) -> list[tuple[Any, int]]:
    """Return name and index at each place where an object is indexed by a literal."""
    found = []
    for array, index, use in zip(steps, steps[1:], steps[2:], strict=False):
        is_literal = index.opname.startswith("LOAD_") and type(index.argval) is int
        if is_literal and _is_subscript(use):
            found.append((_names(array)[-1], index.argval))
    return found


def _is_subscript(step: dis.Instruction) -> bool:
    """Return whether an instruction indexes, or (COPY) prepares to do so twice."""
    if step.opname == "BINARY_OP":  # Python 3.14
        return step.argrepr == "[]"
    return step.opname in ("BINARY_SUBSCR", "STORE_SUBSCR", "COPY")


def _names(step: dis.Instruction) -> tuple[str, ...]:
    if isinstance(step.argval, tuple):
        return step.argval
    return (step.argval,)
