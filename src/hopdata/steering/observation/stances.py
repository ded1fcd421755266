"""Stances of a recording and the hops between them (dissertation, Algorithm 4, made robust)."""

import math
from collections import Counter, deque
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray, IntArray
from hopdata.steering.observation.geometry import HopperGeometry, height_band

# Local polynomial fits to frames that need not be evenly spaced.


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

    def lowest(self) -> float | None:
        """Return the time of a parabola's or cubic's minimum, s; None if outside the frames."""
        c, b, a = np.polynomial.polynomial.polyder(
            np.append(self.coefficients, [0.0, 0.0])[:4]
        )
        square = b * b - 4 * a * c  # squared curvature at the extrema
        if square <= 0:
            return None
        bend = np.sqrt(square)
        if b + bend > 0:
            instant = self.middle_s - 2 * c / (b + bend)
        elif a != 0:
            instant = self.middle_s + (bend - b) / (2 * a)
        else:
            return None
        return float(instant) if self.first_s <= instant <= self.last_s else None


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
    first, last = np.searchsorted(time, [begin_s - 1e-9, end_s + 1e-9])
    if last - first < degree + 1:
        return None
    half_s, middle_s = 0.5 * (end_s - begin_s), 0.5 * (begin_s + end_s)
    powers = np.arange(degree + 1)
    design = ((time[first:last] - middle_s) / half_s)[:, None] ** powers
    found = np.linalg.lstsq(design, values[first:last], rcond=None)[0]
    scaled = (found.T * half_s ** -powers.astype(float)).T
    return LocalFit(middle_s, float(time[first]), float(time[last - 1]), scaled)


# The lowest point of a stance, between frames, and also where frames are missing.

BOTTOM_S = 0.045  # half-width of the window of the fit at the lowest point
SIDE_S = 0.05  # width of the window of the fit on one side of a gap
WIDEST_HOLE_S, WIDEST_HOLE_FRAMES = (
    0.035,
    3.5,
)  # widest gap within a fit: the larger of the two
LONGEST_BRIDGE_S = 0.2
LEAST_BEND_M_S2 = (
    5.0  # half of g: the floor accelerates a hopper upwards harder than a hand does
)

BOTTOM_UNSEEN, NO_BOUNCE = "lowest point not seen", "no bounce"


@dataclass(frozen=True)
class Bottom:
    """The lowest point of a stance.

    Parameters
    ----------
    time_s : float
        Time of the lowest point, between frames.
    height_m : float
        Height of the lowest point. In live use, the lowest height seen, if frames are
        missing there.
    bridged : bool
        Whether it lies in a gap between frames, in which case its time is an estimate.
    """

    time_s: float
    height_m: float
    bridged: bool


def find_bottom(
    time: FloatArray, height: FloatArray, lowest: int, frame_s: float, below_m: float
) -> Bottom | str:
    """Find the lowest point near the lowest frame, or return why there is none.

    It is the minimum of a cubic through the frames there. If a gap is too wide for the
    cubic, and the height falls before the gap and rises after it, it is the
    `turning_point` of the heights and speeds on both sides. In either case the
    acceleration must be at least half of g.

    Parameters
    ----------
    time, height : (N,) array
        Frames with a known height; s, m.
    lowest : int
        Index of the lowest frame.
    frame_s : float
        Time between frames, s.
    below_m : float
        Height that every stance falls below.
    """
    begin, end = time[lowest] - BOTTOM_S, time[lowest] + BOTTOM_S
    first, last = np.searchsorted(time, [begin - 1e-9, end + 1e-9])
    waits = np.diff(np.concatenate([[begin], time[first:last], [end]]))
    fit = local_fit(time, height, begin, end, degree=3)
    allowed_s = max(WIDEST_HOLE_S, WIDEST_HOLE_FRAMES * frame_s) if fit else 0.0
    for k in np.argsort(-waits, kind="stable")[: np.sum(waits > allowed_s)]:
        bridged = _bridged(time, height, int(first - 1 + k), below_m)
        if bridged is not None:
            return bridged
    if fit is None:
        return BOTTOM_UNSEEN
    instant = fit.lowest()
    if instant is None or fit.at(instant, 2) < LEAST_BEND_M_S2:
        return NO_BOUNCE
    return Bottom(instant, float(fit.at(instant)), False)


