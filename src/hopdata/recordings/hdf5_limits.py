"""Datasets and attributes of HDF5 files that may be damaged: none is read before it is looked at.

The library that reads HDF5 believes what a file says of itself: it would make an array of any size,
and follow a type that is none into memory that is not its own.
"""

from __future__ import annotations

from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.raw import require_unpacked

if TYPE_CHECKING:
    import h5py

_DEFLATE_MOST = 1032  # no byte of deflated data gives more bytes than that
NUMBER_BYTES = 8  # what a number takes that is read, however it is stored
_SMALL = 1 << 20  # bytes that any dataset may ask for


def require_sound(file: h5py.File, most_unpacked_mb: float) -> None:
    """Refuse a file that reaches for other files, or would unpack to more than it may.

    Raises
    ------
    ValueError
        Naming a link or dataset that lies outside of the file, or the size of all.
    """
    import h5py

    links: list[tuple[str, Any]] = []
    file.visititems_links(lambda name, link: links.append((name, link)))  # which must not raise
    total = 0
    for name, link in links:
        if isinstance(link, h5py.ExternalLink):
            raise ValueError(_outside(name, "a link to another file", link.filename))
        item = file[name] if isinstance(link, h5py.HardLink) else None
        if not isinstance(item, h5py.Dataset) or item.shape is None:
            continue
        if item.external:
            raise ValueError(_outside(name, "data kept in another file", item.external[0][0]))
        if item.is_virtual:
            sources = item.virtual_sources()
            where = sources[0].file_name if sources else "none"
            raise ValueError(_outside(name, "a virtual dataset", where))
        total += prod(item.shape) * max(item.dtype.itemsize, NUMBER_BYTES)
    require_unpacked(total, most_unpacked_mb)


def _outside(name: str, what: str, where: str) -> str:
    return f"'{name}': expected all data in the file itself, found {what}: {where}; copy it in"


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
