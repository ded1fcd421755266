"""A floor that moves: the deck of a treadmill or ship, or one under sinking cameras."""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.landings.floor_rests import RestPoints, thinned
from hopdata.landings.floor_surface import (
    along,
    design,
    own_axis,
    polynomial_terms,
    robust_regression,
)
from hopdata.landings.sections.modes import robust_rms
from hopdata.messages import Message

#: A foot's rest gives one point for each span of this length.
#: Unit: s. Origin: chosen.
SPAN_S = 0.3

#: A rest shorter than this may be in the air. A longer limit missed a floor that sank
#: by 41 mm under quick hoppers.
#: Unit: s. Origin: measured: quick hoppers on a sinking floor.
REST_S = 0.04

#: Fewest rests per foot: two jumps on a soft sole prove nothing.
#: Unit: rests. Origin: chosen.
LEAST_RESTS = 10

#: Smallest range of a moving floor.
#: Unit: m. Origin: chosen.
LEAST_MOVE_M = 0.005

#: Largest distance from the floor at which a rest follows it: a box is higher.
#: Unit: m. Origin: chosen.
FOLLOWED_M = 0.15

#: Distance from the mode, in ranges of nine in ten rests, of a foot in the air.
#: Unit: ranges. Origin: chosen.
SELDOM = 5.0

#: Quantile of the motion beyond which disagreement between feet is judged, since feet
#: that roll alike differ there.
#: Unit: 1. Origin: chosen.
FAR = 0.9

#: Smallest ratio of the motion to the disagreement of feet that rest in succession:
#: chance gives 3.5, a hand that lifts slowly 8, a moving deck 50.
#: Unit: 1. Origin: measured: moved_floors.csv.
MOVE_PER_APART = 12.0

#: Quantiles between which a motion's range is taken: nine in ten rests.
#: Unit: 1. Origin: chosen.
RANGE_QUANTILES = (0.95, 0.05)

#: Relative singular value below which feet stay in place and show no slope.
#: Unit: 1. Origin: chosen.
STAYS = 0.01

#: Evenly sampled rests from which a slope of the floor is found.
#: Unit: rests. Origin: chosen.
MOST_OF_PLANE = 20_000

#: Smallest turn of the floor between the halves that is reported.
#: Unit: degrees. Origin: chosen.
TURNED_DEG = 0.3

#: Factor by which residuals must grow if a turn is ignored.
#: Unit: 1. Origin: chosen.
TURN_SHOWS = 1.3


def floor_motion(rest: RestPoints) -> tuple[FloatArray, FloatArray]:
    """Find how a floor moves, from feet at rest that rise and fall together.

    Return instants (W,), s, and the height of the floor at each, (W,), m, beyond what a
    floor of degree 2 and the mount heights explain. Both are a single 0 if nine in ten
    rests are within 5 mm of each other, or if the feet disagree.
    """
    still = (np.zeros(1), np.zeros(1))
    n_feet = len(rest.start_m)
    is_followed = np.abs(rest.above_mode) <= FOLLOWED_M * rest.scale
    rest = rest.take(is_followed & ~rest.let_go)
    steps = rest
    if len(rest.foot):
        steps = _settled(rest)
    if n_feet < 2 or min(len(steps.foot), rest.n_steps) < LEAST_RESTS * n_feet:
        return still
    least_m = LEAST_MOVE_M * rest.scale
    # Rare rests farther off than this are in the air.
    usual_m = max(SELDOM * _range(steps.above_mode), least_m)
    steps = steps.take(np.abs(steps.above_mode) <= usual_m)
    if len(steps.foot) < LEAST_RESTS * n_feet:
        return still

    height = steps.points[:, 2]
    columns = _mounts_and_bends(steps, degree=2)
    fit = np.linalg.lstsq(columns, height, rcond=STAYS)[0]
    # Differences of feet that rest in succession cancel the floor's motion.
    other_foot = np.diff(steps.foot) != 0
    columns_apart = np.diff(columns, axis=0)[other_foot]
    height_apart = np.diff(height)[other_foot]
    fit_apart = np.linalg.lstsq(columns_apart, height_apart, rcond=STAYS)[0]
    apart = np.abs(height_apart - columns_apart @ fit_apart)

    lines = np.stack([steps.time, height - columns @ fit, height - columns @ fit_apart])
    window = max(n_feet, 3)
    around = np.lib.stride_tricks.sliding_window_view(lines, window, axis=1)
    when, beyond_place, moved = np.median(around, axis=2)

    motion_then = np.interp(steps.time[1:][other_foot], when, moved)
    by_motion = np.argsort(np.abs(motion_then - np.median(moved)))
    farthest = by_motion[int(FAR * len(by_motion)) :]
    disagreement = max(np.median(apart), np.median(apart[farthest]))
    is_large = _range(beyond_place) > least_m
    feet_agree = _range(moved) > MOVE_PER_APART * disagreement
    if not (is_large and feet_agree):
        return still
    level = np.median(steps.above_mode - np.interp(steps.time, when, moved))
    return when, moved + level


