"""Feet that are timed while they still glide above the floor.

A heel that swings forward in a walk stops falling some centimetres up, glides, and
comes down a tenth of a second later. The kink of its height is where the glide begins.
A foot that has landed yields within some hundredths of a second, and then stands.
"""

from __future__ import annotations

import warnings

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.landings.contacts import joined
from hopdata.recording import Recording

#: Time in which soles and legs have yielded after a contact, of an animal of 1 m.
#: Unit: s. Origin: chosen: runners' shoes take 0.02 to 0.03.
YIELDED_S = 0.04

#: Time after a contact by which a foot that glides has come down, of an animal of 1 m.
#: Unit: s. Origin: chosen.
DOWN_S = 0.25

#: Height by which a foot sinks after it has yielded, from which on it has glided, for
#: an animal of 1 m.
#: Unit: m. Origin: measured: 240 of 241 contacts of three runners sink by at most
#: 0.003 (one, timed 20 mm above the floor, by 0.0052), and 927 of the simulated hopper
#: by 0.0022; heels of a walk that were timed 0.11 s before their force plates sink by
#: 0.006 and 0.009. At 1.5 times this the first is missed.
SINKS_M = 0.005


def glides(recording: Recording, landings: pd.DataFrame) -> BoolArray:
    """Mark the contacts (L, n) after which a foot sinks by more than it yields.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    landings : DataFrame
        Its landings, as `find_landings` returns them.
    """
    feet = recording.names("foot")
    marked = np.zeros((len(landings), len(feet)), dtype=bool)
    for number, markers in enumerate(joined.parts_of_feet(recording)):
        lowest = _lowest(recording.positions[:, markers, 2])
        for row, instant in enumerate(landings[f"contact_{feet[number]}_s"]):
            if not np.isfinite(instant):
                continue
            sinks_m = _sinks(recording.time, lowest, instant, recording.pace)
            marked[row, number] = sinks_m > SINKS_M * recording.scale
    return marked


def _lowest(heights: FloatArray) -> FloatArray:
    """Return the height (N,) of the lowest of a foot's markers (N, p), m."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without any
        return np.asarray(np.nanmin(heights, axis=1))


def _sinks(time: FloatArray, heights: FloatArray, instant: float, pace: float) -> float:
    """Return by how much a foot sinks after it has yielded, m; 0 if it is not seen.

    It is how far it comes below where it has been by then: a foot that bounces has been
    on the floor.
    """
    ends = np.array([0.0, YIELDED_S, DOWN_S]) * pace
    begin, yielded, end = np.searchsorted(time, instant + ends)
    before = heights[begin:yielded]
    after = heights[yielded:end]
    if not (np.isfinite(before).any() and np.isfinite(after).any()):
        return 0.0
    return float(np.nanmin(before) - np.nanmin(after))
