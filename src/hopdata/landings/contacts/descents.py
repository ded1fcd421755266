"""Where to look for a contact: in the first descent of each foot to the floor."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray, IntArray
from hopdata.errors import AnalysisError
from hopdata.recordings.quality.rigid import frame_noise

# Descents of the body, each a possible landing, and where they cross the sections.

BLOCK = 50_000  # frames processed at a time, to bound memory
_SWING = (
    0.3  # smallest swing of a descent, as a share of the body's range from 2 % to 98 %
)
#: How long before the pre section a foot may touch, s; the flight is continued to the
#: section.
CONTINUED_S = 0.01
HIDDEN_S = 0.1  # gap of the body, s, above which a turning point may be hidden
_NOTHING_S = (
    0.5  # time without any frame, s, above which the recording paused or was joined
)


def descents(
    body: FloatArray, time: FloatArray | None = None, *, longest: float = np.inf
) -> list[tuple[int, int]]:
    """Find the descents of the body as (frame of the apex, frame of the nadir after it).

    A turning point counts if the body moves away from it by 30 % of its usual range, so
    neither noise nor a shudder creates one. The recording may begin and end within a
    descent. So may each part between gaps longer than `longest`, in s, or in frames if
    `time` is not given.
    """
    seen = np.flatnonzero(np.isfinite(body))
    if len(seen) == 0:
        return []
    low, high = np.quantile(body[seen], [0.02, 0.98])
    swing = _SWING * float(high - low)
    if swing <= 0:
        return []
    found: list[tuple[int, int]] = []
    waits = np.diff(seen if time is None else time[seen])
    for part in np.split(seen, np.flatnonzero(waits > longest * (1 + 1e-9)) + 1):
        apex: int | None = None
        turn, falling = (
            int(part[0]),
            False,
        )  # the highest (lowest) frame since the last turn
        for frame, height in _one_by_one(part, body):
            beyond = height < body[turn] if falling else height > body[turn]
            if beyond:
                turn = frame
            elif abs(height - body[turn]) > swing:
                if falling and apex is not None:
                    found.append((apex, turn))
                apex = None if falling else turn
                turn, falling = frame, not falling
        if apex is not None:
            found.append((apex, turn))
    return found


def _one_by_one(frames: IntArray, heights: FloatArray) -> Iterator[tuple[int, float]]:
    """Yield frames and their heights as Python numbers, converted one block at a time."""
    for first in range(0, len(frames), BLOCK):
        block = frames[first : first + BLOCK]
        yield from zip(block.tolist(), heights[block].tolist(), strict=True)


@dataclass(frozen=True)
class Transitions:
    """Crossings of the two sections in L descents, in order of time.

    Parameters
    ----------
    t_pre, t_post : (L,) array
        Instants of the crossings, s; NaN where the body rose again first. If the top of
        a descent is below the pre section, `t_pre` is the instant of the top.
    gap_pre, gap_post : (L,) array
        Time between the two frames that bracket each crossing, s. Without a crossing,
        the longest time without a frame that may hide one.
    """

    t_pre: FloatArray
    t_post: FloatArray
    gap_pre: FloatArray
    gap_post: FloatArray

    def __len__(self) -> int:
        return len(self.t_pre)

    @property
    def complete(self) -> BoolArray:
        """Whether each descent reached the post section, (L,)."""
        return ~np.isnan(self.t_post)


def find_transitions(
    time: FloatArray,
    height: FloatArray,
    *,
    pre_height_m: float,
    post_height_m: float,
    spans: FloatArray | None = None,
) -> Transitions:
    """Find where each descent of the body crosses the sections.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    height : (N,) array
        Mean height of the body markers, m; NaN where unseen.
    pre_height_m, post_height_m : float
        The sections, m; the pre section is the upper one.
    spans : (L, 2) array, optional
        Instants of apex and nadir of each descent, s; by default those of `descents`.

    Returns
    -------
    Transitions
        One entry for each descent, including those that turn back before a section.

    Raises
    ------
    AnalysisError
        If the post section is not below the pre section.
    """
    if not post_height_m < pre_height_m:
        found = f"post {post_height_m:.4g} m and pre {pre_height_m:.4g} m"
        raise AnalysisError.at(
            "sections", "the post section below the pre section", found
        )
    if spans is None:
        spans = time[np.array(descents(height), dtype=np.int64).reshape(-1, 2)]
    seen = ~np.isnan(height)
    t, h = time[seen], height[seen]
    steps = np.diff(t, prepend=-np.inf, append=np.inf)  # step k ends in frame k
    rows = [
        _crossings(t, h, steps, span, (pre_height_m, post_height_m)) for span in spans
    ]
    return Transitions(*np.array(rows).reshape(-1, 4).T)


def _crossings(
    t: FloatArray,
    h: FloatArray,
    steps: FloatArray,
    span: FloatArray,
    levels: tuple[float, float],
) -> tuple[float, float, float, float]:
    """Return both crossings within a span, and the gaps about them, s."""
    (first_s, last_s), (pre_m, post_m) = span.tolist(), levels
    start, stop = (
        int(np.searchsorted(t, first_s)),
        int(np.searchsorted(t, last_s, side="right")),
    )
    above = np.flatnonzero(h[start:stop] >= pre_m) + start
    below = np.flatnonzero(h[start:stop] <= post_m) + start
    top, t_pre, t_post = start, first_s, np.nan
    gap_pre = steps[
        start : start + 2
    ].max()  # a gap beside the top may hide a higher one
    if len(above):
        top = int(above[above < below[0]][-1] if len(below) else above[-1])
        gap_pre = steps[top + 1]
        t_pre = _crossing(t, h, top, pre_m) if top + 1 < stop else np.nan
    gap_post = steps[top + 1 : min(stop + 1, len(t))].max(initial=0.0)
    if len(below) and below[0] > start:
        t_post, gap_post = _crossing(t, h, int(below[0]) - 1, post_m), steps[below[0]]
    return t_pre, t_post, gap_pre, gap_post


def _crossing(t: FloatArray, h: FloatArray, index: int, level: float) -> float:
    """Return the instant, s, at which the chord from frame `index` to the next meets `level`."""
    share = (h[index] - level) / (h[index] - h[index + 1])
    return float(t[index] + share * (t[index + 1] - t[index]))


# Landings while the body is hidden: the feet alone show them, so that the table misses
# none.

CLEARLY_UP = 2.0  # height at which a foot is up, in heights below which it is down
LONGEST_GAP_FRAMES = (
    2.5  # longest gap at a crossing, in frames: one frame may be missing
)
LONGEST_GAP_S = (
    0.04  # the same, s: a body on a curved path departs from the chord by 2 mm
)


def find_hidden_landings(
    time: FloatArray,
    feet: FloatArray,
    body: FloatArray,
    spans: FloatArray,
    *,
    down_height_m: float,
) -> FloatArray:
    """Find landings that have no descent of their own because the body is hidden.

    The body's height reveals at most one of several landings in a gap: it is above the
    sections before the gap and below them after it.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    feet : (N, F) array
        Heights of the feet above the floor, m; NaN where unseen.
    body : (N,) array
        Mean height of the body markers, m; NaN where unseen.
    spans : (D, 2) array
        Instants of apex and nadir of the descents that were seen, s.
    down_height_m : float
        Height below which a foot is down, m; at twice this height it is up.

    Returns
    -------
    (H, 2) array
        Instants, s, of the last frame with all seen feet up and of the first with all
        down.
    """
    up = np.fmin.reduce(feet, axis=1) >= CLEARLY_UP * down_height_m
    down = (
        np.fmax.reduce(feet, axis=1) <= down_height_m
    )  # NaN, if no foot is seen, is neither
    state = up.astype(np.int8) - down
    decided = np.flatnonzero(state)
    falls = np.flatnonzero(np.diff(state[decided]) < 0)
    found = time[np.column_stack([decided[falls], decided[falls + 1]])]
    gap = longest_gaps(time[~np.isnan(body)], found)
    lost = (
        longest_gaps(time, found) > _NOTHING_S
    )  # the animal may have been moved meanwhile
    return found[(gap > longest_gap_s(time)) & ~lost & ~_have_a_descent(found, spans)]


def longest_gap_s(time: FloatArray, pace: float = 1.0) -> float:
    """Return the longest gap at which a crossing still counts as seen, s; see `Recording.pace`."""
    return max(
        LONGEST_GAP_FRAMES * float(np.median(np.diff(time))), LONGEST_GAP_S * pace
    )


def longest_gaps(seen: FloatArray, spans: FloatArray) -> FloatArray:
    """Return the longest gap, s, overlapping each span (L, 2); infinite beyond either end."""
    edges = np.concatenate([[-np.inf], seen, [np.inf]])
    gaps = np.diff(edges)
    begin = np.searchsorted(edges, spans[:, 0], side="right") - 1
    end = np.searchsorted(edges, spans[:, 1], side="left")
    return np.array(
        [gaps[a:b].max(initial=0.0) for a, b in zip(begin, end, strict=True)]
    )


def _have_a_descent(found: FloatArray, spans: FloatArray) -> BoolArray:
    """Mark the landings (H, 2) that have a descent: each descent claims the nearest overlapping."""
    have = np.zeros(len(found), dtype=bool)
    first = np.searchsorted(
        found[:, 1], spans[:, 0]
    )  # both columns are in the order of time
    stop = np.searchsorted(found[:, 0], spans[:, 1], side="right")
    for (begin, end), low, high in zip(spans, first, stop, strict=True):
        near = low + np.flatnonzero(~have[low:high])
        if len(near) > 0:
            have[near[np.argmin(np.abs(found[near].sum(axis=1) - begin - end))]] = True
    return have


LANDED, ALREADY_DOWN, NOT_LANDED, MISSING, POOR_FIT, RISES, THIN = range(7)
NEAR_FLOOR = (
    0.15  # height, as a share of the descent, below which a foot is nearly down
)
ON_ITS_WAY = (
    0.4  # height, as a share of the descent, below which the mean speed is taken
)
SETTLES = (
    0.5  # a foot that sinks by less than this share of the down height stood all along
)
LEAST_FRAMES = 5  # fewest frames of a foot in which a contact is sought
LANDINGS = 2000  # landings processed together, to bound memory
#: A foot stands at the height of its fourth-lowest frame. It touches no higher above
#: that than the skin gives, m, plus the way of its fastest fall in the time constant of
#: the softest contact, s.
RESTING_FRAME, SKIN_M, SOFTEST_S = 3, 0.004, 0.01
GAP = 1.5  # time between two frames, in frames, above which something may be hidden
MOST_FRAMES = 200_000  # frames from which the noise is estimated
LEAST_NOISE_M = (
    5e-5  # cameras do no better, and noise-free data do not follow the model exactly
)


# Polynomial in the correlation of consecutive frames: the variance of a fourth
# difference over 70 times the noise variance. Then the range of the ratio of two such
# variances in which noise counts as correlated, and the largest correlation.
_FOURTH = np.array([70.0, -112.0, 56.0, -16.0, 2.0]) / 70.0
NEARLY_WHITE, NO_LONGER_NOISE, MOST_CORRELATED = 1.2, 2.5, 0.85


def height_noise(heights: FloatArray, *, scale: float = 1.0) -> float:
    """Estimate the standard deviation of the noise of heights (N, n), m.

    Third differences of a smooth motion almost vanish, while those of white noise have
    variance 20 sigma^2. The few frames about the contacts do not affect their median.
    If only every k-th frame is seen, the differences span k frames. Longer recordings
    are sampled at `MOST_FRAMES` evenly spaced frames. The result is never less than
    `LEAST_NOISE_M` times the scale of the recording.
    """
    seen = np.flatnonzero(~np.isnan(heights).all(axis=1))
    step = int(np.median(np.diff(seen))) if len(seen) > 1 else 1
    if len(heights) <= 3 * step:
        return float("nan")
    every = -(-len(heights) // MOST_FRAMES)
    z0, z1, z2, z3 = (
        heights[k * step : len(heights) - (3 - k) * step : every] for k in range(4)
    )
    third = z3 - 3 * z2 + 3 * z1 - z0
    third = np.abs(third[~np.isnan(third)])
    if third.size == 0:
        return float("nan")
    return max(
        float(np.median(third) / 0.6744897501960817 / np.sqrt(20.0)),
        LEAST_NOISE_M * scale,
    )


def noise_correlation(body: FloatArray) -> float:
    """Estimate the correlation of a coordinate's noise between consecutive frames.

    The estimate compares fourth differences of the body's markers (N, m, 3) over one
    frame and over two. Their variances are equal if the noise is white; their ratio
    approaches two if it is autoregressive. Motion and filters give larger ratios, which
    cannot be told apart: the result is then 0.
    """
    once, twice = (frame_noise(body, lag=lag) for lag in (1, 2))
    known = once > 0
    ratio = float(np.median(twice[known] / once[known])) ** 2 if known.any() else 0.0
    if not NEARLY_WHITE < ratio < NO_LONGER_NOISE:
        return 0.0
    trial = np.linspace(0.0, MOST_CORRELATED, 100)
    variances = [np.polynomial.Polynomial(_FOURTH)(trial**lag) for lag in (1, 2)]
    return float(np.interp(ratio, variances[1] / variances[0], trial))


def widening(correlation: float, before: int, after: int) -> float:
    """Return the factor by which correlated noise widens the error of a contact.

    The reference is white noise with the same residuals. The fit is least squares of a
    flight with free acceleration in `before` frames before the contact and a constant
    height in `after` frames after it.
    """
    frame = np.arange(-before, after) + 0.5
    flies = frame < 0
    law = np.stack([flies, flies * frame, flies * frame**2, ~flies], axis=1)
    fit = np.linalg.pinv(law)
    contact, left = fit[0] - fit[-1], np.eye(len(frame)) - law @ fit
    alike = correlation ** np.abs(frame[:, None] - frame)
    scatter = np.trace(left @ alike) / np.trace(left)
    return float(np.sqrt(contact @ alike @ contact / (contact @ contact) / scatter))


def approaches(
    time: FloatArray,
    heights: FloatArray,
    transitions: Transitions,
    *,
    noise_m: float,
    down_height_m: float,
    lead_s: float,
    trail_s: float,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Find the rough instant at which each foot came down in each complete transition.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    transitions : Transitions
        L descents of the body.
    noise_m : float
        Standard deviation of a height, m.
    down_height_m : float
        Height to which a foot must sink to have landed, m.
    lead_s, trail_s : float
        Time before the pre section at which the search begins, and time after the post
        section at which it ends, s.

    Returns
    -------
    near : (L, n) array
        Rough instants, s; NaN where the foot did not come down from above.
    earliest : (L, n) array
        Last instant at which the foot was too high to touch, s: higher above its
        resting height than skin and a soft contact let it sink.
    status : (L, n) int array
        `LANDED`, `ALREADY_DOWN`, `NOT_LANDED`, or `MISSING` where gaps may hide which
        one holds.
    """
    shape = (len(transitions), heights.shape[1])
    near, earliest = np.full((2, *shape), np.nan)
    status = np.full(shape, NOT_LANDED, dtype=np.int64)
    complete = np.flatnonzero(transitions.complete)
    longest = [GAP * _frame(time, one) for one in heights.T]
    for rows in np.split(complete, range(LANDINGS, len(complete), LANDINGS)):
        start = np.searchsorted(time, transitions.t_pre[rows] - lead_s)
        stop = np.searchsorted(time, transitions.t_post[rows] + trail_s)
        frames = start[:, None] + np.arange(int(np.max(stop - start, initial=1)))
        inside = frames < stop[:, None]
        frames = np.minimum(frames, len(time) - 1)
        ends = transitions.t_pre[rows], transitions.t_post[rows]
        for foot in range(shape[1] if len(rows) else 0):
            z = np.where(inside, heights[frames, foot], np.nan)
            found = _descents(
                time[frames], z, ends, longest[foot], noise_m, down_height_m
            )
            for all_of_it, one in zip((near, earliest, status), found, strict=True):
                all_of_it[rows, foot] = one
    return near, earliest, status


