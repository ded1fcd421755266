"""When each marker was seen, and what looks wrong, as a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hopdata.arrays import pd

if TYPE_CHECKING:
    from hopdata.recordings.quality.inspection import Inspection, Suspect


def drawn_gaps(
    inspection: Inspection, found: list[Suspect] | None = None, **options: Any
) -> Any:
    """Draw when each marker was seen, and what looks wrong.

    Parameters
    ----------
    inspection : Inspection
    found : list of Suspect, optional
        What looks wrong; by default that of the inspection.
    **options
        ``ax`` and ``style``: see `hopdata.figures.style.styled`.
    """
    from hopdata.figures.quality import recording_gaps_figure

    if found is None:
        found = inspection.suspects()
    time = inspection.time - inspection.time[0]
    last = len(time) - 1
    # The figure groups rows by recording; here is one, without a name.
    recording = ""
    gaps = [
        (recording, one.marker, time[start], time[min(stop, last)])
        for one in inspection.gaps
        for start, stop in one.stretches
    ]
    faults = [
        (recording, marker, suspect.time_s, suspect.kind)
        for suspect in found
        for marker in suspect.markers or ("",)
    ]
    markers = {
        "recording": recording,
        "marker": inspection.markers,
        "duration_s": inspection.duration_s,
    }
    return recording_gaps_figure(
        pd.DataFrame(markers),
        pd.DataFrame(gaps, columns=["recording", "marker", "start_s", "stop_s"]),
        pd.DataFrame(faults, columns=["recording", "marker", "start_s", "kind"]),
        **options,
    )
