"""Which files of a folder hold the same trial, by their positions and not their names.

Programs write a trial in several formats: in another unit, along other axes, cut at its
ends, with fewer digits, at another rate, filtered or with other gaps. Distances between
markers know nothing of axes, and their ratio nothing of the unit.

Distances alone do not tell a trial from a repetition: one body that moves alike, a step
or a jump, has about the same ones. A filter does one thing to all markers, axes and
frames; so of two files of one trial, one filter and one turn of the axes make the one
into the other, all but exactly. No filter makes one repetition into another: its
markers are elsewhere, by a centimetre and not by what a filter leaves.
"""

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.recordings.quality.rigid import norms

#: Markers whose distances are compared.
#: Unit: markers. Origin: chosen.
MOST_COMPARED = 16

#: Frames at which distances are compared.
#: Unit: frames. Origin: chosen.
COMPARED_FRAMES = 60

#: Frames by which the place of a short file within a long one is found.
#: Unit: frames. Origin: chosen.
SEARCHED_FRAMES = 8

#: Largest difference of the distances, relative to how much they vary, that a filter
#: makes; beyond it two files hold two trials.
#: Unit: 1. Origin: chosen. Repetitions of a movement may be nearer.
SAME_MOTION = 0.2

#: The same at which their positions are the same but for rounding.
#: Unit: 1. Origin: chosen.
SAME_POSITIONS = 0.01

#: Largest difference of the positions, relative to how much distances vary, that one
#: filter for all of them may leave in one trial.
#: Unit: 1. Origin: measured. 0.02 after filters of 6 Hz; 0.07 and more in repetitions
#: of a step or a jump.
SAME_FILTERED = 0.05

#: Share of the positions that differ no more: others are next to gaps that one of the
#: files has filled.
#: Unit: 1. Origin: chosen.
MOST_POSITIONS = 0.85

#: Rate at which filtered positions are compared: most of any movement is below half.
#: Unit: Hz. Origin: chosen.
FILTERED_RATE_HZ = 60.0

#: Frames on either side of one from which the filter may take it.
#: Unit: frames. Origin: chosen. A tenth of a second: a filter of 4 Hz is about as long.
FILTER_REACH = 6

#: Frames of a short trial, and of a long one, from which the filter is found.
#: Unit: frames. Origin: chosen. Fewer than the first are no evidence.
FILTERED_FRAMES = (10, 600)

#: Shortest part of a trial that is looked for in it after a filter.
#: Unit: 1. Origin: chosen. Strides are alike, so that a few of one trial, filtered, are
#: as near to those of another; positions that are the same are found in any part.
LEAST_PART = 0.5

#: Largest relative difference of the ratio of two files' distances from that of two
#: units, at which it is taken for that. A part of a trial has distances of its own.
#: Unit: 1. Origin: chosen.
SAME_UNIT = 0.2

#: Least singular value, relative to the largest, that the weights of a filter rest on.
#: Unit: 1. Origin: chosen. Smooth movements leave the others to the noise.
FILTER_CONDITION = 1e-6

# Ratios of the units that files are in.
UNIT_RATIOS = (1.0, 10.0, 100.0, 1000.0, 2.54, 25.4, 39.37)

#: Largest relative difference of the frame rates of one trial.
#: Unit: 1. Origin: chosen.
SAME_RATE = 1e-3

# Fewest markers in common: two distances that change independently.
LEAST_MARKERS = 3

# Fewest frames in which a distance must be known to both files to be compared.
LEAST_FRAMES = 3

# How two files agree.
OTHER = ""
PROCESSED = "processed"
THE_SAME = "same"


def compared_markers(names: Sequence[str]) -> list[int]:
    """Return which markers of a file to keep for a comparison, sorted by name."""
    order = sorted(range(len(names)), key=lambda m: names[m].casefold())
    return order[:MOST_COMPARED]


