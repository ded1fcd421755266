"""How plain values travel between two processes, without a pickle.

A frame is a mark, the length of its head, the head, and the bytes of its arrays. The
head is JSON: numbers, texts, lists and tables, with an array as its place in the list
of arrays, of which type and shape are stated. Whoever receives it compares all claims
with a budget before it allocates anything. A dataclass travels as its name and its
fields, and only those that the receiver names are made again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import date, datetime, time
from math import prod
from pathlib import Path, PurePath
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
        None, bool, int, float, str, bytes, dates and times, paths, arrays of numbers,
        and lists, tuples, mappings and dataclasses of them.

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
        return {"bytes": _array_tree(content, arrays)["array"]}
    if isinstance(value, np.ndarray):
        return _array_tree(value, arrays)
    for name, kind in _TIMES.items():
        if type(value) is kind:
            return {name: value.isoformat()}
    if isinstance(value, PurePath):
        return {"path": str(value)}
    return _container_tree(value, arrays, depth)


def _container_tree(value: Any, arrays: list[NDArray[Any]], depth: int) -> Any:
    """Return the tree of a value that holds others."""
    if isinstance(value, list | tuple):
        name = "tuple" if isinstance(value, tuple) else "list"
        return {name: [_tree(one, arrays, depth + 1) for one in value]}
    pairs = []
    if isinstance(value, Mapping):
        for key, one in value.items():
            pairs.append([_tree(key, arrays, depth + 1), _tree(one, arrays, depth + 1)])
        return {"table": pairs}
    if is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            if field.init:
                of_field = _tree(getattr(value, field.name), arrays, depth + 1)
                pairs.append([field.name, of_field])
        return {"record": [type(value).__name__, pairs]}
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


def receive(stream: Source, most_bytes: int, kinds: Sequence[type] = ()) -> Any:
    """Read a frame and return its value.

    Parameters
    ----------
    stream : Source
    most_bytes : int
        Bytes that all arrays together may have.
    kinds : sequence of type
        Dataclasses that may be made.

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
        return _Values(arrays, {kind.__name__: kind for kind in kinds}).of(tree, 0)
    except Exception as error:  # also what a dataclass says about its fields
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


class _Values:
    """Makes values of trees, arrays and dataclasses."""

    def __init__(
        self, arrays: Sequence[NDArray[Any]], kinds: Mapping[str, type]
    ) -> None:
        self._arrays = arrays
        self._kinds = kinds

    def of(self, tree: Any, depth: int) -> Any:
        """Return the value of which `_tree` made a tree."""
        if depth > DEEPEST:
            raise ValueError("too deep")
        if isinstance(tree, list):
            raise ValueError("a list without a name")
        if not isinstance(tree, dict):
            return tree
        if "array" in tree:
            array = self._arrays[tree["array"]]
            if "order" not in tree:
                return array
            return array.transpose(np.argsort(tree["order"]))
        ((name, content),) = tree.items()
        if name in _TIMES:
            return _TIMES[name].fromisoformat(content)
        if name == "bytes":
            return self._arrays[content].tobytes()
        if name == "path":
            return Path(content)
        return self._container(name, content, depth)

    def _container(self, name: str, content: Any, depth: int) -> Any:
        """Return a value that holds others."""
        if name == "table":
            return self._table(content, depth)
        if name == "record":
            kind, pairs = content
            own = [[field, value] for field, value in pairs if isinstance(field, str)]
            return self._kinds[kind](**self._table(own, depth))
        values = [self.of(one, depth + 1) for one in content]
        if name == "tuple":
            return tuple(values)
        if name == "list":
            return values
        raise ValueError(f"a {name}")

    def _table(self, pairs: Any, depth: int) -> dict[Any, Any]:
        table = {}
        for key, one in pairs:
            of_key = self.of(key, depth + 1)
            table[of_key] = self.of(one, depth + 1)
        return table
