"""The axes of a file, and those of a recording, where z is up."""

from __future__ import annotations

import numpy as np

from hopdata.errors import chosen
from hopdata.recordings.raw import FloatArray

# The recording's x, y, z as directions of the file, for each direction that pointed up there. Along
# an axis they are exchanged in a circle; against one, the first and the last of these are mirrored
# as well. So all are proper rotations, which keep right from left.
FILE_AXES = {
    "x": ("y", "z", "x"),
    "y": ("z", "x", "y"),
    "z": ("x", "y", "z"),
    "-x": ("-y", "z", "-x"),
    "-y": ("-z", "x", "-y"),
    "-z": ("-x", "y", "-z"),
}


def rotate_up(positions: FloatArray, vertical_axis: str) -> FloatArray:
    """Turn (..., 3) positions so that the direction that pointed up, one of `FILE_AXES`, becomes z.

    Numbers are exchanged and mirrored, so that none loses a digit.
    """
    axes = chosen("input.vertical_axis", vertical_axis, FILE_AXES)
    if axes == FILE_AXES["z"]:
        return positions
    turned = np.ascontiguousarray(positions[..., ["xyz".index(axis[-1]) for axis in axes]])
    for i, axis in enumerate(axes):
        if axis.startswith("-"):
            np.negative(turned[..., i], out=turned[..., i])
    return turned


def opposite(axis: str) -> str:
    """Return the direction against one of the file's: ``"-x"`` for ``"x"``, and back."""
    return axis.removeprefix("-") if axis.startswith("-") else f"-{axis}"


def along_file(offset: FloatArray, vertical_axis: str) -> dict[str, float]:
    """Return an offset (3,) of the recording by the axes of the file."""
    pairs = zip(FILE_AXES[vertical_axis], offset.tolist(), strict=True)
    parts = {axis[-1]: -value if axis.startswith("-") else value for axis, value in pairs}
    return {axis: parts[axis] for axis in "xyz"}