def _bridged(
    time: FloatArray, height: FloatArray, before: int, below_m: float
) -> Bottom | str | None:
    """Find the lowest point in the gap after a frame; None if it is outside of the gap."""
    if (
        not 0 <= before < len(time) - 1
        or time[before + 1] - time[before] > LONGEST_BRIDGE_S
    ):
        return BOTTOM_UNSEEN
    out_s, in_s = time[before], time[before + 1]
    fall, rise = side_speeds(time, height, before)
    if not (fall < 0 < rise):
        return BOTTOM_UNSEEN if np.isnan(fall + rise) else None
    if (rise - fall) / (in_s - out_s) < LEAST_BEND_M_S2:
        return NO_BOUNCE
    falling = (float(out_s), float(height[before]), fall)
    rising = (float(in_s), float(height[before + 1]), rise)
    return Bottom(*turning_point(falling, rising, below_m), True)


Motion: TypeAlias = tuple[float, float, float]  # time, s; height, m; speed, m/s


def turning_point(
    falling: Motion, rising: Motion, below_m: float
) -> tuple[float, float]:
    """Return time and height of the lowest point between a fall and a rise.

    Above `below_m` the motion is free flight. Below it, fall and rise are taken to be
    symmetric in time, so the lowest point is halfway between equal heights. A
    difference in height is converted to time at the mean of the two speeds.
    """
    (out_s, out_m, fall), (in_s, in_m, rise) = (
        _flown(falling, below_m),
        _flown(rising, below_m),
    )
    lowest_s = 0.5 * (out_s + in_s) + (out_m - in_m) / (rise - fall)
    lowest_s = min(max(lowest_s, falling[0]), rising[0])
    after = lowest_s < 0.5 * (out_s + in_s)
    when, height_m, speed = (out_s, out_m, fall) if after else (in_s, in_m, rise)
    return lowest_s, height_m + 0.5 * speed * (lowest_s - when)


def _flown(motion: Motion, to_m: float) -> Motion:
    """Extrapolate free flight to a lower height, forwards in a fall and backwards in a rise."""
    time_s, height_m, speed = motion
    if height_m <= to_m:
        return motion
    gained = math.sqrt(2 * GRAVITY_M_S2 * (height_m - to_m))
    there = math.copysign(math.hypot(speed, gained), speed)
    return time_s + (speed - there) / GRAVITY_M_S2, to_m, there


def side_speeds(
    time: FloatArray, height: FloatArray, before: int
) -> tuple[float, float]:
    """Return the speeds just before and just after a gap, m/s; NaN if unknown."""
    speeds = []
    for frame, begin, end in ((before, -SIDE_S, 0.0), (before + 1, 0.0, SIDE_S)):
        at = time[frame]
        window = (time, height, at + begin, at + end)
        fit = local_fit(*window, degree=2) or local_fit(*window, degree=1)
        speeds.append(float("nan") if fit is None else float(fit.at(at, 1)))
    return speeds[0], speeds[1]


# Visits below a height threshold, and what lies between them.

HOLE_S = 0.3  # in a longer gap anything may have happened
SIDE_HOLE_S = (
    0.04  # at a longer gap, the apex is also estimated from the speeds on both sides
)
SHORTEST, LONGEST = (
    0.6,
    1.5,
)  # time above the threshold, relative to free fall from the apex

HELD, HOLE = "held or carried in between", "heights missing in between"


