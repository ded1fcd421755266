"""MAT files of version 5 to 7: their variables as dicts, lists, texts and arrays.

Layout after MathWorks' "MAT-File Format". Only what a motion-capture export holds is decoded. A
size in the file is believed only as far as there are bytes for it, so a damaged file cannot ask for
memory without end; other readers allocate first.
"""

from __future__ import annotations

import zlib
from math import prod
from typing import Any

import numpy as np

from hopdata.recordings.raw import MOST_UNPACKED_MB, require_unpacked

_STRUCT, _CELL, _CHAR = 2, 1, 4
_NUMERIC = range(6, 16)
_LOGICAL_OR_COMPLEX = 0x800
_MATRIX, _COMPRESSED = 14, 15
_DTYPES = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_TEXTS = {2: "utf-8", 1: "utf-8", 16: "utf-8", 4: "utf-16", 17: "utf-16", 18: "utf-32"}
_DEEPEST = 12
HEADER_BYTES = 128


class MatError(ValueError):
    """What is wrong in the file, without its name."""


def read_mat5(data: bytes, most_unpacked_mb: float = MOST_UNPACKED_MB) -> dict[str, Any]:
    """Decode all variables.

    Parameters
    ----------
    data : bytes
        The whole file.
    most_unpacked_mb : float
        Memory that all numbers may ask for, MB.

    Returns
    -------
    dict
        By name: a struct is a dict (an array of them a list of dicts), a cell array a list, text
        is str, numbers are arrays in MATLAB's order of axes. Anything else is None.

    Raises
    ------
    MatError
        Naming the byte, what was expected and what was found.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise MatError(f"byte 126: expected 'IM' or 'MI', found {data[126:128]!r}")
    source = _Bytes(memoryview(data), order, "", _Allowance(most_unpacked_mb))
    return dict(_variables(source, HEADER_BYTES))


def _variables(source: _Bytes, at: int) -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    while at < len(source.data):
        kind, piece, at = source.element(at)
        if kind == _COMPRESSED:
            if source.note:
                raise MatError(f"{source.where(at)}: expected data, found it compressed again")
            whole = memoryview(_inflated(piece, source, source.where(at)))
            inner = _Bytes(whole, source.order, " (decompressed)", source.allowance)
            found += _variables(inner, 0)
        elif kind == _MATRIX:
            found.append(_matrix(source.part(piece), 0))
    return found


def _inflated(piece: memoryview, source: _Bytes, place: str) -> bytes:
    """Decompress one element, of the size that its first bytes state, if that may be."""
    stream = zlib.decompressobj()
    try:
        lead = stream.decompress(piece, 8)
        if len(lead) < 8:
            raise MatError(f"{place}: expected an element, found {len(lead)} bytes")
        size = int(np.frombuffer(lead, f"{source.order}u4")[1])
        source.allowance.take(size)
        data = lead + stream.decompress(stream.unconsumed_tail, size + 8)
    except zlib.error as error:
        raise MatError(f"{place}: expected compressed data, found: {error}") from None
    if not stream.eof:
        raise MatError(f"{place}: expected the end of compressed data, found more or a cut")
    return data


def _matrix(source: _Bytes, depth: int) -> tuple[str, Any]:
    """Name and value of one matrix element."""
    if depth > _DEEPEST:
        raise MatError(f"{source.where(0)}: expected at most {_DEEPEST} levels, found more")
    if not source.data:
        return "", np.empty((0, 0))
    flags, at = source.array(0)
    shape_array, at = source.array(at)
    _, name, at = source.element(at)
    shape = tuple(int(n) for n in shape_array)
    kind = int(flags[0]) & 0xFF if len(flags) else 0
    if any(n < 0 for n in shape) or not shape:
        raise MatError(f"{source.where(at)}: expected a size, found {shape}")
    return bytes(name).decode("latin-1"), _content(source, at, kind, shape, depth)


def _content(source: _Bytes, at: int, kind: int, shape: tuple[int, ...], depth: int) -> Any:
    if kind in _NUMERIC:
        values, _ = source.array(at)
        if prod(shape) != len(values):
            raise MatError(f"{source.where(at)}: expected {shape} numbers, found {len(values)}")
        source.allowance.take(8 * len(values) - values.nbytes)  # a float each, in the end
        return values.reshape(shape, order="F")
    if kind == _CHAR:
        return source.text(at)
    if kind == _CELL:
        return _elements(source, at, prod(shape), depth)[0]
    return _struct(source, at, prod(shape), depth) if kind == _STRUCT else None


def _struct(source: _Bytes, at: int, count: int, depth: int) -> Any:
    """Decode a struct as a dict, and an array of them as a list."""
    width_array, at = source.array(at)
    _, joined, at = source.element(at)
    width = int(width_array[0]) if len(width_array) else 0
    if width < 1:
        raise MatError(f"{source.where(at)}: expected the length of field names, found {width}")
    names = [
        bytes(joined[i : i + width]).split(b"\0")[0].decode("latin-1")
        for i in range(0, len(joined), width)
    ]
    if not names or not count:
        return {} if count == 1 else []
    values, _ = _elements(source, at, count * len(names), depth)
    pieces = range(0, len(values), len(names))
    structs = [dict(zip(names, values[i : i + len(names)], strict=True)) for i in pieces]
    return structs[0] if count == 1 else structs


def _elements(source: _Bytes, at: int, count: int, depth: int) -> tuple[list[Any], int]:
    """Decode `count` matrices, one after the other."""
    if count * 8 > len(source.data) - at:
        raise MatError(f"{source.where(at)}: expected {count} elements, found the end")
    values = []
    for _ in range(count):
        kind, piece, at = source.element(at)
        if kind != _MATRIX:
            raise MatError(f"{source.where(at)}: expected an element of type 14, found {kind}")
        values.append(_matrix(source.part(piece), depth + 1)[1])
    return values, at


class _Allowance:
    """Counts what a file has asked for."""

    def __init__(self, most_mb: float) -> None:
        self.most_mb, self.taken = most_mb, 0

    def take(self, n_bytes: int) -> None:
        self.taken += n_bytes
        try:
            require_unpacked(self.taken, self.most_mb)
        except ValueError as error:
            raise MatError(str(error)) from None


class _Bytes:
    """A stretch of the file, or of what was compressed in it, as tagged elements."""

    def __init__(self, data: memoryview, order: str, note: str, allowance: _Allowance) -> None:
        self.data, self.order, self.note, self.allowance = data, order, note, allowance

    def part(self, data: memoryview) -> _Bytes:
        return _Bytes(data, self.order, self.note, self.allowance)

    def where(self, at: int) -> str:
        return f"byte {at}{self.note}"

    def element(self, at: int) -> tuple[int, memoryview, int]:
        """Type, content and end of the element at a byte."""
        if at + 8 > len(self.data):
            raise MatError(f"{self.where(at)}: expected an element, found the end")
        first, second = (int(x) for x in np.frombuffer(self.data, f"{self.order}u4", 2, at))
        if first >> 16:  # a small element: its size stands before its type
            kind, size, start, end = first & 0xFFFF, first >> 16, at + 4, at + 8
        else:
            kind, size, start = first, second, at + 8
            padding = 0 if kind == _COMPRESSED else -size % 8
            end = start + size + padding
        if start + size > len(self.data) or (start == at + 4 and size > 4):
            raise MatError(
                f"{self.where(at)}: expected an element of {size} bytes, "
                f"found {len(self.data) - start}"
            )
        return kind, self.data[start : start + size], end

    def array(self, at: int) -> tuple[Any, int]:
        """Numbers of the element at a byte, and its end."""
        kind, piece, end = self.element(at)
        if kind not in _DTYPES:
            raise MatError(f"{self.where(at)}: expected numbers, found the type {kind}")
        dtype = np.dtype(self.order + _DTYPES[kind])
        return np.frombuffer(piece[: len(piece) // dtype.itemsize * dtype.itemsize], dtype), end

    def text(self, at: int) -> str:
        """Text of the element at a byte."""
        kind, piece, _ = self.element(at)
        if kind not in _TEXTS:
            raise MatError(f"{self.where(at)}: expected text, found the type {kind}")
        order = "" if _TEXTS[kind] == "utf-8" else {"<": "-le", ">": "-be"}[self.order]
        return bytes(piece).decode(_TEXTS[kind] + order, errors="replace")
