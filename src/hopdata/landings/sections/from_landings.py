"""The rule `landings`: sections that nearly all landings pass as they should.

A landing of all feet has four heights of the body: at its top, at the first and at the
last contact, and at its lowest point. A pre section *holds* the landing if it lies
between the top and the first contact; a post section, if it lies between the last
contact and the lowest point. The share of the landings that a height holds is the area
between two densities, that of the heights of contact and that of the heights of
turning, each estimated with a Gaussian kernel.

Several post sections hold nearly as many landings. Which of them is taken is decided in
`hopdata.landings.sections.depth`.

The rule asks for two heights and not for a tail of frames, because a tail belongs to
whoever is in it. One fall of a second is more frames than the tail has, and moved the
post section by 28 mm; of 500 landings, it is one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.errors import AnalysisError
from hopdata.landings.contacts.descents import (
    CONTINUED_S,
    HIDDEN_S,
    LANDED,
    find_transitions,
)
from hopdata.landings.contacts.tables import contacts_of, floor_instants
from hopdata.landings.sections.densities import grid_of, kde, usual_bandwidth
from hopdata.recording import Recording

# Columns of `landing_heights`.
TOP = 0
FIRST_CONTACT = 1
LAST_CONTACT = 2
LOWEST = 3
UNTOUCHED = 4
SETTLED = 5

#: Share of the landings held by the best height that a section may lose. These are the
#: landings with the widest contacts. At 3 % the sample's post section lies 2.5 mm
#: higher.
#: Unit: 1. Origin: chosen.
MAY_LOSE = 0.02
#: Share of the fall from the top to the first contact at which the usual landing passes
#: the pre section. The body falls from rest, so a quarter of the fall is half of its
#: time: there a fit to the flight has as many frames before as after. At 0.375 the
#: sample's bound rises from 0.133 to 0.135, at 0.4 to 0.136.
#: Unit: 1. Origin: derived: half of the time is a quarter of the way of a free fall.
PRE_FALL = 0.25
#: A pre section lies below the top by at least this share of the fall from the top to
#: the first contact, since a body at its top crosses no height at a sure instant. It
#: matters where tops differ as much as falls do; at 15 % the sample's section stays.
#: Unit: 1. Origin: chosen.
BELOW_TOP = 0.1
#: A post section lies above the lowest point by at least this share of the way from the
#: last contact to it, for the same reason. A section among the lowest points made a C1
#: body "different by 22 %". At 37.5 % fewer landings are held at best, and the sample's
#: post section lies 3.4 mm higher.
#: Unit: 1. Origin: chosen.
ABOVE_LOWEST = 0.25
#: Time by which contacts keep clear of both sections: about two standard errors of a
#: contact seen at 100 Hz. At 3 ms the sample's post section lies 1.4 mm lower.
#: Unit: s. Origin: chosen.
LEAD_S = 0.002

#: Half of the time over which the speed at a section is taken: a frame at 100 Hz. A
#: body that falls freely has exactly this mean speed; after contacts, twice the time
#: reads 0.3 % less on the sample.
#: Unit: s. Origin: chosen.
HALF_SPAN_S = 0.01


def landing_heights(recording: Recording, landings: pd.DataFrame) -> FloatArray:
    """Return the body's heights in the landings of all feet: see the columns above.

    Parameters
    ----------
    recording : Recording
        Levelled, with feet and body; it may be a part of the recording with these
        landings.
    landings : pandas.DataFrame
        Landings from `hopdata.landings.contacts.find.find_landings`.

    Returns
    -------
    ndarray
        (L, 6) mean heights of the body markers, m, for the landings that the recording
        shows: at the top, at the first contact (as far down as the flight can be
        continued), at the last contact, at the lowest point, `LEAD_S` before the first
        contact, and as much after the last.
    """
    touched = floor_instants(landings)
    is_whole = (contacts_of(landings).status == LANDED) & np.isfinite(touched)
    whole = is_whole.all(axis=1)
    instant = touched[whole]
    spans = landings[["begin_s", "end_s"]].to_numpy(float)[whole]
    seen = np.isfinite(recording.body_height)
    time = recording.time[seen]
    height = recording.body_height[seen]
    return heights_at_contacts(
        time, height, spans, instant, time_scale=recording.time_scale
    )


def heights_at_contacts(
    time: FloatArray,
    height: FloatArray,
    spans: FloatArray,
    instant: FloatArray,
    *,
    time_scale: float,
) -> FloatArray:
    """Return what `landing_heights` does, (K, 6), for landings that the frames show.

    Parameters
    ----------
    time, height : (N,) array
        Frames that show the body: time, s, and mean height of the body markers, m.
    spans : (L, 2) array
        Instants of the top and the lowest point of each landing, s.
    instant : (L, n) array
        Instants of the contacts of the n feet, s.
    time_scale : float
        Time scale of the recording: see `hopdata.recording.Recording.time_scale`.
    """
    lead_s = LEAD_S * time_scale
    untouched = instant.min(axis=1) - lead_s
    first = instant.min(axis=1) + CONTINUED_S * time_scale
    last = instant.max(axis=1)
    settled = last + lead_s
    at = np.column_stack([spans[:, 0], first, last, spans[:, 1], untouched, settled])
    at = np.clip(at, spans[:, :1], spans[:, 1:])
    if len(time) < 2:
        return np.empty((0, 6))
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    # A landing may begin with the first frame that shows the body.
    gap = np.where(time[after] == at, 0.0, time[after] - time[after - 1])
    shown = (at >= time[0]) & (at <= time[-1]) & (gap <= HIDDEN_S * time_scale)
    return np.interp(at[shown.all(axis=1)], time, height)


def holds(height_m: float, heights: FloatArray, side: str) -> BoolArray:
    """Mark the landings, (L,) from (L, 6) heights, that a section holds.

    Parameters
    ----------
    height_m : float
        Height of the section, m.
    heights : (L, 6) array
        Heights of the landings from `landing_heights`, m.
    side : {"pre", "post"}
        Which section it is.
    """
    if side == "pre":
        upper = heights[:, TOP]
        lower = heights[:, FIRST_CONTACT]
    else:
        upper = heights[:, LAST_CONTACT]
        lower = heights[:, LOWEST]
    return np.asarray((lower <= height_m) & (height_m <= upper))


@dataclass(frozen=True)
class HeldHeights:
    """Heights that hold nearly as many landings as any.

    Parameters
    ----------
    pre_m : float
        Height of the pre section, m.
    shallow_m, deep_m : float
        The highest and the lowest height of a post section, m.
    bandwidth_m : float
        Bandwidth with which they were found, m.
    """

    pre_m: float
    shallow_m: float
    deep_m: float
    bandwidth_m: float


def heights_from_landings(
    heights: FloatArray, bandwidth_m: float | None = None
) -> HeldHeights:
    """Find the sections that hold nearly as many landings as any does.

    The pre section is the height that holds as many, with the fewest flights continued,
    and is nearest to the middle of the usual flight in time.

    Parameters
    ----------
    heights : (L, 6) array
        Heights of the landings from `landing_heights`, m; L >= 1.
    bandwidth_m : float, optional
        Bandwidth of the densities, m; by default the smaller one that the normal rule
        gives for the first and the last contacts.

    Returns
    -------
    HeldHeights

    Raises
    ------
    AnalysisError
        If the given bandwidth is too small for the range of the heights, or so wide
        that densities cannot tell contacts from turning points.
    """
    top, first, last, lowest, untouched, settled = heights.T
    below_top = top - BELOW_TOP * (top - first)
    above_lowest = lowest + ABOVE_LOWEST * (settled - lowest)
    if bandwidth_m is None:
        bandwidth_m = usual_bandwidth([first, last], float(np.ptp(heights)))
    else:
        _require_narrow(bandwidth_m, below_top - first, settled - above_lowest)
    before = heights_that_hold(first, below_top, bandwidth_m)
    before = most_counted(before, untouched, below_top)
    # Downwards, contacts come before turning points as they do upwards before a pre
    # section.
    after = heights_that_hold(-settled, -above_lowest, bandwidth_m)
    half_time = float(np.median(top - PRE_FALL * (top - untouched)))
    pre_m = float(np.clip(half_time, before[0], before[-1]))
    # Heights beyond a gap hold other landings: those that touch where most stand.
    beyond_gap = np.flatnonzero(np.diff(after) > bandwidth_m)
    deepest = len(after) - 1
    if len(beyond_gap) > 0:
        deepest = int(beyond_gap[0])
    return HeldHeights(pre_m, float(-after[0]), float(-after[deepest]), bandwidth_m)


def fall_speed(
    recording: Recording, landings: pd.DataFrame, height_m: float
) -> FloatArray:
    """Return how fast each landing falls past a height, (L,), m/s; NaN if it does not.

    Parameters
    ----------
    recording : Recording
        Levelled.
    landings : pandas.DataFrame
        Its landings.
    height_m : float
        Height of a section, m.
    """
    half_s = HALF_SPAN_S * recording.time_scale
    seen = np.isfinite(recording.body_height)
    time = recording.time[seen]
    height = recording.body_height[seen]
    spans = landings[["begin_s", "end_s"]].to_numpy(float)
    below = np.nextafter(height_m, -np.inf)
    passed = find_transitions(
        time, height, pre_height_m=height_m, post_height_m=below, spans=spans
    )
    at = passed.t_post
    before = np.interp(at - half_s, time, height)
    after = np.interp(at + half_s, time, height)
    return np.asarray((before - after) / (2.0 * half_s))


def _require_narrow(
    bandwidth_m: float, before_m: FloatArray, after_m: FloatArray
) -> None:
    """Refuse a bandwidth beyond the usual way from contact to turning point, m.

    The ways of each landing are (L,), before its contacts and after them.
    """
    widest_m = min(float(np.median(before_m)), float(np.median(after_m)))
    if bandwidth_m > widest_m:
        way = "the way of the body between its contacts and its turning points"
        expected = f"at most {widest_m:.2g} m, {way}"
        raise AnalysisError.at("sections.bandwidth_m", expected, f"{bandwidth_m:g} m")


def heights_that_hold(
    contact: FloatArray, turn: FloatArray, bandwidth_m: float
) -> FloatArray:
    """Return the heights that hold nearly as many landings as the best one, in order.

    They lose at most `MAY_LOSE` of the landings by the densities, and no more by their
    count: of few landings, the tail of a density is easily one, which need not be lost.

    Parameters
    ----------
    contact, turn : (L,) array
        Height of each landing from which on a section holds it, and height up to which,
        m. A landing whose turn comes before its contact is held nowhere.
    bandwidth_m : float
        Bandwidth of the densities of both, m.

    Raises
    ------
    AnalysisError
        If the bandwidth is too small for the range of the heights.
    """
    turn = np.maximum(contact, turn)
    grid = grid_of(np.concatenate([contact, turn]), bandwidth_m)
    begun = np.cumsum(kde(contact, bandwidth=bandwidth_m, grid=grid))
    ended = np.cumsum(kde(turn, bandwidth=bandwidth_m, grid=grid))
    share = (begun - ended) * (grid[1] - grid[0])
    dense = grid[share >= (1.0 - MAY_LOSE) * share.max()]
    return most_counted(dense, contact, turn)


def most_counted(
    heights_m: FloatArray, contact: FloatArray, turn: FloatArray
) -> FloatArray:
    """Return the heights of (H,) that hold nearly as many landings as any, counted."""
    possible = contact <= turn
    begun = np.searchsorted(np.sort(contact[possible]), heights_m, side="right")
    ended = np.searchsorted(np.sort(turn[possible]), heights_m, side="left")
    held = begun - ended
    may_lose = int(MAY_LOSE * len(contact))
    return heights_m[held >= held.max() - may_lose]