@dataclass(frozen=True)
class Visits:
    """Visits below one threshold; each lasts until the height is above the other one again.

    Parameters
    ----------
    first, last : (V,) array of int
        Outermost frames below the threshold.
    lowest : (V,) array of int
        The lowest frame.
    after_hole : (V,) bool array
        Whether there is a long gap between the previous visit and this one.
    """

    first: IntArray
    last: IntArray
    lowest: IntArray
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
    side = np.where(height < below_m, -1, np.where(height > above_m, 1, 0))
    outside = np.flatnonzero(side)
    holes = np.cumsum(np.diff(time, prepend=time[:1]) > HOLE_S)
    low = side[outside] < 0
    begins = low.copy()
    begins[1:] &= ~low[:-1] | (np.diff(holes[outside]) > 0)
    number = np.cumsum(begins)[low] - 1
    inside = outside[low]
    first = inside[np.flatnonzero(np.diff(number, prepend=-1))]
    last = inside[np.flatnonzero(np.diff(number, append=number[-1:] + 1))]
    lowest = [
        a + int(np.argmin(height[a : b + 1])) for a, b in zip(first, last, strict=True)
    ]
    after_hole = np.zeros(len(first), dtype=bool)
    after_hole[1:] = holes[first[1:]] > holes[last[:-1]]
    return Visits(first, last, np.array(lowest, dtype=int), after_hole)


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
    up = _crossing(time, height, int(high[0]) - 1, above_m)
    down = _crossing(time, height, int(high[-1]), above_m)
    top = float(height[high].max())
    for before in (
        high[0]
        - 1
        + np.flatnonzero(np.diff(time[high[0] - 1 : back + 1]) > SIDE_HOLE_S)
    ):
        rise, fall = side_speeds(time, height, int(before))
        for speed, frame in ((rise, before), (-fall, before + 1)):
            if speed > 0:
                top = max(top, float(height[frame] + speed**2 / (2 * GRAVITY_M_S2)))
    free = 2 * np.sqrt(2 * (top - above_m) / GRAVITY_M_S2)
    flies = max(SHORTEST * free, stood_s) <= down - up <= LONGEST * free
    return None if flies else HELD


def _crossing(
    time: FloatArray, height: FloatArray, frame: int, level_m: float
) -> float:
    """Return the time at which a level is crossed between a frame and the next, s."""
    share = (level_m - height[frame]) / (height[frame + 1] - height[frame])
    return float(time[frame] + share * (time[frame + 1] - time[frame]))


NO_STANCE = "one of them no stance"
REASONS = (BOTTOM_UNSEEN, NO_BOUNCE, NO_STANCE, HOLE, HELD)


@dataclass(frozen=True)
class Stances:
    """Stances in order of time, and which of them are one hop apart.

    Parameters
    ----------
    time_s : (K,) array
        Time of the lowest point, between frames.
    height_m : (K,) array
        Height of the lowest point.
    frame : (K,) array of int
        The nearest frame with a known height.
    bridged : (K,) bool array
        Whether the lowest point lies in a gap, which makes its time less certain.
    pairs : (P, 2) array of int
        Indices k and k + 1 of the two stances of each hop.
    rejected : dict of str to int
        By reason, how many visits below the threshold are not stances ("lowest point
        not seen", "no bounce"), and how many pairs of neighbouring visits are not hops
        ("one of them no stance", "heights missing in between", "held or carried in
        between").
    """

    time_s: FloatArray
    height_m: FloatArray
    frame: IntArray
    bridged: BoolArray
    pairs: IntArray
    rejected: dict[str, int]


def find_stances(
    time: FloatArray, height: FloatArray, band_m: tuple[float, float] | None = None
) -> Stances:
    """Find all stances, and pair those with one flight and nothing else between them.

    A stance is a visit below the lower threshold that lasts until the height is above
    the upper one again. Double minima, and a stumble that does not rise above the upper
    threshold, are thus one visit. The instant of a stance is its lowest point, where
    the body must be accelerated upwards. A pair is a hop if the time above the upper
    threshold is that of free fall; otherwise somebody held or carried the hopper.

    Parameters
    ----------
    time : (N,) array
        Increasing, s; frames may be missing.
    height : (N,) array
        Height of the mean body marker, m; NaN where unknown.
    band_m : (float, float), optional
        The two thresholds; by default `height_band` of these heights.
    """
    below, above = height_band(height) if band_m is None else band_m
    frames = np.flatnonzero(np.isfinite(height))
    t, z = time[frames], height[frames]
    visits = find_visits(t, z, below, above)
    frame_s = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    bottoms = [
        _bottom(t, z, visits, k, frame_s, below) for k in range(len(visits.lowest))
    ]
    links = [_link(t, z, visits, bottoms, k, above) for k in range(len(bottoms) - 1)]
    found = [bottom for bottom in bottoms if isinstance(bottom, Bottom)]
    number = np.cumsum([isinstance(bottom, Bottom) for bottom in bottoms]) - 1
    first = np.array(
        [number[k] for k, link in enumerate(links) if link is None], dtype=int
    )
    why = Counter(reason for reason in [*bottoms, *links] if isinstance(reason, str))
    instants = np.array([bottom.time_s for bottom in found])
    return Stances(
        instants,
        np.array([bottom.height_m for bottom in found]),
        frames[_nearest(t, instants)],
        np.array([bottom.bridged for bottom in found], dtype=bool),
        np.column_stack([first, first + 1]),
        {reason: why[reason] for reason in REASONS},
    )


