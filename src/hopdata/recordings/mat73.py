"""MAT files of version 7.3, which are HDF5: their variables as dicts, lists, texts and arrays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.recordings.hdf5_limits import checked_attribute, require_sound, whole_array

if TYPE_CHECKING:
    import h5py

_MOST_ITEMS = 20_000


def read_mat73(path: Path, most_unpacked_mb: float) -> dict[str, Any]:
    """Decode all variables, in the same types as `mat5.read_mat5`.

    MATLAB stores arrays with their axes reversed; they are turned back.

    Raises
    ------
    OSError
        If the file is no HDF5 file.
    ValueError
        If a dataset is not what MATLAB writes, lies in another file or is too large.
    """
    import h5py

    with h5py.File(path, "r") as file:
        require_sound(file, most_unpacked_mb)
        reader = _Reader(file)
        return {name: reader.decoded(file[name]) for name in file if not name.startswith("#")}


class _Reader:
    """Reads items of one file, so many at most: a damaged file may refer to itself."""

    def __init__(self, file: h5py.File) -> None:
        self.file, self.left = file, _MOST_ITEMS

    def decoded(self, item: Any) -> Any:
        import h5py

        self.left -= 1
        if self.left < 0:
            raise ValueError(f"expected at most {_MOST_ITEMS} items, found more")
        if isinstance(item, h5py.Group):
            return {name: self.decoded(item[name]) for name in item}
        if not isinstance(item, h5py.Dataset):
            raise ValueError(
                f"{item.name}: expected a group or dataset, found {type(item).__name__}"
            )
        is_text = checked_attribute(item, "MATLAB_class") in (b"char", "char")
        if checked_attribute(item, "MATLAB_empty") is not None:
            return "" if is_text else np.empty((0, 0))
        array = whole_array(item)
        if array.dtype == h5py.ref_dtype:  # a cell array, or a field of an array of structs
            references = array.T.ravel(order="F")
            return [self.decoded(self.file[reference]) for reference in references]
        if array.dtype.kind not in "biuf":
            raise ValueError(f"dataset '{item.name}': expected numbers, found {array.dtype}")
        if not is_text:
            return array.T
        codes = array.T.ravel(order="F").astype("<u2")
        return codes.tobytes().decode("utf-16-le", errors="replace")