def agreement(
    names: Sequence[Sequence[str]],
    positions: Sequence[FloatArray],
    rates_hz: Sequence[float],
) -> str:
    """Tell whether two files hold one trial: `THE_SAME`, `PROCESSED` or `OTHER`.

    Parameters
    ----------
    names : two sequences of str
        Marker names of each file.
    positions : two arrays (N, M, 3)
        Positions, each in its own unit and axes; NaN where not seen.
    rates_hz : two floats
        Frame rates, Hz.
    """
    places = [{name.casefold(): m for m, name in enumerate(own)} for own in names]
    shared = sorted(places[0].keys() & places[1].keys())
    if len(shared) < LEAST_MARKERS:
        return OTHER
    tracks = []
    for every_track, place_of in zip(positions, places, strict=True):
        own_places = [place_of[name] for name in shared]
        tracks.append(np.asarray(every_track, dtype=np.float64)[:, own_places])
    rate_hz = min(rates_hz)
    has_one_rate = max(rates_hz) / rate_hz - 1 <= SAME_RATE
    if not has_one_rate:
        tracks = [
            _at_rate(track, own_hz, rate_hz)
            for track, own_hz in zip(tracks, rates_hz, strict=True)
        ]
    long, short = sorted(tracks, key=len, reverse=True)
    if len(short) < 2:
        return OTHER
    of_long = _distances(long)
    of_short = _distances(short)
    start = _likeliest_start(of_long, of_short)
    at = _spread_frames(len(short), COMPARED_FRAMES)
    misfit = _misfit(of_long[at + start], of_short[at])
    if misfit < SAME_POSITIONS and has_one_rate:
        return THE_SAME
    if misfit >= SAME_MOTION or len(short) < LEAST_PART * len(long):
        return OTHER
    same_span = long[start : start + len(short)]
    if _left_by_a_filter(same_span, short, rate_hz) < SAME_FILTERED:
        return PROCESSED
    return OTHER


def _at_rate(track: FloatArray, own_hz: float, rate_hz: float) -> FloatArray:
    """Return positions (N, M, 3) between the frames, at a lower rate."""
    n_frames = int((len(track) - 1) / own_hz * rate_hz) + 1
    if own_hz == rate_hz or len(track) < 2:
        return track
    at = np.arange(n_frames) * (own_hz / rate_hz)
    before = np.minimum(at.astype(np.int64), len(track) - 2)
    part = (at - before)[:, None, None]
    return track[before] * (1 - part) + track[before + 1] * part


def _distances(track: FloatArray) -> FloatArray:
    """Return the distances of neighbours in the list of markers, (N, M), as a ring."""
    return norms(track - np.roll(track, 1, axis=1))


