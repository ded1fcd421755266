"""Recognition of stances, and the hops between them (Algorithm 4, made robust)."""

import math
from collections import Counter, deque
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray, IntArray
from hopdata.steering.observation.geometry import HopperGeometry

# Local polynomial fits to frames that need not be evenly spaced.

# Times of frames on the edge of a window differ by rounding from the window's ends.
_EDGE_S = 1e-9


@dataclass(frozen=True)
class LocalFit:
    """A polynomial in the time since `middle_s`.

    Parameters
    ----------
    middle_s : float
    first_s, last_s : float
        Times of the outermost frames.
    coefficients : (d + 1,) or (d + 1, m) array
        Starting with the constant; one column for each of m quantities.
    """

    middle_s: float
    first_s: float
    last_s: float
    coefficients: FloatArray

    def at(self, time_s: float, derivative: int = 0) -> FloatArray:
        """Return the value, or a derivative, at a time, () or (m,)."""
        found = np.polynomial.polynomial.polyder(self.coefficients, derivative)
        return np.asarray(
            np.polynomial.polynomial.polyval(time_s - self.middle_s, found)
        )


def local_fit(
    time: FloatArray, values: FloatArray, begin_s: float, end_s: float, *, degree: int
) -> LocalFit | None:
    """Fit polynomials by least squares to the frames between two times.

    Parameters
    ----------
    time : (N,) array
        Increasing, s.
    values : (N,) or (N, m) array
        All finite.
    begin_s, end_s : float
        Ends of the window, s; frames on them are included.
    degree : int

    Returns
    -------
    LocalFit or None
        None if there are too few frames.
    """
    first, last = np.searchsorted(time, [begin_s - _EDGE_S, end_s + _EDGE_S])
    if last - first < degree + 1:
        return None
    # Times are scaled to [-1, 1], so that the powers are of like size.
    half_s = 0.5 * (end_s - begin_s)
    middle_s = 0.5 * (begin_s + end_s)
    powers = np.arange(degree + 1)
    design = ((time[first:last] - middle_s) / half_s)[:, None] ** powers
    scaled = np.linalg.lstsq(design, values[first:last], rcond=None)[0]
    coefficients = (scaled.T * half_s ** -powers.astype(float)).T
    return LocalFit(middle_s, float(time[first]), float(time[last - 1]), coefficients)


# Motion beside a gap in the frames, in which the lowest point of a stance may lie.

#: Window of the fit to the heights on one side of a gap, for the speed there.
#: Unit: s. Origin: chosen.
SIDE_S = 0.05
#: Least upward acceleration at the lowest point of a stance.
#: Unit: m/s^2. Origin: derived: about half of g, since the floor accelerates a hopper
#: upwards harder than a hand does.
LEAST_BEND_M_S2 = 5.0


Motion: TypeAlias = tuple[float, float, float]  # time, s; height, m; speed, m/s


def turning_point(falling: Motion, rising: Motion, below_m: float) -> float:
    """Return the time of the lowest point between a fall and a rise, s.

    Above `below_m` the motion is free flight. Below it, fall and rise are taken to be
    symmetric in time, so the lowest point is halfway between equal heights. A
    difference in height is converted to time at the mean of the two speeds.
    """
    out_s, out_m, fall = _flown(falling, below_m)
    in_s, in_m, rise = _flown(rising, below_m)
    lowest_s = 0.5 * (out_s + in_s) + (out_m - in_m) / (rise - fall)
    return min(max(lowest_s, falling[0]), rising[0])


def _flown(motion: Motion, to_m: float) -> Motion:
    """Extrapolate free flight to a lower height: a fall forwards, a rise backwards."""
    time_s, height_m, speed = motion
    if height_m <= to_m:
        return motion
    gained = math.sqrt(2 * GRAVITY_M_S2 * (height_m - to_m))
    speed_there = math.copysign(math.hypot(speed, gained), speed)
    return time_s + (speed - speed_there) / GRAVITY_M_S2, to_m, speed_there


