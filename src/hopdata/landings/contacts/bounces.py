"""Feet that stand higher at first than at rest: they bounce off, or sink on.

A rigid foot that leaves the floor again by some millimetres, within frames of its
contact, raises the floor of the fit, so that its contacts are early: by half a
millisecond to three in feet that rise by 1 to 15 mm. So does a foot that loses part of
its speed at its contact and then sinks on for tens of milliseconds. No frame tells a
bounce from noise, or from sinking; the mean over landings does.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from hopdata.arrays import SD_PER_MAD, BoolArray, FloatArray, IntArray

#: Time after a contact in which a foot is down: the lowest of these frames say where.
#: Unit: s. Origin: chosen.
RESTS_S = 0.15

#: Time after a contact in which a bounce counts: that of the frames that are fitted.
#: Unit: s. Origin: derived: `passes.LONG_WINDOWS_S`.
BOUNCES_S = 0.05

#: Time after a contact in which a soft foot still sinks; it does not count.
#: Unit: s. Origin: derived: three times a compliance of 5 ms.
SINKS_S = 0.015

#: Share of the frames after a contact in which the foot is lower than at rest.
#: Unit: 1. Origin: chosen.
LOWEST = 0.1

#: Fewest frames after a contact that say where the foot rests.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 8

#: Height by which feet must stand higher, in standard errors of its mean.
#: Unit: standard errors. Origin: convention: two sigmas.
CLEARLY = 2.0

#: Common error, in times in which a foot falls by that height.
#: Unit: 1. Origin: measured: feet that bounce by 1 to 15 mm at 100 and 200 Hz
#: (`tests/landings/contacts/test_bounces.py`).
HIDES = 2.0

#: Length of the spans after a contact over which heights are averaged, to see whether
#: the foot rises; of slow recordings, a frame.
#: Unit: s. Origin: chosen: a foot that bounces by 1 mm is in the air for six of them.
SPAN_S = 0.005

#: Height by which feet must rise, and come down again, in standard errors of its mean.
#: Unit: standard errors. Origin: chosen: above `CLEARLY`, since many spans are tried.
RISES_CLEARLY = 3.0


def bounce_errors(
    time: FloatArray,
    heights: FloatArray,
    instant: FloatArray,
    velocity: FloatArray,
    noise_m: float,
) -> FloatArray:
    """Return the error (n,), s, that contacts share because their feet bounce.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    instant, velocity : (L, n) array
        Contacts, s, and the velocities just before them, m/s.
    noise_m : float
        Standard deviation of a height, m.
    """
    higher_m = bounces(time, heights, instant, noise_m)
    errors = np.zeros(heights.shape[1])
    for foot in np.flatnonzero(higher_m):
        is_fitted = np.isfinite(instant[:, foot])
        fall_m_s = np.median(np.abs(velocity[is_fitted, foot]))
        errors[foot] = HIDES * higher_m[foot] / fall_m_s
    return errors


def bounces(
    time: FloatArray, heights: FloatArray, instant: FloatArray, noise_m: float
) -> FloatArray:
    """Return by how much feet are higher right after contacts than at rest, (n,), m.

    It is 0 for a foot that is not clearly higher. See `bounce_errors`.
    """
    higher = np.zeros(heights.shape[1])
    for foot in range(heights.shape[1]):
        is_fitted = np.isfinite(instant[:, foot])
        at = instant[is_fitted, foot]
        higher_m = _higher_at_first(time, heights[:, foot], at, noise_m)
        known_m = higher_m[np.isfinite(higher_m)]
        if not len(known_m):
            continue
        usual_m = float(np.median(known_m))
        if usual_m > CLEARLY * noise_m / np.sqrt(len(known_m)):
            higher[foot] = usual_m
    return higher


def rises(
    time: FloatArray, heights: FloatArray, instant: FloatArray, noise_m: float
) -> BoolArray:
    """Tell which feet rise from the floor after contacts and come down again, (n,).

    A foot that bounces is higher than at its contact in the mean over landings. One
    that sinks on to its rest never is, even if it wavers there; one that dips and comes
    back stays up.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    instant : (L, n) array
        Contacts, s; NaN for none.
    noise_m : float
        Standard deviation of a height, m.
    """
    span_s = max(SPAN_S, float(np.median(np.diff(time))))
    since_s = np.arange(0.0, RESTS_S + span_s / 2, span_s)
    n_tops = int((since_s < BOUNCES_S).sum())
    found = np.zeros(heights.shape[1], dtype=bool)
    for foot, height in enumerate(heights.T):
        at = instant[np.isfinite(instant[:, foot]), foot]
        by_span = _by_span(time, height, at, since_s)
        found[foot] = _rises_and_falls(by_span, n_tops, noise_m)
    return found


def _by_span(
    time: FloatArray, height: FloatArray, instant: FloatArray, since_s: FloatArray
) -> FloatArray:
    """Return mean heights (L, spans), m, between times since contacts (spans + 1,)."""
    edges = np.searchsorted(time, instant[:, None] + since_s)
    seen = np.isfinite(height)
    count = np.concatenate([[0], np.cumsum(seen)])
    total = np.concatenate([[0.0], np.cumsum(np.where(seen, height, 0.0))])
    n_seen = np.diff(count[edges], axis=1)
    sums = np.diff(total[edges], axis=1)
    means = np.full(n_seen.shape, np.nan)
    np.divide(sums, n_seen, out=means, where=n_seen > 0)
    return means


def _rises_and_falls(heights: FloatArray, n_tops: int, noise_m: float) -> bool:
    """Tell whether feet are higher than in the first span, and than in a later one.

    `heights` (L, spans), m; of the spans, `n_tops` are tried.
    """
    n_spans = heights.shape[1]
    for top in range(1, n_tops):
        above = heights[:, [top]] - heights
        if not _is_positive(above[:, 0], noise_m):
            continue
        if any(_is_positive(above[:, k], noise_m) for k in range(top + 1, n_spans)):
            return True
    return False


def _is_positive(differences: FloatArray, noise_m: float) -> bool:
    """Tell whether differences of two heights, m, are positive in the mean."""
    known = differences[np.isfinite(differences)]
    if not len(known):
        return False
    usual_m = float(np.median(known))
    scatter_m = SD_PER_MAD * float(np.median(np.abs(known - usual_m)))
    error_m = max(scatter_m, np.sqrt(2) * noise_m) / np.sqrt(len(known))
    return usual_m > RISES_CLEARLY * error_m


def _higher_at_first(
    time: FloatArray, height: FloatArray, instant: FloatArray, noise_m: float
) -> FloatArray:
    """Return how much higher a foot is after contacts (L,) than at rest, m."""
    first = np.searchsorted(time, instant)
    stop = np.searchsorted(time, instant + RESTS_S)
    frames = first[:, None] + np.arange(int(np.max(stop - first, initial=1)))
    inside = frames < stop[:, None]
    frames = np.minimum(frames, len(time) - 1)
    z = np.where(inside, height[frames], np.nan)
    seen = np.isfinite(z)
    since = time[frames] - instant[:, None]
    is_early = seen & (since >= SINKS_S) & (since < BOUNCES_S)
    n_early = is_early.sum(axis=1)
    early = np.where(is_early, z, 0.0).sum(axis=1) / np.maximum(n_early, 1)
    # Frames that are not seen are put last.
    n_seen = seen.sum(axis=1)
    place = (LOWEST * n_seen).astype(np.int64)
    lowest = np.take_along_axis(np.sort(z, axis=1), place[:, None], axis=1)[:, 0]
    higher = early - (lowest + noise_m * _below_the_mean(place, n_seen))
    return np.where((n_seen >= LEAST_FRAMES) & (n_early > 1), higher, np.nan)


def _below_the_mean(place: IntArray, count: IntArray) -> FloatArray:
    """Return how far below their mean the values at places in order lie, in sigmas.

    `place` and `count` (L,) are the place, from 0, and the number of normal values;
    Blom's approximation.
    """
    share = (place + 0.625) / (count + 0.25)
    which = np.unique(np.minimum(share, 0.5), return_inverse=True)
    quantiles = [-NormalDist().inv_cdf(one) for one in which[0].tolist()]
    return np.array(quantiles)[which[1]]