def _spread_frames(n_frames: int, most: int) -> IntArray:
    """Return at most `most` frames, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, n_frames - 1, most).astype(np.int64))


def _likeliest_start(long: FloatArray, short: FloatArray) -> int:
    """Return the frame of the long file at which the short one fits best."""
    n_starts = len(long) - len(short) + 1
    if n_starts == 1:
        return 0
    scale = _as_ratio_of_units(_median_distance(long) / _median_distance(short))
    at = _spread_frames(len(short), SEARCHED_FRAMES)
    differ = np.zeros(n_starts)
    counts = np.zeros(n_starts)
    for frame in at:
        apart = np.abs(long[frame : frame + n_starts] - scale * short[frame])
        known = np.isfinite(apart)
        differ += np.where(known, apart, 0.0).sum(axis=1)
        counts += known.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_difference = np.where(counts > 0, differ / counts, np.inf)
    return int(np.argmin(mean_difference))


def _as_ratio_of_units(scale: float) -> float:
    """Return the ratio of two units that is near a ratio of distances, or that."""
    ratios = np.array([*UNIT_RATIOS, *(1 / ratio for ratio in UNIT_RATIOS)])
    nearest = float(ratios[np.argmin(np.abs(np.log(ratios / scale)))])
    if abs(scale / nearest - 1) <= SAME_UNIT:
        return nearest
    return scale


def _median_distance(distances: FloatArray) -> float:
    """Return the median of distances (N, K), in their unit; 1 if none is known."""
    known = distances[np.isfinite(distances)]
    if not known.size:
        return 1.0
    median = float(np.median(known))
    return median if median > 0 else 1.0


def _misfit(one: FloatArray, other: FloatArray) -> float:
    """Return the rms difference of distances (n, K), relative to how much they vary."""
    known = np.isfinite(one) & np.isfinite(other)
    is_usable = known.sum(axis=0) >= LEAST_FRAMES
    known &= is_usable
    if np.count_nonzero(is_usable) < 2:
        return np.inf
    in_one = np.where(known, one, 0.0)
    in_other = np.where(known, other, 0.0)
    total = float(in_other.sum())
    if not total > 0:
        return np.inf
    scaled = in_other * (float(in_one.sum()) / total)
    mean = in_one.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    varies = float((np.where(known, one - mean, 0.0) ** 2).sum())
    differs = float(((in_one - scaled) ** 2).sum())
    if not varies > 0:
        return np.inf
    return float(np.sqrt(differs / varies))


def _left_by_a_filter(one: FloatArray, other: FloatArray, rate_hz: float) -> float:
    """Return what of one track is left if turned, scaled and filtered into another.

    Parameters
    ----------
    one, other : (N, M, 3) arrays
        Positions in the same frames.
    rate_hz : float
        Rate of the frames, Hz.

    Returns
    -------
    float
        Difference that most positions do not exceed, relative to the rms variation of
        the distances; infinite where too few are known to tell.
    """
    step = max(1, round(rate_hz / FILTERED_RATE_HZ))
    one = _slower(one, step)
    other = _slower(other, step)
    turned = _turned_into(one, other)
    n_inside = len(other) - 2 * FILTER_REACH
    least, most = FILTERED_FRAMES
    if turned is None or n_inside < least:
        return np.inf
    inside = _spread_frames(n_inside, most)
    # The neighbours of each position in time, (n, M, 3, frames), and what they give.
    frames = inside[:, None] + np.arange(2 * FILTER_REACH + 1)
    neighbours = np.moveaxis(turned[frames], 1, -1)
    wanted = other[inside + FILTER_REACH]
    known = np.isfinite(neighbours).all(axis=(2, 3)) & np.isfinite(wanted).all(axis=2)
    if np.count_nonzero(known) < least * LEAST_MARKERS:
        return np.inf
    # About the middle of all, so that the filter need not keep a constant.
    middle = wanted[known].mean(axis=0)
    inputs = (neighbours[known] - middle[:, None]).reshape(-1, frames.shape[1])
    outputs = (wanted[known] - middle).ravel()
    weights = np.linalg.lstsq(inputs, outputs, rcond=FILTER_CONDITION)[0]
    left = norms((outputs - inputs @ weights).reshape(-1, 3))
    distances = _distances(other)
    varies = _rms_variation(distances)
    if not varies > 0:
        return np.inf
    return float(np.quantile(left, MOST_POSITIONS)) / varies


def _slower(track: FloatArray, step: int) -> FloatArray:
    """Return each `step`-th frame of positions (N, M, 3) that are smoothed so far."""
    box = np.ones(step) / step
    kernel = np.convolve(box, box)
    n_frames = len(track) - len(kernel) + 1
    if step == 1 or n_frames < 1:
        return track
    smooth = np.zeros((n_frames, *track.shape[1:]))
    for k, weight in enumerate(kernel):
        smooth += weight * track[k : k + n_frames]
    return smooth[::step]


def _turned_into(one: FloatArray, other: FloatArray) -> FloatArray | None:
    """Return a track (N, M, 3) in the axes, origin and unit of another; None if few."""
    known = np.isfinite(one).all(axis=2) & np.isfinite(other).all(axis=2)
    if np.count_nonzero(known) < LEAST_MARKERS * LEAST_FRAMES:
        return None
    from_middle = one[known].mean(axis=0)
    to_middle = other[known].mean(axis=0)
    centred = one[known] - from_middle
    left, sizes, right = np.linalg.svd(centred.T @ (other[known] - to_middle))
    spread = float((centred**2).sum())
    if not spread > 0:
        return None
    # Axes may be mirrored, too: some programs write them left-handed.
    scale = float(sizes.sum()) / spread
    return scale * (one - from_middle) @ (left @ right) + to_middle


def _rms_variation(distances: FloatArray) -> float:
    """Return how much distances (N, K) vary about their means, in their unit."""
    known = np.isfinite(distances)
    seen = np.where(known, distances, 0.0)
    mean = seen.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    about_mean = np.where(known, distances - mean, 0.0)
    return float(np.sqrt((about_mean**2).sum() / max(1, np.count_nonzero(known))))
