"""One landing as the cameras and another device saw it, and how much the threshold matters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hopdata.errors import AnalysisError
from hopdata.landings.contact_overlay import MATCHED, compare_contacts
from hopdata.landings.force_contacts import contact_times_of, threshold_of
from hopdata.landings.overlay_summary import summarise_overlay
from hopdata.recordings.external import ForceSignal
from hopdata.recordings.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

BEFORE_S, AFTER_S = 0.08, 0.12
FACTORS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)  # of the threshold


def example_landing(
    recording: Recording, overlay: pd.DataFrame, signals: Sequence[ForceSignal] = ()
) -> pd.DataFrame:
    """Foot heights and forces about one typical landing.

    Parameters
    ----------
    recording : Recording
        Levelled.
    overlay : pandas.DataFrame
        Comparison of this recording, as `compare_contacts` makes it, of one or more columns.
    signals : sequence of ForceSignal
        Its forces.

    Returns
    -------
    pandas.DataFrame
        recording, time_s (from the first external contact), kind (``height``, ``force``,
        ``threshold``, ``external`` or ``found``), name (the foot; the column for a force, and for
        the contact of several feet), value (m, N, body weights; s for instants), unit. The landing
        is the matched one whose difference is the median, with all columns that know of it. Empty
        if there is none.
    """
    import pandas as pd

    matched = overlay[(overlay["status"] == MATCHED) & ~overlay["excluded"].astype(bool)]
    if matched.empty:
        return pd.DataFrame(columns=["recording", "time_s", "kind", "name", "value", "unit"])
    row = matched.sort_values("difference_s", kind="stable").iloc[(len(matched) - 1) // 2]
    same = overlay[(overlay["index"] == row["index"]) & (overlay["status"] == MATCHED)]
    origin = float(same["external_s"].min())
    known = recording.names("foot")
    told = f" {' '.join(same['feet'])} "
    feet = [foot for foot in known if f" {foot} " in told]
    pieces = _heights(recording, feet, origin)
    for one in same.to_dict("records"):
        name = str(one["feet"] if one["feet"] in known else one["column"])
        pieces.append(_instant("external", name, float(one["external_s"]) - origin))
        pieces.append(_instant("found", str(one["first_foot"]), float(one["found_s"]) - origin))
    for signal in signals:
        if signal.column.name in set(same["column"]):
            pieces += _force(signal, origin)
    return pd.concat(pieces, ignore_index=True).assign(recording=recording.name)[
        ["recording", "time_s", "kind", "name", "value", "unit"]
    ]


def threshold_table(
    recording: Recording, touchdowns: pd.DataFrame, signal: ForceSignal, *, window_s: float
) -> pd.DataFrame:
    """Compare the contacts at lower and higher thresholds of the force.

    Returns
    -------
    pandas.DataFrame
        recording, column, threshold, unit, n_matched, n_missed, n_invented, bias_s, robust_sd_s:
        one row a threshold at which the force can be read.
    """
    import pandas as pd

    rows = []
    chosen = threshold_of(signal)
    for factor in FACTORS:
        try:
            contacts = contact_times_of(signal, threshold=factor * chosen)
            table = compare_contacts(recording, touchdowns, contacts, window_s=window_s)
        except AnalysisError:  # too high for this force; the chosen one has been compared already
            continue
        measures = summarise_overlay(table).iloc[0]
        kept = ("n_matched", "n_missed", "n_invented", "bias_s", "robust_sd_s")
        rows.append(
            {
                "recording": recording.name,
                "column": signal.column.name,
                "threshold": factor * chosen,
                "unit": signal.unit,
                **{key: measures[key] for key in kept},
            }
        )
    return pd.DataFrame(rows)


def _instant(kind: str, name: str, time_s: float) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(
        {"time_s": [time_s], "kind": kind, "name": name, "value": np.nan, "unit": "s"}
    )


def _heights(recording: Recording, feet: Sequence[str], origin: float) -> list[pd.DataFrame]:
    import pandas as pd

    names, time = recording.names("foot"), recording.time - origin
    near = (time >= -BEFORE_S) & (time <= AFTER_S)
    return [
        pd.DataFrame(
            {
                "time_s": time[near],
                "kind": "height",
                "name": foot,
                "value": recording.feet[near, names.index(foot), 2],
                "unit": "m",
            }
        )
        for foot in feet
    ]


def _force(signal: ForceSignal, origin: float) -> list[pd.DataFrame]:
    import pandas as pd

    time, name = signal.time - origin, signal.column.name
    near = (time >= -BEFORE_S) & (time <= AFTER_S)
    threshold = {"time_s": [0.0], "kind": "threshold", "name": name, "value": threshold_of(signal)}
    return [
        pd.DataFrame({"time_s": time[near], "kind": "force", "name": name,
                      "value": signal.force[near], "unit": signal.unit}),
        pd.DataFrame({**threshold, "unit": signal.unit}),
    ]  # fmt: skip
