"""Inspect a recording: apply all quality measures in sequence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, one_blas_thread, pd
from hopdata.errors import RecordingError, counted
from hopdata.recording import Recording
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.plausibility import notes
from hopdata.recordings.quality import rigid, stretches, swaps
from hopdata.recordings.quality.orientation import (
    UNITS_IN_M,
    Guess,
    guess_rate,
    guess_unit_and_up,
)
from hopdata.recordings.quality.part_names import roles_by_name
from hopdata.recordings.quality.swaps import Excursion, Swap
from hopdata.recordings.raw import RawRecording
from hopdata.time_stamps import is_pause

Progress = Callable[[str], None]

RATE_TOLERANCE = 0.02  # relative error of the rate from the time stamps
MOST_IRREGULAR = 20  # irregular time steps that are listed one by one
STENCIL = 3  # frames on either side that are used to judge a position


@dataclass(frozen=True)
class Faults:
    """What looks wrong; frame numbers start at 0, lengths are in m."""

    swaps: tuple[Swap, ...]
    spikes: tuple[Excursion, ...]
    jumps: tuple[Excursion, ...]
    frozen: tuple[stretches.Frozen, ...]
    copies: tuple[
        tuple[int, int, int], ...
    ] = ()  # as returned by `stretches.copied_frames`

    @property
    def count(self) -> int:
        """Return the number of faults of all kinds."""
        return sum(
            map(len, (self.swaps, self.spikes, self.jumps, self.frozen, self.copies))
        )


_DOES = {"frozen": "repeats one position", "filled": "runs on straight, as if filled,"}


@dataclass(frozen=True)
class Suspect:
    """One thing that looks wrong.

    Parameters
    ----------
    kind : str
        ``swap, spike, jump, frozen, filled, copy, dropped, irregular, jitter,
        backward`` or ``rate``.
    markers : tuple of str
        Markers concerned; none for faults of the time stamps.
    start, stop : int
        First frame, and the frame after the last, counted from 0.
    time_s : float
        Time after the first frame, s.
    text : str
        What was found.
    """

    kind: str
    markers: tuple[str, ...]
    start: int
    stop: int
    time_s: float
    text: str


@dataclass(frozen=True)
class Inspection:
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
    treated : tuple of str
        Processing of the positions after they were recorded (`rigid.treated`).
    """

    markers: tuple[str, ...]
    time: FloatArray
    positions: FloatArray
    rate_hz: float
    unit: Guess
    up: Guess
    rate: Guess
    gaps: tuple[stretches.MarkerGaps, ...]
    timing: stretches.Timing
    pairs: rigid.PairDistances
    clusters: tuple[rigid.Cluster, ...]
    noise_m: FloatArray
    faults: Faults
    remarks: tuple[str, ...] = ()
    treated: tuple[str, ...] = ()

    def recording(
        self, feet: Iterable[str], body: Iterable[str], **named: str
    ) -> Recording:
        """Return the recording of the markers chosen as feet and body."""
        of = (self.time, self.positions, self.markers)
        return Recording.from_arrays(*of, feet=feet, body=body, **named)

    @property
    def duration_s(self) -> float:
        """Return the time from the first frame to the last, s."""
        return float(self.time[-1] - self.time[0]) if len(self.time) else 0.0

    @property
    def typical_noise_m(self) -> float:
        """Return the median frame-to-frame noise of the markers, m; NaN if none is known."""
        known = self.noise_m[np.isfinite(self.noise_m)]
        return float(np.median(known)) if len(known) else float("nan")

    @property
    def n_problems(self) -> int:
        """Return the number of faults, including those of the time stamps."""
        return sum(1 for _ in self._faults())

    @property
    def lost(self) -> list[str]:
        """Report how many frames are missing without a sign in the time stamps."""
        lost = [n for k, n in self.timing.drops.tolist() if self._is_silent(k)]
        where = (
            f"{counted(sum(lost), 'frame')} missing in {counted(len(lost), 'place')}"
        )
        told = f"about {where}, though no time stamp shows it (all markers jump on); contacts there"
        return [
            f"{told} are wrong: export with times, or exclude those landings"
        ] * bool(lost)

    def _is_silent(self, frame: int) -> bool:
        return bool(
            (self.time[frame + 1] - self.time[frame]) * self.timing.rate_hz < 1.5
        )

    def suspects(self) -> list[Suspect]:
        """List all faults, the earliest first."""
        found = [
            Suspect(
                kind, markers, start, stop, float(self.time[start] - self.time[0]), text
            )
            for kind, markers, start, stop, text in self._faults()
        ]
        return sorted(found, key=lambda s: (s.start, s.kind, s.markers))

    def _faults(self) -> Iterator[tuple[str, tuple[str, ...], int, int, str]]:
        timing = self.timing
        for swap in self.faults.swaps:
            names = (" and " if len(swap.markers) == 2 else ", ").join(swap.markers)
            until = "to the end" if swap.stop is None else f"to frame {swap.stop}"
            text = f"{names} exchanged {until} (by {' and '.join(swap.found_by)})"
            yield "swap", swap.markers, swap.start, swap.stop or len(self.time), text
        for spike in self.faults.spikes:
            length = counted(spike.stop - spike.start, "frame")
            name = self.markers[spike.marker]
            text = f"{name} is {1e3 * spike.size:.1f} mm off for {length}"
            yield "spike", (name,), spike.start, spike.stop, text
        for jump in self.faults.jumps:
            name = self.markers[jump.marker]
            text = f"{name} jumps by {1e3 * jump.size:.1f} mm"
            yield "jump", (name,), jump.start, jump.stop, text
        for one in self.faults.frozen:
            text = f"{one.marker} {_DOES[one.kind]} in {one.stop - one.start} frames"
            yield one.kind, (one.marker,), one.start, one.stop, text
        for start, stop, first in self.faults.copies:
            text = f"frames {start + 1} to {stop} are copies of {first + 1} to"
            text += f" {first + stop - start}: cut them out"
            if first == start - 1:
                text = f"frame {start} stands here {stop - start + 1} times: keep one"
            yield "copy", (), start, stop, text
        if abs(timing.rate_hz / self.rate_hz - 1) > RATE_TOLERANCE:
            found, stated = f"{timing.rate_hz:g} Hz", f"{self.rate_hz:g} Hz"
            text = (
                f"the time stamps run at {found}, and the frame rate stated is {stated}"
            )
            yield "rate", (), 0, 1, text
        for k, n in timing.drops.tolist():
            silent = " (about; no time stamp shows it)" * self._is_silent(k)
            yield (
                "dropped",
                (),
                k,
                k + 1,
                f"{counted(n, 'frame')} dropped after this one{silent}",
            )
        uneven = sorted([*timing.irregular.tolist(), *timing.backward.tolist()])
        if len(uneven) > MOST_IRREGULAR:
            text = f"{len(uneven)} steps of the time stamps are irregular: if the cameras ran"
            text += " evenly, leave the times out of the file and give input.rate_hz"
            yield "jitter", (), uneven[0], uneven[-1] + 2, text
            return
        for k in timing.irregular.tolist():
            yield (
                "irregular",
                (),
                k,
                k + 1,
                "irregular step of the time stamps after this one",
            )
        for k in timing.backward.tolist():
            yield "backward", (), k, k + 1, "the next time stamp is not later"


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
    named = roles_by_name(raw.markers)
    unit_guess, up_guess = guess_unit_and_up(raw, unit=unit, up=up, markers=named)
    positions = _turned(raw.positions, UNITS_IN_M[unit_guess.value], up_guess.value)
    progress("measuring distances between markers")
    noise = rigid.frame_noise(positions)
    pairs = rigid.pair_distances(positions)
    clusters = rigid.rigid_clusters(pairs, noise)
    gaps = stretches.marker_gaps(positions, raw.markers)
    progress("looking for swapped markers, spikes and frozen markers")
    scale = stretches.scale_of_all(positions)
    missed = swaps.surprises(positions, scale=scale)
    known: dict[str, Any] = {"missed": missed, "pairs": pairs, "clusters": clusters}
    exchanged = swaps.find_swaps(
        positions, raw.markers, rate_hz=raw.rate_hz * scale**0.5, **known
    )
    steps = {(e.start, e.marker) for e in missed.steps}
    frozen = stretches.frozen_markers(raw.positions, raw.markers, steps)
    frozen += stretches.straight_stretches(raw.positions, raw.markers)
    timing = stretches.check_stamps(raw.time)
    copies = stretches.copied_frames(raw.positions)
    ends = (copies[:, :2] - 1).ravel()
    uneven = [*timing.drops[:, 0], *timing.irregular, *timing.backward, *ends]
    explained = _explained(positions.shape[:2], raw.markers, exchanged, frozen, uneven)
    lost = stretches.lost_frames(positions)
    lost = lost[~explained[lost[:, 0]].all(axis=1)]
    for frame in lost[:, 0]:
        explained[max(0, frame - STENCIL + 1) : frame + STENCIL + 1] = True
    timing = replace(timing, drops=np.concatenate([timing.drops, lost]))
    faults = Faults(
        swaps=exchanged,
        spikes=swaps.find_spikes(
            missed, explained=explained, heights=positions[:, :, 2]
        ),
        jumps=swaps.find_jumps(missed, explained=explained),
        frozen=frozen,
        copies=tuple(map(tuple, copies.tolist())),
    )
    rate = guess_rate(raw, unit_guess.value, up=up_guess.value)
    rate = rate if rate_hz is None else Guess(f"{raw.rate_hz:g}", "as given")
    part = list(clusters[0].markers) if clusters else slice(None)
    treated = rigid.treated(rigid.middle(positions)[:, part], raw.rate_hz, scale=scale)
    return Inspection(
        raw.markers, raw.time, positions, raw.rate_hz, unit_guess, up_guess, rate, gaps,
        timing, pairs, clusters, noise, faults, raw.remarks, tuple(treated),
    )  # fmt: skip


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


