"""Contact events as BIDS has them: ``events.tsv``, and a sidecar that explains it.

The columns `onset`, `duration` and `trial_type` are those of the BIDS specification,
"Task events"; onsets count from the first sample of the motion file. Further columns
are explained in the JSON file beside the table, as it asks.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from hopdata.arrays import pd
from hopdata.recordings.writers.contact_events import ContactEvent, labels

# Suffix of a motion file, in whose place that of its events stands.
MOTION = "_motion"
EVENTS = "_events"

NOT_KNOWN = "n/a"

COLUMNS = {
    "onset": {
        "Description": "Contact of the foot with the floor, from the first sample on",
        "Units": "s",
    },
    "duration": {
        "Description": "0: a contact is an instant",
        "Units": "s",
    },
    "trial_type": {
        "Description": "What happened, and on which side",
    },
    "foot": {"Description": "Foot that touched, or its marker"},
    "landing": {
        "Description": "Number of the landing, from 1: feet that land together"
    },
    "onset_se": {
        "LongName": "Standard error of the onset",
        "Description": "From the likelihood of a kink in the height of the foot",
        "Units": "s",
    },
}


def events_name(stem: str) -> str:
    """Return the name of the table of a motion file: that of BIDS if it has one."""
    return f"{stem.removesuffix(MOTION)}{EVENTS}.tsv"


def write_bids_events(
    path: Path, events: Sequence[ContactEvent], *, begin_s: float, version: str
) -> None:
    """Write the table, and its sidecar of the same name.

    Parameters
    ----------
    path : path
        The table, ``..._events.tsv``.
    events : sequence of ContactEvent
        In order of time.
    begin_s : float
        Time of the first sample on the clock of the events, s.
    version : str
        Version of hopdata.
    """
    kinds = []
    for event, label in zip(events, labels(events), strict=True):
        kind = label.lower().replace(" ", "_")
        if event.side:
            kind = f"{event.side}_{kind}"
        kinds.append(kind)
    table = pd.DataFrame(
        {
            "onset": [one.time_s - begin_s for one in events],
            "duration": [0] * len(events),
            "trial_type": kinds,
            "foot": [one.foot for one in events],
            "landing": [one.landing for one in events],
            "onset_se": [one.se_s for one in events],
        }
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(
        path,
        sep="\t",
        index=False,
        float_format="%.6f",
        na_rep=NOT_KNOWN,
        lineterminator="\n",
    )
    sidecar = dict(COLUMNS)
    levels = {kind: kind.replace("_", " ") for kind in dict.fromkeys(kinds)}
    sidecar["trial_type"] = {**COLUMNS["trial_type"], "Levels": levels}  # type: ignore[dict-item]
    by = [{"Name": "hopdata", "Version": version}]
    content = {**sidecar, "GeneratedBy": by}
    text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
    path.with_suffix(".json").write_text(text, encoding="utf-8")
