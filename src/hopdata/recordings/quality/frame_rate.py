"""Guess the frame rate from free fall, which seems faster at a higher rate."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, FloatArray
from hopdata.messages import Message
from hopdata.recordings.axes import along
from hopdata.recordings.quality import free_fall as falling
from hopdata.recordings.quality.free_fall import (
    LEAST_SHARE,
    UNITS_IN_M,
    FreeFall,
    accelerations,
    free_fall,
)
from hopdata.recordings.quality.guess import Guess
from hopdata.recordings.raw import RawRecording

# Rates of usual cameras, Hz.
RATES_HZ = (25, 30, 50, 60, 100, 120, 150, 200, 240, 250, 300, 400, 500, 1000)

# Ratios of usual rates to one that is mistaken for them.
OTHER_RATES = (0.5, 1 / 1.2, 1.2, 2.0)

#: Least difference of the rate of the time stamps from the stated one.
#: Unit: 1. Origin: chosen.
OTHER_RATE = 0.02

#: Share of steps of the time stamps that go on; if fewer do, they have too few digits.
#: Unit: 1. Origin: chosen.
ONWARD = 0.9

#: Least acceleration downwards of a body that leaves the ground, at the right rate.
#: Unit: g. Origin: chosen.
LEAST_PULL = 0.7

#: Largest acceleration downwards of a body that leaves the ground, at the right rate.
#: Unit: g. Origin: chosen.
LARGEST_PULL = 1.3

#: Share of the time in which the acceleration downwards exceeds the one measured.
#: Unit: 1. Origin: chosen.
PULL_EXCEEDED = 0.02

#: Ratio of the frames in free fall at another rate to those at the stated rate, above
#: which the other is likelier, if the markers fall as they should at the stated rate.
#: Unit: 1. Origin: derived: as between directions.
CLEARER_THAN_CONFIRMED = falling.CLEARER

#: The same if they do not.
#: Unit: 1. Origin: chosen.
CLEARER_THAN_STATED = 2.0


#: Share of the frames in free fall in which most markers fall at once, from which on
#: they are those of flights. Swinging legs fall one at a time, at a wrong rate.
#: Unit: 1. Origin: chosen. With 1.5 times as much half the rate of one made-up drop in
#: six is no longer noticed; with two thirds nothing changes.
TOGETHER = 0.25

#: Share of the markers that fall at some time, from which on the whole body flies. At
#: twice the rate it is up to 0.71 in made-up walkers.
#: Unit: 1. Origin: derived: as for markers that fall at once.
NEARLY_ALL = falling.ALL_AT_ONCE


def guess_rate(
    raw: RawRecording, unit: str, *, up: str = "z", is_stated: bool = True
) -> Guess:
    """Guess the frame rate, Hz.

    Parameters
    ----------
    raw : RawRecording
        As read, at the stated rate, or at any rate if none is stated.
    unit : str
        Unit of the positions, one of `UNITS_IN_M`.
    up : str
        Direction that points up, one of `axes.DIRECTIONS`.
    is_stated : bool
        Whether the file states its rate.
    """
    units = {unit: UNITS_IN_M[unit]}
    if not is_stated:
        return _by_fall_alone(raw, units)
    stated = f"{raw.rate_hz:g}"
    by_stamps = rate_by_stamps(raw)
    if by_stamps != raw.rate_hz:
        why = Message("recordings.rate_but_stamps", {"rate_hz": by_stamps})
        other = f"{by_stamps:g}"
        return Guess(stated, why, is_sure=False, other=other, evidence=(why,))

    pull = _pull_down(raw, up, units[unit])
    fall = free_fall(raw.positions, raw.rate_hz, units=units)
    is_pulled = LEAST_PULL <= pull <= LARGEST_PULL
    is_fall = fall.is_rather_clear and fall.up == up
    falls_as_stated = is_fall and (
        is_pulled or _has_flights(fall) or _all_fall_at_this_rate(raw, units, fall)
    )
    clearer = CLEARER_THAN_CONFIRMED if falls_as_stated else CLEARER_THAN_STATED
    another_falls = _another_rate_falls(raw, units, up, clearer * fall.share)
    if falls_as_stated and not another_falls:
        why = Message("recordings.rate_confirmed")
        return Guess(stated, why, evidence=_with_stamps(raw, why))
    if not another_falls and not pull > LARGEST_PULL:
        code = "recordings.rate_stated"
        if raw.has_stamps:
            code = "recordings.rate_stated_and_stamps"
        why = Message(code)
        return Guess(stated, why, evidence=(why,))
    doubted = _doubted(raw, units, pull, fall)
    return replace(doubted, evidence=_with_stamps(raw, doubted.why))


def _with_stamps(raw: RawRecording, by_fall: Message) -> tuple[Message, ...]:
    """Return what free fall says of the rate, and the time stamps if there are any."""
    if not raw.has_stamps:
        return (by_fall,)
    return Message("recordings.rate_of_own_stamps"), by_fall


def _by_fall_alone(raw: RawRecording, units: Mapping[str, float]) -> Guess:
    """Guess a rate that is not stated: the usual one at which most frames are falls."""
    (best, share), (following, _) = _usual_rates_by_fall(raw, units)
    if share < LEAST_SHARE:
        nothing = Message("recordings.rate_nothing_falls")
        return Guess("", nothing, is_sure=False, other=following)
    why = Message("recordings.rate_by_fall", {"percent": 100 * share, "rate": best})
    return Guess(best, why, is_sure=False, other=following)


def _doubted(
    raw: RawRecording, units: Mapping[str, float], pull: float, fall: FreeFall
) -> Guess:
    """Return the stated rate with a likelier one."""
    stated = f"{raw.rate_hz:g}"
    pulls_too_much = pull > LARGEST_PULL
    if pulls_too_much:
        why = Message("recordings.rate_pulls_too_much", {"pull": pull})
        other_hz = raw.rate_hz / 2
    else:
        why = Message("recordings.rate_falls_less", {"percent": 100 * fall.share})
        other_hz = 2 * raw.rate_hz
    (best, share), (_, next_share) = _usual_rates_by_fall(raw, units)
    is_clear = not share < max(LEAST_SHARE, falling.CLEARER * next_share)
    if best == stated or not is_clear:
        best = f"{other_hz:g}"
    return Guess(stated, why, is_sure=False, other=best)


def _has_flights(fall: FreeFall) -> bool:
    """Tell whether markers fall all at once, as in flights, and not one by one."""
    return fall.together >= TOGETHER * fall.share > 0


def _all_fall_at_this_rate(
    raw: RawRecording, units: Mapping[str, float], fall: FreeFall
) -> bool:
    """Tell whether nearly all markers fall at some time, less so at lower rates.

    A body that draws in its legs in flight is pulled down by more than g, and its
    markers need not fall all at once. That a lower rate were true needs more free fall
    there.
    """
    if not fall.spread >= NEARLY_ALL:
        return False
    for factor in OTHER_RATES:
        if factor < 1:
            lower = free_fall(raw.positions, factor * raw.rate_hz, units=units)
            if lower.share > fall.share:
                return False
    return True


def _another_rate_falls(
    raw: RawRecording, units: Mapping[str, float], up: str, share: float
) -> bool:
    """Tell whether, at another rate, markers fall freely in more than this share.

    They must fall along the vertical axis, and most of them at once: at twice the true
    rate a swinging leg also seems to fall. At a wrong rate, `up` may have been taken
    for down.
    """
    for factor in OTHER_RATES:
        fall = free_fall(raw.positions, factor * raw.rate_hz, units=units)
        is_vertical = fall.up[-1] == up[-1]
        falls_more = fall.is_rather_clear and fall.share > share
        if falls_more and is_vertical and _has_flights(fall):
            return True
    return False


def _usual_rates_by_fall(
    raw: RawRecording, units: Mapping[str, float]
) -> list[tuple[str, float]]:
    """Return the two usual rates, Hz, with most free fall, and its shares."""
    shares = []
    for rate_hz in RATES_HZ:
        fall = free_fall(raw.positions, rate_hz, units=units)
        shares.append((f"{rate_hz:g}", fall.share))
    return sorted(shares, key=lambda found: -found[1])[:2]


def _pull_down(raw: RawRecording, up: str, metres: float) -> float:
    """Return the acceleration against `up` of the median marker, in g.

    It is exceeded in 2 % of the time. A body that is not pulled down does not exceed 1,
    and one that leaves the ground comes near it. The result is a quarter of that if the
    stated rate is half the true one, and four times as much if it is twice the true
    one. Legs are swung down faster, so if the result is too large, the quarter of the
    markers with the least acceleration decides.
    """
    upward = along(accelerations(raw.positions, raw.rate_hz, metres=metres), up)
    seen = upward[np.isfinite(upward).any(axis=1)]
    if not len(seen):
        return np.nan

    def exceeded(acceleration: FloatArray) -> float:
        usual = np.quantile(acceleration, PULL_EXCEEDED)
        return float(-usual * metres / GRAVITY_M_S2)

    of_median = exceeded(np.nanmedian(seen, axis=1))
    if not of_median > LARGEST_PULL:
        return of_median
    last = np.isfinite(seen).sum(axis=1, keepdims=True) - 1
    three_quarters = -(-3 * last // 4)
    quarter = np.take_along_axis(np.sort(seen, axis=1), three_quarters, axis=1)
    return exceeded(quarter)


def rate_by_stamps(raw: RawRecording) -> float:
    """Return the rate of the time stamps, Hz, if it clearly differs from the stated.

    Otherwise return the stated one.
    """
    steps = np.diff(raw.time)
    if not len(steps):
        return raw.rate_hz
    step_s = float(np.median(steps))
    has_enough_digits = np.count_nonzero(steps > 0) > ONWARD * len(steps)
    if has_enough_digits and abs(step_s * raw.rate_hz - 1) > OTHER_RATE:
        return float(f"{1 / step_s:.4g}")
    return raw.rate_hz