def side_speeds(
    time: FloatArray, height: FloatArray, before: int
) -> tuple[float, float]:
    """Return the speeds just before and just after a gap, m/s; NaN if unknown."""
    out_s = time[before]
    in_s = time[before + 1]
    return (
        _speed_at(time, height, out_s, out_s - SIDE_S, out_s),
        _speed_at(time, height, in_s, in_s, in_s + SIDE_S),
    )


def _speed_at(
    time: FloatArray, height: FloatArray, at_s: float, begin_s: float, end_s: float
) -> float:
    """Return the speed by a parabola through a window, or a line if frames lack."""
    fit = local_fit(time, height, begin_s, end_s, degree=2)
    if fit is None:
        fit = local_fit(time, height, begin_s, end_s, degree=1)
    if fit is None:
        return float("nan")
    return float(fit.at(at_s, 1))


# Recognition of stances, from one height after another: live, and in recordings.

#: Window of the parabola through the last frames; `WINDOW_FRAMES` counts at low rates.
#: Unit: s. Origin: chosen.
WINDOW_S = 0.055
#: Least window of the parabola through the last frames, in times between frames.
#: Unit: 1. Origin: derived: a little more than three, so that it holds four frames.
WINDOW_FRAMES = 3.5
#: Longest gap in the frames across which a stance is still recognised.
#: Unit: s. Origin: chosen.
RECOGNISED_HOLE_S = 0.25
#: A clock that goes back by more has been restarted.
#: Unit: s. Origin: chosen.
RESTART_S = 1.0
#: A height that needs a larger speed has jumped.
#: Unit: m/s. Origin: chosen.
FASTEST_M_S = 4.0
#: A height that needs a larger acceleration has jumped.
#: Unit: m/s^2. Origin: chosen.
HARDEST_M_S2 = 60.0
#: How clearly the height must fall or rise, in errors of its speed.
#: Unit: 1. Origin: chosen.
SIGMAS = 4.0
#: A frame that comes sooner after the last one repeats it.
#: Unit: times between frames. Origin: chosen.
LEAST_STEP_FRAMES = 0.1


@dataclass(frozen=True)
class DetectedStance:
    """A recognised stance.

    Parameters
    ----------
    time_s : float
        Time of the lowest point, between frames.
    height_m : float
        The lowest height that was seen.
    bridged : bool
        Whether the lowest point lies in a gap between frames, or close to one, and its
        time is estimated from the speeds beside it.
    recognised_s : float
        Time of the frame in which it was recognised.
    """

    time_s: float
    height_m: float
    bridged: bool
    recognised_s: float


