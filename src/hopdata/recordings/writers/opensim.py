"""Contact events as a table of OpenSim: a storage file, which its tools and GUI read.

OpenSim has no format of its own for events. Its tables (``.sto``) hold numbers over a
time that increases; here a row is an instant at which feet touch, and each foot has a
column that is 1 in its own rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hopdata.recordings.writers.contact_events import ContactEvent

# Digits of a time, s: instants are known to some 0.1 ms at best.
DIGITS = 6


def write_opensim_events(path: Path, events: Sequence[ContactEvent]) -> None:
    """Write a row for each instant: which feet touched, and the error of the instant.

    Parameters
    ----------
    path : path
        The table, ``.sto``.
    events : sequence of ContactEvent
        In order of time.
    """
    feet = list(dict.fromkeys(event.foot for event in events))
    # Two feet may touch at the same instant; times of a table must differ.
    rows: dict[str, list[ContactEvent]] = {}
    for event in events:
        rows.setdefault(f"{event.time_s:.{DIGITS}f}", []).append(event)
    names = [foot.replace(" ", "_").replace("\t", "_") for foot in feet]
    columns = ["time", *(f"{name}_contact" for name in names), "contact_se_s"]
    lines = [
        path.stem,
        "version=1",
        f"nRows={len(rows)}",
        f"nColumns={len(columns)}",
        "inDegrees=no",
        "endheader",
        "\t".join(columns),
    ]
    for time, touching in rows.items():
        touched = {event.foot for event in touching}
        se_s = max(event.se_s for event in touching)
        cells = [time]
        cells += ["1" if foot in touched else "0" for foot in feet]
        cells.append(f"{se_s:.{DIGITS}f}")
        lines.append("\t".join(cells))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
