"""Force plates of a C3D file as they are stored: their places, channels and types.

The parameters follow the C3D user guide (c3d.org), "The FORCE_PLATFORM group".
`recordings.force_plates` makes forces in the laboratory of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.foreign import door
from hopdata.messages import Message
from hopdata.recordings import raw
from hopdata.recordings.readers import c3d
from hopdata.recordings.readers.c3d_parameters import Parameters

GROUP = "FORCE_PLATFORM"

# Channels of the types that are read, and where the vertical forces are among them.
CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
VERTICAL = {1: (2,), 2: (2,), 3: (4, 5, 6, 7), 4: (2,)}

# Coefficients of a Kistler plate's correction of the centre of pressure.
_POLYNOMIAL = 12


@dataclass(frozen=True)
class StoredPlate:
    """A force plate in the units and axes of its file.

    Parameters
    ----------
    number : int
        From 1, in the order of the file.
    type : int
        1 to 4, as the format numbers them.
    place : str
        File and plate, for messages.
    corners : (4, 3) array
        In the unit of the positions. The corners are those at (+x, +y), (-x, +y), (-x,
        -y) and (+x, -y) of the plate's own axes.
    origin : (3,) array
        From the plate's origin to the middle of its surface, along its own axes; of
        type 3, the distances of the sensors.
    names, units : tuple of str
        Label and unit of each of the C channels.
    signals : (K, C) array
        Samples of the channels, in `units`.
    time : (K,) array
        Time of each sample on the clock of the file's frames, s.
    matrix : (6, 6) array, optional
        From the channels of type 4 to forces and moments; None if there is none.
    polynomial : (12,) array, optional
        Correction of the centre of pressure, of type 3.
    length_unit : str
        Unit of the positions, as the file spells it; empty if it states none.
    """

    number: int
    type: int
    place: str
    corners: FloatArray
    origin: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]
    signals: FloatArray
    time: FloatArray
    matrix: FloatArray | None = None
    polynomial: FloatArray | None = None
    length_unit: str = ""


def count_plates(path: str | Path) -> int:
    """Return how many force plates a C3D file states; 0 for a file that is none.

    Only its parameters are read, so that it may be asked of many files.
    """
    path = Path(path)
    if path.suffix.lower() != ".c3d":
        return 0
    try:
        _, parameters, _ = c3d.open_c3d(path)
        return _stated(parameters)
    except RecordingError:
        return 0  # whoever reads the file will say what is wrong with it


def knows_contacts(path: str | Path) -> bool:
    """Tell whether a C3D file states force plates, or has events."""
    if count_plates(path):
        return True
    try:
        header, parameters, _ = c3d.open_c3d(Path(path))
        return bool(header.events or parameters.number("EVENT", "USED"))
    except RecordingError:
        return False


def _stated(parameters: Parameters) -> int:
    stated = parameters.number(GROUP, "USED")
    if stated is None or not isfinite(stated) or stated < 1:
        return 0
    return int(stated)


def read_stored_plates(
    path: Path, *, rate_hz: float | None = None
) -> tuple[list[StoredPlate], list[Message]]:
    """Read the force plates of a C3D file.

    Parameters
    ----------
    path : path
        The ``.c3d`` file.
    rate_hz : float, optional
        Frame rate, Hz, if it is not the one that the file states.

    Returns
    -------
    plates : list of StoredPlate
    refused : list of Message
        What is wrong with each plate that cannot be read.

    Raises
    ------
    RecordingError
        If the file's header, parameters or analog channels cannot be read.
    """
    plates, refused = door.read(
        f"{__name__}:stored_plates_here",
        Path(path),
        rate_hz,
        place=path,
        n_bytes=door.size_of(path),
        reader="the reader of .c3d files",
        kinds=(StoredPlate,),
    )
    return plates, refused


def stored_plates_here(
    path: Path, rate_hz: float | None
) -> tuple[list[StoredPlate], list[Message]]:
    """Read the plates in this process; `read_stored_plates` has another do so."""
    header, parameters, _ = c3d.open_c3d(path)
    n_plates = _stated(parameters)
    if not n_plates:
        return [], []
    analogs = c3d.read_analogs(path)
    time = analogs.time
    if rate_hz is not None:
        time = time * (c3d.frame_rate(header, parameters) / rate_hz)
    plates = []
    refused = []
    for i in range(n_plates):
        try:
            plates.append(_plate(i, parameters, analogs, time))
        except RecordingError as error:
            values = {"number": i + 1, "why": str(error)}
            refused.append(Message("recordings.plate_refused", values))
            if len(plates) + len(refused) > _most_plates(parameters):
                break  # one line says that there are not so many
    return plates, refused


def _finite(values: FloatArray) -> FloatArray:
    """Return values with NaN in place of what no sensor shows."""
    return np.where(np.isfinite(values), values, np.nan)


def _most_plates(parameters: Parameters) -> int:
    return len(parameters.numbers(GROUP, "TYPE"))


def _plate(
    i: int, parameters: Parameters, analogs: c3d.Analogs, time: FloatArray
) -> StoredPlate:
    """Return the plate of index `i`."""
    place = f"{parameters.path}: force plate {i + 1}"
    types = parameters.numbers(GROUP, "TYPE")
    if len(types) <= i:
        found = f"{len(types)} types"
        wanted = f"{i + 1} types or more, as many as plates"
        raise RecordingError.at(parameters.place(GROUP, "TYPE"), wanted, found)
    kind = types[i]
    if kind not in CHANNELS:
        listed = ", ".join(str(known) for known in CHANNELS)
        raise RecordingError.at(f"{place}: type", f"one of {listed}", f"{kind:g}")
    kind = int(kind)
    corners = _part(parameters, "CORNERS", i, (3, 4)).T
    origin = _part(parameters, "ORIGIN", i, (3,))
    chosen = _channels(parameters, i, kind, len(analogs.names))
    matrix = None
    if kind == 4 and parameters.numbers(GROUP, "CAL_MATRIX"):
        matrix = _matrix(parameters, i)
    return StoredPlate(
        number=i + 1,
        type=kind,
        place=place,
        corners=corners,
        origin=origin,
        names=tuple(analogs.names[k] for k in chosen),
        units=tuple(analogs.units[k] for k in chosen),
        signals=_finite(analogs.values[:, chosen]),
        time=time,
        matrix=matrix,
        polynomial=_polynomial(parameters, i, kind),
        length_unit=next(iter(parameters.texts("POINT", "UNITS")), ""),
    )


def _part(
    parameters: Parameters, name: str, i: int, sizes: tuple[int, ...]
) -> FloatArray:
    """Return the numbers of one plate, with the first index first.

    Raises
    ------
    RecordingError
        If there are too few, or one is not finite.
    """
    each = int(np.prod(sizes))
    numbers = parameters.numbers(GROUP, name)[i * each : (i + 1) * each]
    place = parameters.place(GROUP, name)
    if len(numbers) < each:
        wanted = f"{each} numbers for plate {i + 1}"
        raise RecordingError.at(place, wanted, f"{len(numbers)}")
    if not np.isfinite(numbers).all():
        raise RecordingError.at(place, "finite numbers", f"{numbers}")
    return np.reshape(np.array(numbers), sizes, order="F")


def _rows(parameters: Parameters, name: str, least: int) -> int:
    """Return the first dimension of a table with a column for each plate."""
    sizes = parameters.sizes.get((GROUP, name), ())
    if len(sizes) < 2:
        return least  # of a single plate, some writers leave out the second dimension
    return sizes[0]


def _channels(
    parameters: Parameters, i: int, kind: int, n_analog: int
) -> Sequence[int]:
    """Return the indices of a plate's channels among the analog ones."""
    place = parameters.place(GROUP, "CHANNEL")
    n_channels = CHANNELS[kind]
    rows = _rows(parameters, "CHANNEL", n_channels)
    numbers = parameters.numbers(GROUP, "CHANNEL")[i * rows : (i + 1) * rows]
    if len(numbers) < n_channels:
        wanted = f"{n_channels} channels for plate {i + 1} of type {kind}"
        raise RecordingError.at(place, wanted, len(numbers))
    chosen = numbers[:n_channels]
    for number in chosen:
        if number not in range(1, n_analog + 1):
            wanted = f"channels from 1 to {n_analog} for plate {i + 1}"
            raise RecordingError.at(place, wanted, f"{number:g}")
    return [int(number) - 1 for number in chosen]


