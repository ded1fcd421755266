"""Landings that a section holds: a foot is down from the instant of its contact on.

A pre section holds a landing that begins above it and has its first contact below it, a post
section one with all contacts above it that goes on below it. Heights of feet say only roughly where
that is: a heel or a sole that gives may lie within its threshold long before or after its contact.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.contacts import descents as contact_search
from hopdata.landings.contacts.find import SHORT_WINDOWS_S, find_contacts
from hopdata.landings.sections.frames import descents
from hopdata.recording import Recording

#: Landings that a section may lose for each frame that it may have on its wrong side, both as
#: shares; and the share that the height may lose to which it gives way if it loses more.
LOST_PER_TAIL, LEFT_LOSS = 150.0, 0.015
_INSIDE_M = 1e-3  # of the heights that hold as many, where there is room
_DOWN_SHARE = 0.15  # of the median descent: a foot that stays higher has not landed
#: Columns of `landing_heights` that bound a section: contact and turning point of the body.
_BOUNDS = {"pre": (1, 0, 1.0), "post": (2, 3, -1.0)}


def landing_heights(recording: Recording, *, closely: bool) -> FloatArray:
    """Heights of the body in the landings of all feet: apex, first and last contact, nadir.

    Parameters
    ----------
    recording : Recording
        Levelled, with feet and body.
    closely : bool
        By kinks, or only roughly by heights: within some frames of the contact, but at once.

    Returns
    -------
    ndarray
        (L, 4) mean heights of the body markers, m.
    """
    time, body, feet = recording.time, recording.body_height, recording.feet[:, :, 2]
    apex, nadir = np.array(descents(body), dtype=np.int64).reshape(-1, 2).T
    if len(apex) == 0:
        return np.empty((0, 4))
    gap = np.full(len(apex), np.median(np.diff(time)))
    falls = contact_search.Transitions(time[apex], time[nadir], gap, gap)
    noise_m = contact_search.height_noise(feet)
    down_m = max(_DOWN_SHARE * float(np.median(body[apex] - body[nadir])), 4.0 * noise_m)
    if closely:
        found = find_contacts(time, feet, falls, down_height_m=down_m)
        instant, status = found.instant, found.status
    else:
        lead_s, trail_s = SHORT_WINDOWS_S
        instant, status = contact_search.approaches(
            time, feet, falls, noise_m=noise_m, down_height_m=down_m, lead_s=lead_s, trail_s=trail_s
        )
    whole = (status == contact_search.LANDED).all(axis=1) & np.isfinite(instant).all(axis=1)
    apex, nadir, instant = apex[whole], nadir[whole], instant[whole]
    ends = np.clip([instant.min(axis=1), instant.max(axis=1)], time[apex], time[nadir])
    seen = np.isfinite(body)
    return np.column_stack([body[apex], np.interp(ends, time[seen], body[seen]).T, body[nadir]])


def holds(height_m: float, landings: FloatArray, side: str) -> BoolArray:
    """Say which landings (L, 4) a section of this height, m, holds, (L,): `side` is pre or post."""
    contact, turn, sign = _BOUNDS[side]
    reached = sign * landings[:, contact] <= sign * height_m
    return np.asarray(reached & (sign * height_m <= sign * landings[:, turn]))


def nearest_holding(height_m: float, landings: FloatArray, side: str) -> float:
    """Return the height, m, nearest to this one that loses few landings (L, 4), or the fewest."""
    contact, turn, _ = _BOUNDS[side]
    edges = np.unique(landings[:, [contact, turn]])
    middles = 0.5 * (edges[1:] + edges[:-1])
    losses = np.array([1.0 - np.mean(holds(middle, landings, side)) for middle in middles])
    few = losses <= max(losses.min(initial=1.0), LEFT_LOSS)
    margin = np.minimum(0.5 * (edges[1:] - edges[:-1]), _INSIDE_M)[few]
    inside = np.clip(height_m, edges[:-1][few] + margin, edges[1:][few] - margin)
    return float(inside[np.argmin(np.abs(inside - height_m))]) if few.any() else height_m