def _bottom(
    t: FloatArray, z: FloatArray, visits: Visits, k: int, frame_s: float, below: float
) -> Bottom | str:
    """Return the lowest point of a visit, which must lie within it, or why it has none."""
    found = find_bottom(t, z, int(visits.lowest[k]), frame_s, below)
    first, last = max(visits.first[k] - 1, 0), min(visits.last[k] + 1, len(t) - 1)
    if isinstance(found, Bottom) and not t[first] < found.time_s < t[last]:
        return BOTTOM_UNSEEN
    return found


def _link(
    t: FloatArray,
    z: FloatArray,
    visits: Visits,
    bottoms: list[Bottom | str],
    k: int,
    above: float,
) -> str | None:
    """Return why visits k and k + 1 are not a hop apart; None if they are."""
    one, other = bottoms[k : k + 2]
    if isinstance(one, str) or isinstance(other, str):
        return NO_STANCE
    if visits.after_hole[k + 1]:
        return HOLE
    leave, back = int(visits.last[k]), int(visits.first[k + 1])
    stood_s = max(float(t[leave]) - one.time_s, other.time_s - float(t[back]))
    return not_a_hop(t, z, leave, back, above, stood_s)


def _nearest(time: FloatArray, instants: FloatArray) -> IntArray:
    after = np.searchsorted(time, instants).clip(1, max(len(time) - 1, 1))
    early = instants - time[after - 1] < time[after] - instants
    return np.asarray(after - early)


# Live recognition of stances, from one height after another.

WINDOW_S = 0.055  # window of the parabola through the last frames,
WINDOW_FRAMES = 3.5  # but at least this many frames
TOLD_HOLE_S = 0.25  # longest gap in the frames across which a stance is still reported
RESTART_S = 1.0  # a clock that goes back by more has been restarted
FASTEST_M_S, HARDEST_M_S2 = 4.0, 60.0  # a height that needs more has jumped
SIGMAS = 4.0


@dataclass(frozen=True)
class Stance(Bottom):
    """The lowest point of a recognised stance, and the time of the frame that revealed it, s."""

    told_s: float


