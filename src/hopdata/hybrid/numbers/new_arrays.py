"""New arrays in code that computes with ranges or duals.

A function with a range or a dual among its arguments computes with such numbers, so an
array that it makes holds them, too: ``np.zeros(3)`` may receive them later. The type
follows from the arguments of the function that is being compiled.

Of Numba's internals this uses two: the typing context's stack of functions in
compilation, which tells those arguments; and the exception by which a rewriting of
``np.array([...])`` gives up, because it can only name types of NumPy.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from hopdata.hybrid.compiled.memory import NumberLike, built, is_number
from hopdata.hybrid.numbers.vectors import is_array, ours_among, overload_first
from hopdata.private_numba import LEFT_AS_IT_IS, FirstTried, ask_first

Function = Callable[..., Any]
SEQUENCES = (types.Array, types.List, types.BaseTuple)

# What makes arrays, written for one type of numbers. The default of the last argument
# tells one type's code from another's.


def _dtype(kind: Any) -> Any:
    """Return a function for compiled code that gives the type of an array's items."""
    given = types.DType(kind)

    def generate(context: Any, *_: Any) -> Any:
        return context.get_dummy_value()

    return built(0, lambda: (given(), generate))


def _written(text: str, **names: Any) -> Function:
    """Return the function of a text, which has the name `made`."""
    scope: dict[str, Any] = {"np": np, **names}
    exec(text, scope)
    made: Function = scope["made"]
    return made


def _always(head: str, body: str, kind: Any, **names: Any) -> Function:
    """Return an overload that has the same code for all arguments."""
    head = f"def made({head}, of={str(kind)!r}):\n    "
    code = _written(head + body, ITEMS=_dtype(kind), **names)
    return _written(head + "return code", code=code)


def _zeros(kind: Any) -> Function:
    return _always("shape, dtype=None", "return np.zeros(shape, ITEMS())", kind)


def _ones(kind: Any) -> Function:
    body = "new = np.zeros(shape, ITEMS())\n    new[...] = 1.0\n    return new"
    return _always("shape, dtype=None", body, kind)


def _full(kind: Any) -> Function:
    body = "new = np.zeros(shape, ITEMS())\n    new[...] = fill_value\n    return new"
    return _always("shape, fill_value, dtype=None", body, kind)


def _eye(kind: Any) -> Function:
    body = (
        "new = np.zeros((N, N), ITEMS())\n"
        "    for i in range(N):\n"
        "        new[i, i] = 1.0\n"
        "    return new"
    )
    return _always("N, dtype=None", body, kind)


HEAD_OF_ARRAY = "def made(object, dtype=None, of={of!r}):\n    "
BODIES = {
    "copy": "new = np.zeros(object.shape, ITEMS())\n    new[...] = object",
    "row": (
        "new = np.zeros(len(object), ITEMS())\n"
        "    for i in range(len(object)):\n"
        "        new[i] = object[i]"
    ),
    "table": (
        "new = np.zeros((len(object), len(object[0])), ITEMS())\n"
        "    for i in range(len(object)):\n"
        "        for j in range(len(object[0])):\n"
        "            new[i, j] = object[i][j]"
    ),
}


def _array(kind: Any) -> Function:
    head = HEAD_OF_ARRAY.format(of=str(kind))

    def code_for(given: Any) -> Function:
        body = _body_for(given)
        return _written(f"{head}{body}\n    return new", ITEMS=_dtype(kind))

    return _written(f"{head}return code_for(object)", code_for=code_for)


def _body_for(given: Any) -> str:
    """Return the lines that copy a sequence of this type into a new array."""
    if isinstance(given, types.Array):
        return BODIES["copy"]
    if isinstance(given, types.List):
        return BODIES["table" if isinstance(given.dtype, SEQUENCES) else "row"]
    # The elements of a tuple may have several types.
    if not isinstance(given[0], SEQUENCES):
        lines = [f"new[{i}] = object[{i}]" for i in range(len(given))]
        return "\n    ".join([f"new = np.zeros({len(given)}, ITEMS())", *lines])
    lines = [f"new = np.zeros(({len(given)}, len(object[0])), ITEMS())"]
    for i, item in enumerate(given):
        if isinstance(item, types.BaseTuple):
            lines += [f"new[{i}, {j}] = object[{i}][{j}]" for j in range(len(item))]
        else:
            lines.append(f"for j in range(len(object[{i}])):")
            lines.append(f"    new[{i}, j] = object[{i}][j]")
    return "\n    ".join(lines)


# Which arguments make an array of our numbers.


def _is_shape(kind: Any) -> bool:
    return isinstance(kind, types.Integer | types.BaseTuple)


