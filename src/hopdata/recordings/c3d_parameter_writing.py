"""The parameter section of a C3D file that is to be written."""

from __future__ import annotations

from typing import Any

import numpy as np

from hopdata.recordings.c3d_numbers import PROCESSORS, Processor
from hopdata.recordings.c3d_parameters import BLOCK


def parameter_bytes(processor: Processor, groups: dict[str, dict[str, Any]]) -> bytes:
    """Encode groups of parameters: texts (list of str), whole numbers (int) or floats.

    Returns
    -------
    bytes
        A whole number of blocks.

    Raises
    ------
    ValueError
        If a text or list is longer than the format can say (255).
    """
    body = b""
    for number, (group, parameters) in enumerate(groups.items(), start=1):
        body += _record(processor, group, -number, b"\0")
        for name, value in parameters.items():
            body += _record(processor, name, number, _content(processor, name, value) + b"\0")
    body += b"\0\0"
    n_blocks = -(-(len(body) + 4) // BLOCK)
    number = next(key for key, kind in PROCESSORS.items() if kind == processor)
    if n_blocks > 255:
        raise ValueError(f"parameters: expected at most 255 blocks, found {n_blocks}")
    return bytes([1, 0x50, n_blocks, number]) + body.ljust(n_blocks * BLOCK - 4, b"\0")


def _record(processor: Processor, name: str, number: int, content: bytes) -> bytes:
    title = name.encode()
    lead = bytes([len(title), number % 256]) + title
    return lead + processor.from_whole([len(content) + 2]) + content


def _content(processor: Processor, name: str, value: Any) -> bytes:
    if isinstance(value, list):
        texts = [text.encode() for text in value]
        width = max([1, *map(len, texts)])
        if width > 255 or len(texts) > 255:
            raise ValueError(
                f"{name}: expected at most 255 texts of 255 bytes, found {len(texts)} of {width}"
            )
        data = b"".join(text.ljust(width) for text in texts)
        return bytes([255, 2, width, len(texts)]) + data
    array = np.asarray(value)
    sizes = array.shape[::-1]
    if array.dtype.kind == "f":
        return bytes([4, len(sizes), *sizes]) + processor.from_floats(array)
    return bytes([2, len(sizes), *sizes]) + processor.from_whole(array)
