"""First contacts of a runner's feet against the onset of force, method by method."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.landings.forces import force_onsets
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recording import Recording

ROOT = Path(__file__).parents[1]
FOLDERS = (ROOT / "data/external", ROOT.parent / "shared/recordings/treadmill_running")
MARKERS, FORCES = "RBDS001runT25markers.tsv", "RBDS001runT25forces.txt"
HEADER_LINES, RATE_HZ, FORCE_RATE_HZ = 11, 150.0, 300.0
AT_REST_M = (0.034, 0.045, 0.050)  # heel, first and fifth metatarsal on the standing foot
SECTIONS = {"pre_height_m": 1.07, "post_height_m": 1.02}  # every descent of the body passes both
SAME_S = 0.05  # a contact and an onset farther apart are not of one landing
METHODS = {
    "velocity minimum, whole frame": "velocity_minimum",
    "velocity minimum, parabola": "velocity_minimum_parabola",
    "kink, learned": "kink",
}
SIDES = {"L": (0, "left"), "R": (1, "right")}  # the first onset is of the left foot


def runner_rows() -> list[dict[str, Any]]:
    """One row for each foot and method; one that says so where the files are absent."""
    folder = next((f for f in FOLDERS if (f / MARKERS).is_file() and (f / FORCES).is_file()), None)
    if folder is None:
        return [{"condition": "runner against force", "method": "absent: no files of the runner"}]
    force = pd.read_csv(folder / FORCES, sep="\t")["Fy"].to_numpy(float)  # upwards in this file
    onsets = force_onsets(np.arange(len(force)) / FORCE_RATE_HZ, force)
    rows = []
    for side, (turn, name) in SIDES.items():
        recording = _foot(folder / MARKERS, side)
        for label, method in METHODS.items():
            table = touchdown_table(recording, **SECTIONS, method=method)
            row = {"condition": f"runner's {name} foot against force", "method": label}
            rows.append(row | _compared(table, onsets[turn::2]))
    return rows


def _foot(path: Path, side: str) -> Recording:
    frame = pd.read_csv(path, sep="\t", skiprows=HEADER_LINES)
    names = ("body1", "body2", "body3", f"{side}_heel", f"{side}_mt1", f"{side}_mt5")
    columns = [[f"{name} {axis}" for axis in "XYZ"] for name in names]
    positions = np.stack([frame[c].to_numpy(float) / 1000 for c in columns], axis=1)
    positions[:, 3:, 2] -= AT_REST_M
    time = np.arange(len(frame)) / RATE_HZ
    return Recording("runner", time, positions, names, ("body",) * 3 + ("foot",) * 3, RATE_HZ)


def _compared(table: pd.DataFrame, onsets: np.ndarray) -> dict[str, float]:
    contacts = table[[name for name in table if name.startswith("contact_")]]
    first = contacts.min(axis=1).dropna().to_numpy()
    away = np.abs(first[:, None] - onsets)
    late_ms = 1e3 * (first - onsets[away.argmin(axis=1)])[away.min(axis=1) < SAME_S]
    middle = float(np.median(late_ms))
    return {
        "landings": len(onsets),
        "found": len(late_ms) / len(onsets),
        "bias_ms": middle,
        "sd_ms": 1.4826 * float(np.median(np.abs(late_ms - middle))),
        "missed": int((away.min(axis=0) >= SAME_S).sum()),
        "invented": int((away.min(axis=1) >= SAME_S).sum()),
    }