class StanceDetector:
    """Reports each stance once, 30, 20 or 10 ms after its lowest point.

    These are the delays at 60, 100 and 250 Hz. A stance is reported when the height,
    after rising above one threshold, is below another, and a parabola through the last
    frames has clearly turned upwards in two consecutive frames. Frames may be late or
    missing; parabolas then have fewer points. A height that jumps is left out unless
    the next one confirms it.

    Parameters
    ----------
    geometry : HopperGeometry
        Its noise, and the heights that every stance falls below and every flight rises
        above.
    rate_hz : float
        Frame rate of the stream.

    Attributes
    ----------
    n_left_out : int
        Number of frames with an unknown height, a jump in height, or a time that did
        not advance.
    """

    def __init__(self, geometry: HopperGeometry, *, rate_hz: float = 100.0) -> None:
        self.geometry = geometry
        self.n_left_out = 0
        self.window_s = max(WINDOW_S, WINDOW_FRAMES / rate_hz)
        self.least_step_s = LEAST_STEP_FRAMES / rate_hz
        # A height is the mean over the body markers.
        self.noise_m = float(geometry.noise_m) / math.sqrt(len(geometry.body_m))
        self._forget()

    def _forget(self) -> None:
        """Reset, as if nothing had been seen."""
        # Frames in the window, each with time and height; one that is far from them.
        self._frames: deque[tuple[float, float]] = deque()
        self._stray: tuple[float, float] | None = None
        # The last clear fall, whether a flight was seen since the last stance, and
        # whether the last frame already rose.
        self._falling: Motion | None = None
        self._armed = False
        self._turned = False
        self._lowest_m = math.inf
        self._speed = 0.0
        self._last_s = -math.inf
        # Time of the last frame that was kept, and the longest gap since the fall.
        self._kept_s = math.inf
        self._hole_s = 0.0

    def feed(self, time_s: float, height_m: float) -> DetectedStance | None:
        """Take the next frame; return the stance it reveals, if any.

        Parameters
        ----------
        time_s : float
            Time of the frame, s.
        height_m : float
            Height of the mean body marker, m; NaN if unknown.
        """
        if not self._taken(time_s, height_m):
            self.n_left_out += 1
            return None
        slope, bend, noise = self._parabola(time_s)
        self._speed = slope
        is_high = height_m > self.geometry.flight_above_m
        if is_high and (slope < 0 or not self._armed):
            self._armed = True
            self._lowest_m = math.inf
        if height_m < self._lowest_m:
            self._lowest_m = height_m
        if slope < 0 and self._armed:
            self._turned = False
            if slope < -SIGMAS * noise:
                self._falling = (time_s, height_m, slope)
                self._hole_s = 0.0
        if not self._armed or slope <= SIGMAS * noise or self._falling is None:
            return None
        if not self._turned:  # a single frame that rises is not enough
            self._turned = True
            return None
        return self._recognised((time_s, height_m, slope), bend)

    def _taken(self, time_s: float, height_m: float) -> bool:
        """Keep a frame if it is plausible, and forget those that are too old."""
        if time_s < self._last_s - RESTART_S:
            self._forget()
        if not (math.isfinite(height_m) and time_s - self._last_s > self.least_step_s):
            return False
        self._last_s = time_s
        frame = (time_s, height_m)
        if self._frames and self._far(self._frames[-1], frame):
            if self._stray is None or self._far(self._stray, frame):
                self._stray = frame
                return False
            # Forget the heights before the jump, but not that the hopper was falling.
            self._frames.clear()
            self._frames.append(self._stray)
            self._turned = False
        self._stray = None
        if time_s - self._kept_s > self._hole_s:
            self._hole_s = time_s - self._kept_s
        self._kept_s = time_s
        self._frames.append(frame)
        while self._frames[0][0] < time_s - self.window_s:
            self._frames.popleft()
        return True

    def _far(self, one: tuple[float, float], other: tuple[float, float]) -> bool:
        """Return whether a height is out of reach from another one.

        From the last frame, it is compared with where the height was heading.
        """
        wait_s = other[0] - one[0]
        rise = other[1] - one[1]
        reach = FASTEST_M_S * wait_s
        if len(self._frames) > 2 and one == self._frames[-1]:
            rise -= self._speed * wait_s
            reach = min(reach, 0.5 * HARDEST_M_S2 * wait_s**2)
        return abs(rise) > reach + 4 * SIGMAS * self.noise_m

    def _parabola(self, time_s: float) -> tuple[float, float, float]:
        """Return speed, m/s, acceleration, m/s^2, and error of the speed, at a time.

        The parabola goes through the frames in the window by least squares. There are
        so few numbers that arrays would take eight times as long.
        """
        # Sums of the powers of the time before the last frame, and of the heights
        # times these powers.
        s0 = s1 = s2 = s3 = s4 = 0.0
        z0 = z1 = z2 = 0.0
        for when, z in self._frames:
            s = when - time_s
            ss = s * s
            s0 += 1
            s1 += s
            s2 += ss
            s3 += s * ss
            s4 += ss * ss
            z0 += z
            z1 += s * z
            z2 += ss * z
        if s0 < 2:
            return 0.0, 0.0, math.inf
        if s0 < 3:  # a line
            determinant = s0 * s2 - s1 * s1
            slope = (s0 * z1 - s1 * z0) / determinant
            return slope, math.nan, self.noise_m * math.sqrt(max(0.0, s0 / determinant))
        # Cramer's rule for the normal equations: cofactors of the first row, then those
        # of the others where they are needed.
        c00 = s2 * s4 - s3 * s3
        c01 = s2 * s3 - s1 * s4
        c02 = s1 * s3 - s2 * s2
        c11 = s0 * s4 - s2 * s2
        c12 = s1 * s2 - s0 * s3
        c22 = s0 * s2 - s1 * s1
        determinant = s0 * c00 + s1 * c01 + s2 * c02
        slope = (c01 * z0 + c11 * z1 + c12 * z2) / determinant
        bend = 2 * (c02 * z0 + c12 * z1 + c22 * z2) / determinant
        return slope, bend, self.noise_m * math.sqrt(max(0.0, c11 / determinant))

    def _recognised(self, rising: Motion, bend: float) -> DetectedStance | None:
        """Return the stance before a rise, if it was low, recent and curved enough."""
        assert self._falling is not None
        before_s, _, fall = self._falling
        time_s, _, slope = rising
        below_m = self.geometry.stance_below_m
        is_bridged = bool(time_s - before_s > self.window_s)
        if is_bridged:
            lowest_s = turning_point(self._falling, rising, below_m)
            bend = (slope - fall) / (time_s - before_s)
        elif bend > 0:
            lowest_s = time_s - slope / bend
        else:
            lowest_s = before_s
        if time_s - before_s > RECOGNISED_HOLE_S or not bend > LEAST_BEND_M_S2:
            return None
        if not (self._lowest_m < below_m or self._may_have_been_low(rising)):
            return None
        self._armed = False
        self._falling = None
        return DetectedStance(
            time_s=float(lowest_s),
            height_m=float(self._lowest_m),
            bridged=is_bridged,
            recognised_s=float(time_s),
        )

    def _may_have_been_low(self, rising: Motion) -> bool:
        """Tell whether there was a gap with time to fly down and up again in it."""
        assert self._falling is not None
        below_m = self.geometry.stance_below_m
        down_s = _flown(self._falling, below_m)[0]
        up_s = _flown(rising, below_m)[0]
        return self._hole_s > self.window_s and down_s < up_s


