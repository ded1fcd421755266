"""Pairs in HDF5 files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hopdata.errors import AnalysisError
from hopdata.jobs import whole_file
from hopdata.landings.pairs import Pairs

TEXTS = ("schedule", "recording")
_COLUMNS = (
    "columns: x, y, z of each body marker, then their velocities; home frame of the touchdown; "
    "positions in length_unit_m, velocities in length_unit_m / time_unit_s"
)
_ERRORS = "; from the noise of the frames that were fitted, with the error of the instant"
DESCRIPTIONS = {
    "x": f"states at the pre section; {_COLUMNS}",
    "y": f"states at the post section; {_COLUMNS}",
    "x_se": f"standard errors of x, in its units{_ERRORS}",
    "y_se": f"standard errors of y, in its units{_ERRORS}",
    "schedule": "order in which the feet touched, by their numbers in the recording's order",
    "spread_s": "standard deviation of the contact instants of the touchdown, s",
    "recording": "name of the recording",
    "index": "number of the touchdown in its recording's table",
}


def write_pairs(path: str | Path, pairs: Pairs) -> None:
    """Write pairs to an HDF5 file, which appears under its name only once it is whole.

    Datasets x, y, schedule, spread_s, recording, index, and x_se, y_se where they are known, each
    with an attribute `description`; attributes body_markers, length_unit_m, time_unit_s.
    """
    import h5py

    text = h5py.string_dtype()
    with whole_file(path) as partial, h5py.File(partial, "w") as file:
        for name, description in DESCRIPTIONS.items():
            values = getattr(pairs, name)
            if values is None:
                continue
            if name in TEXTS:
                file.create_dataset(name, data=values.astype(object), dtype=text)
            else:
                file.create_dataset(name, data=values)
            file[name].attrs["description"] = description
        file.attrs["body_markers"] = np.array(pairs.body_markers, dtype=object)
        file.attrs["length_unit_m"] = pairs.length_unit_m
        file.attrs["time_unit_s"] = pairs.time_unit_s


def read_pairs(path: str | Path) -> Pairs:
    """Read pairs from an HDF5 file.

    Raises
    ------
    AnalysisError
        If the file does not exist or holds no pairs.
    """
    import h5py

    if not Path(path).is_file():
        raise AnalysisError(f"{path}: no such file")
    try:
        with h5py.File(path, "r") as file:
            text = {name: file[name].asstr()[:].astype(str) for name in TEXTS}
            return Pairs(
                file["x"][:],
                file["y"][:],
                text["schedule"],
                file["spread_s"][:],
                text["recording"],
                file["index"][:],
                tuple(str(name) for name in file.attrs["body_markers"]),
                float(file.attrs["length_unit_m"]),
                float(file.attrs["time_unit_s"]),
                *(file[name][:] if name in file else None for name in ("x_se", "y_se")),
            )
    except (KeyError, OSError, ValueError) as error:
        raise AnalysisError(f"{path}: not a file of pairs: {error}") from error
