"""Axes of a file and axes of the recording, in which z is up."""

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import chosen

DIRECTIONS = ("x", "-x", "y", "-y", "z", "-z")

# Directions of the file that become the recording's x, y, z, for each direction that
# pointed up in the file. If an axis pointed up, the axes are permuted cyclically; if
# its opposite did, the first and the last of them are also mirrored. All are proper
# rotations, which keep right and left apart.
FILE_AXES = {
    "x": ("y", "z", "x"),
    "y": ("z", "x", "y"),
    "z": ("x", "y", "z"),
    "-x": ("-y", "z", "-x"),
    "-y": ("-z", "x", "-y"),
    "-z": ("-x", "y", "-z"),
}


def rotate_up(positions: FloatArray, vertical_axis: str) -> FloatArray:
    """Turn (..., 3) positions so that the direction that points up becomes z.

    Coordinates are only exchanged and negated, so no digit is lost.

    Parameters
    ----------
    positions : (..., 3) array
        Along the axes of the file.
    vertical_axis : str
        The direction that points up in the file, one of `FILE_AXES`.
    """
    axes = chosen("input.vertical_axis", vertical_axis, FILE_AXES)
    if axes == FILE_AXES["z"]:
        return positions
    return np.stack([along(positions, axis) for axis in axes], axis=-1)


def along(positions: FloatArray, direction: str) -> FloatArray:
    """Return the coordinate (...) of (..., 3) positions along ``"-y"``, for example."""
    coordinate = positions[..., "xyz".index(direction[-1])]
    if direction.startswith("-"):
        return -coordinate
    return coordinate


def opposite(axis: str) -> str:
    """Return the opposite direction: ``"-x"`` for ``"x"``, and vice versa."""
    if axis.startswith("-"):
        return axis.removeprefix("-")
    return f"-{axis}"


def along_file(offset: FloatArray, vertical_axis: str) -> dict[str, float]:
    """Return an offset (3,) of the recording along the axes of the file."""
    in_file = {}
    for axis, value in zip(FILE_AXES[vertical_axis], offset.tolist(), strict=True):
        in_file[axis[-1]] = -value if axis.startswith("-") else value
    return {axis: in_file[axis] for axis in "xyz"}
