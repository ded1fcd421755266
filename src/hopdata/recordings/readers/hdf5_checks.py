"""Checks of HDF5 files that may be damaged, before anything of them is read.

The HDF5 library trusts the file: it would allocate an array of any size, and follow an
invalid type into memory outside its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import h5py
from hopdata.recordings.budget import (
    DEEPEST,
    DEFLATE_MOST,
    MOST_LINKS,
    require_few,
    require_unpacked,
)

# Bytes of a number in memory, however it is stored.
NUMBER_BYTES = 8

# Bytes that any dataset may use.
_SMALL = 1 << 20


def require_sound(file: h5py.File, most_unpacked_mb: float) -> None:
    """Refuse a file that refers to other files or would unpack to more than the limit.

    Raises
    ------
    ValueError
        If it does; names the link or dataset outside the file, or the total size. Also
        if it has more links or levels than any sound file.
    """
    total = 0
    for item in items_of(file):
        if not isinstance(item, h5py.Dataset) or item.shape is None:
            continue
        if item.external:
            where = item.external[0][0]
            raise _outside(item.name, "data kept in another file", where)
        if item.is_virtual:
            sources = item.virtual_sources()
            where = sources[0].file_name if sources else "none"
            raise _outside(item.name, "a virtual dataset", where)
        total += prod(item.shape) * max(item.dtype.itemsize, NUMBER_BYTES)
    require_unpacked(total, most_unpacked_mb)


def items_of(file: h5py.File) -> Iterator[h5py.Group | h5py.Dataset]:
    """Yield root, groups and datasets, each once; soft links are not followed.

    Each item is opened by its name in its own group. By its whole path the time would
    grow as the square of the depth.

    Raises
    ------
    ValueError
        If a link leads to another file, or there are too many links or levels.
    """
    yield file
    waiting: list[tuple[h5py.Group, int]] = [(file, 1)]
    seen = {_address(file)}
    n_links = 0
    while waiting:
        group, depth = waiting.pop()
        n_links += len(group)  # counted before they are listed
        require_few("links between its groups and datasets", n_links, MOST_LINKS)
        require_few("groups within groups", depth, DEEPEST)
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise _outside(name, "a link to another file", link.filename)
            if not isinstance(link, h5py.HardLink):
                continue
            item = group[name]
            address = _address(item)
            if address in seen:
                continue
            seen.add(address)
            yield item
            if isinstance(item, h5py.Group):
                waiting.append((item, depth + 1))


def _address(item: h5py.Group | h5py.Dataset) -> tuple[int, ...]:
    """Return where an object lies in its file, which several links may share."""
    address: tuple[int, ...] = h5py.h5g.get_objinfo(item.id).objno
    return address


def _outside(name: str, what: str, where: str) -> ValueError:
    wanted = "expected all data in the file itself"
    return ValueError(f"'{name}': {wanted}, found {what}: {where}; copy it in")


def whole_array(dataset: h5py.Dataset, dtype: type | None = None) -> NDArray[Any]:
    """Read a dataset of plausible size, as stored or converted to another type.

    A shape is only a claim, unlike the stored bytes. A dataset whose chunks were never
    written would be read as endless zeros.

    Raises
    ------
    ValueError
        If the claimed size exceeds what the stored bytes can hold.
    """
    claimed = prod(dataset.shape) * dataset.dtype.itemsize
    stored = int(dataset.id.get_storage_size())
    most = DEFLATE_MOST * stored
    if claimed > max(_SMALL, most):
        wanted = f"at most {most} bytes by what is stored ({stored} bytes)"
        found = f"a claim of {claimed}"
        raise ValueError(f"dataset '{dataset.name}': expected {wanted}, found {found}")
    if dtype is None:
        return np.asarray(dataset[()])
    return np.asarray(dataset.astype(dtype)[()])


def checked_attribute(item: h5py.Group | h5py.Dataset, name: str) -> Any:
    """Read a numeric or text attribute; None if it does not exist.

    Raises
    ------
    ValueError
        If it has another type, or is too large.
    """
    if name not in item.attrs:
        return None
    attribute = h5py.h5a.open(item.id, name.encode())
    kind = attribute.get_type()
    sound_kinds = (
        h5py.h5t.TypeStringID,
        h5py.h5t.TypeIntegerID,
        h5py.h5t.TypeFloatID,
    )
    n_entries = attribute.get_space().get_simple_extent_npoints()
    claimed = n_entries * kind.get_size()
    is_too_large = max(claimed, kind.get_size()) > _SMALL
    if is_too_large or not isinstance(kind, sound_kinds):
        found = f"{type(kind).__name__} of {claimed} bytes"
        raise ValueError(f"attribute '{name}': expected numbers or text, found {found}")
    return item.attrs[name]