class StanceDetector:
    """Reports each stance once, about 30, 20 or 10 ms after its lowest point at 60, 100 or 250 Hz.

    A stance is reported when the height, after rising above one threshold, is below
    another, and a parabola through the last frames has clearly turned upwards in two
    consecutive frames. Frames may be late or missing; parabolas then have fewer points.
    A height that jumps is left out unless the next one confirms it.

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
        self.geometry, self.n_left_out = geometry, 0
        self.window_s = max(WINDOW_S, WINDOW_FRAMES / rate_hz)
        self.least_step_s = 0.1 / rate_hz
        self.noise_m = geometry.noise_m / np.sqrt(
            len(geometry.body_m)
        )  # noise of a height
        self._forget()

    def _forget(self) -> None:
        """Reset, as if nothing had been seen."""
        self._frames: deque[tuple[float, float]] = deque()
        self._stray: tuple[float, float] | None = None
        self._falling: Motion | None = None
        self._armed, self._turned = False, False
        self._lowest_m, self._speed, self._last_s = np.inf, 0.0, -np.inf
        self._kept_s, self._hole_s = (
            np.inf,
            0.0,
        )  # last accepted frame; longest gap since a fall

    def feed(self, time_s: float, height_m: float) -> Stance | None:
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
        if height_m > self.geometry.flight_above_m and (slope < 0 or not self._armed):
            self._armed, self._lowest_m = True, np.inf
        self._lowest_m = min(self._lowest_m, height_m)
        if slope < 0 and self._armed:
            self._turned = False
            if slope < -SIGMAS * noise:
                self._falling, self._hole_s = (time_s, height_m, slope), 0.0
        if not self._armed or slope <= SIGMAS * noise or self._falling is None:
            return None
        turned, self._turned = self._turned, True
        return self._told((time_s, height_m, slope), bend) if turned else None

    def _taken(self, time_s: float, height_m: float) -> bool:
        """Keep a frame if it is plausible, and forget those that are too old."""
        if time_s < self._last_s - RESTART_S:
            self._forget()
        if not (np.isfinite(height_m) and time_s - self._last_s > self.least_step_s):
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
        self._hole_s, self._kept_s = max(self._hole_s, time_s - self._kept_s), time_s
        self._frames.append(frame)
        while self._frames[0][0] < time_s - self.window_s:
            self._frames.popleft()
        return True

    def _far(self, one: tuple[float, float], other: tuple[float, float]) -> bool:
        """Return whether a height is out of reach from another, or from where it was heading."""
        wait = other[0] - one[0]
        rise, reach = other[1] - one[1], FASTEST_M_S * wait
        if len(self._frames) > 2 and one == self._frames[-1]:
            rise -= self._speed * wait
            reach = min(reach, 0.5 * HARDEST_M_S2 * wait**2)
        return abs(rise) > reach + 4 * SIGMAS * self.noise_m

    def _parabola(self, time_s: float) -> tuple[float, float, float]:
        """Return speed, m/s, acceleration, m/s^2, and error of the speed at the last frame."""
        n, b, c, d, e, p, q, r = (
            0.0,
        ) * 8  # sums of s^0 to s^4, and of the heights by s^0 to s^2
        for (
            when,
            z,
        ) in self._frames:  # so few numbers that arrays take eight times as long
            s = when - time_s
            ss = s * s
            n, b, c, d, e = n + 1, b + s, c + ss, d + s * ss, e + ss * ss
            p, q, r = p + z, q + s * z, r + ss * z
        if n < 2:
            return 0.0, 0.0, np.inf
        if n < 3:
            whole = n * c - b * b
            return (n * q - b * p) / whole, np.nan, self.noise_m * np.sqrt(n / whole)
        f, g, h = (
            c * e - d * d,
            c * d - b * e,
            b * d - c * c,
        )  # cofactors of the first row
        whole = n * f + b * g + c * h
        slope = (g * p + (n * e - c * c) * q + (b * c - n * d) * r) / whole
        bend = 2 * (h * p + (b * c - n * d) * q + (n * c - b * b) * r) / whole
        return slope, bend, self.noise_m * np.sqrt((n * e - c * c) / whole)

    def _told(self, rising: Motion, bend: float) -> Stance | None:
        """Return the stance before a rise, if it was low, recent and curved enough."""
        assert self._falling is not None
        (before, _, fall), (time_s, _, slope) = self._falling, rising
        bridged, below_m = (
            bool(time_s - before > self.window_s),
            self.geometry.stance_below_m,
        )
        if bridged:
            lowest_s, _ = turning_point(self._falling, rising, below_m)
            bend = (slope - fall) / (time_s - before)
        else:
            lowest_s = time_s - slope / bend if bend > 0 else before
        # In a gap it may have been low, if there was time to fly down and up again.
        out_s, in_s = (_flown(motion, below_m)[0] for motion in (self._falling, rising))
        low = self._lowest_m < below_m or (
            self._hole_s > self.window_s and out_s < in_s
        )
        if time_s - before > TOLD_HOLE_S or not low or not bend > LEAST_BEND_M_S2:
            return None
        self._armed, self._falling = False, None
        return Stance(float(lowest_s), float(self._lowest_m), bridged, float(time_s))
