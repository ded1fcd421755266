# ruff: noqa: ARG001, PLW0108 (Numba prescribes signatures and their names)
"""What a plain function returns, stored where the integrator wants it.

`STORES` has a function of compiled code for each kind of user's function. It takes a
tuple, list or array, or one number for one element; the numbers may be of any type that
the array takes. `store_in_python` does the same for a function that Python runs.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from typing import Any

import numpy as np
from numba import TypingError, types
from numba.extending import overload

from hopdata.hybrid.compiled.memory import NumberLike, built, is_number

Function = Callable[..., Any]
RAISE = "    raise ValueError(WRONG)"
WRONG = "{kind}: the function returns another number of elements than {what}"
COUNTS = {
    "field": "the state has (n_states)",
    "guards": "there are guards (guard_names)",
    "on_event": "the state has (n_states)",
    "jacobian": "a matrix (n_states, n_states)",
}


def is_scalar(kind: Any) -> bool:
    """Return whether a Numba type is that of one number, ours or Numba's."""
    if isinstance(kind, types.Array):
        return kind.ndim == 0
    is_ours = isinstance(kind, NumberLike) or getattr(kind, "is_number", False)
    return is_number(kind) or is_ours


def _is_row(kind: Any) -> bool:
    """Return whether a Numba type is that of numbers in a row."""
    if isinstance(kind, types.Array):
        return kind.ndim == 1
    items = getattr(kind, "dtype", None)
    return isinstance(kind, types.List | types.ListType) and is_scalar(items)


def _items(kind: Any) -> tuple[Any, ...]:
    return tuple(kind)


def _is_tuple(kind: Any) -> bool:
    return isinstance(kind, types.BaseTuple) and all(map(is_scalar, _items(kind)))


def _is_matrix_of_tuples(kind: Any) -> bool:
    return isinstance(kind, types.BaseTuple) and all(map(_is_tuple, _items(kind)))


def _made(
    lines: list[str], wrong: str, arguments: str = "value, out", **names: Any
) -> Function:
    """Return a function of these lines, as Numba needs their number to be fixed.

    Its name has a digest, because cached machine code is linked by name.
    """
    text = "\n".join([*lines, wrong, *names])
    name = f"store_{sha256(text.encode()).hexdigest()[:16]}"
    source = [f"def {name}({arguments}):", *(f"    {one}" for one in lines)]
    scope: dict[str, Any] = {"WRONG": wrong, **names}
    exec("\n".join(source), scope)
    made: Function = scope[name]
    return made


def _row_store(
    value: Any,
    wrong: str,
    otherwise: str | None = RAISE,
    *,
    last: str = "return",
) -> Function | None:
    """Return the function that stores a value of this type in a row of numbers."""
    if _is_tuple(value):
        count = str(len(value))
        lines = [f"out[{i}] = value[{i}]" for i in range(len(value))]
    elif is_scalar(value):
        count = "1"
        item = "value[()]" if isinstance(value, types.Array) else "value"
        lines = [f"out[0] = {item}"]
    elif _is_row(value):
        count = "len(value)"
        lines = ["for i in range(len(out)):", "    out[i] = value[i]"]
    else:
        return None
    check: list[str] = []
    if otherwise is not None:
        check = [f"if len(out) != {count}:", otherwise]
    return _made([*check, *lines, last], wrong)


def _wrong(kind: str) -> str:
    return WRONG.format(kind=kind, what=COUNTS[kind])


def _refused(kind: str, value: Any) -> TypingError:
    wanted = "a tuple, a list or an array of numbers, or one number"
    if kind == "jacobian":
        wanted = "a matrix: an array, or a tuple or list of its rows"
    return TypingError(f"it returns {described(value)}; expected {wanted}")


def described(kind: Any) -> str:
    """Return a Numba type in words."""
    if isinstance(kind, types.Array):
        return f"an array of {kind.ndim} axes"
    if isinstance(kind, types.BaseTuple | types.List):
        return "rows of different things"
    if isinstance(kind, types.NoneType):
        return "None on some path"
    if isinstance(kind, types.Optional):
        return "None on some path"
    if isinstance(kind, types.UnicodeType | types.StringLiteral):
        return "text"
    if isinstance(kind, types.Integer):
        return "a whole number"
    return str(kind)


def store_rates(value: Any, out: Any) -> None:
    """Store the rates that a field returns."""


def store_values(value: Any, out: Any) -> None:
    """Store the values that guards return."""


def store_known(value: Any, out: Any) -> None:
    """Store a result whose number of elements is known to be right."""


def store_matrix(value: Any, out: Any) -> None:
    """Store the matrix that a Jacobian returns."""


def store_state(value: Any, out: Any) -> int:
    """Store the state that a handler returns; return whether it wants to stop."""
    return 0


def zeroed(out: Any, like: Any) -> None:
    """Fill the array of the result with zeros, in place of making a new one.

    Its length is compared with what the other would have had, unless `like` is itself.
    """


def _store_rates(value: Any, out: Any) -> Any:
    return _row_or_refused("field", value)


def _store_values(value: Any, out: Any) -> Any:
    return _row_or_refused("guards", value)


def _store_known(value: Any, out: Any) -> Any:
    return _row_or_refused("field", value, None)


