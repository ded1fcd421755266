"""Pairs: states of the body at the pre and at the post section, in the home frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.jobs import whole_file

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Pairs:
    """Input and output states of the map through the touchdown.

    Parameters
    ----------
    x, y : (n, 6B) array
        States at the pre and at the post section: positions of the B body markers (x1, y1, z1, x2,
        ...) and then their velocities, in the home frame; in units of `length_unit_m` and
        `length_unit_m` / `time_unit_s`.
    schedule : (n,) str array
        Mode schedules.
    spread_s : (n,) array
        Standard deviation of the contact instants, s.
    recording : (n,) str array
        Names of the recordings.
    index : (n,) int array
        Number of the touchdown in its recording's table.
    body_markers : tuple of str
        Names of the body markers.
    length_unit_m, time_unit_s : float
        Units; 1 for raw SI.
    x_se, y_se : (n, 6B) array, optional
        Standard errors of `x` and `y`, each in the units of its column, in the home frame as it was
        found (its own error is common to both sections). Unknown for states that were not
        measured.
    """

    x: FloatArray
    y: FloatArray
    schedule: NDArray[np.str_]
    spread_s: FloatArray
    recording: NDArray[np.str_]
    index: NDArray[np.int64]
    body_markers: tuple[str, ...]
    length_unit_m: float = 1.0
    time_unit_s: float = 1.0
    x_se: FloatArray | None = None
    y_se: FloatArray | None = None

    def __post_init__(self) -> None:
        shape = (len(self.schedule), 6 * len(self.body_markers))
        for name in ("x", "y", "x_se", "y_se"):
            states = getattr(self, name)
            if states is not None and states.shape != shape:
                raise ValueError(f"{name}: expected {shape}, found {states.shape}")

    def __len__(self) -> int:
        return len(self.schedule)

    def in_units(self, length_m: float, time_s: float) -> Pairs:
        """Return the same pairs in other units of length, m, and time, s.

        Raises
        ------
        ValueError
            If a unit is not positive.
        """
        if not (length_m > 0 and time_s > 0):
            raise ValueError(f"units: expected positive, found {length_m} m and {time_s} s")
        length = self.length_unit_m / length_m
        half = 3 * len(self.body_markers)
        factor = np.repeat([length, length * time_s / self.time_unit_s], half)
        return replace(
            self,
            x=self.x * factor,
            y=self.y * factor,
            length_unit_m=length_m,
            time_unit_s=time_s,
            x_se=None if self.x_se is None else self.x_se * factor,
            y_se=None if self.y_se is None else self.y_se * factor,
        )


def contact_instants(pairs: Pairs, table: pd.DataFrame) -> FloatArray:
    """Return the contact instants (n, feet) of the pairs, s, from the table of touchdowns.

    Raises
    ------
    AnalysisError
        If a pair has no row in the table.
    """
    columns = [name for name in table.columns if name.startswith("contact_")]
    rows = table.set_index(["recording", "index"])[columns]
    keys = list(zip(pairs.recording.tolist(), pairs.index.tolist(), strict=True))
    missing = [key for key in keys if key not in rows.index]
    if missing:
        name, number = missing[0]
        raise AnalysisError(f"touchdowns: expected a row for touchdown {number} of {name}, no such")
    return rows.loc[keys].to_numpy(float)


# Pairs in HDF5 files.

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