# Stances of a recording, the visits below a height threshold that they belong to, and
# what lies between these.

#: Longest gap between two stances of a hop: in a longer one anything may have happened.
#: Unit: s. Origin: chosen.
HOLE_S = 0.3
#: At a longer gap in the flight, the apex is also estimated from the speeds beside it.
#: Unit: s. Origin: chosen.
SIDE_HOLE_S = 0.04
#: Least time above the threshold, as a share of that of free fall from the apex.
#: Unit: 1. Origin: chosen.
SHORTEST = 0.6
#: Most time above the threshold, as a share of that of free fall from the apex: hands
#: hold a hopper for longer.
#: Unit: 1. Origin: chosen.
LONGEST = 1.5

HELD = "held or carried in between"
HOLE = "heights missing in between"


@dataclass(frozen=True)
class Visits:
    """Visits below one threshold; each lasts until the height is above the other again.

    Parameters
    ----------
    first, last : (V,) array of int
        Outermost frames below the threshold.
    after_hole : (V,) bool array
        Whether there is a long gap between the previous visit and this one.
    """

    first: IntArray
    last: IntArray
    after_hole: BoolArray


def find_visits(
    time: FloatArray, height: FloatArray, below_m: float, above_m: float
) -> Visits:
    """Find the visits below a threshold, with the other one as hysteresis.

    A long gap ends a visit.

    Parameters
    ----------
    time, height : (N,) array
        Frames with a known height; s, m.
    below_m, above_m : float
        The two thresholds.
    """
    # Frames between the thresholds belong to what was before, and are left out.
    decided = np.flatnonzero((height < below_m) | (height > above_m))
    is_low = height[decided] < below_m
    n_holes_before = np.cumsum(np.diff(time, prepend=time[:1]) > HOLE_S)
    begins = is_low.copy()
    begins[1:] &= ~is_low[:-1] | (np.diff(n_holes_before[decided]) > 0)
    visit_of_frame = np.cumsum(begins)[is_low] - 1
    low_frames = decided[is_low]
    is_first = np.diff(visit_of_frame, prepend=-1)
    is_last = np.diff(visit_of_frame, append=visit_of_frame[-1:] + 1)
    first = low_frames[np.flatnonzero(is_first)]
    last = low_frames[np.flatnonzero(is_last)]
    after_hole = np.zeros(len(first), dtype=bool)
    after_hole[1:] = n_holes_before[first[1:]] > n_holes_before[last[:-1]]
    return Visits(first, last, after_hole)


