"""Which files of a folder hold the same trial, by their positions and not their names.

Programs write a trial in several formats: in another unit, along other axes, cut at its
ends, with fewer digits, filtered or with other gaps. Distances between markers know
nothing of axes, and their ratio nothing of the unit.
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

#: Largest difference of the distances, relative to how much they vary, at which two
#: files may hold one trial: beyond that of a filter with the noise that it removes.
#: Unit: 1. Origin: chosen.
SAME_MOTION = 0.2

#: The same of distances averaged over `AVERAGED_S`, which a filter hardly changes.
#: Unit: 1. Origin: measured: steps of a runner at the same phase differ by 0.03 or
#: more (91 pairs of 0.9 s), and filters of 6 Hz or more change a step by 0.011.
SAME_SLOWLY = 0.015

#: Time over which distances are averaged, which takes out what a filter may remove.
#: Unit: s. Origin: measured: of 0.1, 0.2 and 0.3 s it parts steps and filters well
#: without taking much of a short trial.
AVERAGED_S = 0.2

#: Largest relative difference of the ratio of two files' distances from that of two
#: units, if one is the other with a filter.
#: Unit: 1. Origin: measured: 0.0005 with filters of 6 Hz or more; steps of one runner
#: differ by 0.004.
SAME_SCALE = 0.001

#: The same at which their positions are the same but for rounding.
#: Unit: 1. Origin: chosen.
SAME_POSITIONS = 0.01

#: Shortest part of a trial that is looked for in it after a filter.
#: Unit: 1. Origin: chosen. Strides are alike, so that a few of one trial, filtered, are
#: as near to those of another; positions that are the same are found in any part.
LEAST_PART = 0.5

#: Largest relative difference of the ratio of two files' distances from that of two
#: units, at which it is taken for that. A part of a trial has distances of its own.
#: Unit: 1. Origin: chosen.
SAME_UNIT = 0.2

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
    if abs(rates_hz[0] / rates_hz[1] - 1) > SAME_RATE:
        return OTHER
    places = [{name.casefold(): m for m, name in enumerate(own)} for own in names]
    shared = sorted(places[0].keys() & places[1].keys())
    if len(shared) < LEAST_MARKERS:
        return OTHER
    distances = [
        _distances(track[:, [place[name] for name in shared]])
        for track, place in zip(positions, places, strict=True)
    ]
    long, short = sorted(distances, key=len, reverse=True)
    if len(short) < 2:
        return OTHER
    start = _likeliest_start(long, short)
    beside = long[start : start + len(short)]
    at = _spread_frames(len(short), COMPARED_FRAMES)
    misfit = _misfit(beside[at], short[at])
    if misfit < SAME_POSITIONS:
        return THE_SAME
    may_be_filtered = misfit < SAME_MOTION and len(short) >= LEAST_PART * len(long)
    if may_be_filtered and _same_slowly(beside, short, rates_hz[0]):
        return PROCESSED
    return OTHER


def _distances(track: FloatArray) -> FloatArray:
    """Return the distances of neighbours in the list of markers, (N, M), as a ring."""
    return norms(track - np.roll(track, 1, axis=1))


def _same_slowly(one: FloatArray, other: FloatArray, rate_hz: float) -> bool:
    """Return whether distances (N, K) differ by nothing slower than a filter removes.

    Two steps of one animal are alike at each frame, but what they differ by is slow.
    """
    known = np.isfinite(one) & np.isfinite(other)
    in_one = np.where(known, one, 0.0)
    in_other = np.where(known, other, 0.0)
    ratio = float(in_one.sum() / in_other.sum())
    unit = _as_ratio_of_units(ratio)
    if abs(ratio / unit - 1.0) > SAME_SCALE:
        return False
    mean = in_one.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    varies = np.where(known, one - mean, 0.0)
    averaged = _averaged(in_one - unit * in_other, round(AVERAGED_S * rate_hz))
    slow = np.sqrt(np.mean(averaged**2) / np.mean(varies**2))
    return bool(slow < SAME_SLOWLY)


def _averaged(values: FloatArray, frames: int) -> FloatArray:
    """Return the moving means of columns (N, K) over so many frames, or over all."""
    frames = max(1, min(frames, len(values)))
    sums = np.cumsum(values, axis=0)
    sums = np.concatenate([np.zeros((1, values.shape[1])), sums])
    return (sums[frames:] - sums[:-frames]) / frames


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
