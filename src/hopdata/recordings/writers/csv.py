"""Contact events as a plain table of comma-separated values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hopdata.arrays import pd
from hopdata.recordings.writers.contact_events import ContactEvent, labels


def write_csv_events(path: Path, events: Sequence[ContactEvent]) -> None:
    """Write a row for each event: time, its standard error, foot, side and label.

    The columns with a unit in their name are in seconds, on the clock of the file.

    Parameters
    ----------
    path : path
        The table.
    events : sequence of ContactEvent
        In order of time.
    """
    table = pd.DataFrame(
        {
            "time_s": [one.time_s for one in events],
            "se_s": [one.se_s for one in events],
            "label": labels(events),
            "context": [one.context for one in events],
            "foot": [one.foot for one in events],
            "landing": [one.landing for one in events],
        }
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(path, index=False, float_format="%.6f", lineterminator="\n")
