"""Stances recognised as they happen, from one height after the other."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import LEAST_BEND_M_S2

WINDOW_S = 0.055  # of frames through which a parabola is laid,
WINDOW_FRAMES = 3.5  # but at least so many
HOLE_S = 0.25  # longest hole in the frames across which a stance is still told
RESTART_S = 1.0  # a clock that goes back by more has begun anew
FASTEST_M_S, HARDEST_M_S2 = 4.0, 60.0  # beyond these a height has jumped
SIGMAS = 4.0


@dataclass(frozen=True)
class Stance:
    """A stance as it was recognised.

    Parameters
    ----------
    time_s : float
        Instant of the lowest point, between frames.
    height_m : float
        Height there; the lowest one seen if frames are missing there.
    told_s : float
        Time of the frame that told.
    bridged : bool
        Whether the lowest point fell into a hole between frames: its time is a guess then.
    """

    time_s: float
    height_m: float
    told_s: float
    bridged: bool = False


class StanceDetector:
    """Tells each stance once, some 20 ms after the lowest point at 100 Hz.

    A stance is told when the height, having been above one threshold, is below another, and a
    parabola through the last frames has turned upwards for good, in two frames in a row. Frames may
    be missing, in which case parabolas have fewer points, or late; a height that jumps away is left
    out, until a second one confirms it.

    Parameters
    ----------
    stance_below_m, flight_above_m : float
        Heights that every stance falls below, and every flight rises above.
    noise_m : float
        Standard deviation of the noise on a height.
    rate_hz : float
        Frame rate of the stream.

    Attributes
    ----------
    n_left_out : int
        Frames whose height was not known, jumped away, or whose time did not go on.
    """

    _frames: deque[tuple[float, float]]
    _stray: tuple[float, float] | None
    _falling: tuple[float, float] | None
    _armed: bool

    def __init__(
        self,
        *,
        stance_below_m: float,
        flight_above_m: float,
        noise_m: float = 0.00035,
        rate_hz: float = 100.0,
    ) -> None:
        self.stance_below_m, self.flight_above_m = stance_below_m, flight_above_m
        self.window_s = max(WINDOW_S, WINDOW_FRAMES / rate_hz)
        self.least_step_s = 0.1 / rate_hz
        self.noise_m, self.n_left_out = noise_m, 0
        self._forget()

    @classmethod
    def of(cls, geometry: HopperGeometry, *, rate_hz: float = 100.0) -> StanceDetector:
        """Return the detector for a hopper."""
        return cls(
            stance_below_m=geometry.stance_below_m,
            flight_above_m=geometry.flight_above_m,
            noise_m=geometry.noise_m / np.sqrt(len(geometry.body_m)),
            rate_hz=rate_hz,
        )

    def feed(self, time_s: float, height_m: float) -> Stance | None:
        """Take the next frame; return the stance that it tells, if any.

        Parameters
        ----------
        time_s : float
            Time of the frame, s.
        height_m : float
            Height of the mean body marker, m; NaN if it is not known.
        """
        if not self._taken(time_s, height_m):
            self.n_left_out += 1
            return None
        slope, bend, noise = self._parabola(time_s)
        self._speed = slope
        if height_m > self.flight_above_m and (slope < 0 or not self._armed):
            self._armed, self._lowest_m = True, np.inf
        self._lowest_m = min(self._lowest_m, height_m)
        if slope < 0 and self._armed:
            self._falling, self._turned = (time_s, slope), False
        if not self._armed or slope <= SIGMAS * noise or self._falling is None:
            return None
        if not self._turned:
            self._turned = True
            return None
        return self._told(time_s, slope, bend)

    def _forget(self) -> None:
        """Begin as if nothing had been seen."""
        self._frames = deque()
        self._stray = None
        self._armed, self._turned = False, False
        self._falling = None
        self._lowest_m, self._speed, self._last_s = np.inf, 0.0, -np.inf

    def _taken(self, time_s: float, height_m: float) -> bool:
        """Keep a frame if it can be believed, and forget those that are too old."""
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
            self._begin_anew(self._stray)
        self._stray = None
        self._frames.append(frame)
        while self._frames[0][0] < time_s - self.window_s:
            self._frames.popleft()
        return True

    def _far(self, one: tuple[float, float], other: tuple[float, float]) -> bool:
        """Whether a height cannot be reached from another, or from where it is heading."""
        wait = other[0] - one[0]
        rise, reach = other[1] - one[1], FASTEST_M_S * wait
        if len(self._frames) > 2 and one == self._frames[-1]:
            rise -= self._speed * wait
            reach = min(reach, 0.5 * HARDEST_M_S2 * wait**2)
        return abs(rise) > reach + 4 * SIGMAS * self.noise_m

    def _begin_anew(self, frame: tuple[float, float]) -> None:
        """Forget the heights before a jump, but not that the hopper was falling."""
        self._frames.clear()
        self._frames.append(frame)
        self._turned = False

    def _parabola(self, time_s: float) -> tuple[float, float, float]:
        """Speed, m/s, and acceleration, m/s^2, at the last frame, and the error of the speed."""
        n, b, c, d, e, p, q, r = (0.0,) * 8  # sums of s^0 to s^4, and of the heights by s^0 to s^2
        for when, z in self._frames:  # a few numbers, for which arrays take eight times as long
            s = when - time_s
            ss = s * s
            n, b, c, d, e = n + 1, b + s, c + ss, d + s * ss, e + ss * ss
            p, q, r = p + z, q + s * z, r + ss * z
        if n < 2:
            return 0.0, 0.0, np.inf
        if n < 3:
            whole = n * c - b * b
            return (n * q - b * p) / whole, np.nan, self.noise_m * np.sqrt(n / whole)
        f, g, h = c * e - d * d, c * d - b * e, b * d - c * c  # cofactors of the first row
        whole = n * f + b * g + c * h
        slope = (g * p + (n * e - c * c) * q + (b * c - n * d) * r) / whole
        bend = 2 * (h * p + (b * c - n * d) * q + (n * c - b * b) * r) / whole
        return slope, bend, self.noise_m * np.sqrt((n * e - c * c) / whole)

    def _told(self, time_s: float, slope: float, bend: float) -> Stance | None:
        """Return the stance that is behind a rise, if it was low, bent enough and not long ago."""
        assert self._falling is not None
        before, fall = self._falling
        bridged = bool(time_s - before > self.window_s)
        if bridged:  # where the speed passes zero, on a line from the fall to the rise
            lowest_s = before + (time_s - before) * fall / (fall - slope)
            bend = (slope - fall) / (time_s - before)
        else:
            lowest_s = time_s - slope / bend if bend > 0 else before
        if time_s - before > HOLE_S:
            return None
        low = self._lowest_m < self.stance_below_m or bridged
        if not low or not bend > LEAST_BEND_M_S2:
            return None
        self._armed, self._falling = False, None
        return Stance(float(lowest_s), float(self._lowest_m), float(time_s), bridged)