def _explained(
    shape: tuple[int, ...],
    markers: tuple[str, ...],
    exchanged: Iterable[Swap],
    frozen: Iterable[stretches.Frozen],
    steps: Iterable[int],
) -> BoolArray:
    """Mask frames (N, M) whose jumps come from swaps, thawing markers, time stamps or copies.

    For time stamps and copies, the given frames are those after which all markers may
    jump.
    """
    mask = np.zeros(shape, dtype=bool)
    spans: list[tuple[Any, int, int]] = [(slice(None), k + 1, k + 1) for k in steps]
    spans += [(markers.index(one.marker), one.start, one.stop) for one in frozen]
    for swap in exchanged:
        columns = [markers.index(name) for name in swap.markers]
        spans += [(columns, end, end) for end in (swap.start, swap.stop or len(mask))]
    for columns, start, stop in spans:
        mask[max(0, start - STENCIL) : stop + STENCIL, columns] = True
    return mask


# Gaps, faults and noise of a study's recordings; times count from the first frame.

COLUMNS = {
    "markers": "recording marker role duration_s frames missing gaps longest_s noise_m",
    "gaps": "recording marker role start_s stop_s frames",
    "faults": "recording kind marker start_s stop_s remark",
    "remarks": "recording remark",
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
        name, found = recording.name, inspect(recording)
        pauses = is_pause(recording.time, recording.rate_hz)
        since = recording.time - recording.time[0]
        times = [*since.tolist(), float(since[-1]) + 1.0 / recording.rate_hz]
        for role, gaps, noise in zip(
            recording.roles, found.gaps, found.noise_m, strict=True
        ):
            numbers = (found.duration_s, gaps.n_frames, gaps.missing, gaps.count)
            longest_s = gaps.longest / recording.rate_hz
            rows["markers"].append(
                (name, gaps.marker, role, *numbers, longest_s, noise)
            )
            for start, stop in gaps.stretches.tolist():
                ends = (times[start], times[stop])
                rows["gaps"].append((name, gaps.marker, role, *ends, stop - start))
        for one in found.suspects():
            if not (one.kind == "dropped" and pauses[one.start]):
                told = (one.time_s, times[one.stop], one.text)
                rows["faults"] += [
                    (name, one.kind, m, *told) for m in one.markers or ("",)
                ]
        rows["remarks"] += [(name, note) for note in [*notes(recording), *found.lost]]
    return {
        k: pd.DataFrame(rows[k], columns=names.split()) for k, names in COLUMNS.items()
    }
