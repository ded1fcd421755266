"""Landings that a section holds: a foot is down from the instant of its contact on.

A pre section holds a landing that begins above it and has its first contact below it, or so little
above it that the flight can be continued; a post section one with all contacts above it that goes
on below it. Heights of feet say only roughly where that is: a heel or a sole that gives may lie
within its threshold long before or after its contact.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.landings.contacts.descents import CONTINUED_S, HIDDEN_S, LANDED
from hopdata.landings.contacts.find import contacts_of
from hopdata.recording import Recording

#: Landings that a section may lose for each frame that it may have on its wrong side, both as
#: shares; and the share that the height may lose to which it gives way if it loses more.
LOST_PER_TAIL, LEFT_LOSS = 150.0, 0.015
_INSIDE_M = 1e-3  # of the heights that hold as many, where there is room
#: Columns of `landing_heights` that bound a section: contact and turning point of the body.
_BOUNDS = {"pre": (1, 0, 1.0), "post": (2, 3, -1.0)}


def landing_heights(recording: Recording, landings: pd.DataFrame) -> FloatArray:
    """Heights of the body in the landings of all feet: apex, first and last contact, nadir.

    Parameters
    ----------
    recording : Recording
        Levelled, with feet and body; it may be a part of that whose landings these are.
    landings : pandas.DataFrame
        As from `hopdata.landings.contacts.find.find_landings`.

    Returns
    -------
    ndarray
        (L, 4) mean heights of the body markers, m, of the landings that the recording shows; that
        of the first contact is as low as the flight can be continued from it.
    """
    contacts = contacts_of(landings)
    whole = (contacts.status == LANDED).all(axis=1) & np.isfinite(contacts.instant).all(axis=1)
    instant, spans = contacts.instant[whole], landings[["begin_s", "end_s"]].to_numpy(float)[whole]
    ends = np.column_stack([instant.min(axis=1) + CONTINUED_S, instant.max(axis=1)])
    ends = np.clip(ends, spans[:, :1], spans[:, 1:])
    at = np.insert(spans, 1, ends.T, axis=1)
    seen = np.isfinite(recording.body_height)
    time, height = recording.time[seen], recording.body_height[seen]
    if len(time) < 2:
        return np.empty((0, 4))
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    shown = (at >= time[0]) & (at <= time[-1]) & (time[after] - time[after - 1] <= HIDDEN_S)
    return np.interp(at[shown.all(axis=1)], time, height)


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
