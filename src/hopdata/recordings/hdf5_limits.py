"""Datasets and attributes of HDF5 files that may be damaged: none is read before it is looked at.

The library that reads HDF5 believes what a file says of itself: it would make an array of any size,
and follow a type that is none into memory that is not its own.
"""

from __future__ import annotations

from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import h5py

_DEFLATE_MOST = 1032  # no byte of deflated data gives more bytes than that
_SMALL = 1 << 20  # bytes that any dataset may ask for


def whole_array(dataset: h5py.Dataset) -> NDArray[Any]:
    """Read a dataset, if its size can be true.

    A shape is a claim; what is stored is not. A dataset of chunks that were never written would
    come back as zeros without end.

    Raises
    ------
    ValueError
        If the dataset claims more than its stored bytes can hold.
    """
    claimed = prod(dataset.shape) * dataset.dtype.itemsize
    stored = int(dataset.id.get_storage_size())
    if claimed > max(_SMALL, _DEFLATE_MOST * stored):
        raise ValueError(
            f"dataset '{dataset.name}': expected at most {_DEFLATE_MOST * stored} bytes by what is "
            f"stored ({stored} bytes), found a claim of {claimed}"
        )
    array: NDArray[Any] = np.asarray(dataset[()])
    return array


def checked_attribute(item: h5py.Group | h5py.Dataset, name: str) -> Any:
    """Read an attribute that is numbers or text; None if there is none of this name.

    Raises
    ------
    ValueError
        If it is of another type, or too large.
    """
    import h5py

    if name not in item.attrs:
        return None
    attribute = h5py.h5a.open(item.id, name.encode())
    kind = attribute.get_type()
    sound = isinstance(kind, h5py.h5t.TypeStringID | h5py.h5t.TypeIntegerID | h5py.h5t.TypeFloatID)
    claimed = attribute.get_space().get_simple_extent_npoints() * kind.get_size()
    if not sound or max(claimed, kind.get_size()) > _SMALL:
        raise ValueError(
            f"attribute '{name}': expected numbers or text, found {type(kind).__name__} of "
            f"{claimed} bytes"
        )
    return item.attrs[name]
