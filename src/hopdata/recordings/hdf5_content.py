"""Datasets and attributes of an HDF5 group: of the kind that is expected, or refused."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.hdf5_limits import checked_attribute, whole_array

if TYPE_CHECKING:
    import h5py

_NUMBERS = "biuf"  # kinds of dtype; complex numbers, text and records are none


def numbers(group: h5py.Group, name: str) -> NDArray[Any]:
    """Read an array of numbers as float64, or of truth values as they are.

    Raises
    ------
    ValueError
        If there is no such dataset, or it holds something else.
    """
    found = group.get(name)
    dtype, shape = getattr(found, "dtype", None), getattr(found, "shape", None)
    if found is None or dtype is None:
        raise ValueError(f"dataset '{name}': expected numbers, found none")
    if dtype.kind not in _NUMBERS or not shape:
        raise ValueError(
            f"dataset '{name}': expected an array of numbers, found {dtype} of shape {shape}"
        )
    array = whole_array(found)
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        return array if array.dtype == np.bool_ else array.astype(float)


def number(group: h5py.Group, name: str) -> float:
    """Read an attribute that is one number.

    Raises
    ------
    ValueError
        If there is no such attribute, or it is something else.
    """
    found = np.asarray(_attribute(group, name))
    if found.dtype.kind not in _NUMBERS or found.size != 1:
        raise ValueError(f"attribute '{name}': expected a number, found {found}")
    return float(found.item())


def text(group: h5py.Group, name: str) -> str:
    """Read an attribute that is text.

    Raises
    ------
    ValueError
        If there is no such attribute, or it is something else.
    """
    found = _attribute(group, name)
    if not isinstance(found, str):
        raise ValueError(f"attribute '{name}': expected text, found {found}")
    return found


def texts(group: h5py.Group, name: str) -> tuple[str, ...]:
    """Read an attribute that is a list of texts.

    Raises
    ------
    ValueError
        If there is no such attribute, or it is something else.
    """
    found = _attribute(group, name)
    entries = found.tolist() if isinstance(found, np.ndarray) else [None]
    if not (isinstance(entries, list) and all(isinstance(entry, str) for entry in entries)):
        raise ValueError(f"attribute '{name}': expected a list of texts, found {found}")
    return tuple(entries)


def stored_texts(group: h5py.Group, name: str) -> tuple[str, ...]:
    """Read a dataset that is a list of texts.

    Raises
    ------
    ValueError
        If there is no such dataset, or it holds something else.
    """
    import h5py

    found = group.get(name)
    if not isinstance(found, h5py.Dataset) or h5py.check_string_dtype(found.dtype) is None:
        raise ValueError(f"dataset '{name}': expected a list of texts, found {found}")
    entries = whole_array(found)
    if entries.ndim != 1:
        raise ValueError(f"dataset '{name}': expected a list of texts, found {entries.shape}")
    return tuple(entry.decode("utf-8", "replace") for entry in entries)


def _attribute(group: h5py.Group, name: str) -> Any:
    found = checked_attribute(group, name)
    if found is None:
        raise ValueError(f"attribute '{name}': expected a value, found none")
    return found
