"""Writes small TRC files, sound or with the fault that a test needs."""

import numpy as np


def trc_text(
    positions, names, *, rate_hz=100.0, unit="mm", values=None, blank=True, tab=""
):
    """Return the text of a TRC file; `values` replaces entries of the third line."""
    n_frames = len(positions)
    entries = {
        "DataRate": f"{rate_hz:g}",
        "CameraRate": f"{rate_hz:g}",
        "NumFrames": str(n_frames),
        "NumMarkers": str(len(names)),
        "Units": unit,
        "OrigDataRate": f"{rate_hz:g}",
        "OrigDataStartFrame": "1",
        "OrigNumFrames": str(n_frames),
        **(values or {}),
    }
    kept = {key: value for key, value in entries.items() if value is not None}
    lines = [
        "PathFileType\t4\t(X/Y/Z)\ttrial.trc",
        "\t".join(kept),
        "\t".join(kept.values()),
        "Frame#\tTime\t" + "\t\t\t".join(names),
        "\t\t" + "\t".join(f"{a}{i + 1}" for i in range(len(names)) for a in "XYZ"),
        *([""] if blank else []),
    ]
    for i, frame in enumerate(positions):
        numbers = ["" if np.isnan(x) else f"{x:.6f}" for x in np.ravel(frame)]
        lines.append("\t".join([str(i + 1), f"{i / rate_hz:.5f}", *numbers]) + tab)
    return "\n".join(lines) + "\n"
