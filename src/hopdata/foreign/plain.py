"""How plain values travel between two processes, without a pickle.

A frame is a mark, the length of its head, the head, and the bytes of its arrays. The
head is JSON: numbers, texts, lists and tables, with an array as its place in the list
of arrays, of which type and shape are stated. Whoever receives it compares all claims
with a budget before it allocates anything.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import date, datetime, time
from math import prod
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hopdata.foreign.budget import DEEPEST, MOST_HEAD

MARK = b"hopdata1"
_LENGTH_BYTES = 8

# Kinds of numbers that may travel.
_KINDS = "biufc"

# Dimensions of an array.
_MOST_DIMENSIONS = 8

# Bytes that are sent or received at a time.
_BLOCK = 1 << 20

# Bytes up to which an array is copied in one piece to be sent.
_PIECE = 1 << 24

_TIMES: dict[str, Any] = {"datetime": datetime, "date": date, "time": time}


class WrongFrameError(ValueError):
    """What was received is no frame, or one beyond the budget."""


class EndedError(EOFError):
    """The other side ended before the frame did."""


class Source(Protocol):
    """The half of a pipe from which is read."""

    def read(self, n_bytes: int, /) -> bytes | None:
        """Return at most `n_bytes` bytes; none at the end."""


class Sink(Protocol):
    """The half of a pipe to which is written."""

    def write(self, content: Any, /) -> int | None:
        """Write bytes; return how many."""


def send(stream: Sink, value: Any) -> None:
    """Write a value as a frame.

    Parameters
    ----------
    stream : Sink
    value
        None, bool, int, float, str, bytes, dates and times, arrays of numbers, and
        lists, tuples and mappings of them.

    Raises
    ------
    TypeError
        If it holds anything else; nothing has been written then.
    ValueError
        If the head would be too long or too deep; nothing has been written then.
    """
    head, arrays = packed(value)
    _write(stream, MARK + len(head).to_bytes(_LENGTH_BYTES, "little") + head)
    for array in arrays:
        _send_array(stream, array)


def packed(value: Any) -> tuple[bytes, list[NDArray[Any]]]:
    """Return the head of a value, and its arrays in the order of their axes in memory.

    Raises
    ------
    TypeError
        If the value is not plain.
    ValueError
        If the head would be too long or too deep.
    """
    arrays: list[NDArray[Any]] = []
    tree = _tree(value, arrays, 0)
    stated = [[array.dtype.str, list(array.shape)] for array in arrays]
    head = json.dumps({"value": tree, "arrays": stated}).encode("ascii")
    if len(head) > MOST_HEAD:
        raise ValueError(f"expected at most {MOST_HEAD} bytes, found {len(head)}")
    return head, arrays


def _tree(value: Any, arrays: list[NDArray[Any]], depth: int) -> Any:
    """Return what JSON can hold of a value; its arrays are added to `arrays`."""
    if depth > DEEPEST:
        raise ValueError(f"expected at most {DEEPEST} levels, found more")
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, str):  # of a subclass
        return str(value)
    if isinstance(value, bytes | bytearray | memoryview):
        content = np.frombuffer(value, np.uint8)
        return {"bytes": _tree(content, arrays, depth + 1)["array"]}
    if isinstance(value, np.ndarray):
        return _array_tree(value, arrays)
    for name, kind in _TIMES.items():
        if type(value) is kind:
            return {name: value.isoformat()}
    if isinstance(value, Mapping):
        pairs = []
        for key, one in value.items():
            pairs.append([_tree(key, arrays, depth + 1), _tree(one, arrays, depth + 1)])
        return {"table": pairs}
    if isinstance(value, list | tuple):
        name = "tuple" if isinstance(value, tuple) else "list"
        return {name: [_tree(one, arrays, depth + 1) for one in value]}
    raise TypeError(f"expected numbers, texts and arrays, found {type(value).__name__}")


def _array_tree(value: NDArray[Any], arrays: list[NDArray[Any]]) -> dict[str, Any]:
    """Return the place of an array, and the order of its axes in memory if unusual."""
    if value.dtype.kind not in _KINDS:
        raise TypeError(f"expected numbers, found an array of {value.dtype}")
    order = sorted(range(value.ndim), key=lambda axis: -abs(value.strides[axis]))
    if value.flags.c_contiguous:
        order = list(range(value.ndim))
    arrays.append(value.transpose(order))
    tree: dict[str, Any] = {"array": len(arrays) - 1}
    if order != sorted(order):
        tree["order"] = order
    return tree


def _send_array(stream: Sink, array: NDArray[Any]) -> None:
    """Write the bytes of an array, a part at a time where it is not whole in memory."""
    if array.size == 0:
        return
    if array.flags.c_contiguous or array.ndim < 2 or array.nbytes <= _PIECE:
        _write(stream, np.ascontiguousarray(array).reshape(-1).view(np.uint8))
        return
    n_rows = max(1, _PIECE * len(array) // array.nbytes)
    for first in range(0, len(array), n_rows):
        part = np.ascontiguousarray(array[first : first + n_rows])
        _write(stream, part.reshape(-1).view(np.uint8))


def _write(stream: Sink, content: Any) -> None:
    left = memoryview(content)
    while left.nbytes:
        n_written = stream.write(left[:_BLOCK])
        left = left[n_written or 0 :]


def receive(stream: Source, most_bytes: int) -> Any:
    """Read a frame and return its value.

    Parameters
    ----------
    stream : Source
    most_bytes : int
        Bytes that all arrays together may have.

    Raises
    ------
    EndedError
        If the other side ends before the frame does.
    WrongFrameError
        If it is no frame, or claims more than it may.
    """
    start = _read(stream, len(MARK) + _LENGTH_BYTES)
    if not start.startswith(MARK):
        raise WrongFrameError("something else than an answer")
    n_head = int.from_bytes(start[len(MARK) :], "little")
    if n_head > MOST_HEAD:
        raise WrongFrameError(f"a head of {n_head} bytes")
    head = _read(stream, n_head)
    try:
        stated = json.loads(head)
        tree, claims = stated["value"], _claims(stated["arrays"])
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise WrongFrameError("a head that cannot be read") from error
    claimed = 0
    for dtype, shape in claims:
        claimed += dtype.itemsize * prod(shape)
    if claimed > most_bytes:
        raise WrongFrameError(f"arrays of {claimed} bytes")
    arrays = [_received(stream, dtype, shape) for dtype, shape in claims]
    try:
        return _value(tree, arrays, 0)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError) as error:
        raise WrongFrameError("a head that does not fit its arrays") from error


def _claims(stated: Any) -> list[tuple[np.dtype[Any], tuple[int, ...]]]:
    """Return the types and shapes that a head states."""
    claims = []
    for name, shape in stated:
        dtype = np.dtype(str(name))
        is_shape = isinstance(shape, list) and len(shape) <= _MOST_DIMENSIONS
        if dtype.kind not in _KINDS or not is_shape:
            raise ValueError(f"an array of {name}")
        if any(type(number) is not int or number < 0 for number in shape):
            raise ValueError(f"an array of shape {shape}")
        claims.append((dtype, tuple(shape)))
    return claims


def _received(
    stream: Source, dtype: np.dtype[Any], shape: tuple[int, ...]
) -> NDArray[Any]:
    array = np.empty(shape, dtype)
    if array.size == 0:
        return array
    place = array.reshape(-1).view(np.uint8).data
    first = 0
    while first < len(place):
        part = stream.read(min(_BLOCK, len(place) - first))
        if not part:
            raise EndedError
        place[first : first + len(part)] = part
        first += len(part)
    return array


def _read(stream: Source, n_bytes: int) -> bytes:
    parts = []
    while n_bytes > 0:
        part = stream.read(min(_BLOCK, n_bytes))
        if not part:
            raise EndedError
        parts.append(part)
        n_bytes -= len(part)
    return b"".join(parts)


def _value(tree: Any, arrays: Sequence[NDArray[Any]], depth: int) -> Any:
    """Return the value of which `_tree` made a tree."""
    if depth > DEEPEST:
        raise ValueError("too deep")
    if not isinstance(tree, dict):
        if isinstance(tree, list):
            raise ValueError("a list without a name")
        return tree
    if "array" in tree:
        array = arrays[tree["array"]]
        if "order" not in tree:
            return array
        return array.transpose(np.argsort(tree["order"]))
    ((name, content),) = tree.items()
    if name == "bytes":
        return arrays[content].tobytes()
    if name in _TIMES:
        return _TIMES[name].fromisoformat(content)
    if name == "table":
        table = {}
        for key, one in content:
            of_key = _value(key, arrays, depth + 1)
            table[of_key] = _value(one, arrays, depth + 1)
        return table
    values = [_value(one, arrays, depth + 1) for one in content]
    if name == "tuple":
        return tuple(values)
    if name == "list":
        return values
    raise ValueError(f"a {name}")