def _row_or_refused(
    kind: str, value: Any, otherwise: str | None = "    return"
) -> Function:
    # A function that raises costs more than a small field. What is not filled is NaN,
    # which ends the integration, and `solve` tells why.
    made = _row_store(value, _wrong(kind), otherwise)
    if made is None:
        raise _refused(kind, value)
    return made


def _store_matrix(value: Any, out: Any) -> Any:
    wrong = _wrong("jacobian")
    if _is_matrix_of_tuples(value):
        n = len(value)
        lines = [f"if len(out) != {n}:", "    raise ValueError(WRONG)"]
        for i, row in enumerate(value):
            if len(row) != n:
                raise _refused("jacobian", value)
            lines += [f"out[{i}, {j}] = value[{i}][{j}]" for j in range(n)]
        return _made(lines, wrong)
    if isinstance(value, types.Array) and value.ndim == 2:
        lines = [
            "if out.shape != value.shape:",
            "    raise ValueError(WRONG)",
            "for i in range(out.shape[0]):",
            "    for j in range(out.shape[1]):",
            "        out[i, j] = value[i, j]",
        ]
        return _made(lines, wrong)
    if is_scalar(value):
        lines = [
            "if len(out) != 1:",
            "    raise ValueError(WRONG)",
            "out[0, 0] = value",
        ]
        return _made(lines, wrong)
    raise _refused("jacobian", value)


def _taken(context: Any, builder: Any, sign: Any, values: Any) -> Any:
    found = context.cast(builder, values[0], sign.args[0], sign.return_type)
    if context.enable_nrt:  # an array has one more owner
        context.nrt.incref(builder, sign.return_type, found)
    return found


# What is there where a value may be None, and is not.
_there = built(1, lambda kind: (kind.type(kind), _taken))


def _store_state(value: Any, out: Any) -> Any:
    wrong = _wrong("on_event")
    if isinstance(value, types.NoneType):
        return _made(["return 0"], wrong)
    if isinstance(value, types.Boolean):
        return _made(["return 1 if value else 0"], wrong)
    if isinstance(value, types.Optional):
        if (
            isinstance(value.type, types.Boolean)
            or _row_store(value.type, "") is not None
        ):
            lines = [
                "if value is None:",
                "    return 0",
                "return state(there(value), out)",
            ]
            return _made(lines, wrong, state=store_state, there=_there)
        raise _refused("on_event", value)
    if isinstance(value, types.Integer):
        raise TypingError(
            "it returns a whole number; return the new state (0.0 and not 0, if it is "
            "one number), True to stop, or nothing"
        )
    if isinstance(value, types.Array) and value.ndim == 1:
        # It may be a view of the state.
        lines = [
            "if len(out) != len(value):",
            "    raise ValueError(WRONG)",
            "new = value.copy()",
            "for i in range(len(out)):",
            "    out[i] = new[i]",
            "return 0",
        ]
        return _made(lines, wrong)
    made = _row_store(value, wrong, last="return 0")
    if made is None:
        raise _refused("on_event", value)
    return made


def _zeroed(out: Any, like: Any) -> Any:
    wrong = "the array that the function makes has another length than it should"
    if out == like:
        lines = ["for i in range(len(out)):", "    out[i] = 0.0"]
        return _made(lines, "", "out, like")
    size = "len(like)"
    if isinstance(like, types.Integer):
        size = "like"
    elif isinstance(like, types.BaseTuple):
        size = "like[0]"
    lines = [
        f"if len(out) != {size}:",
        "    raise ValueError(WRONG)",
        "for i in range(len(out)):",
        "    out[i] = 0.0",
    ]
    return _made(lines, wrong, "out, like")


# Numba compares the arguments with those of what is returned, without annotations.
overload(store_rates)(lambda value, out: _store_rates(value, out))
overload(store_values)(lambda value, out: _store_values(value, out))
overload(store_known)(lambda value, out: _store_known(value, out))
overload(store_matrix)(lambda value, out: _store_matrix(value, out))
overload(store_state)(lambda value, out: _store_state(value, out))
overload(zeroed)(lambda out, like: _zeroed(out, like))

STORES = {
    "field": store_rates,
    "guards": store_values,
    "on_event": store_state,
    "jacobian": store_matrix,
}
KNOWN = {"field": store_known, "guards": store_known}


class WrongResultError(TypeError):
    """A plain function returns what cannot be stored."""


def store_in_python(kind: str, value: Any, out: Any) -> int | None:
    """Store what a function has returned to Python.

    Raises
    ------
    WrongResultError
        If it is not of the right kind or shape.
    """
    if kind == "on_event":
        if value is None:
            return 0
        if isinstance(value, bool | np.bool_):
            return int(value)
        if isinstance(value, int | np.integer):
            raise WrongResultError(
                "returns a whole number; return the new state (0.0 and not 0, if "
                "it is one number), True to stop, or nothing"
            )
    if value is None:
        raise WrongResultError("returns None on some path; expected numbers")
    try:
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise WrongResultError(f"returns {value!r}; expected numbers") from None
    if numbers.ndim == 0:
        numbers = numbers.reshape((1,) * out.ndim)
    if numbers.shape != out.shape:
        raise WrongResultError(
            f"returns an array of the shape {numbers.shape}; expected {out.shape}"
        )
    out[...] = numbers
    return 0 if kind == "on_event" else None