def _matrix(parameters: Parameters, i: int) -> FloatArray:
    """Return the calibration matrix (6, 6) of a plate.

    Its first index, that of the result, runs fastest, unless ``MATRIX_STORE`` says that
    rows follow each other.
    """
    sizes = parameters.sizes.get((GROUP, "CAL_MATRIX"), ())
    if len(sizes) >= 2 and sizes[:2] != (6, 6):
        found = " x ".join(str(size) for size in sizes[:2])
        place = parameters.place(GROUP, "CAL_MATRIX")
        raise RecordingError.at(place, "6 x 6 numbers for each plate", found)
    matrix = _part(parameters, "CAL_MATRIX", i, (6, 6))
    stored = parameters.texts(GROUP, "MATRIX_STORE")
    if stored and stored[0].upper() == "BYROW":
        matrix = matrix.T
    if not matrix[2].any():
        place = parameters.place(GROUP, "CAL_MATRIX")
        wanted = f"a row for the vertical force of plate {i + 1}"
        raise RecordingError.at(place, wanted, "zeros")
    return matrix


def _polynomial(parameters: Parameters, i: int, kind: int) -> FloatArray | None:
    numbers = parameters.numbers(GROUP, "FPCOPPOLY")
    own = np.array(numbers[i * _POLYNOMIAL : (i + 1) * _POLYNOMIAL])
    if kind != 3 or len(own) < _POLYNOMIAL or not np.isfinite(own).all():
        return None
    return own


# Words for volts, in small letters: what a plate without calibration states.
VOLTS = frozenset({"v", "mv", "uv", "µv", "volt", "volts", "millivolt", "millivolts"})


def metres_per_unit(stored: StoredPlate) -> float:
    """Return the factor from the unit of the file's positions to metres.

    Raises
    ------
    RecordingError
        If it is not a unit of length.
    """
    spelling = stored.length_unit or raw.USUAL_UNIT
    unit, factor = raw.metric(stored.place, spelling)
    return raw.METRES_PER_UNIT[unit] * factor