def not_a_hop(
    time: FloatArray,
    height: FloatArray,
    leave: int,
    back: int,
    above_m: float,
    stood_s: float,
) -> str | None:
    """Return why the frames between two visits are not a flight; None if they are.

    The time above the threshold is compared with that of free fall from the apex. At a
    gap, the apex is extrapolated from the heights and speeds on both sides, if that is
    above all heights seen. A hopper that stands longer next to a lowest point than it
    then flies has stumbled.

    Parameters
    ----------
    time, height : (N,) array
        Frames with a known height; s, m.
    leave, back : int
        Last frame of one visit, and first frame of the next.
    above_m : float
    stood_s : float
        Time from a lowest point to the flight, or from the flight to the next one,
        whichever is longer, s.
    """
    high = leave + np.flatnonzero(height[leave : back + 1] > above_m)
    before_up = int(high[0]) - 1
    up_s = _crossing(time, height, before_up, above_m)
    down_s = _crossing(time, height, int(high[-1]), above_m)
    apex_m = float(height[high].max())
    gaps = np.flatnonzero(np.diff(time[before_up : back + 1]) > SIDE_HOLE_S)
    for before in before_up + gaps:
        speed_up, speed_down = side_speeds(time, height, int(before))
        if speed_up > 0:
            apex_m = max(apex_m, _apex_of(height[before], speed_up))
        if -speed_down > 0:
            apex_m = max(apex_m, _apex_of(height[before + 1], -speed_down))
    free_s = 2 * np.sqrt(2 * (apex_m - above_m) / GRAVITY_M_S2)
    flight_s = down_s - up_s
    if max(SHORTEST * free_s, stood_s) <= flight_s <= LONGEST * free_s:
        return None
    return HELD


def _apex_of(height_m: float, speed_m_s: float) -> float:
    """Return the height to which a free flight with this speed leads."""
    return float(height_m + speed_m_s**2 / (2 * GRAVITY_M_S2))


def _crossing(
    time: FloatArray, height: FloatArray, frame: int, level_m: float
) -> float:
    """Return the time at which a level is crossed between a frame and the next, s."""
    share = (level_m - height[frame]) / (height[frame + 1] - height[frame])
    return float(time[frame] + share * (time[frame + 1] - time[frame]))


NO_STANCE = "no stance recognised"
ONE_NO_STANCE = "one of them no stance"
REASONS = (NO_STANCE, ONE_NO_STANCE, HOLE, HELD)


@dataclass(frozen=True)
class Stances:
    """Stances in order of time, and which of them are one hop apart.

    Parameters
    ----------
    time_s : (K,) array
        Time of the lowest point, between frames.
    height_m : (K,) array
        The lowest height that was seen.
    frame : (K,) array of int
        The nearest frame with a known height.
    bridged : (K,) bool array
        Whether the lowest point lies in or close to a gap, which makes its time less
        certain.
    pairs : (P, 2) array of int
        Indices k and k + 1 of the two stances of each hop.
    rejected : dict of str to int
        By reason, how many visits below the threshold are not stances ("no stance
        recognised"), and how many pairs of neighbouring visits are not hops ("one of
        them no stance", "heights missing in between", "held or carried in between").
    """

    time_s: FloatArray
    height_m: FloatArray
    frame: IntArray
    bridged: BoolArray
    pairs: IntArray
    rejected: dict[str, int]


