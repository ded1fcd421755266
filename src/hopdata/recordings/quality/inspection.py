"""All measures of one recording, in their order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import RecordingError
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.quality.free_fall import UNITS_IN_M
from hopdata.recordings.quality.frozen import Frozen, frozen_markers
from hopdata.recordings.quality.gaps import MarkerGaps, marker_gaps
from hopdata.recordings.quality.one_sided import surprises
from hopdata.recordings.quality.orientation import Guess, guess_unit_and_up
from hopdata.recordings.quality.rigid import (
    Cluster,
    PairDistances,
    frame_noise,
    pair_distances,
    rigid_clusters,
)
from hopdata.recordings.quality.spikes import Jump, Spike, find_jumps, find_spikes
from hopdata.recordings.quality.swaps import Swap, explained_frames, find_swaps
from hopdata.recordings.quality.timing import Timing, check_stamps
from hopdata.recordings.raw import RawRecording

FloatArray = NDArray[np.float64]
Progress = Callable[[str], None]

RATE_TOLERANCE = 0.02  # relative, of the rate by the time stamps
STENCIL = 3  # frames on either side by which a position is judged


@dataclass(frozen=True)
class Faults:
    """What looks wrong; frames count from 0, lengths are in m."""

    swaps: tuple[Swap, ...]
    spikes: tuple[Spike, ...]
    jumps: tuple[Jump, ...]
    frozen: tuple[Frozen, ...]
    never_seen: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of faults of all kinds."""
        parts = (self.swaps, self.spikes, self.jumps, self.frozen, self.never_seen)
        return sum(map(len, parts))


@dataclass(frozen=True)
class Inspection:
    """What is in a recording.

    Parameters
    ----------
    markers : tuple of str
        The M names, in the file's order.
    time : (N,) array
        Time stamps, s.
    positions : (N, M, 3) array
        In m, turned so that z is up.
    rate_hz : float
        Nominal frame rate, Hz.
    unit, up : Guess
        Unit of the file, and the direction in it that points up.
    gaps : tuple of MarkerGaps
        One a marker.
    timing : Timing
        What the time stamps say.
    pairs : PairDistances
        Between all markers, m.
    clusters : tuple of Cluster
        Rigid groups; their noise in m.
    noise_m : (M,) array
        Noise of each marker from frame to frame, m.
    faults : Faults
        What looks wrong.
    """

    markers: tuple[str, ...]
    time: FloatArray
    positions: FloatArray
    rate_hz: float
    unit: Guess
    up: Guess
    gaps: tuple[MarkerGaps, ...]
    timing: Timing
    pairs: PairDistances
    clusters: tuple[Cluster, ...]
    noise_m: FloatArray
    faults: Faults

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last, s."""
        return float(self.time[-1] - self.time[0]) if len(self.time) else 0.0

    @property
    def typical_noise_m(self) -> float:
        """Median of the markers' noise from frame to frame, m; NaN if none is known."""
        known = self.noise_m[np.isfinite(self.noise_m)]
        return float(np.median(known)) if len(known) else float("nan")

    @property
    def has_wrong_rate(self) -> bool:
        """Whether the time stamps run at another rate than the one stated."""
        return bool(abs(self.timing.rate_hz / self.rate_hz - 1) > RATE_TOLERANCE)

    @property
    def n_problems(self) -> int:
        """Number of faults, those of the time stamps included."""
        timing = self.timing
        of_stamps = len(timing.drops) + len(timing.irregular) + len(timing.backward)
        return self.faults.count + of_stamps + self.has_wrong_rate


def _silent(_step: str) -> None:
    """Tell nobody."""


@one_blas_thread()
def inspect_recording(
    raw: RawRecording,
    *,
    unit: str | None = None,
    up: str | None = None,
    progress: Progress = _silent,
) -> Inspection:
    """Measure a recording.

    Parameters
    ----------
    raw : RawRecording
        As read; its positions are left as they are.
    unit, up : str, optional
        Unit, and the direction that is up, if the user knows them.
    progress : callable
        Told each step, in words, before it begins.

    Raises
    ------
    RecordingError
        If there is no frame or no marker.
    """
    if not len(raw.time) or not len(raw.markers):
        raise RecordingError(
            f"expected frames and markers, found {len(raw.time)} frames, {len(raw.markers)} markers"
        )
    with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are for the checks
        return _inspected(raw, unit, up, progress)


def _inspected(
    raw: RawRecording, unit: str | None, up: str | None, progress: Progress
) -> Inspection:
    progress("looking for free fall, to find the unit and the vertical axis")
    unit_guess, up_guess = guess_unit_and_up(raw, unit=unit, up=up)
    positions = _turned(raw.positions, UNITS_IN_M[unit_guess.value], up_guess.value)
    progress("measuring distances between markers")
    noise = frame_noise(positions)
    pairs = pair_distances(positions)
    clusters = rigid_clusters(pairs, noise)
    gaps = marker_gaps(positions, raw.markers)
    progress("looking for swapped markers, spikes and frozen markers")
    missed = surprises(positions)
    swaps = find_swaps(
        positions,
        raw.markers,
        missed=missed,
        pairs=pairs,
        clusters=clusters,
        rate_hz=raw.rate_hz,
    )
    frozen, timing = frozen_markers(raw.positions, raw.markers), check_stamps(raw.time)
    explained = explained_frames(swaps, raw.markers, len(positions))
    explained |= _told_elsewhere(explained.shape, timing, frozen, raw.markers)
    faults = Faults(
        swaps=swaps,
        spikes=find_spikes(missed, raw.markers, explained=explained),
        jumps=find_jumps(missed, raw.markers, explained=explained),
        frozen=frozen,
        never_seen=tuple(g.marker for g in gaps if g.missing == g.n_frames),
    )
    return Inspection(
        raw.markers, raw.time, positions, raw.rate_hz, unit_guess, up_guess, gaps,
        timing, pairs, clusters, noise, faults,
    )  # fmt: skip


def _turned(positions: FloatArray, metres: float, up: str) -> FloatArray:
    """Return (N, M, 3) positions in m and z up, NaN for what is infinite.

    In memory one marker follows the other, since that is how the checks go through them.
    """
    tracks = np.empty((positions.shape[1], len(positions), 3))
    for m, track in enumerate(tracks):
        track[:] = rotate_up(positions[:, m] * metres, up)
        track[np.isinf(track)] = np.nan
    return np.moveaxis(tracks, 0, 1)


def _told_elsewhere(
    shape: tuple[int, ...], timing: Timing, frozen: tuple[Frozen, ...], markers: tuple[str, ...]
) -> NDArray[np.bool_]:
    """Mask (N, M) of frames whose jumps come from dropped frames, or from a marker that thaws."""
    mask = np.zeros(shape, dtype=bool)
    for frame in [*timing.drops[:, 0], *timing.irregular, *timing.backward]:
        mask[max(0, frame - STENCIL + 1) : frame + STENCIL + 1] = True
    for stretch in frozen:
        column = mask[:, markers.index(stretch.marker)]
        column[max(0, stretch.start - STENCIL) : stretch.stop + STENCIL] = True
    return mask