def _mounts_and_bends(rest: RestPoints, *, degree: int) -> FloatArray:
    """Return columns for the mount of each foot and for a floor without its level."""
    mounts = np.eye(len(rest.start_m))[rest.foot]
    place = _in_own_axes(rest.points[:, :2])
    bends = design(place, polynomial_terms(degree))[:, 1:]
    return np.hstack([mounts, bends])


def _settled(rest: RestPoints) -> RestPoints:
    """Return one point for each foot and span in which it rests, in order of time.

    The first of several spans is left out, because a soft sole settles in it. Each
    point is a lower quartile, because a foot in the air is above the floor.
    """
    span_s = SPAN_S * np.sqrt(rest.scale)
    least_s = REST_S * np.sqrt(rest.scale)
    other_foot = np.diff(rest.foot, prepend=-1) != 0
    begins = other_foot | (np.diff(rest.time, prepend=0) > span_s)
    number = np.cumsum(begins)  # of the rest that each point belongs to, from 1
    begin_s = rest.time[begins][number - 1]
    span = ((rest.time - begin_s) / span_s).astype(int)
    order = np.lexsort((rest.points[:, 2], span, number))
    is_new_rest = np.diff(number[order], prepend=0)
    is_new_span = np.diff(span[order], prepend=0)
    first = np.flatnonzero(is_new_rest | is_new_span)
    count = np.diff(first, append=len(order))
    frame_s = np.diff(np.unique(rest.time[:1000])).min(initial=np.inf)
    is_long = count >= least_s / frame_s
    goes_on = np.append(np.diff(number[order[first]]) == 0, False)
    settles = (span[order[first]] == 0) & goes_on
    lower_quartile = first + count // 4
    lower = rest.take(order[lower_quartile[is_long & ~settles]])
    return lower.take(in_order(lower))


def in_order(rest: RestPoints) -> IntArray:
    """Return the order of the points in time.

    Within one instant heights decide, not numbers of feet.
    """
    return np.lexsort((rest.points[:, 2], rest.time))


def _in_own_axes(places: FloatArray) -> FloatArray:
    """Return places (P, 2) about their mean, in own axes, with the farthest at 1."""
    around = along(places - places.mean(axis=0), own_axis(places))
    return np.asarray(around / np.hypot(around[:, 0], around[:, 1]).max())


def _range(moved_m: FloatArray) -> float:
    return float(np.subtract(*np.quantile(moved_m, RANGE_QUANTILES)))


def motion_messages(moved_m: FloatArray) -> list[Message]:
    """Report how far a floor moves, by `floor_motion`; nothing if it does not."""
    if len(moved_m) < 2:
        return []
    return [Message("landings.floor_moves", {"range_mm": 1e3 * _range(moved_m)})]


def turn_messages(rest: RestPoints) -> list[Message]:
    """Report if the floor is tilted in the second half of a recording."""
    rest = thinned(rest, MOST_OF_PLANE)
    n_feet = len(rest.start_m)
    if len(np.unique(rest.foot)) < 2 or rest.n_steps < LEAST_RESTS * n_feet:
        return []
    is_late = (rest.time > np.median(rest.time))[:, None]
    around = rest.points[:, :2] - rest.points[:, :2].mean(axis=0)
    height = rest.points[:, 2]
    still = np.hstack([_mounts_and_bends(rest, degree=3), is_late])
    turning = np.hstack([still, is_late * around])
    fit_still = robust_regression(still, height)
    fit_turning = robust_regression(turning, height)
    rms_still = robust_rms(height - still @ fit_still)
    rms_turning = robust_rms(height - turning @ fit_turning)
    turned_deg = np.rad2deg(np.hypot(*fit_turning[-2:]))
    if turned_deg < TURNED_DEG or rms_still < TURN_SHOWS * rms_turning:
        return []
    return [Message("landings.floor_turns", {"degrees": float(turned_deg)})]
