"""Whether frames follow each other as they should, and when they were captured on our own clock."""

from __future__ import annotations

import math
from typing import Literal

Verdict = Literal["next", "restart", "outdated", "implausible"]

SLACK = 0.05  # of the time between two frames: a frame rate may differ by so much from the one told
MOST_IN_A_ROW = 10  # frames out of place, after which it is the rate, or the last, that is wrong
RECENT = 100  # frames; one by so much behind the last or less may have been held up on its way
CREEP = 2e-4  # by which two clocks may drift apart; quartz clocks keep to 1e-4


class Timeline:
    """Judges the numbers and times of frames of one connection.

    A frame is plausible if its number and its time have grown, by as much as the frame rate says.
    If one is not, something in it is damaged, or the camera system has begun anew: that is so when
    the next frame follows on this one. If that never is so, the frame rate is another than was
    told, and only the order counts from then on. A frame that the last one follows on, or that is
    the last one, is outdated: it comes late or twice; several of these in a row that follow each
    other are no new time, unless they do not end.
    """

    def __init__(self, rate_hz: float | None) -> None:
        self._period_s = None if rate_hz is None else 1 / rate_hz
        self._last: tuple[int, float] | None = None
        self._suspect: tuple[int, float] | None = None
        self._in_a_row = 0  # implausible or outdated ones
        self.missing = 0  # frames left out just before the last good one

    def judge(self, number: int, time_s: float) -> Verdict:
        """Return whether a frame follows on the last, begins a new time, or is to be left out."""
        new = (number, time_s)
        verdict: Verdict = "implausible"
        if self._last is None or self._follows(self._last, new):
            verdict = "next"
        elif self._is_outdated(self._last, new) and self._in_a_row < MOST_IN_A_ROW:
            verdict = "outdated"
        elif self._suspect is not None and self._follows(self._suspect, new):
            verdict = "restart"
        if verdict in ("outdated", "implausible"):
            self._suspect, self._in_a_row = new, self._in_a_row + 1
            if verdict == "implausible" and self._in_a_row == MOST_IN_A_ROW:
                self._period_s = None
            return verdict
        before = self._last if verdict == "next" else self._suspect
        self.missing = 0 if before is None else number - before[0] - 1
        self._last, self._suspect, self._in_a_row = new, None, 0
        return verdict

    def _is_outdated(self, last: tuple[int, float], new: tuple[int, float]) -> bool:
        return new == last or (last[0] - new[0] <= RECENT and self._follows(new, last))

    def _follows(self, old: tuple[int, float], new: tuple[int, float]) -> bool:
        frames, span = new[0] - old[0], new[1] - old[1]
        if frames < 1 or span <= 0:
            return False
        if self._period_s is None:
            return True
        expected = frames * self._period_s
        return abs(span - expected) <= max(0.5 * self._period_s, SLACK * expected)


class CameraClock:
    """Puts camera times on our monotonic clock, by the shortest delay seen lately.

    A frame that was held up on its way so keeps the time at which it was captured, and looks as old
    as it is. The delay that is always there cannot be seen and is not counted.
    """

    def __init__(self) -> None:
        self._offset_s, self._last_s = math.inf, math.inf

    def captured(self, time_s: float, arrival_s: float) -> float:
        """Return when a frame was captured, s, given its camera time and its arrival."""
        crept = self._offset_s + CREEP * max(0.0, arrival_s - self._last_s)
        self._offset_s = min(crept, arrival_s - time_s)
        self._last_s = arrival_s
        return time_s + self._offset_s
