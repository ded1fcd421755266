"""Landings between which the body hardly rises, or in which it hardly falls.

A body that did not sink far after a landing rises by little before the next one, and
one that is caught early falls by little. A swing so small may also be a shudder; that
every foot comes down from its own apex tells the two apart.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts import descents
from hopdata.landings.contacts.steps import Steps

Falls = list[tuple[int, int]]  # frames of apex and nadir


def with_shallow_falls(
    time: FloatArray,
    heights: FloatArray,
    body: FloatArray,
    falls: Falls,
    steps: Steps,
) -> Falls:
    """Return the descents of the body with those that its feet tell.

    A descent that holds several of them is divided where the later ones begin.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    body : (N,) array
        Height of the body, m; NaN where unseen.
    falls : list of tuple of int
        Frames of apex and nadir of the descents found so far, in order of time.
    steps : Steps
        Descents of the feet.
    """
    shallow = descents.shallow_descents(body, time, longest=descents.HIDDEN_S)
    if not shallow:
        return falls
    spans = time[np.array(shallow, dtype=np.int64)]
    lands = _all_feet_come_down(time, heights, steps, spans)
    landings = [fall for fall, does in zip(shallow, lands, strict=True) if does]
    held = _held_by(falls, landings)
    begins: list[list[int]] = [[] for _ in falls]
    found: Falls = []
    for row, landing in zip(held.tolist(), landings, strict=True):
        if row < 0:
            found.append(landing)
        else:
            begins[row].append(landing[0])
    for fall, its in zip(falls, begins, strict=True):
        found += _divided(body, fall, its[1:])
    return sorted(found)


def _held_by(falls: Falls, landings: Falls) -> IntArray:
    """Return which of the descents each landing (L,) lies in; -1 for none."""
    apexes, nadirs = np.array(falls, dtype=np.int64).reshape(-1, 2).T
    begins = np.array([begin for begin, _ in landings], dtype=np.int64)
    row = np.searchsorted(apexes, begins, side="right") - 1
    return np.where(np.append(nadirs, -1)[row] > begins, row, -1)


def _divided(body: FloatArray, fall: tuple[int, int], at: list[int]) -> Falls:
    """Divide a descent where others begin; each part ends where the body is lowest."""
    apex, nadir = fall
    parts: Falls = []
    for begin in at:
        parts.append((apex, apex + int(np.nanargmin(body[apex:begin]))))
        apex = begin
    parts.append((apex, nadir))
    return parts


def _all_feet_come_down(
    time: FloatArray, heights: FloatArray, steps: Steps, spans: FloatArray
) -> BoolArray:
    """Tell in which spans (L, 2), s, every foot comes down, (L,).

    Of a foot that is hidden nothing is known; one must be seen to come down.
    """
    n_feet = heights.shape[1]
    comes_down = np.zeros((len(spans), n_feet), dtype=bool)
    is_hidden = np.zeros((len(spans), n_feet), dtype=bool)
    for foot in range(n_feet):
        own = steps.foot == foot
        first = np.searchsorted(spans[:, 0], steps.half_way[own], side="right") - 1
        is_within = (first >= 0) & (steps.down[own] <= spans[first, 1])
        comes_down[first[is_within], foot] = True
        seen = time[np.isfinite(heights[:, foot])]
        is_hidden[:, foot] = descents.longest_gaps(seen, spans) > descents.HIDDEN_S
    is_known_of_all = (comes_down | is_hidden).all(axis=1)
    return np.asarray(is_known_of_all & comes_down.any(axis=1))
