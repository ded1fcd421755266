"""Pairs: states of the body at the pre and the post section, in the home frame."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray, Shown, h5py
from hopdata.errors import AnalysisError
from hopdata.foreign import door
from hopdata.jobs import whole_file
from hopdata.seal import Seal, seal_of, sealed


@dataclass(frozen=True, repr=False)
class Pairs(Shown):
    """Input and output states of the map through the touchdown.

    Parameters
    ----------
    x, y : (n, 6B) array
        States at the pre and the post section: positions of the B body markers (x1, y1,
        z1, x2, ...), m, followed by their velocities, m/s, in the home frame.
    schedule : (n,) str array
        Mode schedules.
    spread_s : (n,) array
        Standard deviation of the contact instants, s.
    recording : (n,) str array
        Names of the recordings.
    touchdown : (n,) int array
        Number of the touchdown in its recording's table, from 1.
    body_markers : tuple of str
        Names of the body markers.
    length_unit_m, time_unit_s : float
        The study's units of normalisation; 1 until they are chosen.
    x_se, y_se : (n, 6B) array, optional
        Standard errors of `x` and `y`, in the units of each column, with the home frame
        taken as known (its own error is common to both sections). None for states that
        were not measured.
    instants, instants_se : (n, feet) array, optional
        Contact instants of the feet, s, and their standard errors.
    feet, feet_se : (n, feet, 3) array, optional
        Positions of the feet at the pre section in the home frame, m, with heights
        above the floor, and their standard errors; NaN where a foot is not seen. None
        for states without feet.
    time_s : (n,) array, optional
        Instants at the pre section, s, on the clock of the session.
    """

    x: FloatArray
    y: FloatArray
    schedule: NDArray[np.str_]
    spread_s: FloatArray
    recording: NDArray[np.str_]
    touchdown: NDArray[np.int64]
    body_markers: tuple[str, ...]
    length_unit_m: float = 1.0
    time_unit_s: float = 1.0
    x_se: FloatArray | None = None
    y_se: FloatArray | None = None
    instants: FloatArray | None = None
    instants_se: FloatArray | None = None
    feet: FloatArray | None = None
    feet_se: FloatArray | None = None
    time_s: FloatArray | None = None

    def _told(self) -> str:
        """Describe the numbers of landings, orders and coordinates."""
        orders = len(set(self.schedule))
        counts = f"{len(self)} landings in {orders} orders"
        return f"of {counts}, {self.x.shape[1]} coordinates each"

    def _rows(self) -> dict[str, Any]:
        """Count the landings for each order of contacts."""
        orders, counts = np.unique(self.schedule, return_counts=True)
        return {"order of contacts": orders, "landings": counts}

    def __len__(self) -> int:
        return len(self.schedule)

    def blocks(self, labels: Mapping[str, str | None]) -> NDArray[np.str_] | None:
        """Return the block of each landing; None if all are of one block.

        Parameters
        ----------
        labels : mapping
            Block of each recording by its name; by default, and with None, a recording
            is a block of its own.
        """
        names = self.recording.tolist()
        blocks = np.array([labels.get(name) or name for name in names], dtype=str)
        if len(np.unique(blocks)) < 2:
            return None
        return blocks

    def with_units(self, length_m: float, time_s: float) -> Self:
        """Return the same pairs with units, m and s, > 0, for `normalised`."""
        return replace(self, length_unit_m=length_m, time_unit_s=time_s)

    def normalised(self) -> tuple[FloatArray, FloatArray]:
        """Return `x` and `y` in the study's units of length and velocity."""
        per_length = 1.0 / self.length_unit_m
        per_velocity = per_length * self.time_unit_s
        n_coordinates = 3 * len(self.body_markers)
        factor = np.repeat([per_length, per_velocity], n_coordinates)
        return self.x * factor, self.y * factor


# Pairs in HDF5 files.

