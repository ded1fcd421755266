"""Feet that sink after their contacts and spring back, as on a sole that yields.

Such a foot stops, dips by a millimetre and is back at its rest within a tenth of a
second. The law of stance has no word for it: it takes the dip for a soft contact that
rises afterwards, which is early, or overlooks it, which is late. Which of the two
cannot be told, so both are stated.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import SD_PER_MAD, FloatArray

#: Times after a contact between which a foot may be lowest, one span after the other.
#: Unit: s. Origin: chosen: a dip that turns after 5 to 40 ms is deepest in one of them.
LOW_S = ((0.0, 0.006), (0.003, 0.01), (0.01, 0.025), (0.025, 0.045))

#: Times after a contact between which it is back at its rest.
#: Unit: s. Origin: chosen: a runner's foot stands as long.
BACK_S = (0.07, 0.15)

#: Fewest frames in the latter.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 3

#: Depth by which feet must have sunk, in standard errors of its mean over landings.
#: Unit: standard errors. Origin: chosen: three, and more since four spans are tried.
CLEARLY = 3.5

#: A dip makes a law at most as soft as the foot falls by it in this share of the time.
#: Unit: 1. Origin: measured: hard feet that dip (benchmarks/springy_soles.py).
SOFTENED = 4.0


def springs_back_errors(
    depth_m: FloatArray, fall_m_s: FloatArray, compliance_s: FloatArray
) -> FloatArray:
    """Return the error (n,), s, that contacts share because their feet spring back.

    If the foot stops at once and then dips, the compliance of the law is not its own,
    and contacts are early by it. If it falls straight through and then springs back,
    they are late by the time in which it falls by the depth.

    Parameters
    ----------
    depth_m : (n,) array
        Depths of `springs_back`, m.
    fall_m_s : (n,) array
        Speed at which each foot comes down, m/s.
    compliance_s : (n,) array
        Compliance to which the instants belong, s.
    """
    falls_s = depth_m / fall_m_s
    early_s = np.minimum(compliance_s, SOFTENED * falls_s)
    return np.asarray(np.hypot(early_s, falls_s))


def springs_back(
    time: FloatArray, heights: FloatArray, instant: FloatArray, noise_m: float
) -> FloatArray:
    """Return how deep feet sink after contacts and come back from, (n,), m.

    It is 0 for a foot that does not clearly do so.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet above their rest, m; NaN where unseen.
    instant : (L, n) array
        Contacts, s; NaN for none.
    noise_m : float
        Standard deviation of a height, m.
    """
    depth = np.zeros(heights.shape[1])
    for foot, height in enumerate(heights.T):
        at = instant[np.isfinite(instant[:, foot]), foot]
        if not len(at):
            continue
        back_m, n_back = _mean_within(time, height, at, BACK_S)
        # A foot that leaves the floor again has come back to its rest before.
        back_m = np.minimum(np.where(n_back >= LEAST_FRAMES, back_m, np.nan), 0.0)
        for span_s in LOW_S:
            low_m, n_low = _mean_within(time, height, at, span_s)
            known = np.isfinite(back_m - low_m)
            if not known.any():
                continue
            sunk_m = (back_m - low_m)[known]
            usual_m = float(np.median(sunk_m))
            scatter_m = SD_PER_MAD * float(np.median(np.abs(sunk_m - usual_m)))
            least_m = noise_m / np.sqrt(float(np.median(n_low[known])))
            error_m = max(scatter_m, least_m) / np.sqrt(len(sunk_m))
            if usual_m > CLEARLY * error_m:
                depth[foot] = max(depth[foot], usual_m)
    return depth


def _mean_within(
    time: FloatArray,
    height: FloatArray,
    instant: FloatArray,
    span_s: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return the mean height (L,) in a span after contacts, m, and its frames (L,)."""
    first = np.searchsorted(time, instant + span_s[0])
    stop = np.searchsorted(time, instant + span_s[1])
    seen = np.isfinite(height)
    count = np.concatenate([[0], np.cumsum(seen)])
    total = np.concatenate([[0.0], np.cumsum(np.where(seen, height, 0.0))])
    n_seen = (count[stop] - count[first]).astype(float)
    sums = total[stop] - total[first]
    mean = np.divide(sums, n_seen, out=np.full(len(instant), np.nan), where=n_seen > 0)
    return mean, n_seen