def _frame(time: FloatArray, heights: FloatArray) -> float:
    """Return the usual time between frames that show a foot, s; it may be seen in every k-th."""
    seen = time[~np.isnan(heights)]
    return float(np.median(np.diff(seen))) if len(seen) > 1 else float("nan")


def _descents(
    t: FloatArray,
    z: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    longest: float,
    noise_m: float,
    down_height_m: float,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return what `approaches` does, each (R,), for one foot in each window (R, W).

    Missing frames never count against a foot: it is `ALREADY_DOWN` before the pre
    section or `NOT_LANDED` by the post section (`ends`, each (R,)) only if no gap can
    hide the contrary. Frames farther apart than `longest` are a gap.
    """
    count = (~np.isnan(z)).sum(axis=1)
    order = np.argsort(
        np.isnan(z), axis=1, kind="stable"
    )  # frames that show the foot come first
    t, z = np.take_along_axis(t, order, axis=1), np.take_along_axis(z, order, axis=1)
    rows, place = np.arange(len(z)), np.arange(z.shape[1])
    low_first = np.where(np.isnan(z), np.inf, z)
    low = low_first.min(axis=1)
    depth = np.where(np.isnan(z), -np.inf, z).max(axis=1, initial=-np.inf) - low
    nearly = np.maximum(5 * noise_m, NEAR_FLOOR * depth)
    above = z > (low + nearly)[:, None]
    low_first = np.where(_has_left(z, above, low + 0.5 * nearly), np.inf, low_first)
    bottom = np.argmin(low_first, axis=1)
    low = low_first[rows, bottom]
    falling = place < bottom[:, None]
    last = _last(falling & above)
    with np.errstate(
        invalid="ignore"
    ):  # depth is not finite if no frame shows the foot
        on_its_way = z > (low + ON_ITS_WAY * depth)[:, None]
    first = _last((place <= last[:, None]) & on_its_way)
    first = np.where(first < 0, last, first)
    stood = (last < 0) | (depth <= SETTLES * down_height_m)
    status = np.where(stood, np.where(t[:, 0] > ends[0], MISSING, ALREADY_DOWN), LANDED)
    hidden = _may_hide_landing(t, z, ends, longest, down_height_m)
    status = np.where(
        low > down_height_m, np.where(hidden, MISSING, NOT_LANDED), status
    )
    status = np.where(count < LEAST_FRAMES, MISSING, status)
    after = np.minimum(last + 1, z.shape[1] - 1)
    half_down = np.argmax(
        (place > last[:, None]) & (z <= (low + 0.5 * nearly)[:, None]), axis=1
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        fall = (z[rows, first] - z[rows, after]) / (t[rows, after] - t[rows, first])
        near = t[rows, after] + (z[rows, after] - low) / fall
        near = np.minimum(
            near, 2 * t[rows, half_down] - t[rows, last]
        )  # a fall does not slow down
        gap = t[rows, after] - t[rows, last]
        before = np.maximum(np.minimum(first, last - 1), 0)
        fall = (z[rows, before] - z[rows, last]) / (t[rows, last] - t[rows, before])
        early = t[rows, last] + np.minimum((z[rows, last] - low) / fall, gap)
    in_gap = (
        (gap > longest) & (last > 0) & (fall > 0)
    )  # the far end of the gap does not help
    near = np.where(in_gap, early, near)
    landed = status == LANDED
    rest = np.sort(low_first, axis=1)[:, min(RESTING_FRAME, z.shape[1] - 1)]
    earliest = np.where(landed, _last_above(t, z, falling, rest, longest), np.nan)
    return np.where(landed, np.maximum(near, earliest), np.nan), earliest, status


def _has_left(z: FloatArray, above: BoolArray, stands_m: FloatArray) -> BoolArray:
    """Mark the frames (R, W) after a foot that came down and stood has left the floor again.

    A foot may land twice in one descent: the body may keep sinking while it pushes off
    again.
    """
    stands = np.logical_or.accumulate(above, axis=1) & (z <= stands_m[:, None])
    return np.logical_or.accumulate(
        above & (np.cumsum(stands, axis=1) > RESTING_FRAME), axis=1
    )


def _last_above(
    t: FloatArray, z: FloatArray, falling: BoolArray, rest: FloatArray, longest: float
) -> FloatArray:
    """Return the instants (R,) until which a foot is too high to touch; -inf where it never is."""
    rows, last_place = np.arange(len(z)), z.shape[1] - 1
    step, rise = np.diff(t, axis=1), np.diff(z, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        down = np.where((step <= longest) & falling[:, 1:], -rise / step, 0.0)
        limit = rest + SKIN_M + SOFTEST_S * np.nan_to_num(down).max(axis=1, initial=0.0)
        place = _last(falling & (z > limit[:, None]))
        after = np.minimum(place + 1, last_place)
        ahead = t[rows, after] - t[rows, place]
        share = (z[rows, place] - limit) / (z[rows, place] - z[rows, after])
        at = t[rows, place] + np.where(ahead <= longest, share * ahead, 0.0)
    return np.where(place < 0, -np.inf, at)


def _may_hide_landing(
    t: FloatArray,
    z: FloatArray,
    ends: tuple[FloatArray, ...],
    longest: float,
    down_height_m: float,
) -> NDArray[np.bool_]:
    """Mark the rows (R, W) in which a gap may hide that the foot was down; seen frames come first.

    The foot is assumed to enter a gap at the fastest fall that was seen, and then to
    fall freely. If it is seen again after the gap, it must also have had time to come
    back up.
    """
    gap, rise = np.diff(t, axis=1), np.diff(z, axis=1)  # NaN where a frame is not seen
    fall = np.where((gap <= longest) & (rise < 0), -rise / gap, 0.0).max(
        axis=1, initial=0.0
    )
    lower = np.fmin(z[:, :-1], z[:, 1:]) + 0.0 * rise
    within = lower - _drop(fall[:, None], 0.5 * gap) <= down_height_m
    seen = np.maximum((~np.isnan(z)).sum(axis=1) - 1, 0)
    rows = np.arange(len(z))
    final, rest = z[rows, seen], ends[1] - t[rows, seen]
    first, lead = z[:, 0], t[:, 0] - ends[0]
    return np.asarray(
        (within & (gap > longest)).any(axis=1)
        | ((final - _drop(fall, rest) <= down_height_m) & (rest > longest))
        | ((first - _drop(fall, lead) <= down_height_m) & (lead > longest))
    )


def _drop(speed: FloatArray, duration: FloatArray) -> FloatArray:
    """Return the drop, m, in free fall of the given duration, s, from a downward speed, m/s."""
    return duration * (speed + 0.5 * GRAVITY_M_S2 * duration)


def _last(marked: NDArray[np.bool_]) -> IntArray:
    """Return the place of the last mark in each row (R, W), -1 where there is none."""
    last = marked.shape[1] - 1 - np.argmax(marked[:, ::-1], axis=1)
    return np.where(marked.any(axis=1), last, -1)
