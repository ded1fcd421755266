"""Arrays of numbers from an archive of NumPy, as a trained model is kept in.

Only the arrays that are named are read, each in memory that was measured before: a few
bytes of an archive can unpack to gigabytes, and the head of an array can claim any
shape. Arrays of objects are pickles, which are never loaded.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as numpy_format
from numpy.typing import NDArray

from hopdata.errors import HopdataError, RecordingError
from hopdata.foreign.texts import bytes_of
from hopdata.messages import Message


def arrays_of(
    path: str | Path,
    names: Iterable[str],
    *,
    wanted: str,
    most: int,
    error: type[HopdataError] = RecordingError,
) -> dict[str, NDArray[Any]]:
    """Return arrays of numbers by name.

    Parameters
    ----------
    path : path
    names : iterable of str
        Arrays that are read; others are left alone.
    wanted : str
        What the file should be, for messages.
    most : int
        Bytes that the file, and each array, may have.
    error : type of HopdataError
        Class of the error.

    Raises
    ------
    MemoryError
        If this computer lacks the memory, which says nothing about the file.
    HopdataError
        Of class `error`, if the file cannot be read or an array is missing, too large,
        or holds other things than numbers.
    """
    content = bytes_of(path, wanted=wanted, most=most, error=error)
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            return {name: _array(archive, name, most) for name in names}
    except MemoryError:
        raise
    except Exception as fault:  # a damaged archive makes the library raise anything
        found = str(fault) or type(fault).__name__
        values = {"place": f"{path}", "wanted": wanted, "found": found}
        raise error(Message("foreign.other_file", values)) from None


def _array(archive: zipfile.ZipFile, name: str, most: int) -> NDArray[Any]:
    with archive.open(f"{name}.npy") as member:
        content = member.read(most + 1)
    if len(content) > most:
        raise ValueError(f"{name}: more than {most / 1e6:g} MB once it is unpacked")
    file = BytesIO(content)
    version = numpy_format.read_magic(file)
    if version == (1, 0):
        shape, _, dtype = numpy_format.read_array_header_1_0(file)
    else:
        shape, _, dtype = numpy_format.read_array_header_2_0(file)
    if dtype.kind not in "biuf":
        raise ValueError(f"{name}: no numbers, but {dtype}")
    n_bytes = prod(shape) * dtype.itemsize
    if n_bytes > len(content) - file.tell():
        raise ValueError(f"{name}: a claim of {n_bytes} bytes in {len(content)}")
    file.seek(0)
    return np.asarray(numpy_format.read_array(file, allow_pickle=False))
