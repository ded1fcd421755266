"""Gaps, faults and noise of the recordings of a study; times are from the first frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from hopdata.blas import one_blas_thread
from hopdata.recordings.joining import is_pause
from hopdata.recordings.quality.inspection import Inspection, inspect_recording
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.recording import Recording
from hopdata.recordings.remarks import notes

if TYPE_CHECKING:
    import pandas as pd

GAP_COLUMNS = ("recording", "marker", "role", "start_s", "stop_s", "frames")
REMARK_COLUMNS = ("recording", "remark")
FAULT_COLUMNS = ("recording", "kind", "marker", "start_s", "stop_s", "remark")
MARKER_COLUMNS = (
    *("recording", "marker", "role", "duration_s", "frames"),
    *("missing", "gaps", "longest_s", "noise_m"),
)

Inspected = tuple[Recording, Inspection]


def inspect(recording: Recording) -> Inspection:
    """Inspect a recording whose unit and vertical axis are settled."""
    raw = RawRecording(
        recording.markers, recording.time, recording.positions, recording.rate_hz, unit="m"
    )
    return inspect_recording(raw, unit="m", up="z")


@one_blas_thread()
def recording_tables(recordings: Iterable[Recording]) -> dict[str, pd.DataFrame]:
    """Inspect recordings; return their tables ``markers``, ``gaps``, ``faults``, ``remarks``."""
    recordings = list(recordings)
    inspections = [(recording, inspect(recording)) for recording in recordings]
    return {
        "markers": marker_table(inspections),
        "gaps": gap_table(inspections),
        "faults": fault_table(inspections),
        "remarks": remark_table(recordings),
    }


def marker_table(inspections: Iterable[Inspected]) -> pd.DataFrame:
    """One row a marker of each recording: frames missing, longest gap, noise of a coordinate."""
    import pandas as pd

    rows = []
    for recording, found in inspections:
        for role, gaps, noise in zip(recording.roles, found.gaps, found.noise_m, strict=True):
            longest = gaps.longest / recording.rate_hz
            counts = (gaps.n_frames, gaps.missing, gaps.count)
            rows.append(
                (recording.name, gaps.marker, role, found.duration_s, *counts, longest, noise)
            )
    return pd.DataFrame(rows, columns=list(MARKER_COLUMNS))


def gap_table(inspections: Iterable[Inspected]) -> pd.DataFrame:
    """One row a gap of each marker, from its first missing frame to the next seen one."""
    import pandas as pd

    rows = []
    for recording, found in inspections:
        for role, gaps in zip(recording.roles, found.gaps, strict=True):
            for start, stop in gaps.stretches:
                times = (_time(recording, int(start)), _time(recording, int(stop)))
                rows.append((recording.name, gaps.marker, role, *times, int(stop - start)))
    return pd.DataFrame(rows, columns=list(GAP_COLUMNS))


def fault_table(inspections: Iterable[Inspected]) -> pd.DataFrame:
    """One row a fault and marker: swaps, spikes, jumps, frozen stretches, faults of the stamps.

    Kinds are ``swap, spike, jump, frozen, never seen``, and without a marker ``dropped, irregular,
    backward``. A pause, in which nothing was recorded (`joining.is_pause`), is no fault.
    """
    import pandas as pd

    rows = [
        (recording.name, kind, marker, _time(recording, start), _time(recording, stop), remark)
        for recording, found in inspections
        for kind, marker, start, stop, remark in _faults(found)
        if not (kind == "dropped" and is_pause(recording.time, recording.rate_hz)[start])
    ]
    return pd.DataFrame(rows, columns=list(FAULT_COLUMNS))


def remark_table(recordings: Iterable[Recording]) -> pd.DataFrame:
    """One row a remark on a recording, as `hopdata check` notes them: a guessed unit, for one."""
    import pandas as pd

    rows = [(recording.name, note) for recording in recordings for note in notes(recording)]
    return pd.DataFrame(rows, columns=list(REMARK_COLUMNS))


def _faults(found: Inspection) -> Iterator[tuple[str, str, int, int, str]]:
    faults, timing, n = found.faults, found.timing, len(found.time)
    for swap in faults.swaps:
        ends = n if swap.stop is None else swap.stop
        for marker in swap.markers:
            others = ", ".join(name for name in swap.markers if name != marker)
            yield "swap", marker, swap.start, ends, f"with {others}"
    for spike in faults.spikes:
        yield "spike", spike.marker, spike.start, spike.stop, f"{1e3 * spike.size:.1f} mm"
    for jump in faults.jumps:
        yield "jump", jump.marker, jump.frame, jump.frame + 1, f"{1e3 * jump.size:.1f} mm"
    for frozen in faults.frozen:
        yield "frozen", frozen.marker, frozen.start, frozen.stop, ""
    for marker in faults.never_seen:
        yield "never seen", marker, 0, n, ""
    for frame, missing in timing.drops:
        yield (
            "dropped",
            "",
            int(frame),
            int(frame) + 1,
            "1 frame" if missing == 1 else f"{int(missing)} frames",
        )
    for kind, frames in (("irregular", timing.irregular), ("backward", timing.backward)):
        for frame in frames:
            yield kind, "", int(frame), int(frame) + 1, "time stamp"


def _time(recording: Recording, frame: int) -> float:
    """Return the time of a frame from the first one, s; of the one after the last by the rate."""
    if frame < len(recording.time):
        return float(recording.time[frame] - recording.time[0])
    return float(recording.time[-1] - recording.time[0]) + 1.0 / recording.rate_hz
