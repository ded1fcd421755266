"""Inspect a recording: apply all quality measures in sequence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    Shown,
    one_blas_thread,
    pd,
)
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recording import Event, Recording
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.plausibility import notes
from hopdata.recordings.quality import processing, repeats, rests, rigid, swaps
from hopdata.recordings.quality.frame_rate import guess_rate
from hopdata.recordings.quality.free_fall import UNITS_IN_M
from hopdata.recordings.quality.orientation import Guess, guess_unit_and_up
from hopdata.recordings.quality.stretches import MarkerGaps, marker_gaps
from hopdata.recordings.quality.surprises import (
    Excursion,
    Surprises,
    find_jumps,
    find_spikes,
    surprises,
)
from hopdata.recordings.quality.swaps import Swap
from hopdata.recordings.quality.timing import Timing, check_stamps, lost_frames
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.wording import frames
from hopdata.time_stamps import is_pause

Progress = Callable[[str], None]

#: Largest difference of the rate of the time stamps from the stated one.
#: Unit: 1. Origin: chosen.
RATE_TOLERANCE = 0.02

#: Irregular time steps that are listed one by one; more of them are one fault.
#: Unit: 1. Origin: chosen.
MOST_IRREGULAR = 20

#: Frames on either side that are used to judge a position.
#: Unit: frames. Origin: derived: a parabola has three coefficients.
STENCIL = 3

#: Step of the time stamps up to which they show no lost frames.
#: Unit: frames. Origin: derived: halfway to the step with one frame lost.
SILENT = 1.5

_CODE_OF_KIND = {
    repeats.FROZEN: "recordings.frozen",
    repeats.FILLED: "recordings.filled",
}


@dataclass(frozen=True)
class Faults:
    """What looks wrong; frame numbers start at 0, lengths are in m.

    Parameters
    ----------
    swaps : tuple of Swap
        Exchanged names.
    spikes, jumps : tuple of Excursion
        Displaced markers: for a few frames, or from a frame on.
    frozen : tuple of Frozen
        Repeated positions and straight lines.
    copies : tuple
        As returned by `repeats.copied_frames`.
    """

    swaps: tuple[Swap, ...]
    spikes: tuple[Excursion, ...]
    jumps: tuple[Excursion, ...]
    frozen: tuple[repeats.Frozen, ...]
    copies: tuple[tuple[int, int, int], ...] = ()

    @property
    def count(self) -> int:
        """Return the number of faults of all kinds."""
        of_markers = len(self.swaps) + len(self.spikes) + len(self.jumps)
        return of_markers + len(self.frozen) + len(self.copies)


@dataclass(frozen=True)
class Fault:
    """One thing that looks wrong, before its time is known.

    Parameters
    ----------
    kind : str
        ``swap, spike, jump, frozen, filled, copy, dropped, irregular, jitter,
        backward`` or ``rate``.
    markers : tuple of str
        Markers concerned; none for faults of the time stamps.
    start, stop : int
        First frame, and the frame after the last, counted from 0.
    message : Message
        What was found.
    """

    kind: str
    markers: tuple[str, ...]
    start: int
    stop: int
    message: Message


@dataclass(frozen=True)
class Suspect(Fault):
    """One thing that looks wrong.

    Parameters
    ----------
    time_s : float
        Time after the first frame, s.
    """

    time_s: float

    @property
    def text(self) -> str:
        """What was found, in words."""
        return str(self.message)


@dataclass(frozen=True, repr=False)
class Inspection(Shown):
    """Contents of a recording and what looks wrong with it.

    Parameters
    ----------
    markers : tuple of str
        The M names, in the file's order.
    time : (N,) array
        Time stamps, s.
    positions : (N, M, 3) array
        Positions, m, with z up.
    rate_hz : float
        Nominal frame rate, Hz.
    unit, up, rate : Guess
        Unit of the file, its direction that points up, and the frame rate, Hz.
    gaps : tuple of MarkerGaps
        One per marker.
    timing : Timing
        Result of checking the time stamps.
    pairs : PairDistances
        Distances between all markers, m.
    clusters : tuple of Cluster
        Rigid groups of markers, noise in m.
    noise_m : (M,) array
        Noise of each marker from frame to frame, m.
    faults : Faults
        What looks wrong.
    remarks : tuple of str
        Remarks of the reader on the file.
    treated : tuple of Message
        Processing of the positions after they were recorded (`processing.treated`), and
        what it does to contacts and states.
    events : tuple of Event
        Events marked in the file.
    place : str
        The file, for messages; empty if it is not known.
    """

    markers: tuple[str, ...]
    time: FloatArray
    positions: FloatArray
    rate_hz: float
    unit: Guess
    up: Guess
    rate: Guess
    gaps: tuple[MarkerGaps, ...]
    timing: Timing
    pairs: rigid.PairDistances
    clusters: tuple[rigid.Cluster, ...]
    noise_m: FloatArray
    faults: Faults
    remarks: tuple[str, ...] = ()
    treated: tuple[Message, ...] = ()
    events: tuple[Event, ...] = ()
    place: str = ""

    def _told(self) -> str:
        size = f"{len(self.markers)} markers, {len(self.time):,} frames"
        return f"of {self.place or size}: {self.n_problems} suspects"

    def recording(
        self, feet: Iterable[str], body: Iterable[str], **named: str
    ) -> Recording:
        """Return the recording of the markers chosen as feet and body.

        Raises
        ------
        RecordingError
            If its frames have no order in time, or are seconds apart.
        """
        try:
            return Recording.from_arrays(
                self.time, self.positions, self.markers, feet=feet, body=body, **named
            )
        except RecordingError as error:
            if not self.place:
                raise
            raise RecordingError(f"{self.place}: {error}") from None

    @property
    def duration_s(self) -> float:
        """Return the time from the first frame to the last, s."""
        if not len(self.time):
            return 0.0
        return float(self.time[-1] - self.time[0])

    @property
    def typical_noise_m(self) -> float:
        """Return the median frame-to-frame noise of the markers, m, or NaN."""
        known = self.noise_m[np.isfinite(self.noise_m)]
        if not len(known):
            return float("nan")
        return float(np.median(known))

    @property
    def n_problems(self) -> int:
        """Return the number of faults, including those of the time stamps."""
        return len(self._faults())

    @property
    def lost(self) -> list[Message]:
        """Report how many frames are missing without a sign in the time stamps."""
        n_lost = [n for k, n in self.timing.drops.tolist() if self._is_silent(k)]
        if not n_lost:
            return []
        places = Message("recordings.one_place")
        if len(n_lost) > 1:
            places = Message("recordings.places", {"number": len(n_lost)})
        values = {"lost": frames(sum(n_lost)), "places": places}
        return [Message("recordings.lost", values)]

    def _is_silent(self, frame: int) -> bool:
        """Tell whether the time stamps show no loss after a frame."""
        step_s = self.time[frame + 1] - self.time[frame]
        return bool(step_s * self.timing.rate_hz < SILENT)

    def suspects(self) -> list[Suspect]:
        """List all faults, the earliest first."""
        found = []
        for fault in self._faults():
            time_s = float(self.time[fault.start] - self.time[0])
            found.append(
                Suspect(
                    fault.kind,
                    fault.markers,
                    fault.start,
                    fault.stop,
                    fault.message,
                    time_s,
                )
            )
        return sorted(found, key=lambda s: (s.start, s.kind, s.markers))

    def _faults(self) -> list[Fault]:
        return [
            *self._faults_of_markers(),
            *self._copied_frames(),
            *self._faults_of_stamps(),
        ]

    def _faults_of_markers(self) -> Iterator[Fault]:
        for swap in self.faults.swaps:
            yield self._swap(swap)
        for spike in self.faults.spikes:
            name = self.markers[spike.marker]
            values = {
                "marker": name,
                "size_mm": 1e3 * spike.size,
                "length": frames(spike.stop - spike.start),
            }
            message = Message("recordings.spike", values)
            yield Fault("spike", (name,), spike.start, spike.stop, message)
        for jump in self.faults.jumps:
            name = self.markers[jump.marker]
            values = {"marker": name, "size_mm": 1e3 * jump.size}
            message = Message("recordings.jump", values)
            yield Fault("jump", (name,), jump.start, jump.stop, message)
        for one in self.faults.frozen:
            values = {"marker": one.marker, "number": one.stop - one.start}
            message = Message(_CODE_OF_KIND[one.kind], values)
            yield Fault(one.kind, (one.marker,), one.start, one.stop, message)

    def _swap(self, swap: Swap) -> Fault:
        names = ", ".join(swap.markers)
        if len(swap.markers) == 2:
            names = " and ".join(swap.markers)
        values: dict[str, Any] = {
            "markers": names,
            "tests": " and ".join(swap.found_by),
        }
        if swap.stop is None:
            message = Message("recordings.swap_until_the_end", values)
        else:
            message = Message("recordings.swap", {**values, "stop": swap.stop})
        stop = swap.stop or len(self.time)
        return Fault("swap", swap.markers, swap.start, stop, message)

    def _copied_frames(self) -> Iterator[Fault]:
        for start, stop, first in self.faults.copies:
            n_frames = stop - start
            if first == start - 1:
                values = {"frame": start, "times": n_frames + 1}
                message = Message("recordings.held", values)
            else:
                values = {
                    "first": start + 1,
                    "last": stop,
                    "first_original": first + 1,
                    "last_original": first + n_frames,
                }
                message = Message("recordings.copied", values)
            yield Fault("copy", (), start, stop, message)

    def _faults_of_stamps(self) -> Iterator[Fault]:
        found_hz = self.timing.rate_hz
        if abs(found_hz / self.rate_hz - 1) > RATE_TOLERANCE:
            rates = {"found_hz": found_hz, "stated_hz": self.rate_hz}
            yield Fault("rate", (), 0, 1, Message("recordings.rate_of_stamps", rates))
        for k, n_lost in self.timing.drops.tolist():
            code = "recordings.dropped"
            if self._is_silent(k):
                code = "recordings.dropped_silently"
            message = Message(code, {"lost": frames(n_lost)})
            yield Fault("dropped", (), k, k + 1, message)

        irregular = self.timing.irregular.tolist()
        backward = self.timing.backward.tolist()
        uneven = sorted([*irregular, *backward])
        if len(uneven) > MOST_IRREGULAR:
            message = Message("recordings.irregular_steps", {"number": len(uneven)})
            yield Fault("jitter", (), uneven[0], uneven[-1] + 2, message)
            return
        for k in irregular:
            message = Message("recordings.irregular_step")
            yield Fault("irregular", (), k, k + 1, message)
        for k in backward:
            message = Message("recordings.backward_step")
            yield Fault("backward", (), k, k + 1, message)


@one_blas_thread()
@np.errstate(over="ignore", invalid="ignore")  # absurd numbers are left to the checks
def inspect_recording(
    raw: RawRecording,
    *,
    unit: str | None = None,
    up: str | None = None,
    rate_hz: float | None = None,
    progress: Progress = lambda _step: None,
) -> Inspection:
    """Measure a recording.

    Parameters
    ----------
    raw : RawRecording
        As read; its positions are not changed.
    unit, up : str, optional
        Unit, and the direction that points up, if the user knows them.
    rate_hz : float, optional
        Frame rate, Hz, used to read `raw`, if the user knows it.
    progress : callable
        Called with a description of each step before it begins.

    Raises
    ------
    RecordingError
        If there are no frames or no markers.
    """
    if not len(raw.time) or not len(raw.markers):
        found = f"{len(raw.time)} frames, {len(raw.markers)} markers"
        raise RecordingError(f"expected frames and markers, found {found}")
    progress("looking for free fall, to find the unit and the vertical axis")
    unit_guess, up_guess = guess_unit_and_up(raw, unit=unit, up=up)
    positions = _turned(raw.positions, UNITS_IN_M[unit_guess.value], up_guess.value)

    progress("measuring distances between markers")
    noise_m = rigid.frame_noise(positions)
    pairs = rigid.pair_distances(positions)
    clusters = rigid.rigid_clusters(pairs, noise_m)
    gaps = marker_gaps(positions, raw.markers)

    progress("looking for swapped markers, spikes and frozen markers")
    scale = rests.scale_of_all(positions)
    missed = surprises(positions, scale=scale)
    exchanged = swaps.find_swaps(
        positions,
        raw.markers,
        missed=missed,
        pairs=pairs,
        clusters=clusters,
        rate_hz=raw.rate_hz * scale**0.5,
    )
    faults, stamps = _faults(raw, positions, missed, exchanged)
    if rate_hz is None:
        rate = guess_rate(raw, unit_guess.value, up=up_guess.value)
    else:
        rate = Guess(f"{raw.rate_hz:g}", Message("recordings.given"))
    part = list(clusters[0].markers) if clusters else slice(None)
    treated = processing.treated(
        processing.middle(positions)[:, part], raw.rate_hz, scale=scale
    )
    return Inspection(
        markers=raw.markers,
        time=raw.time,
        positions=positions,
        rate_hz=raw.rate_hz,
        unit=unit_guess,
        up=up_guess,
        rate=rate,
        gaps=gaps,
        timing=stamps,
        pairs=pairs,
        clusters=clusters,
        noise_m=noise_m,
        faults=faults,
        remarks=tuple(str(remark) for remark in raw.remarks),
        treated=tuple(treated),
        events=raw.events,
    )


def _turned(positions: FloatArray, metres: float, up: str) -> FloatArray:
    """Return (N, M, 3) positions in m with z up; infinite values become NaN.

    Positions already in that form are not copied, since memory may not hold a long
    recording twice.
    """
    if metres == 1.0 and up == "z" and not np.isinf(positions).any():
        return positions
    tracks = np.empty((positions.shape[1], len(positions), 3))
    for m, track in enumerate(tracks):
        track[:] = rotate_up(positions[:, m] * metres, up)
        track[np.isinf(track)] = np.nan
    return np.moveaxis(tracks, 0, 1)


def _faults(
    raw: RawRecording,
    positions: FloatArray,
    missed: Surprises,
    exchanged: tuple[Swap, ...],
) -> tuple[Faults, Timing]:
    """Return what looks wrong, and the timing with losses that no stamp shows.

    Parameters
    ----------
    raw : RawRecording
        As read.
    positions : (N, M, 3) array
        The same, m, z up.
    missed : Surprises
        Gross misses of predictions.
    exchanged : tuple of Swap
        Exchanged names.
    """
    steps = {(step.start, step.marker) for step in missed.steps}
    frozen = repeats.frozen_markers(raw.positions, raw.markers, steps)
    frozen += repeats.straight_stretches(raw.positions, raw.markers)
    copies = repeats.copied_frames(raw.positions)
    stamps = check_stamps(raw.time)

    explained = np.zeros(positions.shape[:2], dtype=bool)
    _explain_by_stamps(explained, stamps, copies)
    _explain_by_markers(explained, raw.markers, exchanged, frozen)
    lost = lost_frames(positions)
    lost = lost[~explained[lost[:, 0]].all(axis=1)]
    for frame in lost[:, 0]:
        explained[_around(frame + 1, frame + 1)] = True
    faults = Faults(
        swaps=exchanged,
        spikes=find_spikes(missed, explained=explained, heights=positions[:, :, 2]),
        jumps=find_jumps(missed, explained=explained),
        frozen=frozen,
        copies=tuple(tuple(copy) for copy in copies.tolist()),
    )
    return faults, replace(stamps, drops=np.concatenate([stamps.drops, lost]))


def _around(start: int, stop: int) -> slice:
    """Return the frames that are judged by some of the frames from start to stop."""
    return slice(max(0, start - STENCIL), stop + STENCIL)


def _explain_by_stamps(explained: BoolArray, stamps: Timing, copies: IntArray) -> None:
    """Mark frames (N, M) whose jumps come from the time stamps or from copies.

    After odd steps and at both ends of copies all markers may jump.
    """
    ends = (copies[:, :2] - 1).ravel()
    for frame in (*stamps.drops[:, 0], *stamps.irregular, *stamps.backward, *ends):
        explained[_around(frame + 1, frame + 1)] = True


def _explain_by_markers(
    explained: BoolArray,
    markers: tuple[str, ...],
    exchanged: Iterable[Swap],
    frozen: Iterable[repeats.Frozen],
) -> None:
    """Mark frames (N, M) whose jumps come from swaps or from thawing markers."""
    for one in frozen:
        explained[_around(one.start, one.stop), markers.index(one.marker)] = True
    for swap in exchanged:
        columns = [markers.index(name) for name in swap.markers]
        for end in (swap.start, swap.stop or len(explained)):
            explained[_around(end, end), columns] = True


# Gaps, faults and noise of a study's recordings; times count from the first frame.

COLUMNS = {
    "markers": (
        "recording",
        "marker",
        "role",
        "duration_s",
        "frames",
        "missing",
        "gaps",
        "longest_s",
        "noise_m",
    ),
    "gaps": ("recording", "marker", "role", "start_s", "stop_s", "frames"),
    "faults": ("recording", "kind", "marker", "start_s", "stop_s", "remark"),
    "remarks": ("recording", "remark"),
}


def inspect(known: Recording) -> Inspection:
    """Inspect a recording whose unit and vertical axis are settled."""
    raw = RawRecording(
        known.markers, known.time, known.positions, known.rate_hz, unit="m"
    )
    return inspect_recording(raw, unit="m", up="z")


@one_blas_thread()
def recording_tables(recordings: Iterable[Recording]) -> dict[str, pd.DataFrame]:
    """Inspect recordings.

    Returns
    -------
    dict
        ``markers``, a row per marker: missing frames, longest gap, noise of a
        coordinate. ``gaps``, from the first missing frame to the next seen one.
        ``faults``, a row per fault and marker: ``swap, spike, jump, frozen, filled``,
        and without a marker the faults of frames and time stamps; pauses in the
        recording are not faults. ``remarks``, as noted by `hopdata check`.
    """
    rows: dict[str, list[tuple[Any, ...]]] = {table: [] for table in COLUMNS}
    for recording in recordings:
        found = inspect(recording)
        rows["markers"] += _marker_rows(recording, found)
        rows["gaps"] += _gap_rows(recording, found)
        rows["faults"] += _fault_rows(recording, found)
        for remark in (*notes(recording), *found.lost):
            rows["remarks"].append((recording.name, str(remark)))
    tables = {}
    for table, columns in COLUMNS.items():
        tables[table] = pd.DataFrame(rows[table], columns=list(columns))
    return tables


def _marker_rows(recording: Recording, found: Inspection) -> Iterator[tuple[Any, ...]]:
    for role, gaps, noise_m in zip(
        recording.roles, found.gaps, found.noise_m, strict=True
    ):
        yield (
            recording.name,
            gaps.marker,
            role,
            found.duration_s,
            gaps.n_frames,
            gaps.missing,
            gaps.count,
            gaps.longest / recording.rate_hz,
            noise_m,
        )


def _gap_rows(recording: Recording, found: Inspection) -> Iterator[tuple[Any, ...]]:
    times = _times_of_boundaries(recording)
    for role, gaps in zip(recording.roles, found.gaps, strict=True):
        for start, stop in gaps.stretches.tolist():
            yield (
                recording.name,
                gaps.marker,
                role,
                times[start],
                times[stop],
                stop - start,
            )


def fault_table(recording: Recording, found: Inspection) -> pd.DataFrame:
    """Return the faults of a recording, a row per fault and marker."""
    rows = [*_fault_rows(recording, found)]
    return pd.DataFrame(rows, columns=list(COLUMNS["faults"]))


def _fault_rows(recording: Recording, found: Inspection) -> Iterator[tuple[Any, ...]]:
    times = _times_of_boundaries(recording)
    pauses = is_pause(recording.time, recording.rate_hz)
    for suspect in found.suspects():
        if suspect.kind == "dropped" and pauses[suspect.start]:
            continue
        for marker in suspect.markers or ("",):
            yield (
                recording.name,
                suspect.kind,
                marker,
                suspect.time_s,
                times[suspect.stop],
                suspect.text,
            )


def _times_of_boundaries(recording: Recording) -> list[float]:
    """Return the time of each frame and the end of the last, s, after the first."""
    since_first = recording.time - recording.time[0]
    end = float(since_first[-1]) + 1.0 / recording.rate_hz
    return [*since_first.tolist(), end]
