"""Writes small QTM exports, sound or with the fault that a test needs."""

import numpy as np

NAMES = ("hip left", "hip right", "back", "heel", "toe")
UPRIGHT = np.array(
    [
        [0.1, 0.0, 0.5],
        [-0.1, 0.0, 0.5],
        [0.0, -0.15, 0.55],
        [0.1, 0.05, 0.02],
        [-0.1, 0.05, 0.03],
    ]
)


def standing(n_frames=40, *, scale=1000.0, wobble=0.01):
    """Return positions (N, 5, 3) of a small upright figure, with `scale` units per metre."""
    rng = np.random.default_rng(5)
    return scale * (UPRIGHT + wobble * rng.standard_normal((n_frames, len(UPRIGHT), 3)))


def qtm_text(
    positions=None,
    *,
    names=NAMES,
    frequency="100",
    header=None,
    column_row=True,
    counters=True,
    rows=None,
    line_end="\r\n",
):
    """Return the text of an export; `header` replaces or (None) removes keys of the header."""
    positions = standing() if positions is None else positions
    keys = {
        "NO_OF_FRAMES": str(len(positions)),
        "NO_OF_CAMERAS": "8",
        "NO_OF_MARKERS": str(len(names)),
        "FREQUENCY": frequency,
        "NO_OF_ANALOG": "0",
        "ANALOG_FREQUENCY": "0",
        "DESCRIPTION": "--",
        "TIME_STAMP": "2021-01-01, 12:00:00.000\t100.00000000",
        "DATA_INCLUDED": "3D",
        "MARKER_NAMES": "\t".join(names),
        "TRAJECTORY_TYPES": "\t".join(["Measured"] * len(names)),
        **(header or {}),
    }
    lines = [f"{key}\t{value}" for key, value in keys.items() if value is not None]
    if column_row:
        lines.append(
            "\t".join([*(("Frame", "Time") if counters else ()), *columns(names)])
        )
    return line_end.join(
        lines + (data_rows(positions, counters) if rows is None else rows)
    ) + (line_end)


def columns(names=NAMES):
    return [f"{name} {axis}" for name in names for axis in "XYZ"]


def data_rows(positions, counters=True, rate=100.0):
    rows = []
    for i, frame in enumerate(positions):
        numbers = [f"{x:.3f}" for x in np.ravel(frame)]
        rows.append(
            "\t".join(([str(i + 1), f"{i / rate:.5f}"] if counters else []) + numbers)
        )
    return rows


def write(folder, text, name="trial.tsv"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path