def find_stances(
    time: FloatArray, height: FloatArray, geometry: HopperGeometry
) -> Stances:
    """Find all stances, and pair those with one flight and nothing else between them.

    Stances are recognised as in live use, by a `StanceDetector` that is given one
    height after another. Each belongs to a visit below the lower threshold, which lasts
    until the height is above the upper one again. Two stances are a hop apart if their
    visits follow each other and the time above the upper threshold is that of free
    fall; otherwise somebody held or carried the hopper.

    Parameters
    ----------
    time : (N,) array
        Increasing, s; frames may be missing.
    height : (N,) array
        Height of the mean body marker, m; NaN where unknown.
    geometry : HopperGeometry
        Its noise and its two thresholds.
    """
    known = np.flatnonzero(np.isfinite(height))
    known_time = time[known]
    known_height = height[known]
    below_m = geometry.stance_below_m
    above_m = geometry.flight_above_m
    visits = find_visits(known_time, known_height, below_m, above_m)
    recognised = _stances_in(known_time, known_height, geometry)
    by_visit = _by_visit(known_time, visits, recognised)
    links = [
        _link(known_time, known_height, visits, by_visit, k, above_m)
        for k in range(len(by_visit) - 1)
    ]
    stances = [one for one in by_visit if one is not None]
    stance_of_visit = np.cumsum([one is not None for one in by_visit]) - 1
    # Two visits that are a hop apart are two stances that follow each other.
    first = np.array(
        [stance_of_visit[k] for k, link in enumerate(links) if link is None], dtype=int
    )
    instants = np.array([stance.time_s for stance in stances])
    why = Counter(link for link in links if link is not None)
    why[NO_STANCE] = len(by_visit) - len(stances)
    return Stances(
        time_s=instants,
        height_m=np.array([stance.height_m for stance in stances]),
        frame=known[_nearest(known_time, instants)],
        bridged=np.array([stance.bridged for stance in stances], dtype=bool),
        pairs=np.column_stack([first, first + 1]),
        rejected={reason: why[reason] for reason in REASONS},
    )


def _stances_in(
    time: FloatArray, height: FloatArray, geometry: HopperGeometry
) -> list[DetectedStance]:
    """Return the stances that a detector recognises in heights that are known."""
    if len(time) < 2:
        return []
    detector = StanceDetector(geometry, rate_hz=1.0 / float(np.median(np.diff(time))))
    found = map(detector.feed, time.tolist(), height.tolist())
    return [stance for stance in found if stance is not None]


def _by_visit(
    time: FloatArray, visits: Visits, recognised: list[DetectedStance]
) -> list[DetectedStance | None]:
    """Return the stance of each visit, or None where none was recognised.

    A stance whose lowest point is in a gap may have no visit, since no frame is low;
    nobody knows what else was in the gap, and it is left out.
    """
    before = (visits.first - 1).clip(0)
    after = (visits.last + 1).clip(max=max(len(time) - 1, 0))
    instants = np.array([stance.time_s for stance in recognised])
    first = np.searchsorted(instants, time[before], side="right")
    past = np.searchsorted(instants, time[after])
    return [
        recognised[one] if one < other else None
        for one, other in zip(first.tolist(), past.tolist(), strict=True)
    ]


def _link(
    time: FloatArray,
    height: FloatArray,
    visits: Visits,
    by_visit: list[DetectedStance | None],
    k: int,
    above_m: float,
) -> str | None:
    """Return why visits k and k + 1 are not a hop apart; None if they are."""
    one = by_visit[k]
    other = by_visit[k + 1]
    if one is None or other is None:
        return ONE_NO_STANCE
    if visits.after_hole[k + 1]:
        return HOLE
    leave = int(visits.last[k])
    back = int(visits.first[k + 1])
    stood_s = max(float(time[leave]) - one.time_s, other.time_s - float(time[back]))
    return not_a_hop(time, height, leave, back, above_m, stood_s)


def _nearest(time: FloatArray, instants: FloatArray) -> IntArray:
    """Return the frame nearest to each instant."""
    after = np.searchsorted(time, instants).clip(1, max(len(time) - 1, 1))
    is_nearer_before = instants - time[after - 1] < time[after] - instants
    return np.asarray(after - is_nearer_before)
