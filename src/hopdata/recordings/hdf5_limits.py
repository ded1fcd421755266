"""Datasets of HDF5 files that somebody else wrote: none may be larger than its bytes can say."""

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