def _is_table(kind: Any) -> bool:
    """Return whether a type is that of a sequence of numbers, not all integers."""
    return (
        isinstance(kind, SEQUENCES)
        and bool(_holds(kind, all, _is_any_number))
        and (_holds(kind, any, _is_no_integer))
    )


def _holds(kind: Any, how: Function, test: Function) -> bool:
    if isinstance(kind, types.Array | types.List):
        return _holds(kind.dtype, how, test)
    if isinstance(kind, types.BaseTuple):
        items: Any = kind
        return len(kind) > 0 and bool(how(_holds(one, how, test) for one in items))
    return bool(test(kind))


def _is_any_number(kind: Any) -> bool:
    return isinstance(kind, NumberLike) or is_number(kind)


def _is_no_integer(kind: Any) -> bool:
    return isinstance(kind, NumberLike | types.Float)


def _is_of_floats(dtype: Any) -> bool:
    """Return whether what is given for the type of an array's items means floats."""
    if dtype is None or isinstance(dtype, types.NoneType):
        return True
    if isinstance(dtype, types.Function):
        return bool(dtype.typing_key is float)
    if isinstance(dtype, types.NumberClass | types.DType):
        return _is_no_integer(dtype.dtype)
    return False


MAKERS: dict[Any, tuple[Function, Function, tuple[str, ...]]] = {
    np.zeros: (_zeros, _is_shape, ("shape", "dtype")),
    # What a user's code reads before it writes is undefined; zeros are safe.
    np.empty: (_zeros, _is_shape, ("shape", "dtype")),
    np.ones: (_ones, _is_shape, ("shape", "dtype")),
    np.full: (_full, _is_shape, ("shape", "fill_value", "dtype")),
    np.eye: (_eye, _is_shape, ("N", "M", "k", "dtype")),
    np.identity: (_eye, _is_shape, ("N", "dtype")),
    np.array: (_array, _is_table, ("object", "dtype")),
    np.asarray: (_array, _is_table, ("object", "dtype")),
}
_made: dict[tuple[Any, Any], Function] = {}


def make_arrays_of(kind: Any) -> None:
    """Let code that computes with a type of our numbers make arrays of it."""
    for key, (code, _, _) in MAKERS.items():

        def made() -> None:
            """Stand for the function that makes an array of this type."""

        overload(made, strict=False)(code(kind))
        _made[key, kind] = made


def _numbers_in_use(typing: Any) -> Any:
    """Return the type of our numbers in the function in compilation, or None."""
    if len(typing.callstack) == 0:
        return None
    return ours_among(typing.callstack[0].args)


def _end_rewriting(typing: Any, dtype: Any) -> None:
    """End Numba's rewriting of ``np.array([...])`` for our numbers.

    It calls ``np.empty`` with the type of the items. In a user's function nothing else
    does so with one of our types; functions of Numba's own may, and are left alone.
    """
    is_of_ours = isinstance(dtype, types.DType) and isinstance(dtype.dtype, NumberLike)
    if is_of_ours and not _is_numbas_own(typing):
        raise LEFT_AS_IT_IS


def _is_numbas_own(typing: Any) -> bool:
    """Return whether the function in compilation is one of Numba's."""
    if len(typing.callstack) == 0:
        return False
    return str(typing.callstack[0].func_id.modname).startswith("numba.")


def _maker(key: Any, takes: Function, names: tuple[str, ...]) -> None:
    class Maker(FirstTried):
        def generic(self, args: Any, kws: Any) -> Any:
            given = dict(zip(names, args, strict=False)) | kws
            dtype = given.get("dtype")
            if key is np.empty:
                _end_rewriting(self.context, kws.get("dtype"))
            if not takes(given.get(names[0])) or not _is_of_floats(dtype):
                return None
            kind = ours_among(given.values()) or _numbers_in_use(self.context)
            if (key, kind) not in _made or "k" in given or "M" in given:
                return None
            if key is np.full and not _is_any_number(given.get("fill_value")):
                return None
            self._found = self.context.resolve_value_type(_made[key, kind])
            return self._found.get_call_type(self.context, args, kws)

        def get_impl_key(self, sig: Any) -> Any:
            return self._found.get_impl_key(sig)

    ask_first(key, Maker)


for _key, (_, _takes, _names) in MAKERS.items():
    _maker(_key, _takes, _names)


def _like(name: str, value: float) -> Function:
    text = f"def made({name}):\n    new = np.copy({name})\n    new[...] = {value}\n"
    code = _written(f"{text}    return new")
    text = f"def made({name}): return code if is_array({name}) else None"
    return _written(text, code=code, is_array=is_array)


overload_first(np.zeros_like)(_like("a", 0.0))
overload_first(np.empty_like)(_like("a", 0.0))
overload_first(np.ones_like)(_like("a", 1.0))
