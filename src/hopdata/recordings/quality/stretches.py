"""Stretches of frames: rests, gaps, frozen and copied positions, and faulty time stamps."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recording import extent
from hopdata.recordings.axes import DIRECTIONS, along

# Stretches of frames in which a condition holds.


def runs(holds: BoolArray) -> IntArray:
    """Return the stretches of True values in an (N,) mask.

    Returns
    -------
    (K, 2) array
        First frame of each stretch and the frame after its last.
    """
    padded = np.concatenate([[False], holds, [False]])
    return np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2).astype(np.int64)


def near(holds: BoolArray, reach: int) -> BoolArray:
    """Tell which frames of a mask (N, ...) are at most `reach` frames from a True one."""
    found = holds.copy()
    for shift in range(1, reach + 1):
        found[shift:] |= holds[:-shift]
        found[:-shift] |= holds[shift:]
    return found


# Frozen markers: one position repeated in a way that noise makes all but impossible.

LEAST_REPEATS = 3
CHANCE = 1e-3  # probability of any false alarm in a recording
LEAST_STRAIGHT = 5  # frames between seen ones
# Roundings: least motion in a frame, and least deviation from the line at its ends
CURVED = 5.0


@dataclass(frozen=True)
class Frozen:
    """A stretch in which a marker repeats one position or follows a straight line.

    Parameters
    ----------
    marker : str
        Name of the marker.
    start, stop : int
        First frame of the stretch, and the frame after its last.
    kind : str
        ``frozen``, or ``filled`` if along a line.
    """

    marker: str
    start: int
    stop: int
    kind: str = "frozen"


def frozen_markers(
    positions: FloatArray,
    markers: tuple[str, ...],
    steps: Collection[tuple[int, int]] = (),
) -> tuple[Frozen, ...]:
    """Find exact repeats that are too long to be chance, or that end with a jump.

    In a coarsely rounded file, positions repeat by chance while a foot rests. The
    probability that one repeat follows another is therefore estimated from all other
    runs of the same marker.

    Parameters
    ----------
    positions : (N, M, 3) array
        Positions as in the file, not smoothed.
    markers : tuple of str
        The M names.
    steps : collection of (frame, marker)
        Gross steps relative to the frame before.
    """
    n_tests = max(len(positions) - 1, 1) * len(markers)
    found = []
    for m, name in enumerate(markers):
        stretches = runs(np.all(np.diff(positions[:, m], axis=0) == 0, axis=1))
        long = stretches[_too_long(stretches, n_tests)].tolist()
        for start, stop in stretches[
            np.diff(stretches)[:, 0] >= LEAST_REPEATS
        ].tolist():
            if [start, stop] in long or (start, m) in steps or (stop + 1, m) in steps:
                found.append(Frozen(name, start, stop + 1))
    return tuple(found)


def straight_stretches(
    positions: FloatArray, markers: tuple[str, ...]
) -> tuple[Frozen, ...]:
    """Find stretches in which a marker follows a straight line to within rounding: filled gaps.

    Second differences are zero in all axes within them, but not before and after.
    """
    found = []
    for name, track in zip(markers, np.moveaxis(positions, 1, 0), strict=True):
        axes = track.T[
            ..., None
        ]  # one axis at a time, so that ten million frames fit into memory
        digit = min(
            np.min(d, initial=np.inf, where=d > 0) for d in (_bends(x, 1) for x in axes)
        )
        rounding = 2 * digit + 4 * np.finfo(np.float32).eps * np.nanmax(
            np.abs(track), initial=0
        )
        bends = max(quantiles(_bends(x), [0.5])[0, 0] for x in axes) > CURVED * rounding
        straight = np.logical_and.reduce([_bends(x)[:, 0] <= rounding for x in axes])
        for start, stop in runs(straight & bends).tolist():
            corners = (
                _bends(track[k : k + 3]).max(initial=0)
                for k in (max(start - 1, 0), stop)
            )
            way = np.abs(track[stop] - track[start]).max() / (stop - start)
            if (
                stop - start >= LEAST_STRAIGHT
                and min(way, *corners) > CURVED * rounding
            ):
                found.append(Frozen(name, start + 1, stop + 1, "filled"))
    return tuple(found)


def _bends(track: FloatArray, order: int = 2) -> FloatArray:
    return np.abs(np.diff(track, order, axis=0))


def _too_long(stretches: IntArray, n_tests: int) -> BoolArray:
    """Tell which runs of repeats, (K,), are longer than the other runs make plausible."""
    length = np.diff(stretches, axis=1)[:, 0]
    is_long = length >= LEAST_REPEATS
    others, again = max(len(length) - 1, 1), np.sum(length > 1) - 1
    chance_again = np.clip(again / others, 1e-9, 1 - 1e-9)
    return np.asarray(
        is_long & (length > 1 + np.log(CHANCE / n_tests) / np.log(chance_again))
    )


LEAST_COPIED = 5  # consecutive frames, and distance to the frames that they repeat
MOST_HELD = (
    0.1  # largest share of held frames; with more, holding is how the file was made
)
ALL_MOVE = 0.9  # of the coordinates must move before and after a held frame


def copied_frames(positions: FloatArray) -> IntArray:
    """Find blocks of frames of (N, M, 3) positions that are copies of earlier ones.

    Returns (K, 3): first frame, the frame after the last, and the first frame of the
    original.
    """
    tracks = [
        track for marker in np.moveaxis(positions, 0, 2) for track in marker
    ]  # views
    weights = np.random.default_rng(0).uniform(1.0, 2.0, len(tracks))
    digest = np.zeros(len(positions))
    for weight, track in zip(weights, tracks, strict=True):
        digest += weight * np.nan_to_num(track)
    order = np.argsort(digest, kind="stable")
    same = np.flatnonzero(np.diff(digest[order]) == 0)
    lag = np.zeros(len(digest), dtype=np.int64)
    lag[order[same + 1]] = order[same + 1] - order[same]
    later, again = runs(lag >= LEAST_COPIED), runs(lag == 1)
    copied = [
        (a, b, a - lag[a])
        for a, b in later
        if b - a >= LEAST_COPIED and not np.ptp(lag[a:b])
    ]
    held = [
        (a, b, a - 1)
        for a, b in again[(again[:, 0] > 1) & (again[:, 1] < len(lag))]
        if np.isfinite(positions[a]).any()
        and np.mean(positions[[a - 1, b]] != positions[[a - 2, a]]) > ALL_MOVE
    ]
    found = copied + held * (len(held) < MOST_HELD * len(lag))
    return np.array(found, dtype=np.int64).reshape(-1, 3)


# Frames in which each marker was not seen.


@dataclass(frozen=True)
class MarkerGaps:
    """The gaps of one marker.

    Parameters
    ----------
    marker : str
        Its name.
    stretches : (K, 2) array
        First frame of each gap, and the frame after its last; frame numbers start at 0.
    n_frames : int
        Number of frames of the recording.
    """

    marker: str
    stretches: IntArray
    n_frames: int

    @property
    def count(self) -> int:
        """Return the number of gaps."""
        return len(self.stretches)

    @property
    def longest(self) -> int:
        """Return the length of the longest gap, frames; 0 without gaps."""
        return int(np.diff(self.stretches, axis=1).max(initial=0))

    @property
    def missing(self) -> int:
        """Return the number of frames in which the marker was not seen."""
        return int(np.diff(self.stretches, axis=1).sum())

    @property
    def share(self) -> float:
        """Return the share of frames in which the marker was not seen."""
        return self.missing / self.n_frames if self.n_frames else 0.0


def seen(positions: FloatArray) -> BoolArray:
    """Tell in which frames each marker of (N, M, 3) positions was seen, (N, M)."""
    x, y, z = np.moveaxis(
        np.isfinite(positions), 2, 0
    )  # faster than `all` along a short axis
    return np.asarray(x & y & z)


def marker_gaps(
    positions: FloatArray, markers: tuple[str, ...]
) -> tuple[MarkerGaps, ...]:
    """Find the gaps of every marker.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    markers : tuple of str
        The M names.
    """
    unseen = zip(markers, ~seen(positions).T, strict=True)
    return tuple(MarkerGaps(name, runs(mask), len(mask)) for name, mask in unseen)


BAND_M = 0.02  # m; a rest is at most this far above a marker's lowest height
SINKS_M = 0.06  # m; how far a soft floor or sole may give when a body lands
SPEED_M_S = 0.15
WINDOW_S = 0.04
LEAST_REST_S = 0.03
FLAT = (
    0.05  # of the range of heights: largest span of the lowest tenth of a foot's frames
)
CLEARER = 2.0
ON_THE_FLOOR = (
    0.05  # of the extent: largest height of another resting marker above the lowest
)
LEAST_TIMES_DOWN = 5  # descents of a marker that stands on a floor repeatedly
MOST_FRAMES = 200_000  # evenly spaced frames used of a longer recording
OFF_THE_FLOOR = 0.1  # of the range of heights
ONE_M = (
    1e-5  # below any camera's noise: heights whose difference varies less are copies
)


def scale_of_all(positions: FloatArray) -> float:
    """Return a rough scale of markers (N, M, 3), m, whose roles are not known: ..., 1/16, 1/4, 1.

    It is their `extent`, rounded to a power of four, and at most 1, since some may
    belong to the room. Only drafts, remarks and refusals use it, never an estimate,
    which has the continuous `hopdata.recording.scale_of` the body and the feet.
    """
    size = extent(positions)
    if not size > 0:
        return 1.0
    return float(min(4.0 ** np.round(0.5 * np.log2(np.clip(size, 1e-3, 1e3))), 1.0))


def lowest(heights: FloatArray) -> FloatArray:
    """Return the lowest height of each marker but for 1 % of frames, (M,); NaN if never seen."""
    return quantiles(heights, [0.01])[0]


def high_feet(
    heights: FloatArray, names: Sequence[str], *, above_m: float
) -> list[str]:
    """Report feet, of heights (N, n) m, that stay over `above_m` higher than the lowest one."""
    low = lowest(heights)
    floor = int(np.nanargmin(low))
    return [
        f"foot '{name}' comes no nearer to the floor than {height:.3f} m above '{names[floor]}'"
        for name, height in zip(names, low - low[floor], strict=True)
        if height > above_m
    ]


def feet_as_one(heights: FloatArray, names: Sequence[str]) -> list[str]:
    """Report pairs of feet, of heights (N, n) m, at a constant difference in height.

    Noise prevents this for separate markers. Only frames in which one of the two is off
    the floor are used, because on the floor rounding alone can make heights equal. The
    outer tenths may be wrong.
    """
    remarks = []
    low, high = quantiles(heights, [0.01, 0.99])
    up = heights > low + OFF_THE_FLOOR * (high - low)
    for i, j in combinations(range(len(names)), 2):
        apart = heights[up[:, i] | up[:, j], i] - heights[up[:, i] | up[:, j], j]
        low, middle, high = quantiles(apart[:, None], [0.1, 0.5, 0.9])[:, 0]
        if high - low < ONE_M:
            where = (
                f"{1e3 * abs(middle):.1f} mm apart"
                if abs(middle) > ONE_M
                else "the same"
            )
            remarks.append(
                f"the heights of feet '{names[i]}' and '{names[j]}' are always {where}"
            )
    return remarks


def at_rest(heights: FloatArray, rate_hz: float) -> BoolArray:
    """Tell when each marker rests near its lowest height, or where it settles on a soft floor.

    Parameters
    ----------
    heights : (N, M) array
        Heights, m, of an animal of about 1 m; NaN where not seen.
    rate_hz : float
        Frame rate, Hz.

    Returns
    -------
    (N, M) bool array
        True where a marker rests; rests shorter than `LEAST_REST_S` are left out.
    """
    half = max(1, round(WINDOW_S * rate_hz / 2))
    speed = np.full_like(heights, np.nan)
    if len(heights) > 2 * half:
        speed[half:-half] = (
            (heights[2 * half :] - heights[: -2 * half]) * rate_hz / (2 * half)
        )
    low = lowest(heights)
    with np.errstate(invalid="ignore"):
        slow = np.abs(speed) < SPEED_M_S
        settled = quantiles(
            np.where(slow & (heights < low + SINKS_M), heights, np.nan), [0.5]
        )[0]
        resting = slow & (heights < np.fmax(low, settled - 0.5 * BAND_M) + BAND_M)
    for m in range(heights.shape[1]):
        for start, stop in runs(resting[:, m]):
            if stop - start < max(2, round(LEAST_REST_S * rate_hz)):
                resting[start:stop, m] = False
    return resting


def flattest_direction(positions: FloatArray) -> tuple[str, float, float]:
    """Find the direction at whose lower end at least two markers repeatedly stay for a while.

    Someone who stands still does so only once, along any direction.

    Parameters
    ----------
    positions : (N, M, 3) array
        In any unit.

    Returns
    -------
    direction : str
        ``"z"``, ``"-y"`` and so on: the up direction, if something stands on a floor.
    flatness, next_flatness : float
        Range of the lowest tenth of the frames over the range of all, for the second
        flattest marker, in this direction and in the next best.
    """
    found: dict[str, float] = {}
    positions = positions[:: max(1, -(-len(positions) // MOST_FRAMES))]
    for up in DIRECTIONS:
        heights = along(positions, up)
        low, tenth, high = quantiles(heights, [0.01, 0.1, 0.99])
        floor, top = np.nanmin(low, initial=np.inf), np.nanmax(high, initial=-np.inf)
        comes = low - floor < ON_THE_FLOOR * (top - floor)
        comes &= _times_down(heights, low, high) >= LEAST_TIMES_DOWN
        with np.errstate(invalid="ignore", divide="ignore"):
            flatness = np.sort(((tenth - low) / (high - low))[comes])
        found[up] = float(flatness[1]) if len(flatness) > 1 else np.inf
    best, following = sorted(found, key=lambda up: found[up])[:2]
    return best, found[best], found[following]


def _times_down(values: FloatArray, low: FloatArray, high: FloatArray) -> IntArray:
    """Count descents of each column (N, M) from its upper half to its lowest tenth."""
    counts = np.zeros(values.shape[1], dtype=np.int64)
    with np.errstate(invalid="ignore", divide="ignore"):
        level = (values - low) / (high - low)
    for m in np.flatnonzero(high > low):
        ends = np.where(level[:, m] > 0.5, 1, np.where(level[:, m] < 0.1, -1, 0))
        counts[m] = np.count_nonzero(np.diff(ends[ends != 0]) < 0)
    return counts


def quantiles(values: FloatArray, levels: list[float]) -> FloatArray:
    """Return quantiles of the columns of (N, M) values, (len(levels), M); NaN if all are NaN."""
    result = np.full((len(levels), values.shape[1]), np.nan)
    for m in range(values.shape[1]):
        known = values[np.isfinite(values[:, m]), m]
        if len(known):
            result[:, m] = np.quantile(known, levels)
    return result


# Time stamps: dropped frames, and steps that are irregular or run backwards.

IRREGULAR = 0.2  # frames; least deviation from a whole number of median steps


@dataclass(frozen=True)
class Timing:
    """Result of checking the time stamps.

    Parameters
    ----------
    rate_hz : float
        Rate from the median step, Hz; NaN with fewer than two frames.
    drops : (K, 2) array
        Frame after which frames are missing, from 0, and how many.
    irregular : (J,) array
        Frames whose step to the next is irregular: neither one frame nor several whole
        ones.
    backward : (L,) array
        Frames whose successor does not have a later time stamp.
    jitter_s : float
        Largest deviation of the other steps from the median, s.
    """

    rate_hz: float
    drops: IntArray
    irregular: IntArray
    backward: IntArray
    jitter_s: float

    @property
    def n_dropped(self) -> int:
        """Return the number of frames missing between the stamps."""
        return int(self.drops[:, 1].sum())


def check_stamps(time: FloatArray) -> Timing:
    """Check time stamps (N,), s, against their own median step."""
    steps = np.diff(time)
    is_forward = steps > 0
    step = float(np.median(steps[is_forward])) if is_forward.any() else np.nan
    frames = steps / step
    whole = np.round(frames)
    on_grid = np.abs(frames - whole) <= IRREGULAR
    is_dropped = is_forward & on_grid & (whole > 1) & lasting(frames)
    dropped, regular = np.flatnonzero(is_dropped), is_forward & on_grid & (whole == 1)
    return Timing(
        rate_hz=1 / step,
        drops=np.column_stack([dropped, whole[dropped].astype(np.int64) - 1]),
        irregular=np.flatnonzero(is_forward & ~is_dropped & ~regular),
        backward=np.flatnonzero(~is_forward),
        # NaN if the clock never moves forward.
        jitter_s=float(np.abs(steps[regular] - step).max(initial=0.0 * step)),
    )


def lasting(frames: FloatArray) -> BoolArray:
    """Tell which steps (K,), in frames, no neighbour compensates: frames were lost there."""
    near = np.pad(np.where(frames > 0, frames, 1.0), 1, constant_values=1.0)
    return np.asarray(near[:-2] + near[1:-1] + near[2:] > 3.5)


# Frames missing without a sign in the time stamps: all markers skip ahead by n frames.

HALF = 5  # frames on either side to which a cubic is fitted
BLOCK = 100_000  # frames processed at a time
MOST_LOST = 10  # consecutive frames
MOST_MISFIT = (
    5.0  # times the usual misfit of a marker; beyond it, something else happened
)
# Ratio to the usual step; with one frame missing, all markers move twice as far
FURTHER = 1.5
TELLING = 4.0  # total log gain of the fits; contacts at 30 Hz reach 2.5


def lost_frames(positions: FloatArray) -> IntArray:
    """Find where markers (N, M, 3) fit better if the later frames are n frames later.

    A marker contributes the logarithm of the ratio by which its fit improves, counted
    down to its usual misfit. The marker with the largest gain is left out, since it may
    have jumped alone.

    Returns
    -------
    (K, 2) array
        Frame after which frames are missing, from 0, and how many.
    """
    if len(positions) < 2 * HALF:
        return np.zeros((0, 2), dtype=np.int64)
    windows = np.lib.stride_tricks.sliding_window_view(positions, 2 * HALF, axis=0)
    usual = quantiles(_misfit(windows[:: 1 + len(windows) // BLOCK], 0), [0.5])[0]
    usual[~(usual > 0)] = np.inf  # the marker is never seen, or never moves
    blocks = (windows[k : k + BLOCK] for k in range(0, len(windows), BLOCK))
    worse = (
        np.log(np.fmax(_misfit(block, 0) / usual, 1.0)).sum(axis=1) for block in blocks
    )
    at, lost = (
        np.flatnonzero(np.concatenate(list(worse)) > TELLING),
        range(MOST_LOST + 1),
    )
    at = at[_steps_out(positions, at + HALF)]
    misfits = np.stack(
        [np.log(np.fmax(_misfit(windows, n, at) / usual, 1.0)) for n in lost]
    )
    gain = np.where(
        np.fmin(misfits, misfits[0]) < np.log(MOST_MISFIT), misfits[0] - misfits, 0.0
    )
    gain = gain.sum(axis=2) - gain.max(axis=2)
    found: dict[int, int] = {}
    for k in np.argsort(-gain.max(axis=0), kind="stable"):
        if gain[:, k].max() > TELLING and all(
            abs(at[k] - other) >= HALF for other in found
        ):
            found[int(at[k])] = int(gain[:, k].argmax())
    return np.reshape(
        [(k + HALF - 1, n) for k, n in sorted(found.items())], (-1, 2)
    ).astype(int)


def _steps_out(positions: FloatArray, frames: IntArray) -> BoolArray:
    """Tell at which frames (K,) all markers move further than just before and after."""
    ends = (-3, -1), (-1, 0), (0, 2)
    ways = [positions[frames + b] - positions[frames + a] for a, b in ends]
    before, step, after = (np.nansum(way**2, axis=(1, 2)) ** 0.5 for way in ways)
    return np.asarray(step > FURTHER * np.maximum(before, after) / 2)


def _misfit(windows: FloatArray, n_lost: int, at: IntArray | None = None) -> FloatArray:
    """Return squares (K, M) left by cubics in (K, M, 3, 2 HALF) positions with a loss."""
    frames = np.arange(2.0 * HALF) + n_lost * (np.arange(2 * HALF) >= HALF)
    rest = np.linalg.qr(np.vander(frames, 4), mode="complete")[0][:, 4:]
    tracks = (
        track if at is None else track[at] for track in np.moveaxis(windows, 1, 0)
    )
    return np.stack(
        [np.square(track @ rest).sum(axis=(1, 2)) for track in tracks], axis=1
    )