TEXTS = ("schedule", "recording")
_COLUMNS = (
    "columns: x, y, z of each body marker, then their velocities; home frame of the "
    "touchdown; positions in m, velocities in m/s"
)
_ERRORS = (
    "; from the noise of the frames that were fitted, with the error of the instant"
)
DESCRIPTIONS = {
    "x": f"states at the pre section; {_COLUMNS}",
    "y": f"states at the post section; {_COLUMNS}",
    "x_se": f"standard errors of x, in its units{_ERRORS}",
    "y_se": f"standard errors of y, in its units{_ERRORS}",
    "schedule": (
        "order in which the feet touched, by their numbers in the recording's order"
    ),
    "spread_s": "standard deviation of the contact instants of the touchdown, s",
    "recording": "name of the recording",
    "touchdown": "number of the touchdown in its recording's table, from 1",
    "instants": "contact instants of the feet, s",
    "instants_se": "standard errors of the contact instants, s",
    "feet": (
        "positions of the feet at the pre section, x, y, z in the home frame of the "
        "touchdown, m; NaN where a foot is not seen in flight before the first contact"
    ),
    "feet_se": f"standard errors of feet, m{_ERRORS}",
    "time_s": (
        "instant of each landing at the pre section, s, on the clock of the session: "
        "recordings follow one another unless the study says when they begin"
    ),
}
OPTIONAL = ("x_se", "y_se", "instants", "instants_se", "feet", "feet_se", "time_s")


def write_pairs(path: str | Path, pairs: Pairs) -> None:
    """Write pairs to an HDF5 file, which appears only once it is complete.

    The datasets are those of `DESCRIPTIONS`, each with an attribute `description`;
    those of `OPTIONAL` are written only if known. The file's attributes are
    body_markers, length_unit_m and time_unit_s.
    """
    text = h5py.string_dtype()
    with (
        whole_file(path) as partial,
        sealed(partial),
        h5py.File(partial, "w", locking=False) as file,
    ):
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
        If the file does not exist, is damaged or does not contain pairs.
    """
    try:
        seal = seal_of(path)
    except OSError as error:
        raise AnalysisError(f"{path}: not a file of pairs: {error}") from error
    if seal is Seal.BROKEN:
        found = "it is damaged: its bytes are not those that were written"
        raise AnalysisError(f"{path}: not a file of pairs: {found}")
    if seal is Seal.WHOLE:
        stored = stored_pairs(str(path))
    else:  # the HDF5 library may never come to an end with it
        stored = door.read(
            f"{__name__}:stored_pairs",
            str(path),
            place=path,
            n_bytes=door.size_of(path),
            raises=AnalysisError,
            reader="the HDF5 library",
        )
    for name in TEXTS:
        stored[name] = np.array(stored[name], dtype=str)
    stored["body_markers"] = tuple(stored["body_markers"])
    return Pairs(**stored)


def stored_pairs(path: str) -> dict[str, Any]:
    """Read the fields of `Pairs` from an HDF5 file; texts are lists.

    Raises
    ------
    AnalysisError
        If the file is damaged or does not contain pairs.
    """
    found: dict[str, Any] = {}
    try:
        with h5py.File(path, "r", locking=False) as file:
            found["body_markers"] = [str(one) for one in file.attrs["body_markers"]]
            for name in ("length_unit_m", "time_unit_s"):
                found[name] = float(file.attrs[name])
            for name in DESCRIPTIONS:
                if name in file or name not in OPTIONAL:
                    found[name] = _column(file, name)
        _require_alike(found)
    except (KeyError, OSError, ValueError, TypeError, RuntimeError) as error:
        raise AnalysisError(f"{path}: not a file of pairs: {error}") from error
    return found


def _column(file: Any, name: str) -> Any:
    """Return a dataset, or a list of texts.

    Raises
    ------
    ValueError
        If it is another thing, or states more numbers than the file has bytes.
    """
    dataset = file[name]
    if not isinstance(dataset, h5py.Dataset):
        raise ValueError(f"{name} is no dataset")
    if dataset.nbytes > file.id.get_filesize():
        raise ValueError(f"{name} states more numbers than the file has bytes")
    if name in TEXTS:
        return [str(text) for text in np.ravel(dataset.asstr()[:])]
    if dataset.dtype.kind not in "iuf":
        raise ValueError(f"{name} has no numbers but {dataset.dtype}")
    return dataset[:]


def _require_alike(found: Mapping[str, Any]) -> None:
    """Require columns of as many rows, and states of all body markers.

    Raises
    ------
    ValueError
        If they are not.
    """
    n_pairs = len(found["schedule"])
    for name in DESCRIPTIONS:
        if name in found and len(found[name]) != n_pairs:
            raise ValueError(f"{len(found[name])} rows of {name}, not {n_pairs}")
    shape = (n_pairs, 6 * len(found["body_markers"]))
    for name in ("x", "y"):
        if found[name].shape != shape:
            raise ValueError(f"{name} has shape {found[name].shape}, not {shape}")
